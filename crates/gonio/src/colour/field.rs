//! Chroma of a BRDF at every pair of angles.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::chroma::{Chroma, luminance_weights};
use crate::reflectance::{BivariateTable, CELLS, THETA_D, THETA_H, angles_of, trusted_cells};

/// Range of half angles (degrees) of the cells that determine the colour of the body.
const BODY_HALF_ANGLES: (f64, f64) = (30.0, 70.0);

/// Largest half angle (degrees) of the cells that determine the colour of the highlight.
const HIGHLIGHT_HALF_ANGLE: f64 = 2.0;

/// Largest difference angle (degrees) of the cells that determine either colour: at grazing angles,
/// every material reflects like a mirror.
const MAX_DIFFERENCE_ANGLE: f64 = 60.0;

/// Smallest ratio of a channel to the luminance.
const MIN_RATIO: f32 = 1e-5;

/// Ratio of each channel to the luminance in every cell of a table.
///
/// A BRDF in colour is `F_c = x_c F` with its luminance `F` and the field `x_c`, whose luminance is
/// one in every cell. Every material has such a field, whatever its number of colours.
#[derive(Clone, Debug, PartialEq)]
pub struct ChromaField {
    /// Red, green and blue; `None` for grey.
    ratios: Option<Box<[Vec<f32>; 3]>>,
}

impl ChromaField {
    /// The field of a grey BRDF.
    pub const GREY: Self = Self { ratios: None };

    /// Returns the field with the same chroma in every cell.
    pub fn uniform(chroma: Chroma) -> Self {
        if chroma == Chroma::default() {
            return Self::GREY;
        }
        let rgb = chroma.rgb().as_vec3().to_array();
        Self { ratios: Some(Box::new(rgb.map(|value| vec![value; CELLS]))) }
    }

    /// Builds the field of three channels (red, green, blue).
    ///
    /// Each cell may have a factor that is common to its channels. A black cell is grey.
    pub fn of_tables(channels: &[BivariateTable; 3]) -> Self {
        Self::normalised(channels.each_ref().map(|table| table.as_slice().to_vec()))
    }

    /// Builds the field from logarithms of the channels, `[channel][cell]`.
    ///
    /// Each cell may have an additive constant that is common to its channels.
    ///
    /// # Panics
    /// If a channel does not have a value for each cell.
    pub fn of_logs(logs: [Vec<f32>; 3]) -> Self {
        let mut channels = logs;
        for cell in 0..CELLS {
            let top = channels.iter().map(|log| log[cell]).fold(f32::NEG_INFINITY, f32::max);
            channels.iter_mut().for_each(|log| log[cell] = (log[cell] - top).exp());
        }
        Self::normalised(channels)
    }

    fn normalised(mut channels: [Vec<f32>; 3]) -> Self {
        assert!(channels.iter().all(|channel| channel.len() == CELLS), "each channel must have a value for each cell");
        let weights = luminance_weights().map(|weight| weight as f32);
        for cell in 0..CELLS {
            let luminance: f32 = (0..3).map(|c| weights[c] * channels[c][cell].max(0.0)).sum();
            for channel in &mut channels {
                let ratio = if luminance > 0.0 { channel[cell] / luminance } else { 1.0 };
                channel[cell] = ratio.max(MIN_RATIO);
            }
        }
        Self { ratios: Some(Box::new(channels)) }
    }

    /// Whether every cell is grey by construction.
    pub fn is_grey(&self) -> bool {
        self.ratios.is_none()
    }

    /// Returns the ratios of a channel (0 red, 1 green, 2 blue) to the luminance by cell.
    ///
    /// Returns `None` for grey, where all ratios are one.
    pub fn ratios(&self, channel: usize) -> Option<&[f32]> {
        self.ratios.as_ref().map(|ratios| &ratios[channel][..])
    }

    /// Returns the tables of the channels (red, green, blue) for the luminance `table`.
    ///
    /// For grey, the tables are copies of `table`.
    pub fn tables(&self, table: &BivariateTable) -> [BivariateTable; 3] {
        [0, 1, 2].map(|c| match self.ratios(c) {
            None => table.clone(),
            Some(ratios) => {
                BivariateTable::from_vec(table.as_slice().iter().zip(ratios).map(|(value, x)| value * x).collect())
            }
        })
    }

    /// Returns the field with a chroma added in every cell.
    #[must_use]
    pub fn shifted(&self, by: Chroma) -> Self {
        let rgb = by.rgb().as_vec3().to_array();
        let channel = |c: usize| match self.ratios(c) {
            None => vec![rgb[c]; CELLS],
            Some(ratios) => ratios.iter().map(|ratio| rgb[c] * ratio).collect(),
        };
        Self::normalised([channel(0), channel(1), channel(2)])
    }

    /// Returns the chroma of the body of a BRDF of this luminance.
    ///
    /// The chroma is that of the sum over half angles of 30 to 70 degrees and difference angles up
    /// to 60 degrees.
    pub fn body(&self, table: &BivariateTable) -> Chroma {
        self.mean(table, |half| (BODY_HALF_ANGLES.0..=BODY_HALF_ANGLES.1).contains(&half))
    }

    /// Returns the chroma of the highlight of a BRDF of this luminance.
    ///
    /// The chroma is that of the sum over half angles up to 2 degrees and difference angles up to
    /// 60 degrees.
    pub fn highlight(&self, table: &BivariateTable) -> Chroma {
        self.mean(table, |half| half <= HIGHLIGHT_HALF_ANGLE)
    }

    fn mean(&self, table: &BivariateTable, counts: impl Fn(f64) -> bool) -> Chroma {
        let Some(ratios) = &self.ratios else { return Chroma::default() };
        let mut sum = DVec3::ZERO;
        for cell in trusted_cells().filter(|cell| cell % THETA_D > 0) {
            let (half, difference) = angles_of(cell);
            if difference.to_degrees() <= MAX_DIFFERENCE_ANGLE && counts(half.to_degrees()) {
                // No weight depends on the difference angle: the highlights of grazing light are no
                // brighter than others.
                let value = f64::from(table.as_slice()[cell]).max(0.0);
                sum += value * DVec3::from_array([0, 1, 2].map(|c| f64::from(ratios[c][cell])));
            }
        }
        Chroma::of(sum)
    }
}

/// Steps of the grid on which a field is saved, along half and difference angles.
const SAVED_STEPS: [usize; 2] = [6, 15];

/// A field on a coarse grid, with its uncertainty.
///
/// The grid contains every sixth half angle and every fifteenth difference angle of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SavedChroma {
    /// Logarithms of R/G, then of B/G, at each point of the grid, half angles first.
    pub log_ratios: [Vec<f32>; 2],
    /// Standard deviation of the chroma of the body, `(ln R/G, ln B/G)`.
    pub body_sd: [f64; 2],
}

impl SavedChroma {
    /// Samples a field on the grid.
    pub fn of(field: &ChromaField, body_sd: [f64; 2]) -> Self {
        let cells = || {
            (0..THETA_H)
                .step_by(SAVED_STEPS[0])
                .flat_map(|h| (0..THETA_D).step_by(SAVED_STEPS[1]).map(move |d| h * THETA_D + d))
        };
        let log = |c: usize, cell: usize| field.ratios(c).map_or(0.0, |ratios| ratios[cell].ln());
        let log_ratios = [0, 2].map(|c| cells().map(|cell| log(c, cell) - log(1, cell)).collect());
        Self { log_ratios, body_sd }
    }

    /// Whether all values are present and valid.
    pub fn is_sound(&self) -> bool {
        let [rows, columns] = [THETA_H.div_ceil(SAVED_STEPS[0]), THETA_D.div_ceil(SAVED_STEPS[1])];
        let complete = |logs: &Vec<f32>| logs.len() == rows * columns && logs.iter().all(|log| log.is_finite());
        self.log_ratios.iter().all(complete) && self.body_sd.iter().all(|sd| sd.is_finite() && *sd >= 0.0)
    }

    /// Returns the field, interpolated bilinearly between the points of the grid.
    ///
    /// # Panics
    /// If the values are not [valid](Self::is_sound).
    pub fn field(&self) -> ChromaField {
        let [rows, columns] = [THETA_H.div_ceil(SAVED_STEPS[0]), THETA_D.div_ceil(SAVED_STEPS[1])];
        let at = |logs: &[f32], cell: usize| {
            let place = |index: usize, step: usize, count: usize| {
                let x = (index as f32 / step as f32).min((count - 1) as f32);
                let below = (x as usize).min(count - 2);
                (below, x - below as f32)
            };
            let ((h, of_h), (d, of_d)) =
                (place(cell / THETA_D, SAVED_STEPS[0], rows), place(cell % THETA_D, SAVED_STEPS[1], columns));
            let row = |h: usize| (1.0 - of_d) * logs[h * columns + d] + of_d * logs[h * columns + d + 1];
            (1.0 - of_h) * row(h) + of_h * row(h + 1)
        };
        let channel = |logs: &Vec<f32>| (0..CELLS).map(|cell| at(logs, cell)).collect();
        let [red, blue] = self.log_ratios.each_ref().map(channel);
        ChromaField::of_logs([red, vec![0.0; CELLS], blue])
    }

    /// Returns the mean of fields, weighted by inverse variances; `None` without fields.
    pub fn mean(all: &[Self]) -> Option<Self> {
        let first = all.first()?;
        let weights: Vec<f64> =
            all.iter().map(|one| 1.0 / (1e-4 + one.body_sd.iter().map(|sd| sd * sd).sum::<f64>())).collect();
        let total: f64 = weights.iter().sum();
        let log_ratios = [0, 1].map(|c| {
            let point = |at: usize| {
                let sum: f64 = all.iter().zip(&weights).map(|(one, w)| w * f64::from(one.log_ratios[c][at])).sum();
                (sum / total) as f32
            };
            (0..first.log_ratios[c].len()).map(point).collect()
        });
        let sd = |c: usize| (all.iter().map(|one| one.body_sd[c].max(1e-3).powi(-2)).sum::<f64>()).powf(-0.5);
        Some(Self { log_ratios, body_sd: [sd(0), sd(1)] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::luminance;

    fn lobe(width: f64, height: f64, base: f64) -> BivariateTable {
        BivariateTable::from_fn(move |h, _| base + height * (-(h / width).powi(2)).exp())
    }

    #[test]
    fn recovers_the_channels_of_any_material() {
        let channels = [lobe(0.1, 1.0, 0.5), lobe(0.2, 1.5, 1e-3), lobe(0.05, 0.7, 0.1)];
        let table = BivariateTable::luminance(&channels);
        let back = ChromaField::of_tables(&channels).tables(&table);
        for (made, want) in back.iter().zip(&channels) {
            for (made, want) in made.as_slice().iter().zip(want.as_slice()) {
                assert!((made - want).abs() <= 1e-4 * want.max(1e-2), "{made} {want}");
            }
        }
    }

    #[test]
    fn keeps_the_luminance_of_every_cell() {
        let logs = [0.3_f32, -2.0, 1.5].map(|log| (0..CELLS).map(|cell| log * (cell % 7) as f32).collect());
        let table = lobe(0.1, 3.0, 0.2);
        let made = ChromaField::of_logs(logs).tables(&table);
        for (cell, want) in table.as_slice().iter().enumerate() {
            let rgb = glam::Vec3::from_array([0, 1, 2].map(|c| made[c].as_slice()[cell]));
            assert!((luminance(rgb) - want).abs() < 1e-4 * want, "{rgb} {want}");
        }
    }

    #[test]
    fn body_and_highlight_have_the_colours_of_their_cells() {
        let (base, peak) = (DVec3::new(0.6, 0.2, 0.1), DVec3::ONE);
        let channels = [0, 1, 2].map(|c| lobe(0.05, 100.0 * peak[c], base[c]));
        let (table, field) = (BivariateTable::luminance(&channels), ChromaField::of_tables(&channels));
        assert!(field.body(&table).distance(Chroma::of(base)) < 1e-3);
        assert!(field.highlight(&table).distance(Chroma::of(peak)) < 0.02);
        let moved = field.shifted(Chroma([0.3, -0.1]));
        let want = field.body(&table).0;
        assert!(moved.body(&table).distance(Chroma([want[0] + 0.3, want[1] - 0.1])) < 1e-3);
        let one = ChromaField::uniform(Chroma([0.4, -0.2]));
        assert!(one.body(&table).distance(one.highlight(&table)) < 1e-6);
        assert!(ChromaField::GREY.is_grey() && ChromaField::uniform(Chroma::default()).is_grey());
    }

    #[test]
    fn recovers_a_saved_field() {
        let channels = [lobe(0.3, 1.0, 0.5), lobe(0.4, 1.5, 0.2), lobe(0.3, 0.7, 0.1)];
        let field = ChromaField::of_tables(&channels);
        let table = BivariateTable::luminance(&channels);
        let saved = SavedChroma::of(&field, [0.1, 0.2]);
        assert!(saved.is_sound());
        let back = saved.field();
        assert!(back.body(&table).distance(field.body(&table)) < 0.02);
        assert!(back.highlight(&table).distance(field.highlight(&table)) < 0.02);
        // The mean of a certain and an uncertain field is close to the certain one.
        let other = SavedChroma::of(&ChromaField::uniform(Chroma([1.0, 1.0])), [10.0, 10.0]);
        let mean = SavedChroma::mean(&[saved.clone(), other]).unwrap();
        assert!(mean.field().body(&table).distance(field.body(&table)) < 0.03);
        assert!(SavedChroma::mean(&[]).is_none());
    }

    #[test]
    fn a_black_cell_is_grey() {
        let dark = BivariateTable::from_fn(|_, _| 0.0);
        let field = ChromaField::of_tables(&[dark.clone(), dark.clone(), dark]);
        assert!((0..3).all(|c| field.ratios(c).is_some_and(|ratios| ratios.iter().all(|x| *x == 1.0))));
    }
}
