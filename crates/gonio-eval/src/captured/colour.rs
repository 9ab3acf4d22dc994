//! Errors in RGB: predictions of the object's other photographs, with one scale for all channels.

use glam::DVec3;
use gonio::colour::ChromaField;
use gonio::estimate::Colouring;
use gonio::reflectance::BivariateTable;
use serde::Serialize;

use super::errors::WITHIN;
use super::object::Captured;
use crate::metrics::{mean, relight};

/// RGB relight errors of an estimate and of references: means over the photographs that the
/// estimate does not use; NaN if there is only one photograph.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct RgbErrors {
    /// The estimated channels.
    pub(super) estimate: f64,
    /// The estimated luminance, in grey.
    pub(super) grey: f64,
    /// The estimated luminance, in the median colour of the photograph.
    pub(super) median: f64,
    /// The estimated luminance, in the single colour that fits the other photographs best: an
    /// oracle.
    pub(super) one: f64,
    /// The measured slice in the single colour that fits best: an oracle.
    pub(super) measured: f64,
}

/// Red, green and blue channel of a reflectance over half and difference angle (radians).
type Channels<'a> = [&'a (dyn Fn(f64, f64) -> f64 + Sync); 3];

impl RgbErrors {
    /// Measures the errors of the colours of a luminance table. `median` is the median colour of
    /// the photograph.
    pub(super) fn of(
        object: &Captured,
        photograph: usize,
        (table, colouring, median): (&BivariateTable, &Colouring, &Colouring),
    ) -> Self {
        let tables = |field: ChromaField| {
            let [r, g, b] = field.tables(table);
            let channels: Channels<'_> = [&|h, d| r.eval(h, d), &|h, d| g.eval(h, d), &|h, d| b.eval(h, d)];
            error(object, photograph, channels, false)
        };
        let (grey, slice) = (|h, d| table.eval(h, d), |h, d| object.slice.eval(h, d));
        Self {
            estimate: tables(colouring.field()),
            grey: tables(ChromaField::GREY),
            median: tables(median.field()),
            one: error(object, photograph, [&grey; 3], true),
            measured: error(object, photograph, [&slice; 3], true),
        }
    }
}

/// Mean relight error over the photographs other than `photograph`. With `coloured`, each channel
/// has its own scale, the same in all photographs.
fn error(object: &Captured, photograph: usize, channels: Channels<'_>, coloured: bool) -> f64 {
    let pixels = object.pixels(WITHIN);
    let others = (0..object.photographs.len()).filter(|at| *at != photograph);
    let pairs: Vec<[Vec<DVec3>; 2]> = others
        .map(|at| {
            // A grey reflectance is rendered once.
            let made: Vec<_> = channels[..if coloured { 1 } else { 3 }].iter().map(|f| object.render(at, f)).collect();
            let photograph = object.photographs[at].picture.rgb.as_slice();
            let sent = |&p: &usize| DVec3::from_array([0, 1, 2].map(|c| made[c.min(made.len() - 1)].as_slice()[p][c]));
            [pixels.iter().map(sent).collect(), pixels.iter().map(|&p| photograph[p].as_dvec3()).collect()]
        })
        .collect();
    let scale = |c: usize| {
        let sums = pairs.iter().map(|[sent, observed]| {
            // Each photograph has the same weight, regardless of its exposure.
            let norm = observed.iter().map(|p| p.length_squared()).sum::<f64>().max(f64::MIN_POSITIVE);
            let product = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).map(|(a, b)| a[c] * b[c]).sum::<f64>() / norm;
            (product(sent, observed), product(sent, sent))
        });
        let (above, below) = sums.fold((0.0, 0.0), |(a, b), (x, y)| (a + x, b + y));
        above / below.max(f64::MIN_POSITIVE)
    };
    let colour = if coloured { DVec3::new(scale(0), scale(1), scale(2)) } else { DVec3::ONE };
    let flat = |pixels: &[DVec3], by: DVec3| pixels.iter().flat_map(|p| (*p * by).to_array()).collect::<Vec<f64>>();
    let errors: Vec<f64> = pairs
        .iter()
        .map(|[sent, observed]| relight(&flat(sent, colour), &flat(observed, DVec3::ONE)).relative)
        .collect();
    mean(&errors)
}

#[cfg(test)]
mod tests {
    use super::super::planted;
    use super::*;

    #[test]
    fn a_ball_in_its_own_colour_has_no_error() {
        let truth = BivariateTable::from_fn(|h, d| 0.1 + 3.0 * (-(h / 0.2).powi(2)).exp() + 0.05 * d);
        let ball = planted::ball(&truth);
        let errors = RgbErrors::of(&ball, 0, (&truth.scaled(3.0), &Colouring::Grey, &Colouring::Grey));
        assert!(errors.estimate < 1e-6 && errors.one < 1e-6, "{errors:?}");
        let red = Colouring::Median(gonio::colour::Chroma([1.0, 0.0]));
        let errors = RgbErrors::of(&ball, 0, (&truth, &red, &Colouring::Grey));
        assert!(errors.estimate > 0.2 && errors.grey < 1e-6, "{errors:?}");
    }
}
