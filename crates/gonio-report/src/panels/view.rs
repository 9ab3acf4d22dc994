//! Frame in which photograph and reproduction are shown.

use glam::{DVec3, Vec3};
use gonio::picture::{Picture, Plane};
use gonio::reflectance::BivariateTable;
use gonio::scene::Circle;
use gonio::shape::SurfacePoint;
use gonio::shape::{PosedSurface, Visibility, VisibilityPoint, hit_at, view_at};
use gonio::sphere::OctahedralMap;
use rayon::prelude::*;

use super::renderer::{APART, PanelRenderer, RADIUS};
use super::{PANEL, Subject};

/// Texels along a side of the grid on which self-shadowing is computed for the pictures.
const SHADOWS: usize = 16;

/// Part of the photograph that a panel shows, with the data for rendering the model in the same
/// frame.
pub(crate) enum View<'a> {
    Sphere(Circle, Option<&'a Plane<f32>>),
    /// Normals, and the square frame in pixels: left, top, side.
    Normals(&'a Plane<Vec3>, [f64; 3], Option<&'a Plane<f32>>, Option<&'a PosedSurface>),
}

impl<'a> View<'a> {
    pub(crate) fn of(subject: &Subject<'a>) -> Self {
        let (detection, coverage) = (subject.detection, subject.detection.coverage.as_ref());
        match (detection.circle(), &detection.normals) {
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
                    detection.placed.as_ref().filter(|_| subject.shadows),
                )
            }
            (None, None) => unreachable!("a detection has a circle or normals"),
        }
    }

    /// Returns the part of the photograph that is shown: left, top and side in pixels.
    fn frame(&self) -> [f64; 3] {
        match self {
            Self::Sphere(c, _) => {
                let side = c.radius * PANEL as f64 / RADIUS;
                [c.x - 0.5 * side, c.y - 0.5 * side, side]
            }
            Self::Normals(_, frame, ..) => *frame,
        }
    }

    /// Maps a position in the photograph to a panel of `side` pixels.
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
    /// coverage by the object as alpha. Photographs of higher resolution are averaged over each
    /// pixel, those of lower resolution are interpolated.
    pub(crate) fn cut(&self, picture: &Picture, side: usize) -> Picture {
        let size = picture.rgb.size();
        // The background around the object is not shown.
        let share = |at: (usize, usize)| self.coverage().map_or(1.0, |c| c[at].clamp(0.0, 1.0));
        let fine = self.frame()[2] > side as f64;
        let pixels = |x: usize, y: usize| -> Vec<((usize, usize), f32)> {
            if fine {
                self.behind(x, y, side, size).map(|at| (at, 1.0)).collect()
            } else {
                self.about(x, y, side, size)
            }
        };
        let pixel = |at: usize| {
            let (mut rgb, mut sum, mut alpha, mut total) = (Vec3::ZERO, 0.0, 0.0, 0.0);
            for (at, weight) in pixels(at % side, at / side) {
                let share = share(at);
                (alpha, total) = (alpha + weight * share, total + weight);
                if picture.rgb[at].is_finite() && share > 0.5 {
                    rgb += weight * picture.rgb[at].max(Vec3::ZERO);
                    sum += weight;
                }
            }
            let alpha = if total > 0.0 { alpha / total } else { 0.0 };
            (if sum > 0.0 { rgb * alpha / sum } else { Vec3::ZERO }, alpha)
        };
        let (rgb, alpha) = (0..side * side).into_par_iter().map(pixel).unzip();
        Picture { rgb: Plane::from_vec(side, side, rgb), alpha: Some(Plane::from_vec(side, side, alpha)) }
    }

    /// Returns the surface points at every `step`th pixel of a panel, row by row; `None` where
    /// there is no surface.
    fn points(&self, normals: &Plane<Vec3>, placed: Option<&PosedSurface>, step: usize) -> Vec<Option<SurfacePoint>> {
        let side = PANEL / step;
        let coverage = self.coverage();
        let point = |i: usize| {
            let at = self.pixel(i % side, i / side, side, normals.size())?;
            let seen = coverage.is_none_or(|c| c[at] > 0.5) && normals[at].is_finite();
            let normal = seen.then(|| normals[at].as_dvec3()).and_then(DVec3::try_normalize)?;
            let view = placed.map_or(DVec3::Z, |p| view_at(&p.camera, at.0, at.1));
            (normal.dot(view) > -AWAY).then_some(SurfacePoint { normal, view }.facing())
        };
        (0..side * side).map(point).collect()
    }

    /// Returns the pixel of the photograph behind a pixel of a panel of `side` pixels.
    fn pixel(&self, x: usize, y: usize, side: usize, (width, height): (usize, usize)) -> Option<(usize, usize)> {
        let [left, top, whole] = self.frame();
        let at = |i: usize| (i as f64 + 0.5) / side as f64 * whole;
        let (u, v) = (left + at(x), top + at(y));
        let inside = u >= 0.0 && v >= 0.0 && (u as usize) < width && (v as usize) < height;
        inside.then_some((u as usize, v as usize))
    }

    /// Returns the four pixels of the photograph around the centre of a pixel of a panel, with
    /// bilinear weights; fewer at the edges of the photograph.
    fn about(&self, x: usize, y: usize, side: usize, (width, height): (usize, usize)) -> Vec<((usize, usize), f32)> {
        let [left, top, whole] = self.frame();
        let place = |low: f64, i: usize, most: usize| {
            let at = low + (i as f64 + 0.5) / side as f64 * whole - 0.5;
            let part = (at - at.floor()) as f32;
            [(at.floor(), 1.0 - part), (at.floor() + 1.0, part)].map(move |(i, weight)| {
                let inside = i >= 0.0 && i < most as f64;
                (i.max(0.0) as usize, if inside { weight } else { 0.0 })
            })
        };
        let columns = place(left, x, width);
        let four = place(top, y, height).into_iter().flat_map(|(v, b)| columns.map(|(u, a)| ((u, v), a * b)));
        four.filter(|(_, weight)| *weight > 0.0).collect()
    }

    /// Iterates over the pixels of the photograph, of this size, that a pixel of a panel of `side`
    /// pixels covers; at least one inside the photograph.
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
            // Limit the range to the photograph.
            (first.max(0.0) as usize)..(end.max(0.0) as usize).min(most)
        };
        let columns = span(left, x, width);
        span(top, y, height).flat_map(move |row| columns.clone().map(move |column| (column, row)))
    }

    /// Computes the visibility of the light at some points, on a grid fine enough for viewing;
    /// `None` if nothing is occluded.
    fn visibility(&self, points: &[Option<SurfacePoint>], step: usize) -> Option<Visibility> {
        let Self::Normals(normals, _, _, Some(placed)) = self else { return None };
        if placed.surface.is_convex() {
            return None;
        }
        let side = PANEL / step;
        let viewpoint = |(i, point): (usize, &Option<SurfacePoint>)| {
            let hit = point.as_ref().and_then(|_| {
                let (x, y) = self.pixel(i % side, i / side, side, normals.size())?;
                hit_at(placed.surface.as_ref(), &placed.camera, x, y)
            });
            // A missing point has a zero normal, so no rays are traced.
            hit.map_or(VisibilityPoint { from: DVec3::ZERO, normal: DVec3::ZERO }, |h| VisibilityPoint {
                from: h.ray_origin,
                normal: h.normal,
            })
        };
        let viewpoints: Vec<VisibilityPoint> = points.iter().enumerate().map(viewpoint).collect();
        Some(Visibility::trace(placed.surface.as_ref(), &viewpoints, OctahedralMap::EqualArea, SHADOWS, &|_| ()))
    }

    /// Renders the object with this material in the frame.
    pub(crate) fn render(&self, material: &[BivariateTable; 3], stage: &PanelRenderer) -> Picture {
        match self {
            Self::Sphere(..) => stage.spheres(std::slice::from_ref(material)).remove(0),
            Self::Normals(normals, _, _, placed) => {
                let some = self.points(normals, *placed, APART);
                let visibility = self.visibility(&some, APART);
                stage.object(material, &self.points(normals, *placed, 1), (&some, visibility.as_ref()))
            }
        }
    }
}

/// Cosine between normal and view direction. Normals below its negative are not visible.
const AWAY: f64 = 0.1;
