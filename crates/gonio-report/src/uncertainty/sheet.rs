//! Picture of the maps, `uncertainty.png`.

use glam::Vec3;
use gonio::estimate::MaterialEstimate;
use gonio::picture::Plane;

use super::{DIFFERENCE, DIFFERENCE_TICKS, HALF, HALF_TICKS, MAP, Map, across, colour, down, mean, number, width};
use crate::canvas::{INK, LINE, fill, heading, note, place, sheet, text, width_of};

/// Margin to the left of a map, for the numbers of its axis.
const LEFT: usize = 60;
/// Space between a map and its colour bar, width of the bar, and width of the bar's numbers.
const BAR: (usize, usize, usize) = (18, 18, 72);
/// Margins above and below a map.
const TOP: usize = 72;
const BOTTOM: usize = 96;

/// Draws the mean and the width of the 90 % interval side by side, hatched where the BRDF is
/// undetermined. Returns linear display values in 0..=1.
pub fn draw(material: &MaterialEstimate) -> Plane<Vec3> {
    let (left, right) = (drawn(&mean(&material.table)), drawn(&width(material)));
    let mut out = sheet(left.width() + right.width(), left.height());
    place(&mut out, 0, 0, &left);
    place(&mut out, left.width(), 0, &right);
    out
}

/// Draws one map with axes and a colour bar.
fn drawn(map: &Map) -> Plane<Vec3> {
    let mut sheet = sheet(LEFT + MAP + BAR.0 + BAR.1 + BAR.2, TOP + MAP + BOTTOM);
    let out = &mut sheet;
    heading(out, LEFT, 14, map.title);
    note(out, LEFT, TOP - LINE - 4, &format!("vertical: {DIFFERENCE}"));
    place(out, LEFT, TOP, &map.pixels);
    for degrees in HALF_TICKS {
        let x = LEFT + (across(degrees) * MAP as f64) as usize;
        fill(out, (x, TOP + MAP), (1, 6), INK);
        let label = format!("{degrees:.0}");
        text(out, x - width_of(&label) / 2, TOP + MAP + 9, &label);
    }
    note(out, LEFT, TOP + MAP + 9 + LINE, &format!("horizontal: {HALF}, stretched at the highlight"));
    note(out, LEFT, TOP + MAP + 9 + 2 * LINE, map.note);
    for degrees in DIFFERENCE_TICKS {
        let y = TOP + (down(degrees) * MAP as f64) as usize;
        fill(out, (LEFT - 6, y), (6, 1), INK);
        let label = format!("{degrees:.0}");
        text(out, LEFT - 11 - width_of(&label), y - 9, &label);
    }
    let bar = LEFT + MAP + BAR.0;
    place(out, bar, TOP, &Plane::from_fn(BAR.1, MAP, |_, y| colour(1.0 - y as f64 / (MAP - 1) as f64)));
    for tick in map.scale.ticks() {
        let y = TOP + ((1.0 - map.scale.at(tick)) * (MAP - 1) as f64) as usize;
        fill(out, (bar + BAR.1, y), (5, 1), INK);
        text(out, bar + BAR.1 + 9, y.saturating_sub(9), &number(tick));
    }
    sheet
}
