//! Values of single faulty pixels, interpolated from the pixels around them.
//!
//! The learnt posterior depends on statistics of fine detail, which change if a cell of the disk
//! lacks one of its pixels. An interpolated value leaves them unchanged.

use std::borrow::Cow;

use glam::{DVec3, Vec3};

use super::PixelStatus;
use super::components::neighbours;
use super::outliers::stencil::{NEIGHBOURS, Stencil};
use crate::picture::Plane;

/// Smallest number of used pixels among the eight around a pixel that is interpolated.
const MIN_ADJACENT: usize = 6;

/// Returns the value of a pixel (row-major index) if it is used or can be interpolated.
///
/// A pixel can be interpolated if it is faulty and nearly all pixels around it are used.
pub(super) fn repaired(rgb: &Plane<Vec3>, statuses: &Plane<PixelStatus>, pixel: usize) -> Option<Vec3> {
    let status = statuses.as_slice()[pixel];
    if status.is_used() {
        return Some(rgb.as_slice()[pixel]);
    }
    if !status.is_faulty() {
        return None;
    }
    let (size, at) = (rgb.size(), (pixel % rgb.width(), pixel / rgb.width()));
    let adjacent = neighbours(at, size, true).filter(|next| statuses[*next].is_used()).count();
    if adjacent < MIN_ADJACENT {
        return None;
    }
    let (mut values, mut known) = ([DVec3::ZERO; 24], 0_u32);
    for (i, (dx, dy)) in NEIGHBOURS.iter().enumerate() {
        let (Some(x), Some(y)) = (at.0.checked_add_signed(*dx), at.1.checked_add_signed(*dy)) else { continue };
        if x < size.0 && y < size.1 && statuses[(x, y)].is_used() {
            values[i] = rgb[(x, y)].as_dvec3();
            known |= 1 << i;
        }
    }
    biharmonic(&values, known).or_else(|| quadratic(&values, known)).map(|value| value.as_vec3().max(Vec3::ZERO))
}

/// Returns the picture with an interpolated value at each outlier that can be interpolated.
pub(super) fn without_outliers<'a>(rgb: &'a Plane<Vec3>, statuses: &Plane<PixelStatus>) -> Cow<'a, Plane<Vec3>> {
    let mut out = Cow::Borrowed(rgb);
    for i in (0..statuses.as_slice().len()).filter(|i| statuses.as_slice()[*i] == PixelStatus::Outlier) {
        if let Some(value) = repaired(rgb, statuses, i) {
            out.to_mut().as_mut_slice()[i] = value;
        }
    }
    out
}

/// Interpolates by the discrete biharmonic equation, exact for cubics; `None` if one of its twelve
/// pixels is unknown.
fn biharmonic(values: &[DVec3; 24], known: u32) -> Option<DVec3> {
    let mut sum = DVec3::ZERO;
    for (i, (x, y)) in NEIGHBOURS.iter().enumerate() {
        let weight = match x * x + y * y {
            1 => 8.0,
            2 => -2.0,
            4 => -1.0,
            _ => continue,
        };
        if known >> i & 1 == 0 {
            return None;
        }
        sum += weight / 20.0 * values[i];
    }
    Some(sum)
}

/// Interpolates by a robust quadratic.
fn quadratic(values: &[DVec3; 24], known: u32) -> Option<DVec3> {
    let stencil = Stencil::new(known)?;
    let channel = |c: usize| stencil.predict(&values.map(|value| value[c])).value;
    Some(DVec3::new(channel(0), channel(1), channel(2)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolates_single_faulty_pixels_of_a_smooth_picture() {
        let value = |x: usize, y: usize| {
            let (x, y) = (x as f32 / 9.0, y as f32 / 9.0);
            Vec3::new(1.0 + x + y, 2.0 + x * y - x * x, 3.0 - y * y)
        };
        let rgb = Plane::from_fn(9, 9, value);
        let mut statuses = rgb.map(|_| PixelStatus::Used);
        let off = |statuses: &Plane<PixelStatus>, (x, y): (usize, usize)| {
            repaired(&rgb, statuses, 9 * y + x).map(|got| (got - value(x, y)).abs().max_element())
        };
        assert_eq!(off(&statuses, (4, 4)), Some(0.0));
        for status in [PixelStatus::Outlier, PixelStatus::NotFinite, PixelStatus::Negative] {
            statuses[(4, 4)] = status;
            assert!(off(&statuses, (4, 4)).unwrap() < 1e-5, "{status:?}");
        }
        // Two adjacent faulty pixels, and one near the border of the used pixels.
        statuses[(5, 4)] = PixelStatus::Outlier;
        assert!(off(&statuses, (4, 4)).unwrap() < 1e-5 && off(&statuses, (5, 4)).unwrap() < 1e-5);
        statuses[(1, 1)] = PixelStatus::Outlier;
        assert!(off(&statuses, (1, 1)).unwrap() < 1e-5);
        // A corner, a group, and pixels that are ignored for another reason.
        statuses[(0, 8)] = PixelStatus::Outlier;
        statuses[(4, 5)] = PixelStatus::NotFinite;
        statuses[(5, 5)] = PixelStatus::NotFinite;
        statuses[(7, 7)] = PixelStatus::Clipped;
        assert_eq!(off(&statuses, (0, 8)), None);
        assert_eq!(off(&statuses, (7, 7)), None);
        assert_eq!(off(&statuses, (8, 8)), Some(0.0));
    }
}
