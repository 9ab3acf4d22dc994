//! A photograph averaged over square cells, in which paint is segmented.

use glam::{DVec3, Vec3};

use super::components::neighbours;
use crate::picture::{Plane, luminance};
use crate::statistics::median;

/// Smallest share of usable pixels in a cell whose tone is known.
const KNOWN: f32 = 0.5;
/// Offset added to all channels before the logarithm, relative to the median luminance: the
/// chromaticity of dark pixels is unreliable.
const DARK: f32 = 0.02;

/// Surface behind the pixels.
pub(super) struct SurfaceGeometry<'a> {
    /// Unit normal of a pixel.
    pub(super) normal: &'a dyn Fn((usize, usize)) -> Vec3,
    /// Whether no part of the surface can shadow another.
    pub(super) convex: bool,
}

/// The picture averaged over cells.
pub(super) struct Cells {
    /// Pixels along a side of each cell.
    pub(super) side: usize,
    /// Pixel at the corner of the first cell.
    origin: (usize, usize),
    /// Logarithms of the channels, where known.
    pub(super) tones: Plane<Option<DVec3>>,
    /// Normal in the middle of each cell.
    pub(super) normals: Plane<Vec3>,
    /// Offset added to all channels before the logarithm.
    floor: Vec3,
}

impl Cells {
    /// Averages the usable pixels over about `count` cells along the longer side of the object. If
    /// `is_smooth`, a tone is the mean over the cell and its neighbours.
    ///
    /// Returns `None` if no pixel is usable or the object is black.
    pub(super) fn of(
        rgb: &Plane<Vec3>,
        usable: &dyn Fn((usize, usize)) -> bool,
        surface: &SurfaceGeometry<'_>,
        (count, is_smooth): (f64, bool),
    ) -> Option<Self> {
        let (mut low, mut high) = ((usize::MAX, usize::MAX), (0, 0));
        for y in 0..rgb.height() {
            let is_usable = |x: &usize| usable((*x, y));
            if let (Some(left), Some(right)) = ((0..rgb.width()).find(is_usable), (0..rgb.width()).rfind(is_usable)) {
                low = (low.0.min(left), low.1.min(y));
                high = (high.0.max(right + 1), y + 1);
            }
        }
        if high == (0, 0) {
            return None;
        }
        let (width, height) = (high.0 - low.0, high.1 - low.1);
        let side = ((width.max(height) as f64 / count).round() as usize).max(1);
        let size = (width.div_ceil(side), height.div_ceil(side));
        let means = Plane::from_fn(size.0, size.1, |u, v| {
            let (left, top) = (low.0 + u * side, low.1 + v * side);
            let inside =
                (top..(top + side).min(high.1)).flat_map(|y| (left..(left + side).min(high.0)).map(move |x| (x, y)));
            let (sum, count) = inside
                .filter(|at| usable(*at))
                .fold((Vec3::ZERO, 0.0_f32), |(sum, n), at| (sum + rgb[at].max(Vec3::ZERO), n + 1.0));
            (count >= KNOWN * (side * side) as f32).then(|| sum / count)
        });
        let bright = median(means.as_slice().iter().flatten().map(|c| luminance(*c)))?;
        let floor = Vec3::splat(DARK * bright);
        if floor.x <= 0.0 {
            return None;
        }
        let tones = Plane::from_fn(size.0, size.1, |u, v| {
            let own = means[(u, v)]?;
            let around = neighbours((u, v), size, true).filter(|_| is_smooth).filter_map(|at| means[at]);
            let (sum, count) = around.fold((own, 1.0), |(sum, n), c| (sum + c, n + 1.0));
            Some(tone(sum / count, floor))
        });
        let normals = Plane::from_fn(size.0, size.1, |u, v| {
            let at = |low: usize, cell: usize, high: usize| (low + cell * side + side / 2).min(high - 1);
            (surface.normal)((at(low.0, u, high.0), at(low.1, v, high.1)))
        });
        Some(Self { side, origin: low, tones, normals, floor })
    }

    /// Returns the logarithms of the channels of a pixel.
    pub(super) fn tone(&self, colour: Vec3) -> DVec3 {
        tone(colour.max(Vec3::ZERO), self.floor)
    }

    /// Returns the channels that have these logarithms, the inverse of [`Self::tone`].
    pub(super) fn radiance(&self, tone: DVec3) -> DVec3 {
        (tone.exp() - self.floor.as_dvec3()).max(DVec3::ZERO)
    }

    /// Returns the offset added to all channels before the logarithm.
    pub(super) fn floor(&self) -> f64 {
        f64::from(self.floor.x)
    }

    /// Returns the first pixel of a cell.
    pub(super) fn first_pixel(&self, (u, v): (usize, usize)) -> (usize, usize) {
        (self.origin.0 + u * self.side, self.origin.1 + v * self.side)
    }

    /// Returns the cell of a pixel; `None` outside of the cells.
    pub(super) fn cell(&self, (x, y): (usize, usize)) -> Option<(usize, usize)> {
        let at = (x.checked_sub(self.origin.0)? / self.side, y.checked_sub(self.origin.1)? / self.side);
        (at.0 < self.tones.width() && at.1 < self.tones.height()).then_some(at)
    }

    /// Returns the pixels, in a picture of `size`, of the cells in a set.
    pub(super) fn pixels(&self, set: &Plane<bool>, (width, height): (usize, usize)) -> Plane<bool> {
        Plane::from_fn(width, height, |x, y| self.cell((x, y)).is_some_and(|at| set[at]))
    }
}

/// Returns the logarithms of the channels of a colour after the offset `floor`.
fn tone(colour: Vec3, floor: Vec3) -> DVec3 {
    let colour = (colour + floor).as_dvec3();
    DVec3::new(colour.x.ln(), colour.y.ln(), colour.z.ln())
}
