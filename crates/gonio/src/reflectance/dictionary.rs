//! A prior of materials: measured ones, analytic ones, and what lies between them.
//!
//! A hundred measured materials are samples of `p(F)`, too few to stand for every paint. Sums of two of them, of one and a
//! diffuse reflector, and a family of formulas (Lambert and GGX) fill the space between and around. Everything is a non-negative mixture of a few
//! *components*, so that images of any of it are the same mixtures of the components' images.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::log_basis::LogBasis;
use super::parametric::{Ggx, Lambert, Parametric};
use super::table::{BivariateTable, CELLS, THETA_D, is_trusted};
use crate::linalg::principal_axes;

/// Widths of the analytic lobes; those between are mixtures of neighbours.
const ALPHAS: [f64; 12] = [0.02, 0.03, 0.045, 0.065, 0.09, 0.13, 0.18, 0.25, 0.35, 0.5, 0.7, 1.0];

/// Floor of the logarithm in [`Coordinates`], relative to the median of a table.
const FLOOR: f64 = 1e-3;

/// Weights, positive with sum one, of components of albedo one.
pub type Mixture = Vec<(usize, f64)>;

/// Where tables lie in the space of materials: principal axes of the logarithm of tables without their scale, over the trusted cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Coordinates {
    /// Mean of the logarithms over the prior, one value for each cell; zero in cells that are not trusted.
    pub mean: Vec<f32>,
    /// Axes, divided by the standard deviation along them: each coordinate has variance one over the prior.
    pub axes: Vec<Vec<f32>>,
}

/// Components and mixtures of them that stand for the prior of materials.
#[derive(Clone, Debug, PartialEq)]
pub struct Dictionary {
    /// The measured materials, which are the first components and the first entries.
    pub measured: LogBasis,
    /// Tables of albedo one along the normal: measured, then Lambert, then GGX lobes in pairs (no reflectance along the normal, full reflectance).
    pub components: Vec<BivariateTable>,
    /// Albedo of each component before it was scaled to one.
    albedos: Vec<f64>,
    /// Entries: each measured material alone, then draws from the prior.
    pub entries: Vec<Mixture>,
    /// The space they lie in.
    pub coordinates: Coordinates,
    /// Where each entry lies.
    pub places: Vec<Vec<f64>>,
}

/// How a dictionary is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DictionarySettings {
    /// Draws from the prior beside the measured materials.
    pub draws: usize,
    /// Number of coordinates.
    pub dimensions: usize,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for DictionarySettings {
    fn default() -> Self {
        Self { draws: 600, dimensions: 8, seed: 1 }
    }
}

impl Coordinates {
    /// Coordinates of a table; its scale does not matter.
    pub fn of(&self, table: &BivariateTable) -> Vec<f64> {
        let log = relative_log(table);
        let axis = |axis: &Vec<f32>| {
            let terms = log.iter().zip(&self.mean).zip(axis);
            terms.map(|((x, m), a)| (x - f64::from(*m)) * f64::from(*a)).sum()
        };
        self.axes.iter().map(axis).collect()
    }
}

/// Logarithm of a table above its floor, with mean zero over the trusted cells; zero elsewhere.
pub(crate) fn relative_log(table: &BivariateTable) -> Vec<f64> {
    let trusted = |c: &usize| is_trusted(c / THETA_D, c % THETA_D);
    let values = table.as_slice();
    let mut kept: Vec<f32> = (0..CELLS).filter(trusted).map(|c| values[c]).collect();
    let count = kept.len();
    let (_, median, _) = kept.select_nth_unstable_by(count / 2, f32::total_cmp);
    let floor = (FLOOR * f64::from(*median)).max(1e-30);
    let mut log = vec![0.0; CELLS];
    for c in (0..CELLS).filter(trusted) {
        log[c] = (f64::from(values[c]) + floor).ln();
    }
    let mean = log.iter().sum::<f64>() / count as f64;
    (0..CELLS).filter(trusted).for_each(|c| log[c] -= mean);
    log
}

impl Dictionary {
    /// Of measured materials. Deterministic for a seed.
    ///
    /// # Panics
    /// Without materials.
    pub fn new(measured: LogBasis, settings: &DictionarySettings) -> Self {
        let mut dictionary = Self::components_of(measured);
        let mut rng = Pcg64::seed_from_u64(settings.seed);
        let alone = (0..dictionary.measured.len()).map(|m| vec![(m, 1.0)]);
        let entries = alone.chain((0..settings.draws).map(|_| dictionary.draw(&mut rng))).collect();
        dictionary.entries = entries;
        let logs: Vec<Vec<f64>> = dictionary.entries.par_iter().map(|e| relative_log(&dictionary.table(e))).collect();
        let (mean, axes, variances) = principal_axes(&logs, settings.dimensions);
        let scaled = |(axis, v): (&Vec<f64>, &f64)| axis.iter().map(|a| (a / v.sqrt()) as f32).collect();
        dictionary.coordinates = Coordinates {
            mean: mean.iter().map(|v| *v as f32).collect(),
            axes: axes.iter().zip(&variances).map(scaled).collect(),
        };
        dictionary.locate();
        dictionary
    }

    /// The dictionary with entries and coordinates that were made before.
    pub fn restore(measured: LogBasis, entries: Vec<Mixture>, coordinates: Coordinates) -> Self {
        let mut dictionary = Self { entries, coordinates, ..Self::components_of(measured) };
        dictionary.locate();
        dictionary
    }

    fn locate(&mut self) {
        self.places = self.entries.par_iter().map(|e| self.coordinates.of(&self.table(e))).collect();
    }

    /// Number of components of a dictionary of so many measured materials.
    pub fn components_with(measured: usize) -> usize {
        measured + 1 + 2 * ALPHAS.len()
    }

    fn components_of(measured: LogBasis) -> Self {
        assert!(!measured.is_empty(), "no materials");
        let mut components: Vec<BivariateTable> =
            (0..measured.len()).into_par_iter().map(|m| measured.table(m)).collect();
        components.push(Lambert { albedo: 1.0 }.to_bivariate());
        for alpha in ALPHAS {
            components.extend(Ggx::lobes(alpha));
        }
        let albedos: Vec<f64> = components.par_iter().map(|t| t.normal_albedo().max(1e-12)).collect();
        for (table, albedo) in components.iter_mut().zip(&albedos) {
            table.as_mut_slice().iter_mut().for_each(|v| *v = (f64::from(*v) / albedo) as f32);
        }
        Self {
            measured,
            components,
            albedos,
            entries: Vec::new(),
            coordinates: Coordinates { mean: Vec::new(), axes: Vec::new() },
            places: Vec::new(),
        }
    }

    /// The table of a mixture, of albedo one.
    pub fn table(&self, mixture: &[(usize, f64)]) -> BivariateTable {
        let mut sum = vec![0.0_f32; CELLS];
        for &(component, weight) in mixture {
            let values = self.components[component].as_slice();
            sum.iter_mut().zip(values).for_each(|(sum, v)| *sum += weight as f32 * v);
        }
        BivariateTable::from_vec(sum)
    }

    /// A material drawn from the prior: in 45 of 100 cases a measured one, in 20 two of them, in 15 one above a diffuse
    /// base, and else a dielectric or a metal by formula.
    pub fn draw(&self, rng: &mut Pcg64) -> Mixture {
        let measured = self.measured.len();
        let lambert = measured;
        let pick = |rng: &mut Pcg64| rng.random_range(0..measured);
        let kind: f64 = rng.random_range(0.0..1.0);
        let (first, share) = (pick(rng), rng.random_range(0.0..1.0));
        let mixture = if kind < 0.45 {
            vec![(first, 1.0)]
        } else if kind < 0.65 {
            vec![(first, share), (pick(rng), 1.0 - share)]
        } else if kind < 0.8 {
            vec![(first, share), (lambert, 1.0 - share)]
        } else {
            let between = |rng: &mut Pcg64, low: f64, high: f64| -> f64 { rng.random_range(low..high) };
            let (f0, diffuse) = if between(rng, 0.0, 1.0) < 0.65 {
                (between(rng, 0.02, 0.08), between(rng, 0.02_f64.ln(), 0.8_f64.ln()).exp())
            } else {
                (between(rng, 0.3, 1.0), between(rng, 0.002_f64.ln(), 0.2_f64.ln()).exp())
            };
            let width = between(rng, 0.0, (ALPHAS.len() - 1) as f64);
            let (narrow, blend) = ((width as usize).min(ALPHAS.len() - 2), width.fract());
            let mut parts = vec![(lambert, diffuse)];
            for (lobe, share) in [(narrow, 1.0 - blend), (narrow + 1, blend)] {
                parts.push((lambert + 1 + 2 * lobe, share * (1.0 - f0)));
                parts.push((lambert + 2 + 2 * lobe, share * f0));
            }
            parts.into_iter().map(|(c, weight)| (c, weight * self.albedos[c])).collect()
        };
        let total: f64 = mixture.iter().map(|(_, w)| w).sum();
        mixture.into_iter().filter(|(_, w)| *w > 0.0).map(|(c, w)| (c, w / total)).collect()
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
    fn a_full_basis_holds_its_materials() {
        let lobe = |w: f64| BivariateTable::from_fn(move |h, _| 0.05 + (-(h / w).powi(2)).exp());
        let set: Vec<(String, BivariateTable)> = [0.1, 0.3, 0.9].map(|w| (w.to_string(), lobe(w))).into();
        let basis = LogBasis::fit(&set, 9);
        assert_eq!((basis.len(), basis.axes.len()), (3, 2));
        for (m, (_, table)) in set.iter().enumerate() {
            for c in (0..CELLS).filter(|c| is_trusted(c / THETA_D, c % THETA_D)) {
                assert!((basis.table(m).as_slice()[c] / table.as_slice()[c] - 1.0).abs() < 1e-4);
            }
        }
        // Fewer axes, larger error, but no bias of the mean.
        assert_eq!(LogBasis::fit(&set, 1).axes.len(), 1);
    }

    #[test]
    fn draws_are_mixtures_of_albedo_one() {
        let dictionary = Dictionary::new(measured(), &DictionarySettings { draws: 60, ..Default::default() });
        assert_eq!(dictionary.entries.len(), 65);
        for (entry, place) in dictionary.entries.iter().zip(&dictionary.places) {
            assert!((entry.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-12);
            let table = dictionary.table(entry);
            assert!((table.normal_albedo() - 1.0).abs() < 1e-3);
            for (a, b) in dictionary.coordinates.of(&table).iter().zip(place) {
                assert!((a - b).abs() < 1e-3, "{a} {b}");
            }
        }
        // Coordinates are of variance one over the entries.
        for k in 0..dictionary.coordinates.axes.len() {
            let square: f64 = dictionary.places.iter().map(|p| p[k] * p[k]).sum();
            assert!((square / 65.0 - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn scale_is_not_a_coordinate() {
        let dictionary = Dictionary::new(measured(), &DictionarySettings { draws: 20, ..Default::default() });
        let table = dictionary.table(&dictionary.entries[7]);
        let bright = BivariateTable::from_vec(table.as_slice().iter().map(|v| 50.0 * v).collect());
        let (a, b) = (dictionary.coordinates.of(&table), dictionary.coordinates.of(&bright));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-4));
    }

    #[test]
    fn a_dictionary_comes_back_from_its_parts() {
        let basis = measured();
        let made = Dictionary::new(basis.clone(), &DictionarySettings { draws: 30, ..Default::default() });
        let back = Dictionary::restore(basis, made.entries.clone(), made.coordinates.clone());
        assert_eq!(made, back);
    }

    #[test]
    fn formulas_are_drawn_with_their_own_reflectance() {
        // The lobes of full and of no reflectance make the lobe of any: Schlick's formula is linear in it.
        let dictionary = Dictionary::new(measured(), &DictionarySettings { draws: 1, ..Default::default() });
        let lambert = dictionary.measured.len();
        let (f0, lobe) = (0.3, 4);
        let parts = [(lambert + 1 + 2 * lobe, 1.0 - f0), (lambert + 2 + 2 * lobe, f0)];
        let mixture: Mixture = parts.iter().map(|&(c, w)| (c, w * dictionary.albedos[c])).collect();
        let table = dictionary.table(&mixture);
        let want = Ggx { diffuse: 0.0, f0, alpha: ALPHAS[lobe] }.to_bivariate();
        for (a, b) in table.as_slice().iter().zip(want.as_slice()) {
            assert!((a - b).abs() <= 1e-4 * b.abs() + 1e-7, "{a} {b}");
        }
    }
}
