//! Effects between a scene and its photograph: camera, texture, shadows, and imperfectly known
//! shapes.
//!
//! Each effect has its own strength; zero disables it. The effects act on the disk of normals, on
//! which images of all shapes have the same format.

use rand::{Rng, RngExt};
use rand_distr::{Distribution, Poisson};

use super::fields::{between, bilinear, blurred, field, gauss, log_between, quantile, slopes};
use super::figure::MultiPartObject;
use super::scene::Scene;
use crate::appearance::disk::{self, DISK_SIDE, DiskImage, on_disk};
use crate::appearance::{Sample, scatter};
use crate::statistics::median;

/// Standard deviation of the logarithm of the ratio between the albedos of paint and object.
const PAINT: f32 = 0.7;

/// Range of the values of undetected hot pixels, relative to the mean of the picture.
const HOT: (f32, f32) = (1.2, 20.0);

/// Strengths of all effects on one photograph; zero disables an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotographEffects {
    /// Radius in pixels of a ball with as many pixels as the object. Photographs 100 to 1,000
    /// pixels across are common.
    pub radius: f32,
    /// Standard deviation of the logarithm of the number of pixels per normal: zero for a ball, one
    /// or more for a figure with flat parts.
    pub uneven: f32,
    /// Share of the normals without pixels: the side facing a pedestal, holes in a scan, the
    /// cropped part of a picture.
    pub missing: f32,
    /// Noise independent of brightness, relative to the mean of the picture: read noise, at most a
    /// few percent in the dark parts of one exposure (EMVA 1288).
    pub read: f32,
    /// Shot noise of a pixel of mean brightness, relative to the mean of the picture. It grows with
    /// the square root of the brightness (EMVA 1288).
    pub shot: f32,
    /// Number of levels between black and the largest value: 2^8 for 8 bits, zero for floats.
    pub levels: f32,
    /// Share of the pixels that are clipped.
    pub clipped: f32,
    /// Standard deviation of the lens's blur, in cells of the disk.
    pub blur: f32,
    /// Share of the light that the lens scatters over the whole picture: veiling glare, one to five
    /// percent for ordinary lenses (ISO 9358).
    pub glare: f32,
    /// Relative standard deviation of the albedo from pixel to pixel: grain, flakes, weave. The
    /// project's three photographed objects have 6 to 23 %.
    pub speckle: f32,
    /// Standard deviation of the logarithm of the albedo between regions: stains, wear.
    pub stains: f32,
    /// Share of the light that unmodelled shadows remove from the darkest parts of a figure, 0..=1.
    pub shadow: f32,
    /// Interreflected light in a figure, relative to the mean of the picture.
    pub bounce: f32,
    /// Share of the pixels that show another material.
    pub other_material: f32,
    /// Share of the pixels with paint of another albedo, with sharp edges.
    pub painted: f32,
    /// Share of the normals hidden by an object in front, with a straight edge.
    pub occluded: f32,
    /// Share of the pixels that are hot or dead.
    pub defective: f32,
    /// Error of the normals from pixel to pixel, in radians: the noise of a scan.
    pub rough_normals: f32,
    /// Error of the normals over regions, in radians: from a scan that is smoothed or shifted by a
    /// pixel relative to the picture.
    pub wrong_normals: f32,
    /// Error of the radius and the centre of the outline, relative to the radius.
    pub outline: f32,
    /// Whether pixels with the same normal come from several places on the object, which differ in
    /// albedo, shadow and interreflected light.
    pub figure: bool,
}

impl PhotographEffects {
    /// A photograph without effects, of a ball 128 pixels across.
    pub const CLEAN: Self = Self {
        radius: 64.0,
        uneven: 0.0,
        missing: 0.0,
        read: 0.0,
        shot: 0.0,
        levels: 0.0,
        clipped: 0.0,
        blur: 0.0,
        glare: 0.0,
        speckle: 0.0,
        stains: 0.0,
        shadow: 0.0,
        bounce: 0.0,
        other_material: 0.0,
        painted: 0.0,
        occluded: 0.0,
        defective: 0.0,
        rough_normals: 0.0,
        wrong_normals: 0.0,
        outline: 0.0,
        figure: false,
    };

    /// Draws a camera, an object and its shape at random.
    ///
    /// One quarter of the photographs are renderings, clean except for weak noise and, in some,
    /// unevenly spread normals. In the others, each effect occurs with its own probability.
    pub fn draw(rng: &mut impl Rng) -> Self {
        let clean = rng.random_range(0.0..1.0) < 0.25;
        let radius = log_between(rng, 40.0, 600.0);
        // The normals of a mesh or a list are not spread as evenly as a ball's pixels.
        let scattered = if rng.random_range(0.0..1.0) < 0.4 { between(rng, 0.01, 0.6) } else { 0.0 };
        if clean {
            return Self { radius, uneven: scattered, read: between(rng, 0.0, 0.01), ..Self::CLEAN };
        }
        let mut maybe = |share: f64, value: &dyn Fn(&mut _) -> f32| {
            if rng.random_range(0.0..1.0) < share { value(&mut *rng) } else { 0.0 }
        };
        let figure = maybe(0.6, &|_| 1.0) > 0.0;
        Self {
            radius: if figure { maybe(1.0, &|r| log_between(r, 60.0, 400.0)) } else { radius },
            uneven: if figure { maybe(1.0, &|r| between(r, 0.0, 1.2)) } else { scattered },
            missing: maybe(0.3, &|r| log_between(r, 0.01, 0.4)),
            read: maybe(0.7, &|r| log_between(r, 5e-4, 0.03)),
            shot: maybe(0.7, &|r| log_between(r, 1e-3, 0.05)),
            levels: maybe(0.4, &|r| [256.0, 256.0, 1024.0, 4096.0][r.random_range(0..4)]),
            clipped: maybe(0.15, &|r| log_between(r, 5e-4, 0.05)),
            blur: maybe(0.5, &|r| log_between(r, 0.2, 2.0)),
            glare: maybe(0.4, &|r| log_between(r, 0.002, 0.05)),
            speckle: maybe(0.7, &|r| log_between(r, 0.003, 0.35)),
            stains: maybe(0.5, &|r| log_between(r, 0.01, 0.3)),
            shadow: if figure { maybe(0.7, &|r| between(r, 0.0, 0.8)) } else { 0.0 },
            bounce: if figure { maybe(0.6, &|r| log_between(r, 0.005, 0.15)) } else { 0.0 },
            other_material: maybe(0.12, &|r| log_between(r, 0.003, 0.12)),
            painted: maybe(0.1, &|r| log_between(r, 0.02, 0.5)),
            occluded: maybe(0.05, &|r| between(r, 0.1, 0.5)),
            defective: maybe(0.1, &|r| log_between(r, 1e-4, 3e-3)),
            rough_normals: maybe(0.4, &|r| log_between(r, 0.003, 0.08)),
            wrong_normals: maybe(0.4, &|r| log_between(r, 0.003, 0.05)),
            outline: maybe(0.4, &|r| log_between(r, 0.002, 0.03)),
            figure,
        }
    }

    /// Simulates the photograph of a scene; `other` is the scene of another material in the same
    /// light.
    pub fn photograph(&self, scene: &Scene, other: &Scene, rng: &mut impl Rng) -> DiskImage {
        let mut scene = scene.clone();
        self.cover(&mut scene, other, rng);
        if self.wrong_normals > 0.0 || self.outline > 0.0 {
            let places = self.displaced(rng);
            scene = Scene { values: shifted(&scene.values, &places), details: shifted(&scene.details, &places) };
        }
        let Scene { values: mut image, mut details } = scene;
        // Normals that vary within a cell make its pixels differ by the slope of the image.
        let slope = if self.rough_normals > 0.0 { slopes(&image) } else { Vec::new() };
        let rough = self.rough_normals * 0.5 * DISK_SIDE as f32;
        let mean = self.blur_and_glare(&mut image, &mut details, rough);
        let figure = self.figure.then(|| MultiPartObject::draw(self, rng));
        let among = match &figure {
            Some(figure) => figure.show(&mut image, &mut details, mean),
            None => {
                self.stain(&mut image, &mut details, rng);
                Vec::new()
            }
        };
        let clip = if self.clipped > 0.0 { quantile(&image, 1.0 - self.clipped) } else { f32::INFINITY };
        let (counts, fine) = self.counts(figure.as_ref(), rng);
        let top = image.iter().copied().fold(0.0, f32::max).min(clip);
        let step = if self.levels > 0.0 { top / self.levels } else { 0.0 };
        let image = OpticalImage { values: image, details, slope, among, mean, rough, step };
        let (values, kept, found) = self.expose(&image, &counts, clip, rng);
        let reported_noise = if fine { self.estimated_scatter(&image, rng) } else { scatter_of_cells(&values, &kept) };
        DiskImage::of_cells(values, kept, found, reported_noise)
    }

    /// Covers parts of a scene with another material and with paint.
    fn cover(&self, scene: &mut Scene, other: &Scene, rng: &mut impl Rng) {
        if self.other_material > 0.0 {
            let patches = field(6, rng);
            let edge = quantile(&patches, 1.0 - self.other_material);
            for cell in (0..DISK_SIDE * DISK_SIDE).filter(|&c| patches[c] > edge) {
                (scene.values[cell], scene.details[cell]) = (other.values[cell], other.details[cell]);
            }
        }
        if self.painted > 0.0 {
            let regions = field(8, rng);
            let edge = quantile(&regions, 1.0 - self.painted);
            let albedo = (PAINT * gauss(rng)).exp();
            for cell in (0..DISK_SIDE * DISK_SIDE).filter(|&c| regions[c] > edge) {
                scene.values[cell] *= albedo;
                scene.details[cell] *= albedo;
            }
        }
    }

    /// Applies the blur of the lens and of normals that vary over `rough` cells, and the glare.
    ///
    /// Returns the mean of the image.
    fn blur_and_glare(&self, image: &mut Vec<f32>, details: &mut [f32], rough: f32) -> f32 {
        let width = self.blur.hypot(rough);
        if width > 0.15 {
            *image = blurred(image, width);
        }
        // Details have wavelengths of about 1.7 cells; the Fourier transform of the blur damps
        // them.
        let kept_detail = (-7.0 * width * width).exp() * (1.0 - self.glare);
        details.iter_mut().for_each(|d| *d *= kept_detail);
        let mean = disk::mean(image);
        if self.glare > 0.0 {
            image.iter_mut().for_each(|v| *v = (1.0 - self.glare) * *v + self.glare * mean);
        }
        mean
    }

    /// Returns the noisy values of the cells, their numbers of pixels, and their details if each
    /// quarter of the cell contains a pixel.
    ///
    /// Cells without pixels and cells above `clip` have no pixels in the result.
    fn expose(
        &self,
        image: &OpticalImage,
        counts: &[f32],
        clip: f32,
        rng: &mut impl Rng,
    ) -> (Vec<f32>, Vec<f32>, Vec<Option<f32>>) {
        let (mean, step) = (image.mean, image.step);
        let mut values = vec![0.0; DISK_SIDE * DISK_SIDE];
        let mut kept = vec![0.0; DISK_SIDE * DISK_SIDE];
        let mut found = vec![None; DISK_SIDE * DISK_SIDE];
        for cell in (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c) && counts[c] > 0.0) {
            let (value, count) = (image.values[cell], counts[cell]);
            if value > clip {
                continue;
            }
            let tilt = image.tilt(cell);
            let variance = (self.speckle * value).powi(2)
                + self.shot.powi(2) * mean * value
                + (self.read * mean).powi(2)
                + tilt * tilt
                + step * step / 12.0
                + image.variance_among(cell);
            let error = (variance / count).sqrt();
            let mut noisy = value + gauss(rng) * error;
            // With this probability, one of the pixels of the cell is defective.
            if self.defective > 0.0 && between(rng, 0.0, 1.0) < self.defective * count.max(1.0) {
                let reading = if between(rng, 0.0, 1.0) < 0.5 { 0.0 } else { mean * log_between(rng, HOT.0, HOT.1) };
                noisy += (reading - value) / count.max(1.0);
            }
            // Rounding is visible where few pixels are averaged.
            let rounded = if step > 0.0 && count < 3.0 { (noisy / step).round() * step } else { noisy };
            values[cell] = rounded.max(0.0);
            kept[cell] = count;
            // The four quarters, each with a fourth of the pixels, have three independent
            // differences. Each difference has the same standard error as the mean of the cell.
            if self.quarters_seen(count, rng) {
                let [a, b, c] = [image.details[cell], 0.0, 0.0].map(|d| d + gauss(rng) * error);
                found[cell] = Some((a * a + b * b + c * c).sqrt());
            }
        }
        (values, kept, found)
    }

    /// Draws whether each quarter of a cell contains a pixel. The pixels are spread evenly or, if
    /// `uneven` is positive, at random.
    fn quarters_seen(&self, count: f32, rng: &mut impl Rng) -> bool {
        let share = if self.uneven > 0.0 { (1.0 - (-0.25 * count).exp()).powi(4) } else { (count - 3.0) / 3.0 };
        share >= 1.0 || (share > 0.0 && between(rng, 0.0, 1.0) < share)
    }

    /// Applies the stains of an object that has each normal at one place only.
    fn stain(&self, image: &mut [f32], details: &mut [f32], rng: &mut impl Rng) {
        if self.stains > 0.0 {
            let (coarse, fine) = (field(6, rng), field(16, rng));
            let each = image.iter_mut().zip(&mut *details).zip(coarse.iter().zip(&fine));
            each.for_each(|((v, d), (a, b))| {
                let albedo = (self.stains * (0.8 * a + 0.6 * b)).exp();
                (*v, *d) = (*v * albedo, *d * albedo);
            });
        }
    }

    /// Returns the number of pixels of each cell, and whether cells have enough pixels (three) for
    /// an estimate of their scatter.
    fn counts(&self, figure: Option<&MultiPartObject>, rng: &mut impl Rng) -> (Vec<f32>, bool) {
        let each = (self.radius / (0.5 * DISK_SIDE as f32)).powi(2);
        let mut counts = vec![each; DISK_SIDE * DISK_SIDE];
        if let Some(figure) = figure {
            counts.iter_mut().zip(figure.densities()).for_each(|(c, d)| *c *= d);
        }
        if self.uneven > 0.0 {
            let density = field(10, rng);
            // Large counts are nearly normally distributed; normal numbers are faster to draw.
            let mut poisson = |mean: f32| match mean {
                many if many > 12.0 => (many + many.sqrt() * gauss(rng)).round().max(0.0),
                few => Poisson::new(f64::from(few.max(1e-4))).map_or(0.0, |p| p.sample(rng) as f32),
            };
            counts.iter_mut().zip(&density).for_each(|(c, d)| *c = poisson(*c * (self.uneven * d).exp()));
        } else if figure.is_none() && each < 1.0 {
            // The grid of pixels is coarser than the cells.
            let stride = 1.0 / each.sqrt();
            let line = |i: usize| ((i + 1) as f32 / stride).floor() > (i as f32 / stride).floor();
            for (cell, count) in counts.iter_mut().enumerate() {
                *count = f32::from(u8::from(line(cell % DISK_SIDE) && line(cell / DISK_SIDE)));
            }
        }
        if self.missing > 0.0 {
            let gaps = field(5, rng);
            let edge = quantile(&gaps, 1.0 - self.missing);
            counts.iter_mut().zip(&gaps).for_each(|(c, g)| *c = if *g > edge { 0.0 } else { *c });
        }
        if self.occluded > 0.0 {
            let (sin, cos) = between(rng, 0.0, std::f32::consts::TAU).sin_cos();
            let along = |cell| {
                let (x, y) = disk::centre(cell);
                x * cos + y * sin
            };
            let depths: Vec<f32> = (0..DISK_SIDE * DISK_SIDE).map(along).collect();
            let edge = quantile(&depths, 1.0 - self.occluded);
            counts.iter_mut().zip(&depths).for_each(|(c, d)| *c = if *d > edge { 0.0 } else { *c });
        }
        (counts, each >= 3.0)
    }

    /// Returns, for each cell, the position `(x, y)` in cells from which it takes its value if the
    /// shape is wrong.
    ///
    /// The positions deviate by a smooth field of shifts, a global shift, and a change of the
    /// radius.
    fn displaced(&self, rng: &mut impl Rng) -> Vec<(f32, f32)> {
        let cells = 0.5 * DISK_SIDE as f32;
        let (right, down) = (field(7, rng), field(7, rng));
        let mut off = || self.outline * cells * gauss(rng);
        let (dx, dy, stretch) = (off(), off(), off() / cells);
        let regional = self.wrong_normals * cells;
        let at = |cell: usize| {
            let (x, y) = ((cell % DISK_SIDE) as f32 + 0.5 - cells, (cell / DISK_SIDE) as f32 + 0.5 - cells);
            let x = x * (1.0 + stretch) + dx + regional * right[cell];
            let y = y * (1.0 + stretch) + dy + regional * down[cell];
            // There is no object beyond the rim.
            let shrink = (0.975 * cells / (x * x + y * y).sqrt().max(1e-6)).min(1.0);
            (x * shrink + cells - 0.5, y * shrink + cells - 0.5)
        };
        (0..DISK_SIDE * DISK_SIDE).map(at).collect()
    }

    /// Simulates the estimate of the scatter from pixels that share a normal, with its error.
    fn estimated_scatter(&self, image: &OpticalImage, rng: &mut impl Rng) -> f32 {
        let (mean, step) = (image.mean, image.step);
        let relative: Vec<f32> = (0..DISK_SIDE * DISK_SIDE)
            .filter(|&c| on_disk(c) && image.values[c] > 0.0)
            .step_by(7)
            .map(|c| {
                let (value, detail, tilt) = (image.values[c], image.details[c], image.tilt(c));
                let rest =
                    self.shot.powi(2) * mean * value + (self.read * mean).powi(2) + tilt * tilt + step * step / 12.0;
                // Sharp reflections vary within a cell too.
                (rest + image.variance_among(c) + detail * detail) / (value * value)
            })
            .collect();
        let rest = median(relative).unwrap_or(0.0);
        let reported_noise = (self.speckle.powi(2) + rest).sqrt() * (0.15 * gauss(rng)).exp();
        reported_noise.max(0.001)
    }
}

/// Image on the disk of normals before the noise of its pixels.
struct OpticalImage {
    values: Vec<f32>,
    details: Vec<f32>,
    /// Slope of the values at each cell; empty if the normals are exact.
    slope: Vec<f32>,
    /// Variance among the places that each cell shows; empty for a single place.
    among: Vec<f32>,
    /// Mean of the values before the figure or stains.
    mean: f32,
    /// Error of the normals from pixel to pixel, in cells.
    rough: f32,
    /// Difference between neighbouring levels of the file; zero for floats.
    step: f32,
}

impl OpticalImage {
    /// Returns the standard deviation of the pixels of a cell due to errors of their normals.
    fn tilt(&self, cell: usize) -> f32 {
        self.slope.get(cell).map_or(0.0, |s| s * self.rough)
    }

    fn variance_among(&self, cell: usize) -> f32 {
        self.among.get(cell).copied().unwrap_or(0.0)
    }
}

/// Resamples an image at these places, in cells.
fn shifted(image: &[f32], places: &[(f32, f32)]) -> Vec<f32> {
    let at = |(cell, &(x, y)): (usize, &(f32, f32))| if on_disk(cell) { bilinear(image, x, y) } else { 0.0 };
    places.iter().enumerate().map(at).collect()
}

/// Estimates the scatter of an image that has one pixel in each cell.
fn scatter_of_cells(values: &[f32], counts: &[f32]) -> f32 {
    let samples: Vec<Sample> = (0..DISK_SIDE * DISK_SIDE)
        .filter(|&c| counts[c] > 0.0)
        .map(|c| {
            let (x, y) = disk::centre(c);
            Sample { x, y, value: values[c], rgb: [values[c]; 3], weight: 1.0 }
        })
        .collect();
    scatter(&samples).unwrap_or(0.0)
}

#[cfg(test)]
mod tests;
