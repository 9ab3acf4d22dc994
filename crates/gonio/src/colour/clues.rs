//! Colours of a photograph in a few numbers.

use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;

use super::chroma::{Chroma, luminance_of};
use super::parts::highlight_share;
use crate::appearance::Lattice;
use crate::lighting::LightGrid;
use crate::reflectance::BivariateTable;
use crate::shape::SurfacePoint;
use crate::sphere::fibonacci_hemisphere;

/// Number of chromas in [`Clues`].
pub const CLUES: usize = 7;

/// Smoothing widths (standard deviations in degrees) that bound fine and coarse detail.
const DETAIL: [(f64, f64); 2] = [(2.5, 5.0), (10.0, 20.0)];

/// Cosine of the largest angle to the view in the centre.
const CENTRE: f64 = 0.8;

/// Shares of the highlight that are subtracted from the mean and the median, relative to
/// [`highlight_share`](super::highlight_share).
const TAKEN: [f64; 2] = [0.6, 0.4];

/// Largest share of the highlight that is subtracted.
const LARGEST_SHARE: f64 = 0.8;

/// Chromas of a photograph on the [`Lattice`].
#[derive(Clone, Debug, PartialEq)]
pub struct Clues {
    /// Chromas, in order: the mean; the median of each channel; the mean of the centre, within 37
    /// degrees of the view; fine detail (2.5 to 5 degrees) and coarse detail (10 to 20), by
    /// regression of the channels on their luminance; the mean and the median with a share of the
    /// fine detail's colour subtracted.
    pub chromas: [Chroma; CLUES],
    /// Share of the highlight in the luminance BRDF, zero to one.
    pub share: f64,
}

/// Filters on a [`Lattice`]; 22 MB.
#[derive(Clone, Debug)]
pub struct ClueFinder {
    lattice: Lattice,
    /// `[scale][normal * count + other]`.
    details: Vec<Vec<f32>>,
}

impl Default for ClueFinder {
    fn default() -> Self {
        Self::new()
    }
}

impl ClueFinder {
    /// Builds the filters.
    pub fn new() -> Self {
        let lattice = Lattice::new();
        let normals = lattice.normals();
        let detail = |(narrow, wide): (f64, f64)| -> Vec<f32> {
            let row = |n: &DVec3| {
                let smooth = |width: f64| -> Vec<f64> {
                    let variance = width.to_radians().powi(2);
                    let weights: Vec<f64> =
                        normals.iter().map(|m| (-0.5 * (*m - *n).length_squared() / variance).exp()).collect();
                    let total: f64 = weights.iter().sum();
                    weights.into_iter().map(|w| w / total).collect()
                };
                smooth(narrow).into_iter().zip(smooth(wide)).map(|(a, b)| (a - b) as f32).collect::<Vec<f32>>()
            };
            normals.par_iter().flat_map_iter(row).collect()
        };
        let details = DETAIL.map(detail).into();
        Self { lattice, details }
    }

    /// Computes the clues of the colours of points, those of a material whose luminance is `table`.
    pub fn read(&self, points: &[SurfacePoint], colours: &[Option<Vec3>], table: &BivariateTable) -> Clues {
        self.of(&self.lattice.gather_colours(points, colours), highlight_share(table))
    }

    /// Computes the clues of an image, given as a linear RGB value for each normal of the lattice,
    /// of a material whose highlight has this [share](highlight_share).
    ///
    /// # Panics
    /// If the image does not have as many values as the lattice has normals.
    fn of(&self, image: &[Vec3], share: f64) -> Clues {
        let count = self.lattice.normals().len();
        assert_eq!(image.len(), count);
        let mean = image.iter().map(|c| c.as_dvec3()).sum::<DVec3>() / count as f64;
        let median = DVec3::from_array([0, 1, 2].map(|c| {
            let mut values: Vec<f32> = image.iter().map(|p| p[c]).collect();
            f64::from(*values.select_nth_unstable_by(count / 2, f32::total_cmp).1)
        }));
        let centre =
            image.iter().zip(self.lattice.normals()).filter(|(_, n)| n.z > CENTRE).map(|(c, _)| c.as_dvec3()).sum();
        let [fine, coarse] = [0, 1].map(|scale| self.slope(&self.details[scale], image, mean));
        let unmixed = |colour: DVec3, taken: f64| {
            let taken = taken * share.clamp(0.0, LARGEST_SHARE);
            Chroma::of((colour / luminance_of(colour).max(1e-300) - taken * fine.rgb()).max(DVec3::ZERO))
        };
        let [of_mean, of_median] = TAKEN;
        Clues {
            chromas: [
                Chroma::of(mean),
                Chroma::of(median),
                Chroma::of(centre),
                fine,
                coarse,
                unmixed(mean, of_mean),
                unmixed(median, of_median),
            ],
            share,
        }
    }

    /// Chroma of the detail: that of the slope of each channel over the luminance. An image without
    /// detail has the chroma of its mean.
    fn slope(&self, filter: &[f32], image: &[Vec3], mean: DVec3) -> Chroma {
        let detail: Vec<DVec3> = filter
            .par_chunks(image.len())
            .map(|row| row.iter().zip(image).map(|(w, c)| *w * *c).sum::<Vec3>().as_dvec3())
            .collect();
        let (mut sum, mut square) = (DVec3::ZERO, 0.0);
        for d in detail {
            let y = luminance_of(d);
            sum += y * d;
            square += y * y;
        }
        // Rounding errors of 32-bit sums are not detail.
        if square > image.len() as f64 * (1e-5 * luminance_of(mean)).powi(2) {
            Chroma::of((sum / square).max(DVec3::ZERO))
        } else {
            Chroma::of(mean)
        }
    }
}

/// Whether every colour has three equal channels, up to rounding.
pub(crate) fn is_grey<'a>(colours: impl IntoIterator<Item = &'a Vec3>) -> bool {
    colours.into_iter().all(|c| c.max_element() - c.min_element() <= 1e-5 * c.max_element().abs())
}

/// Chroma of light as a white matte ball shows it to a camera that looks along -z of the frame that
/// `camera` turns to: that of the mean of its radiance over the visible normals. This is the colour
/// of the light in [`ColourModel`](super::ColourModel).
pub fn white_chroma(light: &LightGrid, camera: DQuat) -> Chroma {
    let normals: Vec<DVec3> = fibonacci_hemisphere(500).map(|n| camera * n).collect();
    let mut sum = DVec3::ZERO;
    for (texel, radiance) in light.texels().iter().enumerate() {
        let (u, v) = LightGrid::centre_of(light.side(), texel);
        let direction = light.map().direction(u, v);
        let seen: f64 = normals.iter().map(|n| n.dot(direction).max(0.0)).sum();
        sum += light.map().density(u, v) * seen * radiance.as_dvec3();
    }
    Chroma::of(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::OctahedralMap;
    use crate::testing::on_threads;

    fn image(body: Vec3, highlight: Vec3) -> Vec<Vec3> {
        let lamp = DVec3::new(0.3, 0.4, 0.8).normalize();
        let value = |n: &DVec3| {
            let spot = 6.0 * (-(n.angle_between(lamp) / 0.06).powi(2)).exp();
            body * (0.6 + 0.4 * n.y as f32) + highlight * spot as f32
        };
        Lattice::new().normals().iter().map(value).collect()
    }

    #[test]
    fn detail_has_the_colour_of_the_highlight_and_the_median_that_of_the_body() {
        let finder = ClueFinder::new();
        let (body, highlight) = (Vec3::new(0.6, 0.2, 0.1), Vec3::new(1.0, 0.9, 0.8));
        let clues = finder.of(&image(body, highlight), 0.1);
        let chroma = |c: Vec3| Chroma::of(c.as_dvec3());
        assert!(clues.chromas[3].distance(chroma(highlight)) < 0.05, "{clues:?}");
        assert!(clues.chromas[1].distance(chroma(body)) < 0.1, "{clues:?}");
        // Subtracting the highlight brings the mean nearer to the body.
        let distance = |clue: usize| clues.chromas[clue].distance(chroma(body));
        assert!(distance(5) < distance(0), "{clues:?}");
    }

    #[test]
    fn the_light_adds_to_all_and_brightness_to_none() {
        let finder = ClueFinder::new();
        let plain = image(Vec3::new(0.6, 0.3, 0.2), Vec3::ONE);
        let light = Vec3::new(1.3, 1.0, 0.7);
        let lit: Vec<Vec3> = plain.iter().map(|c| 40.0 * light * *c).collect();
        let shift = Chroma::of(light.as_dvec3()).0;
        let (a, b) = (finder.of(&plain, 0.0), finder.of(&lit, 0.0));
        // The slopes are taken over another luminance, so they differ a little.
        for (clue, (a, b)) in a.chromas.iter().zip(&b.chromas).enumerate() {
            let moved = Chroma([a.0[0] + shift[0], a.0[1] + shift[1]]);
            assert!(moved.distance(*b) < 0.02, "{clue}: {moved:?} {b:?}");
        }
    }

    #[test]
    fn clues_do_not_depend_on_threads() {
        let picture = image(Vec3::new(0.6, 0.2, 0.1), Vec3::ONE);
        let run = || ClueFinder::new().of(&picture, 0.2);
        assert_eq!(on_threads(1, run), on_threads(3, run));
    }

    #[test]
    fn a_smooth_image_has_one_colour() {
        let finder = ClueFinder::new();
        let flat = vec![Vec3::new(0.5, 0.25, 0.25); Lattice::new().normals().len()];
        let clues = finder.of(&flat, 0.3);
        assert!(clues.chromas.iter().all(|c| c.distance(clues.chromas[0]) < 1e-6), "{clues:?}");
        assert!(!is_grey(&flat));
        assert!(is_grey(&[Vec3::splat(0.3), Vec3::ZERO]));
    }

    #[test]
    fn a_ball_shows_the_light_before_it() {
        let side = 16;
        let map = OctahedralMap::EqualArea;
        let texel = |i: usize| {
            let (u, v) =
                ((2 * (i % side) + 1) as f64 / side as f64 - 1.0, 1.0 - (2 * (i / side) + 1) as f64 / side as f64);
            if map.direction(u, v).z > 0.0 { Vec3::new(2.0, 1.0, 1.0) } else { Vec3::new(1.0, 1.0, 2.0) }
        };
        let light = LightGrid::from_texels(map, side, (0..side * side).map(texel).collect());
        let (front, back) =
            (white_chroma(&light, DQuat::IDENTITY), white_chroma(&light, DQuat::from_rotation_y(std::f64::consts::PI)));
        assert!(front.0[0] > 0.4 && front.0[1] < 0.3, "{front:?}");
        // Texels on the equator belong to one half only.
        assert!((front.0[0] - back.0[1]).abs() < 0.1, "{front:?} {back:?}");
    }
}
