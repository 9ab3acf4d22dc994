//! Frame in which photograph and reproduction are shown.

use glam::{DVec3, Vec3};
use gonio::picture::{Picture, Plane};
use gonio::reflectance::BivariateTable;
use gonio::render::{Brdf, Lobe, LobeSettings, PrefilteredLight};
use gonio::scene::Circle;
use gonio::shape::SurfacePoint;
use gonio::shape::{Lookout, Placed, Visibility, hit_at, view_at};
use gonio::sphere::OctahedralMap;
use rayon::prelude::*;

use super::{PANEL, Subject};

/// Texels along a side of the grid on which self-shadowing is computed for the pictures.
const SHADOWS: usize = 16;

/// Part of the photograph that a panel shows, with what is needed to draw the model in the same
/// frame.
pub(crate) enum View<'a> {
    Sphere(Circle, Option<&'a Plane<f32>>),
    /// Normals, and the square frame in pixels: left, top, side.
    Normals(&'a Plane<Vec3>, [f64; 3], Option<&'a Plane<f32>>, Option<&'a Placed>),
}

impl<'a> View<'a> {
    pub(crate) fn of(subject: &Subject<'a>) -> Self {
        let (sighting, coverage) = (subject.sighting, subject.sighting.coverage.as_ref());
        match (sighting.circle(), &sighting.normals) {
            (Some(circle), _) => Self::Sphere(circle, coverage),
            (None, Some(normals)) => {
                let (width, height) = normals.size();
                let (mut low, mut high) = ((width, height), (0, 0));
                for (i, n) in normals.as_slice().iter().enumerate() {
                    let seen = coverage.is_none_or(|c| c.as_slice()[i] > 0.5);
                    if n.is_finite() && *n != Vec3::ZERO && seen {
                        let (x, y) = (i % width, i / width);
                        low = (low.0.min(x), low.1.min(y));
                        high = (high.0.max(x + 1), high.1.max(y + 1));
                    }
                }
                let side = (high.0 - low.0).max(high.1 - low.1) as f64 + 4.0;
                let centre = ((low.0 + high.0) as f64 / 2.0, (low.1 + high.1) as f64 / 2.0);
                Self::Normals(
                    normals,
                    [centre.0 - 0.5 * side, centre.1 - 0.5 * side, side],
                    coverage,
                    sighting.placed.as_ref().filter(|_| subject.shadows),
                )
            }
            (None, None) => unreachable!("a sighting has a circle or normals"),
        }
    }

    /// Returns the part of the photograph that is shown: left, top and side in pixels.
    fn frame(&self) -> [f64; 3] {
        match self {
            Self::Sphere(c, _) => {
                let side = 2.0 * c.radius * PANEL as f64 / (PANEL as f64 - 4.0);
                [c.x - 0.5 * side, c.y - 0.5 * side, side]
            }
            Self::Normals(_, frame, ..) => *frame,
        }
    }

    /// Maps a place of the photograph to a panel of `side` pixels.
    pub(crate) fn shown(&self, (x, y): (f64, f64), side: usize) -> (f64, f64) {
        let [left, top, whole] = self.frame();
        ((x - left) / whole * side as f64, (y - top) / whole * side as f64)
    }

    fn coverage(&self) -> Option<&'a Plane<f32>> {
        match self {
            Self::Sphere(_, coverage) | Self::Normals(_, _, coverage, _) => *coverage,
        }
    }

    /// Cuts the photograph to the frame, `side` pixels wide; black outside the photograph, with the
    /// coverage by the object as alpha.
    pub(crate) fn cut(&self, picture: &Picture, side: usize) -> Picture {
        let size = picture.rgb.size();
        let pixel = |x: usize, y: usize| self.pixel(x, y, side, size);
        let rgb = Plane::from_fn(side, side, |x, y| match pixel(x, y) {
            Some(at) if picture.rgb[at].is_finite() => picture.rgb[at].max(Vec3::ZERO),
            _ => Vec3::ZERO,
        });
        let alpha = Plane::from_fn(side, side, |x, y| match (pixel(x, y), self.coverage()) {
            (Some(at), Some(coverage)) => coverage[at].clamp(0.0, 1.0),
            (Some(_), None) => 1.0,
            (None, _) => 0.0,
        });
        // Around a ball on a real background only the ball is of interest.
        let rgb = Plane::from_fn(side, side, |x, y| if alpha[(x, y)] > 0.5 { rgb[(x, y)] } else { Vec3::ZERO });
        Picture { rgb, alpha: Some(alpha) }
    }

    /// Returns the surface points at every second pixel of a panel, row by row; `None` where there
    /// is no surface.
    fn points(&self) -> Vec<Option<SurfacePoint>> {
        let half = PANEL / 2;
        let point = |i: usize| {
            let (x, y) = (2 * (i % half) + 1, 2 * (i / half) + 1);
            match self {
                Self::Sphere(..) => {
                    sphere_normal(x as f64, y as f64).map(|normal| SurfacePoint { normal, view: DVec3::Z })
                }
                Self::Normals(normals, _, coverage, placed) => {
                    let at = self.pixel(x, y, PANEL, normals.size())?;
                    let seen = coverage.is_none_or(|c| c[at] > 0.5) && normals[at].is_finite();
                    let normal = seen.then(|| normals[at].as_dvec3()).and_then(DVec3::try_normalize)?;
                    let view = placed.map_or(DVec3::Z, |p| view_at(&p.camera, at.0, at.1));
                    (normal.dot(view) > -AWAY).then_some(SurfacePoint { normal, view }.facing())
                }
            }
        };
        (0..half * half).map(point).collect()
    }

    /// Returns the pixel of the photograph behind a pixel of a panel of `side` pixels.
    fn pixel(&self, x: usize, y: usize, side: usize, (width, height): (usize, usize)) -> Option<(usize, usize)> {
        let [left, top, whole] = self.frame();
        let at = |i: usize| (i as f64 + 0.5) / side as f64 * whole;
        let (u, v) = (left + at(x), top + at(y));
        let inside = u >= 0.0 && v >= 0.0 && (u as usize) < width && (v as usize) < height;
        inside.then_some((u as usize, v as usize))
    }

    /// Iterates over all pixels of the photograph, of this size, that fall on a pixel of a panel of
    /// `side` pixels; at least one if there are any near.
    pub(crate) fn behind(
        &self,
        x: usize,
        y: usize,
        side: usize,
        (width, height): (usize, usize),
    ) -> impl Iterator<Item = (usize, usize)> {
        let [left, top, whole] = self.frame();
        let span = |low: f64, i: usize, most: usize| {
            let at = |i: usize| (low + i as f64 / side as f64 * whole).floor();
            let (first, end) = (at(i), at(i + 1).max(at(i) + 1.0));
            // Casts saturate, so nothing lies before the first pixel.
            (first.max(0.0) as usize)..(end.max(0.0) as usize).min(most)
        };
        let columns = span(left, x, width);
        span(top, y, height).flat_map(move |row| columns.clone().map(move |column| (column, row)))
    }

    /// Computes the visibility of the light at some points, on a grid fine enough for viewing;
    /// `None` if nothing is occluded.
    fn visibility(&self, points: &[Option<SurfacePoint>]) -> Option<Visibility> {
        let Self::Normals(normals, _, _, Some(placed)) = self else { return None };
        if placed.surface.is_convex() {
            return None;
        }
        let half = PANEL / 2;
        let lookout = |(i, point): (usize, &Option<SurfacePoint>)| {
            let hit = point.as_ref().and_then(|_| {
                let (x, y) = self.pixel(2 * (i % half) + 1, 2 * (i / half) + 1, PANEL, normals.size())?;
                hit_at(placed.surface.as_ref(), &placed.camera, x, y)
            });
            // A missing point has a zero normal, so no rays are traced.
            hit.map_or(Lookout { from: DVec3::ZERO, normal: DVec3::ZERO }, |h| Lookout {
                from: h.clear,
                normal: h.normal,
            })
        };
        let lookouts: Vec<Lookout> = points.iter().enumerate().map(lookout).collect();
        Some(Visibility::trace(placed.surface.as_ref(), &lookouts, OctahedralMap::EqualArea, SHADOWS, &|_| ()))
    }

    /// Renders the object with this material in the frame.
    pub(crate) fn render(&self, material: &[BivariateTable; 3], light: &PrefilteredLight) -> Picture {
        match self {
            Self::Sphere(..) => spheres(std::slice::from_ref(material), light).remove(0),
            Self::Normals(..) => {
                let points = self.points();
                let visibility = self.visibility(&points);
                pictures(&points, visibility.as_ref(), std::slice::from_ref(material), light).remove(0)
            }
        }
    }
}

/// Cosine between normal and view: normals below its negative do not belong to a visible surface.
const AWAY: f64 = 0.1;

/// Radius of a sphere in a panel, pixels.
const RADIUS: f64 = 0.5 * PANEL as f64 - 2.0;

/// Sine of 80 degrees. Beyond it nothing was observed, and an estimated light that only the rim
/// would see is unconstrained.
const RIM: f64 = 0.985;

/// Returns the normal of a sphere that fills a panel; its rim, and a little beyond, has the normal
/// at [`RIM`].
fn sphere_normal(x: f64, y: f64) -> Option<DVec3> {
    let (a, b) = ((x - 0.5 * PANEL as f64) / RADIUS, (0.5 * PANEL as f64 - y) / RADIUS);
    let r = a.hypot(b);
    let (a, b) = (a * RIM / r.max(RIM), b * RIM / r.max(RIM));
    (r < 1.0 + 3.0 / RADIUS).then(|| DVec3::new(a, b, (1.0 - a * a - b * b).sqrt()).normalize())
}

/// Renders spheres of these materials that fill a panel.
pub(crate) fn spheres(materials: &[[BivariateTable; 3]], light: &PrefilteredLight) -> Vec<Picture> {
    let whole = View::Sphere(Circle { x: 0.0, y: 0.0, radius: 1.0 }, None);
    pictures(&whole.points(), None, materials, light).into_iter().map(cut_out).collect()
}

/// Cuts the picture of a sphere to its antialiased outline.
fn cut_out(mut picture: Picture) -> Picture {
    let alpha = Plane::from_fn(PANEL, PANEL, |x, y| {
        let r = (x as f64 + 0.5 - 0.5 * PANEL as f64).hypot(y as f64 + 0.5 - 0.5 * PANEL as f64);
        (RADIUS - r + 0.5).clamp(0.0, 1.0) as f32
    });
    picture.rgb.as_mut_slice().iter_mut().zip(alpha.as_slice()).for_each(|(p, a)| *p *= *a);
    Picture { alpha: Some(alpha), ..picture }
}

/// Renders panels of several materials at the same points, those of every second pixel: the light
/// is subdivided once for all, and values between the points are interpolated. Colour is
/// premultiplied by alpha.
fn pictures(
    points: &[Option<SurfacePoint>],
    visibility: Option<&Visibility>,
    materials: &[[BivariateTable; 3]],
    light: &PrefilteredLight,
) -> Vec<Picture> {
    let half = PANEL / 2;
    let brdfs: Vec<&dyn Brdf> = materials.iter().map(|m| m as &dyn Brdf).collect();
    let lobe = Lobe::new(&brdfs, light, LobeSettings::DRAFT);
    let colours: Vec<Vec<Vec3>> = points
        .par_iter()
        .enumerate()
        .map(|(i, point)| {
            let Some(point) = point else { return vec![Vec3::ZERO; materials.len()] };
            let open = |direction: Vec3| visibility.map_or(1.0, |v| v.share_along(i, direction.as_dvec3()));
            lobe.radiance(point, light, open)
        })
        .collect();
    let panel = |which: usize| {
        // Interpolates over the points that exist, by their distance to the pixel.
        let pixel = |x: usize, y: usize| {
            let near = |at: usize| {
                let own = at / 2;
                // Beyond the edge there is no point.
                let other = if at.is_multiple_of(2) { own.wrapping_sub(1) } else { own + 1 };
                [(own, 0.75), (other, 0.25)]
            };
            let (mut sum, mut weight) = (Vec3::ZERO, 0.0_f32);
            for (j, v) in near(y) {
                for (i, u) in near(x) {
                    if i < half && j < half && points[j * half + i].is_some() {
                        sum += u * v * colours[j * half + i][which];
                        weight += u * v;
                    }
                }
            }
            (sum, weight)
        };
        let rgb = Plane::from_fn(PANEL, PANEL, |x, y| {
            let (sum, weight) = pixel(x, y);
            if weight > 0.5 { sum / weight } else { Vec3::ZERO }
        });
        let alpha = Plane::from_fn(PANEL, PANEL, |x, y| if pixel(x, y).1 > 0.5 { 1.0 } else { 0.0 });
        Picture { rgb, alpha: Some(alpha) }
    };
    (0..materials.len()).map(panel).collect()
}
