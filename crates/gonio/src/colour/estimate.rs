//! Estimate of the colours of a material, with its uncertainty.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::chroma::Chroma;
use super::field::{ChromaField, SavedChroma};
use crate::reflectance::BivariateTable;

/// Quantiles of the draws at the steps of the strip of a [`ChromaInterval`].
const STRIP_SHARES: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

/// A chroma and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChromaInterval {
    /// Estimate, `(ln R/G, ln B/G)`.
    pub chroma: Chroma,
    /// 90 % interval of both components, from 5 to 95 %.
    pub interval: [[f64; 2]; 2],
    /// Standard deviation of both components.
    pub sd: [f64; 2],
    /// Chromas at 5, 25, 50, 75 and 95 % of the draws along the direction in which they vary most.
    pub strip: [Chroma; 5],
}

impl ChromaInterval {
    /// Computes the uncertainty from equally likely draws; zero without draws.
    pub fn of(chroma: Chroma, draws: &[Chroma]) -> Self {
        if draws.is_empty() {
            let interval = chroma.0.map(|x| [x, x]);
            return Self { chroma, interval, sd: [0.0; 2], strip: [chroma; 5] };
        }
        let count = draws.len() as f64;
        let mean = [0, 1].map(|c| draws.iter().map(|draw| draw.0[c]).sum::<f64>() / count);
        let product = |i: usize, j: usize| {
            draws.iter().map(|draw| (draw.0[i] - mean[i]) * (draw.0[j] - mean[j])).sum::<f64>() / count
        };
        let (a, b, d) = (product(0, 0), product(0, 1), product(1, 1));
        let angle = 0.5 * (2.0 * b).atan2(a - d);
        let axis = [angle.cos(), angle.sin()];
        let quantiles = |values: &mut dyn Iterator<Item = f64>, shares: &[f64]| -> Vec<f64> {
            let mut sorted: Vec<f64> = values.collect();
            sorted.sort_by(f64::total_cmp);
            shares.iter().map(|share| sorted[((share * count) as usize).min(sorted.len() - 1)]).collect()
        };
        let interval = [0, 1].map(|c| {
            let ends = quantiles(&mut draws.iter().map(|draw| draw.0[c]), &[0.05, 0.95]);
            [ends[0], ends[1]]
        });
        let along = |draw: &Chroma| (draw.0[0] - mean[0]) * axis[0] + (draw.0[1] - mean[1]) * axis[1];
        let places = quantiles(&mut draws.iter().map(along), &STRIP_SHARES);
        let strip = [0, 1, 2, 3, 4].map(|k| Chroma([mean[0] + places[k] * axis[0], mean[1] + places[k] * axis[1]]));
        Self { chroma, interval, sd: [a.max(0.0).sqrt(), d.max(0.0).sqrt()], strip }
    }
}

/// Colours of a material and of the light, with their uncertainty.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourEstimate {
    /// Chroma of every cell.
    pub field: ChromaField,
    /// Equally likely fields, with which draws of the luminance are paired in turn.
    pub draws: Vec<ChromaField>,
    /// Chroma of the body ([`ChromaField::body`]).
    pub body: ChromaInterval,
    /// Chroma of the highlight ([`ChromaField::highlight`]).
    pub highlight: ChromaInterval,
    /// Chroma of the light, as returned by [`white_chroma`](super::white_chroma).
    pub light: ChromaInterval,
    /// Whether the chroma of the light was given.
    pub light_given: bool,
}

impl ColourEstimate {
    /// Summarises fields of a material whose luminance is `table`.
    ///
    /// The last argument contains the chroma of the light, its draws, and whether it was given.
    pub(crate) fn of(
        table: &BivariateTable,
        field: ChromaField,
        draws: Vec<ChromaField>,
        (light, of_light, light_given): (Chroma, &[Chroma], bool),
    ) -> Self {
        let part = |chroma: fn(&ChromaField, &BivariateTable) -> Chroma| {
            let of_draws: Vec<Chroma> = draws.iter().map(|draw| chroma(draw, table)).collect();
            ChromaInterval::of(chroma(&field, table), &of_draws)
        };
        let (body, highlight) = (part(ChromaField::body), part(ChromaField::highlight));
        Self { body, highlight, light: ChromaInterval::of(light, of_light), light_given, field, draws }
    }

    /// Adds an error to the chroma of every draw, the same in all cells.
    ///
    /// The error has the standard deviation `sd` in both components. `table` is the luminance of
    /// the material. The same `seed` adds the same errors.
    pub(crate) fn add_error(&mut self, table: &BivariateTable, sd: f64, seed: u64) {
        let mut rng = Pcg64::seed_from_u64(seed);
        for draw in &mut self.draws {
            let error = [0; 2].map(|_| sd * Distribution::<f64>::sample(&StandardNormal, &mut rng));
            *draw = draw.shifted(Chroma(error));
        }
        let light = (self.light.chroma, &[][..], self.light_given);
        let whole = Self::of(table, self.field.clone(), std::mem::take(&mut self.draws), light);
        *self = Self { light: self.light, ..whole };
    }

    /// Returns the part that is combined with other photographs.
    pub fn saved(&self) -> SavedChroma {
        SavedChroma::of(&self.field, self.body.sd)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_contain_nine_of_ten_draws() {
        let draws: Vec<Chroma> = (0..1000).map(|i| f64::from(i) / 1000.0).map(|x| Chroma([x, -2.0 * x])).collect();
        let found = ChromaInterval::of(Chroma([0.5, -1.0]), &draws);
        assert!((found.interval[0][0] - 0.05).abs() < 0.01 && (found.interval[0][1] - 0.95).abs() < 0.01);
        assert!((found.sd[1] / found.sd[0] - 2.0).abs() < 1e-9);
        // The strip runs along the draws.
        for (chroma, share) in found.strip.iter().zip(STRIP_SHARES) {
            assert!((chroma.0[1] + 2.0 * chroma.0[0]).abs() < 1e-9);
            assert!((chroma.0[0] - share).abs() < 0.01 || (chroma.0[0] - (1.0 - share)).abs() < 0.01);
        }
        assert_eq!(ChromaInterval::of(Chroma([0.1, 0.2]), &[]).interval, [[0.1, 0.1], [0.2, 0.2]]);
    }
}
