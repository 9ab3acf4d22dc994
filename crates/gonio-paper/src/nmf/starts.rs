//! Starts of the factorisation.

use faer::{Mat, MatRef, Side};
use gonio_linalg::product;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::hals::{Pair, dot};

/// Returns start number `index`.
///
/// The first start uses the singular vectors; then random samples and random numbers alternate.
pub(super) fn start(x: MatRef<'_, f64>, rank: usize, index: usize, seed: u64) -> Pair {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mean = (0..x.ncols()).map(|j| x.col(j).iter().sum::<f64>()).sum::<f64>() / (x.nrows() * x.ncols()) as f64;
    let mut pair = match index {
        0 => singular(x, rank).unwrap_or_else(|| uniform(x, rank, &mut rng)),
        n if n % 2 == 1 => columns(x, rank, &mut rng),
        _ => uniform(x, rank, &mut rng),
    };
    // Avoids exact zeros, which the updates leave slowly.
    for m in [&mut pair.w, &mut pair.v] {
        let top = m.norm_max();
        let fill = 1e-3 * if top > 0.0 { top } else { mean };
        for k in 0..rank {
            m.col_as_slice_mut(k).iter_mut().for_each(|v| *v += fill * rng.random::<f64>());
        }
    }
    rescale(x, &mut pair);
    pair
}

/// Multiplies `v` by the factor that minimises the cost.
fn rescale(x: MatRef<'_, f64>, pair: &mut Pair) {
    let across = dot(&product(x, pair.v.as_ref()), &pair.w);
    let own = dot(&product(pair.w.transpose(), pair.w.as_ref()), &product(pair.v.transpose(), pair.v.as_ref()));
    if own > 0.0 && across > 0.0 {
        pair.v *= faer::Scale(across / own);
    }
}

fn random(rows: usize, rank: usize, rng: &mut Pcg64) -> Mat<f64> {
    Mat::from_fn(rows, rank, |_, _| rng.random::<f64>())
}

fn uniform(x: MatRef<'_, f64>, rank: usize, rng: &mut Pcg64) -> Pair {
    Pair { w: random(x.nrows(), rank, rng), v: random(x.ncols(), rank, rng) }
}

/// Uses different samples as functions, and random coefficients.
fn columns(x: MatRef<'_, f64>, rank: usize, rng: &mut Pcg64) -> Pair {
    let mut order: Vec<usize> = (0..x.ncols()).collect();
    for k in 0..rank {
        let pick = rng.random_range(k..order.len());
        order.swap(k, pick);
    }
    Pair { w: Mat::from_fn(x.nrows(), rank, |i, k| x[(i, order[k])]), v: random(x.ncols(), rank, rng) }
}

/// Uses the sign half of each singular pair that has the larger product of norms.
///
/// The method is NNDSVD (Boutsidis & Gallopoulos 2008). `None` if the eigenvalue iteration fails.
fn singular(x: MatRef<'_, f64>, rank: usize) -> Option<Pair> {
    if x.ncols() > x.nrows() {
        return singular(x.transpose(), rank).map(|p| Pair { w: p.v, v: p.w });
    }
    let gram = product(x.transpose(), x);
    let eigen = gram.self_adjoint_eigen(Side::Lower).ok()?;
    let last = x.ncols() - 1;
    // Eigenvalues are in ascending order.
    let right = Mat::from_fn(x.ncols(), rank, |j, k| eigen.U()[(j, last - k)]);
    let left = product(x, right.as_ref());
    let mut pair = Pair { w: Mat::zeros(x.nrows(), rank), v: Mat::zeros(x.ncols(), rank) };
    for k in 0..rank {
        let half = |m: &Mat<f64>, sign: f64| -> (Vec<f64>, f64) {
            let half: Vec<f64> = m.col_as_slice(k).iter().map(|v| (sign * v).max(0.0)).collect();
            let norm = half.iter().map(|v| v * v).sum::<f64>().sqrt();
            (half, norm)
        };
        let [plus, minus] = [1.0, -1.0].map(|sign| (half(&left, sign), half(&right, sign)));
        let chosen = if plus.0.1 * plus.1.1 >= minus.0.1 * minus.1.1 { plus } else { minus };
        // `left` already contains the singular value, which is shared evenly between the factors.
        let ((w, w_norm), (v, v_norm)) = chosen;
        let size = (w_norm * v_norm).sqrt();
        if size > 0.0 {
            pair.w.col_as_slice_mut(k).iter_mut().zip(w).for_each(|(to, v)| *to = v * size / w_norm);
            pair.v.col_as_slice_mut(k).iter_mut().zip(v).for_each(|(to, v)| *to = v * size / v_norm);
        }
    }
    Some(pair)
}
