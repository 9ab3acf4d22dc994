//! BRDF of two colours: that of its body and that of its highlight.
//!
//! `F_c(theta_h, theta_d) = b_c B(theta_h, theta_d) + h_c (F - B)` where `F` is the luminance BRDF,
//! `B` its body and `b`, `h` colours of luminance one: the dichromatic model (Shafer 1985) with the
//! reflectance of both parts taken from the luminance estimate. The luminance of `F_c` is `F`, and
//! no channel is negative.

use glam::DVec3;

use super::chroma::Chroma;
use crate::reflectance::{BivariateTable, THETA_D, THETA_H, place_of, theta_d_of, theta_h_of, trusted_cells};

/// Half angles (radians) at which only the body contributes: the highlights of all materials but
/// blurry mirrors have ended there.
const BODY: (f64, f64) = (60.0 / 180.0 * std::f64::consts::PI, 80.0 / 180.0 * std::f64::consts::PI);

/// Strength with which two colours that a material hardly distinguishes are pulled to its mean
/// colour, as a share of its squared brightness.
const PULL: f64 = 0.003;

/// Colours of a material's body and highlight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TwoColours {
    /// Colour of the part scattered below the surface, or by a rough one.
    pub body: Chroma,
    /// Colour of the rest.
    pub highlight: Chroma,
}

/// Body of a luminance BRDF: for each difference angle the median over half angles of 60 to 80
/// degrees, or the BRDF where it is darker.
pub fn body(table: &BivariateTable) -> BivariateTable {
    let rows: Vec<usize> = (0..THETA_H).filter(|&i| (BODY.0..BODY.1).contains(&theta_h_of(i))).collect();
    let mut out = table.clone();
    for j in 0..THETA_D {
        let mut far: Vec<f32> = rows.iter().map(|&i| table.cell(i, j)).collect();
        let middle = far.len() / 2;
        let (_, level, _) = far.select_nth_unstable_by(middle, f32::total_cmp);
        let level = *level;
        (0..THETA_H).for_each(|i| {
            let cell = &mut out.as_mut_slice()[i * THETA_D + j];
            *cell = cell.min(level);
        });
    }
    out
}

impl TwoColours {
    /// One colour for both.
    pub fn same(chroma: Chroma) -> Self {
        Self { body: chroma, highlight: chroma }
    }

    /// Tables of the channels (red, green, blue) whose luminance is `table`; grey ones are copies
    /// of it.
    pub fn tables(&self, table: &BivariateTable) -> [BivariateTable; 3] {
        if *self == Self::default() {
            return [table.clone(), table.clone(), table.clone()];
        }
        let body = body(table);
        let (dull, bright) = (self.body.rgb(), self.highlight.rgb());
        [0, 1, 2].map(|c| {
            let cells = table.as_slice().iter().zip(body.as_slice());
            let mixed = cells.map(|(all, body)| {
                let body = f64::from(*body).max(0.0);
                (dull[c] * body + bright[c] * (f64::from(*all) - body).max(0.0)) as f32
            });
            BivariateTable::from_vec(mixed.collect())
        })
    }

    /// Fits the colours to the channels of a material: least squares over the trusted cells,
    /// relative to the brightness of each, in which a part that hardly exists in the material takes
    /// the mean colour.
    pub fn of(channels: &[BivariateTable; 3]) -> Self {
        let table = BivariateTable::luminance(channels);
        let body = body(&table);
        let (level, count) =
            trusted_cells().fold((0.0, 0.0), |(sum, count), c| (sum + f64::from(table.as_slice()[c]), count + 1.0));
        let floor = (0.3 * level / count).powi(2).max(1e-30);
        let (mut normal, mut right, mut whole, mut one) = ([0.0; 3], [[0.0; 2]; 3], 0.0, [0.0; 3]);
        for c in trusted_cells() {
            let all = f64::from(table.as_slice()[c]);
            let (b, h) = (f64::from(body.as_slice()[c]), all - f64::from(body.as_slice()[c]));
            let weight = solid(c) / (all * all + floor);
            normal = [normal[0] + weight * b * b, normal[1] + weight * b * h, normal[2] + weight * h * h];
            whole += weight * all * all;
            for (channel, table) in channels.iter().enumerate() {
                let value = f64::from(table.as_slice()[c]);
                right[channel][0] += weight * b * value;
                right[channel][1] += weight * h * value;
                one[channel] += weight * all * value;
            }
        }
        if whole <= 0.0 {
            return Self::default();
        }
        let pull = PULL * whole;
        let [bb, bh, hh] = [normal[0] + pull, normal[1], normal[2] + pull];
        let determinant = bb * hh - bh * bh;
        let solved: [[f64; 2]; 3] = [0, 1, 2].map(|c| {
            let mean = one[c] / whole;
            let (x, y) = (right[c][0] + pull * mean, right[c][1] + pull * mean);
            [(hh * x - bh * y) / determinant, (bb * y - bh * x) / determinant]
        });
        let colour = |part: usize| Chroma::of(DVec3::from_array(solved.map(|c| c[part].max(0.0))));
        Self { body: colour(0), highlight: colour(1) }
    }
}

/// Brightness-weighted share of the highlight in light that is reflected along the normal direction
/// from everywhere: between zero and one.
pub fn highlight_share(table: &BivariateTable) -> f64 {
    let body = body(table);
    let (mut part, mut all) = (0.0, 0.0);
    for c in trusted_cells() {
        let weight = solid(c) * theta_h_of(c / THETA_D).cos();
        all += weight * f64::from(table.as_slice()[c]);
        part += weight * f64::from(table.as_slice()[c] - body.as_slice()[c]);
    }
    if all > 0.0 { (part / all).clamp(0.0, 1.0) } else { 0.0 }
}

/// Weight of a cell: the solid angle of its half vectors times, up to a small constant, that of the
/// light at its difference angle.
fn solid(cell: usize) -> f64 {
    let (i, j) = place_of(cell);
    let width = 0.5 * (theta_h_of((i + 1).min(THETA_H - 1)) - theta_h_of(i.saturating_sub(1)));
    theta_h_of(i).sin() * width * ((2.0 * theta_d_of(j)).sin() + 0.02)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plastic() -> BivariateTable {
        BivariateTable::from_fn(|h, d| 0.1 + 0.02 * d + 8.0 * (-(h / 0.08).powi(2)).exp())
    }

    fn colours() -> TwoColours {
        TwoColours { body: Chroma([0.8, -1.1]), highlight: Chroma([0.1, -0.05]) }
    }

    #[test]
    fn the_luminance_stays_and_nothing_is_negative() {
        let table = plastic();
        let rgb = colours().tables(&table);
        for (c, (want, got)) in table.as_slice().iter().zip(BivariateTable::luminance(&rgb).as_slice()).enumerate() {
            assert!((got / want - 1.0).abs() < 1e-5, "{c}: {got} {want}");
        }
        assert!(rgb.iter().flat_map(|t| t.as_slice()).all(|v| *v >= 0.0));
        let grey = TwoColours::default().tables(&table);
        assert!(grey.iter().all(|channel| *channel == table));
    }

    #[test]
    fn each_part_shows_its_colour() {
        let rgb = colours().tables(&plastic());
        let at = |i: usize| DVec3::from_array([0, 1, 2].map(|c| f64::from(rgb[c].cell(i, 20))));
        assert!(Chroma::of(at(80)).distance(colours().body) < 1e-4);
        assert!(Chroma::of(at(0)).distance(colours().highlight) < 0.05);
    }

    #[test]
    fn the_colours_of_a_table_come_back() {
        let got = TwoColours::of(&colours().tables(&plastic()));
        assert!(got.body.distance(colours().body) < 0.05, "{got:?}");
        assert!(got.highlight.distance(colours().highlight) < 0.05, "{got:?}");
        // A part that does not exist has the colour of the other.
        let chalk = BivariateTable::from_fn(|_, _| 0.2);
        let got = TwoColours::of(&colours().tables(&chalk));
        assert!(got.highlight.distance(colours().body) < 0.02, "{got:?}");
    }

    #[test]
    fn the_share_of_the_highlight() {
        assert_eq!(highlight_share(&BivariateTable::from_fn(|_, _| 0.2)), 0.0);
        let metal = BivariateTable::from_fn(|h, _| 1e-4 + 50.0 * (-(h / 0.1).powi(2)).exp());
        assert!(highlight_share(&metal) > 0.9);
        assert!(highlight_share(&plastic()) > 0.05 && highlight_share(&plastic()) < 0.9);
    }
}
