//! Tables of many microfacet lobes at once.

use super::{Facet, HORIZON};
use crate::parallel;
use crate::reflectance::table::{BivariateTable, CELLS, PHI_D, angles_of};
use std::f64::consts::PI;

/// Returns the mean over `phi_d` of a function that is symmetric in light and view.
///
/// The result equals that of [`Parametric::to_bivariate`](super::Parametric::to_bivariate) up to
/// round-off. Swapping light and view gives `180 degrees - phi_d`, so that half of the samples
/// suffice.
pub(super) fn averaged(value: impl Fn(&Facet) -> f64 + Sync) -> BivariateTable {
    let cosines: Vec<f64> = (0..=PHI_D / 2).map(|k| (k as f64).to_radians().cos()).collect();
    let cell = |c: usize| {
        let (h, d) = angles_of(c);
        let (level, swing) = (h.cos() * d.cos(), h.sin() * d.sin());
        let (cos_h, cos_d, tan2_h) = (h.cos(), d.cos(), h.tan().powi(2));
        let (mut sum, mut count) = (0.0, 0_u32);
        for (k, cosine) in cosines.iter().enumerate() {
            let (cos_i, cos_o) = (level - swing * cosine, level + swing * cosine);
            if cos_i > HORIZON && cos_o > HORIZON {
                let times = if k == 0 || 2 * k == PHI_D { 1 } else { 2 };
                sum += f64::from(times) * value(&Facet { cos_i, cos_o, cos_h, cos_d, tan2_h });
                count += times;
            }
        }
        if count > 0 { (sum / f64::from(count)) as f32 } else { 0.0 }
    };
    BivariateTable::from_vec(parallel::map_range(CELLS, cell))
}

/// Returns the density of facet normals whose slopes follow Student's t (Ribardiere et al. 2017).
///
/// Times `cos_h`, it integrates to 1 over the hemisphere. It is GGX for a `tail` of 2 and
/// Beckmann's for an infinite one; values between 1 and 2 give heavier tails.
pub(super) fn student(facet: &Facet, alpha: f64, tail: f64) -> f64 {
    let a2 = alpha * alpha;
    (1.0 + facet.tan2_h / ((tail - 1.0) * a2)).powf(-tail) / (PI * a2 * facet.cos_h.powi(4))
}

/// Returns Smith's height-correlated `G / (4 cos_i cos_o)` for GGX (Heitz 2014).
///
/// The form avoids the removable singularity at the horizon.
pub(super) fn visibility(a2: f64, ci: f64, co: f64) -> f64 {
    0.5 / (co * (a2 + (1.0 - a2) * ci * ci).sqrt() + ci * (a2 + (1.0 - a2) * co * co).sqrt())
}

/// Computes lobes of facets whose slopes follow Student's t (Ribardiere et al. 2017).
///
/// For each tail (above 1), it returns two lobes of width `alpha` (above 0, at most 1) under
/// Schlick's formula: one that reflects nothing along the normal, `f0 = 0`, and one that reflects
/// everything, `f0 = 1`. Lobes of other `f0` are their mixtures. A tail of 2 is GGX, an infinite
/// one Beckmann's. Masking is that of [`Ggx`](super::Ggx) for all.
pub fn lobes(alpha: f64, tails: &[f64]) -> Vec<[BivariateTable; 2]> {
    // Only masking depends on phi_d.
    let masked = averaged(|facet| visibility(alpha * alpha, facet.cos_i, facet.cos_o));
    let lobe = |tail: f64| {
        let cells: Vec<[f32; 2]> = parallel::map_range(CELLS, |c| {
            let (h, d) = angles_of(c);
            let facet = Facet { cos_i: 1.0, cos_o: 1.0, cos_h: h.cos(), cos_d: d.cos(), tan2_h: h.tan().powi(2) };
            let mirror = student(&facet, alpha, tail) * f64::from(masked.as_slice()[c]);
            [0.0, 1.0].map(|f0| (mirror * facet.schlick(f0)) as f32)
        });
        [0, 1].map(|which| BivariateTable::from_vec(cells.iter().map(|c| c[which]).collect()))
    };
    tails.iter().map(|&tail| lobe(tail)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Ggx, Parametric};
    use super::*;

    #[test]
    fn tail_of_two_matches_ggx() {
        for alpha in [0.03, 0.4] {
            for (f0, lobe) in [0.0, 1.0].into_iter().zip(&lobes(alpha, &[2.0])[0]) {
                let want = Ggx { diffuse: 0.0, f0, alpha }.to_bivariate();
                for (c, (a, b)) in lobe.as_slice().iter().zip(want.as_slice()).enumerate() {
                    assert!((a - b).abs() <= 1e-5 * b.abs() + 1e-12, "{alpha} {f0} {c}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn distributions_are_normalised() {
        for (alpha, tail) in [(0.1, 1.5), (0.5, 2.0), (1.0, 6.0), (0.3, 300.0_f64)] {
            // tan^2 = (tail - 1) alpha^2 (v^(-1/(tail - 1)) - 1) makes the integrand constant; the
            // measure is pi cos^4 dtan^2.
            let (n, q) = (2000, 1.0 / (tail - 1.0));
            let sum: f64 = (0..n)
                .map(|i| {
                    let v = (i as f64 + 0.5) / n as f64;
                    let t = (tail - 1.0) * alpha * alpha * (v.powf(-q) - 1.0);
                    let cos_h = (1.0 + t).powf(-0.5);
                    let facet = Facet { cos_i: 1.0, cos_o: 1.0, cos_h, cos_d: 1.0, tan2_h: t };
                    let slope = alpha * alpha * v.powf(-q - 1.0);
                    student(&facet, alpha, tail) * PI * cos_h.powi(4) * slope / n as f64
                })
                .sum();
            assert!((sum - 1.0).abs() < 1e-6, "{alpha} {tail}: {sum}");
        }
        // Beckmann's distribution is the limit.
        let facet = Facet { cos_i: 1.0, cos_o: 1.0, cos_h: 0.9, cos_d: 1.0, tan2_h: 0.1 };
        let beckmann = (-0.1_f64 / 0.09).exp() / (PI * 0.09 * 0.9_f64.powi(4));
        assert!((student(&facet, 0.3, 1e7) / beckmann - 1.0).abs() < 1e-5);
    }
}
