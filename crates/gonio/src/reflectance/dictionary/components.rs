//! Components of a dictionary. The entries of the dictionary are mixtures of them.

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::super::log_basis::LogBasis;
use super::super::parametric::{Burley, Lambert, Parametric, Sheen, Undercoat, lobes};
use super::super::table::{BivariateTable, CELLS, THETA_D, THETA_H, theta_d_of, theta_h_of};
use crate::parallel;

/// Factors by which the highlights of measured materials are made narrower or wider.
pub(super) const HIGHLIGHT_WIDTH_FACTORS: [f64; 4] = [0.5, 0.707, 1.414, 2.0];

/// Number of variants of each measured material.
pub(super) const VARIANTS_PER_MATERIAL: usize = 8;

/// Standard deviation of the step of a variant away from the line between its parents.
///
/// The unit is the difference between two other materials. With this value, variants vary as
/// much as the measured ones.
const VARIANT_STEP: f64 = 0.4;

/// Largest step, in the same unit.
const MAX_STEP: f64 = 0.8;

/// Widths of the analytic lobes; mixtures of neighbouring lobes give the widths between them.
pub(super) const ALPHAS: [f64; 15] =
    [0.006, 0.009, 0.0135, 0.02, 0.03, 0.045, 0.065, 0.09, 0.13, 0.18, 0.25, 0.35, 0.5, 0.7, 1.0];

/// Tails of the analytic lobes (see [`lobes`]).
pub(super) const TAILS: [f64; 4] = [1.5, 2.0, 3.0, 6.0];

/// Number of diffuse components: Lambert, Burley at three roughnesses, a base below a surface.
pub(super) const DIFFUSE: usize = 5;

/// Widths of the sheen of cloth.
pub(super) const SHEENS: [f64; 3] = [0.15, 0.3, 0.6];

/// Order of the components: measured, measured with other highlights, variants, diffuse, sheen,
/// lobes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    /// Number of measured materials.
    pub(super) measured: usize,
}

impl Layout {
    pub(super) fn count(self) -> usize {
        self.lobe(ALPHAS.len(), 0, false)
    }

    pub(super) fn warped(self, material: usize, with_highlight_width: usize) -> usize {
        self.measured + material * HIGHLIGHT_WIDTH_FACTORS.len() + with_highlight_width
    }

    pub(super) fn variant(self, child: usize) -> usize {
        self.warped(self.measured, 0) + child
    }

    pub(super) fn diffuse(self, kind: usize) -> usize {
        self.variant(self.measured * VARIANTS_PER_MATERIAL) + kind
    }

    pub(super) fn sheen(self, width: usize) -> usize {
        self.diffuse(DIFFUSE) + width
    }

    /// Index of a lobe, whose reflectance along the normal is one if `full`, else zero.
    pub(super) fn lobe(self, width: usize, tail: usize, full: bool) -> usize {
        self.sheen(SHEENS.len()) + 2 * (width * TAILS.len() + tail) + usize::from(full)
    }
}

/// Returns all components in the order of [`Layout`], and their albedos before scaling.
///
/// Each component is scaled to albedo one along the normal.
pub(super) fn components(measured: &LogBasis) -> (Vec<BivariateTable>, Vec<f64>) {
    let own: Vec<BivariateTable> = parallel::map_range(measured.len(), |m| measured.table(m));
    let warped = parallel::flat_map_range(own.len(), |at| {
        HIGHLIGHT_WIDTH_FACTORS.map(|factor| with_highlight_width(&own[at], factor))
    });
    let mut all = [own, warped].concat();
    let mut rng = Pcg64::seed_from_u64(1);
    let variant: Vec<Vec<f64>> =
        (0..measured.len() * VARIANTS_PER_MATERIAL).map(|_| differential_variant(measured, &mut rng)).collect();
    all.extend(parallel::map(&variant, |coefficients| measured.at(coefficients)));
    all.push(Lambert { albedo: 1.0 }.to_bivariate());
    all.extend([0.0, 0.5, 1.0].map(|roughness| Burley { albedo: 1.0, roughness }.to_bivariate()));
    all.push(Undercoat { albedo: 1.0, f0: 0.04 }.to_bivariate());
    all.extend(SHEENS.map(|width| Sheen { factor: 1.0, width }.to_bivariate()));
    all.extend(ALPHAS.iter().flat_map(|&alpha| lobes(alpha, &TAILS)).flatten());
    debug_assert_eq!(all.len(), Layout { measured: measured.len() }.count());
    let albedos: Vec<f64> = parallel::map(&all, |t| t.normal_albedo().max(1e-12));
    for (table, albedo) in all.iter_mut().zip(&albedos) {
        table.as_mut_slice().iter_mut().for_each(|v| *v = (f64::from(*v) / albedo) as f32);
    }
    (all, albedos)
}

/// Draws the coefficients of a material near the line between two measured ones.
///
/// Its logarithm is a mixture of the logarithms of two materials, plus a multiple of the difference
/// between two others (differential evolution; Storn and Price 1997). Such variants therefore
/// differ from each measured material in the ways in which measured materials differ from each
/// other.
fn differential_variant(measured: &LogBasis, rng: &mut Pcg64) -> Vec<f64> {
    let mut parent = || &measured.coefficients[rng.random_range(0..measured.len())];
    let [one, two, from, to] = [parent(), parent(), parent(), parent()];
    let share: f64 = rng.random_range(0.0..1.0);
    let step: f64 = StandardNormal.sample(rng);
    let step = (VARIANT_STEP * step).clamp(-MAX_STEP, MAX_STEP);
    let child = |k: usize| {
        let [one, two, from, to] = [one, two, from, to].map(|parent| f64::from(parent[k]));
        share * one + (1.0 - share) * two + step * (to - from)
    };
    (0..measured.axes.len()).map(child).collect()
}

/// Returns a table with highlights `factor` times as wide.
///
/// The tangents of the half angles are stretched, so the horizon does not move.
fn with_highlight_width(table: &BivariateTable, factor: f64) -> BivariateTable {
    // Each row has one angle, which is computed only once, because hundreds of tables are built.
    let rows: Vec<f64> = (0..THETA_H).map(|i| (theta_h_of(i).tan() / factor).atan()).collect();
    let cell = |c: usize| table.eval(rows[c / THETA_D], theta_d_of(c % THETA_D)) as f32;
    BivariateTable::from_vec((0..CELLS).map(cell).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_at_the_indices_of_the_layout() {
        let lobe = |w: f64| BivariateTable::from_fn(move |h, d| 0.05 + (1.0 + d) * (-(h / w).powi(2)).exp());
        let set: Vec<(String, BivariateTable)> = [0.1, 0.3].map(|w| (w.to_string(), lobe(w))).into();
        let basis = LogBasis::fit(&set, 5);
        let (all, albedos) = components(&basis);
        let layout = Layout { measured: 2 };
        assert_eq!((all.len(), albedos.len()), (layout.count(), layout.count()));
        let same = |at: usize, want: &BivariateTable| {
            let values = all[at].as_slice().iter().zip(want.as_slice());
            values.for_each(|(a, b)| {
                let got = f64::from(*a) * albedos[at];
                assert!((got - f64::from(*b)).abs() <= 1e-4 * f64::from(*b) + 1e-7, "{at}: {got} {b}");
            });
            assert!((all[at].normal_albedo() - 1.0).abs() < 1e-3);
        };
        same(1, &basis.table(1));
        same(layout.warped(1, 3), &with_highlight_width(&basis.table(1), HIGHLIGHT_WIDTH_FACTORS[3]));
        assert_eq!(layout.diffuse(0), layout.variant(2 * VARIANTS_PER_MATERIAL));
        same(layout.diffuse(0), &Lambert { albedo: 1.0 }.to_bivariate());
        same(layout.diffuse(2), &Burley { albedo: 1.0, roughness: 0.5 }.to_bivariate());
        same(layout.diffuse(4), &Undercoat { albedo: 1.0, f0: 0.04 }.to_bivariate());
        same(layout.sheen(1), &Sheen { factor: 1.0, width: SHEENS[1] }.to_bivariate());
        same(layout.lobe(9, 2, true), &lobes(ALPHAS[9], &TAILS)[2][1]);
    }

    #[test]
    fn variants_vary_as_much_as_measured_materials() {
        let widths = (0..20).map(|i| 0.03 * 1.2_f64.powi(i));
        let set: Vec<_> = widths.map(|w| (w.to_string(), crate::testing::lobe(0.02, 1.0 / w, w))).collect();
        let basis = LogBasis::fit(&set, 10);
        let mut rng = Pcg64::seed_from_u64(1);
        let variant: Vec<Vec<f64>> = (0..4000).map(|_| differential_variant(&basis, &mut rng)).collect();
        for k in 0..3 {
            let spread = |of: &[f64]| {
                let mean = of.iter().sum::<f64>() / of.len() as f64;
                (mean, (of.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / of.len() as f64).sqrt())
            };
            let (mean, wide) = spread(&basis.coefficients.iter().map(|c| f64::from(c[k])).collect::<Vec<_>>());
            let (variant_mean, variant_spread) = spread(&variant.iter().map(|c| c[k]).collect::<Vec<_>>());
            assert!((variant_mean - mean).abs() < 0.1 * wide, "{k}: {variant_mean} {mean} {wide}");
            assert!((0.85..1.1).contains(&(variant_spread / wide)), "{k}: {variant_spread} {wide}");
        }
    }

    #[test]
    fn warps_widen_only_the_highlight() {
        let table = BivariateTable::from_fn(|h, d| 0.1 + d + (-(h.tan() / 0.1).powi(2)).exp());
        let wide = with_highlight_width(&table, 2.0);
        let want = BivariateTable::from_fn(|h, d| 0.1 + d + (-(h.tan() / 0.2).powi(2)).exp());
        for c in 0..CELLS {
            let (a, b) = (wide.as_slice()[c], want.as_slice()[c]);
            assert!((a - b).abs() < 0.005, "{} {a} {b}", theta_h_of(c / 90));
        }
    }
}
