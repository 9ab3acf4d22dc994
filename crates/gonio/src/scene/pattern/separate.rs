//! Pixels of both paints of a pattern.

use glam::{DVec3, Vec3};

use super::{Cells, Conversion, Groups, Pattern, SurfaceGeometry, dilated, reassign};
use crate::picture::Plane;

/// Approximate number of the finer cells along the longer side of the object. The conversion
/// assigns these cells to the paints again, because larger cells at the border show both paints.
const FINE_CELLS: f64 = 200.0;
/// Largest error to expect of a converted pixel, relative to its radiance.
const MAX_ERROR: f64 = 0.03;
/// Smallest share of the second paint, without its border, that must be converted. Otherwise, gonio
/// ignores this paint: the accurate conversions form a narrow strip along the border.
const MIN_CONVERTED: f64 = 0.5;
/// Smallest share of the object that must remain.
const MIN_REMAINING: f64 = 0.15;
/// Largest width in pixels of the border that shows both paints, on each side.
const MAX_BORDER: usize = 4;

/// The photograph of a pattern.
pub(super) struct Photograph<'a> {
    pub(super) rgb: &'a Plane<Vec3>,
    /// Whether a pixel shows the object and is sound.
    pub(super) usable: &'a dyn Fn((usize, usize)) -> bool,
    pub(super) surface: &'a SurfaceGeometry<'a>,
}

/// Separates the paints of two groups that differ by `step`, and converts the second paint where
/// this is accurate. Returns `None` if too few pixels remain.
pub(super) fn separate(
    groups: &mut Groups,
    step: DVec3,
    cells: &Cells,
    photograph: &Photograph<'_>,
) -> Option<Pattern> {
    let &Photograph { rgb, usable, surface } = photograph;
    let mut conversion = Conversion::fit(groups, cells);
    let mut second = None;
    if let Some(first) = &conversion
        && let Some(fine) = Cells::of(rgb, usable, surface, (FINE_CELLS, false))
    {
        let mut divided = groups.divided(cells, &fine);
        reassign(&mut divided, &fine, first);
        groups.join_groups(cells, &divided, &fine);
        second = Some(divided.second_paint(&fine, rgb, step));
        conversion = Conversion::fit(groups, cells);
    }
    let second = second.unwrap_or_else(|| groups.second_paint(cells, rgb, step));
    let is_border = border(&second, usable, border_width(cells.side));
    let errors = conversion.as_ref().map(|conversion| conversion.errors(groups, cells));
    let is_accurate = |at| {
        let error = || Some(errors.as_ref()?[groups.index[cells.cell(at)?]?]);
        error().is_some_and(|error| error < MAX_ERROR)
    };
    let is_second = |at| usable(at) && second[at] && !is_border[at];
    let convertible = Plane::from_fn(rgb.width(), rgb.height(), |x, y| is_second((x, y)) && is_accurate((x, y)));
    let is_converted = count(&convertible) as f64
        >= MIN_CONVERTED * count(&Plane::from_fn(rgb.width(), rgb.height(), |x, y| is_second((x, y)))) as f64;
    let converted = Plane::from_fn(rgb.width(), rgb.height(), |x, y| {
        let conversion = conversion.as_ref().filter(|_| is_converted && convertible[(x, y)])?;
        Some(conversion.convert(rgb[(x, y)], (surface.normal)((x, y))))
    });
    let other = Plane::from_fn(rgb.width(), rgb.height(), |x, y| {
        is_border[(x, y)] || second[(x, y)] && converted[(x, y)].is_none()
    });
    let all = Plane::from_fn(rgb.width(), rgb.height(), |x, y| usable((x, y)));
    let remaining = Plane::from_fn(rgb.width(), rgb.height(), |x, y| all[(x, y)] && !other[(x, y)]);
    let is_enough = count(&remaining) as f64 >= MIN_REMAINING * count(&all) as f64;
    is_enough.then(|| {
        let colour = step.exp().as_vec3();
        let paint = |is_second: &bool| if *is_second { colour } else { Vec3::ONE };
        Pattern { other, converted, ratio: groups.ratio(step), relative: second.map(paint) }
    })
}

fn count(set: &Plane<bool>) -> usize {
    set.as_slice().iter().filter(|is_in| **is_in).count()
}

/// Returns the width in pixels of the border on each side, for cells of this side.
fn border_width(side: usize) -> usize {
    if side > 1 { (side / 2).min(MAX_BORDER) } else { 2 }
}

/// Returns the pixels within `width` pixels of usable ones of the other paint.
fn border(second: &Plane<bool>, usable: &dyn Fn((usize, usize)) -> bool, width: usize) -> Plane<bool> {
    let size = second.size();
    let near = |paint: bool| {
        let is_paint = |x, y| usable((x, y)) && second[(x, y)] == paint;
        dilated(Plane::from_fn(size.0, size.1, is_paint), width)
    };
    let (first, second) = (near(false), near(true));
    Plane::from_fn(size.0, size.1, |x, y| first[(x, y)] && second[(x, y)])
}
