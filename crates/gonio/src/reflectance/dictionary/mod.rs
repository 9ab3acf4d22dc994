//! Prior of materials: measured ones, analytic ones, and interpolations between them.
//!
//! A hundred measured materials are samples of `p(F)`, too few to represent every paint. Other
//! kinds of materials ([`MaterialKind`]) fill the space between and around them. Some modify or
//! combine measured materials: they narrow or widen highlights, interpolate, or add a second
//! material, a diffuse reflector or a coat. Others are formulas of dielectrics, metals and cloth.
//!
//! Every material is a non-negative mixture of a fixed set of *components*, so a few numbers
//! describe it. A smooth random [`MaterialField`] multiplies a part of the mixtures, because real
//! materials differ from every mixture.

mod components;
mod field;
mod prior;

use crate::parallel;
use crate::statistics::median;
use gonio_linalg::principal_axes;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::log_basis::LogBasis;
use super::table::{BivariateTable, CELLS, trusted_cells};
use components::Layout;
pub use field::MaterialField;
pub(crate) use field::unit_field;
pub use prior::{MaterialKind, Prior};

/// Floor of the logarithm in [`LatentSpace`], relative to the median of a table.
const LOG_FLOOR: f64 = 1e-3;

/// Components of albedo one, with weights that are positive and sum to one.
pub type Mixture = Vec<(usize, f64)>;

/// A material of the prior.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnMaterial {
    /// Components and their weights.
    pub mixture: Mixture,
    /// Factor of each cell of the mixture's table; `None` means a factor of one everywhere.
    pub field: Option<MaterialField>,
}

/// Coordinates of the space of materials: principal axes of the logarithm of tables without their
/// scale, over the trusted cells.
#[derive(Clone, Debug, PartialEq)]
pub struct LatentSpace {
    /// Mean of the logarithms over the prior, one value for each cell; zero in cells that are not
    /// trusted.
    pub mean: Vec<f32>,
    /// Axes, divided by the standard deviation along them: each coordinate has unit variance under
    /// the prior.
    pub axes: Vec<Vec<f32>>,
}

/// Components, and mixtures of them that represent the prior of materials.
#[derive(Clone, Debug, PartialEq)]
pub struct Dictionary {
    /// Measured materials, which are the first components and the first entries.
    pub measured: LogBasis,
    /// Tables of albedo one along the normal; the measured ones come first.
    pub components: Vec<BivariateTable>,
    /// Albedo of each component before it was scaled to one.
    albedos: Vec<f64>,
    /// Entries: each measured material alone, then draws from the prior.
    pub entries: Vec<DrawnMaterial>,
    /// Coordinates of the space of materials.
    pub latent_space: LatentSpace,
    /// Coordinates of each entry.
    pub coordinates: Vec<Vec<f64>>,
}

/// Settings of a dictionary.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DictionarySettings {
    /// Number of draws from the prior in addition to the measured materials.
    pub draws: usize,
    /// Number of coordinates.
    pub dimensions: usize,
    /// Seed of the draws.
    pub seed: u64,
    /// Prior of the draws.
    pub prior: Prior,
}

impl Default for DictionarySettings {
    fn default() -> Self {
        Self { draws: 1600, dimensions: 32, seed: 1, prior: Prior::default() }
    }
}

impl LatentSpace {
    /// Computes the coordinates of a table, which do not depend on its scale.
    pub fn of(&self, table: &BivariateTable) -> Vec<f64> {
        let mut log = relative_log(table);
        log.iter_mut().zip(&self.mean).for_each(|(x, m)| *x -= f64::from(*m));
        let axis = |axis: &Vec<f32>| {
            // Eight sums that do not wait for each other.
            let mut sums = [0.0; 8];
            for (x, a) in log.chunks(8).zip(axis.chunks(8)) {
                sums.iter_mut().zip(x.iter().zip(a)).for_each(|(sum, (x, a))| *sum += x * f64::from(*a));
            }
            sums.iter().sum()
        };
        self.axes.iter().map(axis).collect()
    }

    /// Returns the change of the logarithm per unit of each coordinate: the axis times the variance
    /// along it.
    pub(crate) fn directions(&self) -> Vec<Vec<f32>> {
        let scaled = |axis: &Vec<f32>| {
            let square = axis.iter().map(|a| f64::from(*a).powi(2)).sum::<f64>().max(1e-300);
            axis.iter().map(|a| (f64::from(*a) / square) as f32).collect()
        };
        self.axes.iter().map(scaled).collect()
    }

    /// Computes the tables of materials with these coordinates, each with an arbitrary scale.
    ///
    /// A table is `exp(mean + sum_k z_k a_k)`, with `a_k` the axis times the variance along it.
    /// Cells beyond the trusted ones have the value of the nearest trusted cell.
    ///
    /// # Panics
    /// If the coordinates of a material do not have a number for each axis.
    pub fn tables(&self, materials: &[Vec<f64>]) -> Vec<BivariateTable> {
        let directions = self.directions();
        let table = |coordinates: &Vec<f64>| {
            assert_eq!(coordinates.len(), self.axes.len());
            let mut log = self.mean.clone();
            for (axis, z) in directions.iter().zip(coordinates) {
                log.iter_mut().zip(axis).for_each(|(l, a)| *l += *z as f32 * a);
            }
            // No measured value is farther from the mean than this.
            let mut table = BivariateTable::from_vec(log.into_iter().map(|l| l.clamp(-25.0, 25.0).exp()).collect());
            table.extend_from_trusted();
            table
        };
        parallel::map(materials, table)
    }
}

/// Computes the logarithm of a table plus its floor, shifted to mean zero over the trusted cells;
/// zero elsewhere.
pub(crate) fn relative_log(table: &BivariateTable) -> Vec<f64> {
    let values = table.as_slice();
    let count = trusted_cells().count();
    let median = median(trusted_cells().map(|c| values[c])).unwrap_or(0.0);
    let floor = (LOG_FLOOR * f64::from(median)).max(1e-30);
    let mut log = vec![0.0; CELLS];
    for c in trusted_cells() {
        log[c] = (f64::from(values[c]).max(0.0) + floor).ln();
    }
    let mean = log.iter().sum::<f64>() / count as f64;
    trusted_cells().for_each(|c| log[c] -= mean);
    log
}

impl Dictionary {
    /// Builds a dictionary from measured materials. The same seed gives the same dictionary.
    ///
    /// # Panics
    /// If there are no materials.
    pub fn new(measured: LogBasis, settings: &DictionarySettings) -> Self {
        let mut dictionary = Self::components_of(measured);
        let mut rng = Pcg64::seed_from_u64(settings.seed);
        let alone = (0..dictionary.measured.len()).map(|m| DrawnMaterial { mixture: vec![(m, 1.0)], field: None });
        let entries = alone.chain((0..settings.draws).map(|_| dictionary.draw(&settings.prior, &mut rng))).collect();
        dictionary.entries = entries;
        let logs: Vec<Vec<f64>> = parallel::map(&dictionary.entries, |e| relative_log(&dictionary.table(e)));
        let (mean, axes, variances) = principal_axes(&logs, settings.dimensions);
        let scaled = |(axis, v): (&Vec<f64>, &f64)| axis.iter().map(|a| (a / v.sqrt()) as f32).collect();
        dictionary.latent_space = LatentSpace {
            mean: mean.iter().map(|v| *v as f32).collect(),
            axes: axes.iter().zip(&variances).map(scaled).collect(),
        };
        dictionary.coordinates =
            parallel::map(&dictionary.entries, |e| dictionary.latent_space.of(&dictionary.table(e)));
        dictionary
    }

    fn layout(&self) -> Layout {
        Layout { measured: self.measured.len() }
    }

    fn components_of(measured: LogBasis) -> Self {
        assert!(!measured.is_empty(), "no materials");
        let (components, albedos) = components::components(&measured);
        Self {
            measured,
            components,
            albedos,
            entries: Vec::new(),
            latent_space: LatentSpace { mean: Vec::new(), axes: Vec::new() },
            coordinates: Vec::new(),
        }
    }

    /// Returns the table of a material. Without its field, the table has albedo one along the
    /// normal.
    pub fn table(&self, material: &DrawnMaterial) -> BivariateTable {
        let mut sum = vec![0.0_f32; CELLS];
        for &(component, weight) in &material.mixture {
            let values = self.components[component].as_slice();
            sum.iter_mut().zip(values).for_each(|(sum, v)| *sum += weight as f32 * v);
        }
        if let Some(field) = &material.field {
            sum.iter_mut().zip(field.logs()).for_each(|(v, log)| *v *= log.exp());
        }
        BivariateTable::from_vec(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured() -> LogBasis {
        let lobe = |w: f64, s: f64| {
            BivariateTable::from_fn(move |h, d| 0.05 + s * (-(h / w).powi(2)).exp() * (1.0 + d.powi(4)))
        };
        let set = [(0.05, 30.0), (0.1, 8.0), (0.2, 2.0), (0.5, 0.3), (1.0, 0.05)];
        let tables: Vec<(String, BivariateTable)> =
            set.iter().map(|&(w, s)| (format!("lobe {w}"), lobe(w, s))).collect();
        LogBasis::fit(&tables, 10)
    }

    #[test]
    fn a_full_basis_reproduces_its_materials() {
        let set = [0.1, 0.3, 0.9].map(|w| (w.to_string(), crate::testing::lobe(0.05, 1.0, w)));
        let basis = LogBasis::fit(&set, 9);
        assert_eq!((basis.len(), basis.axes.len()), (3, 2));
        for (m, (_, table)) in set.iter().enumerate() {
            for c in trusted_cells() {
                assert!((basis.table(m).as_slice()[c] / table.as_slice()[c] - 1.0).abs() < 1e-4);
            }
        }
        // The basis has no more axes than requested.
        assert_eq!(LogBasis::fit(&set, 1).axes.len(), 1);
    }

    #[test]
    fn draws_are_mixtures_of_albedo_one() {
        let dictionary = Dictionary::new(measured(), &DictionarySettings { draws: 60, ..Default::default() });
        assert_eq!(dictionary.entries.len(), 65);
        for (entry, coordinates) in dictionary.entries.iter().zip(&dictionary.coordinates) {
            assert!((entry.mixture.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-12);
            let table = dictionary.table(entry);
            let plain = dictionary.table(&DrawnMaterial { field: None, ..entry.clone() });
            assert!((plain.normal_albedo() - 1.0).abs() < 1e-3);
            for (a, b) in dictionary.latent_space.of(&table).iter().zip(coordinates) {
                assert!((a - b).abs() < 1e-3, "{a} {b}");
            }
        }
        // Coordinates have variance one over the entries.
        for k in 0..dictionary.latent_space.axes.len() {
            let square: f64 = dictionary.coordinates.iter().map(|p| p[k] * p[k]).sum();
            assert!((square / 65.0 - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn tables_have_the_coordinates_of_their_places() {
        // Six axes cannot express the fields.
        let prior = Prior { fields: 0.0, ..Prior::default() };
        let settings = DictionarySettings { draws: 40, dimensions: 6, prior, ..Default::default() };
        let dictionary = Dictionary::new(measured(), &settings);
        let materials = &dictionary.coordinates[..8];
        let log_rms = |a: &BivariateTable, b: &BivariateTable| {
            let (a, b) = (relative_log(a), relative_log(b));
            (a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / CELLS as f64).sqrt()
        };
        for (at, (table, coordinates)) in dictionary.latent_space.tables(materials).iter().zip(materials).enumerate() {
            // The floor of the logarithm distorts values near it.
            for (a, b) in dictionary.latent_space.of(table).iter().zip(coordinates) {
                assert!((a - b).abs() < 0.1, "{at}: {a} {b}");
            }
            let error = log_rms(table, &dictionary.table(&dictionary.entries[at]));
            assert!(error < 0.3, "{at}: {error}");
        }
    }

    #[test]
    fn coordinates_do_not_depend_on_the_scale() {
        // Use fewer axes than the tables span: coordinates along further axes would be round-off.
        let settings = DictionarySettings { draws: 20, dimensions: 6, ..Default::default() };
        let dictionary = Dictionary::new(measured(), &settings);
        let table = dictionary.table(&dictionary.entries[7]);
        let bright = table.scaled(50.0);
        let (a, b) = (dictionary.latent_space.of(&table), dictionary.latent_space.of(&bright));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-4));
    }
}
