//! Leading left singular subspace of a tall stack of rows, by randomised sketching.
//!
//! The rows need not fit in memory (Halko, Martinsson and Tropp 2011).

use faer::{Accum, Mat, MatMut, MatRef};
use gonio_linalg::{Cholesky, column_bands, eigenvectors, multiply};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// Source of rows: blocks of consecutive rows, either stored or recomputed on each pass.
pub(super) trait RowBlocks {
    /// Returns the number of rows.
    fn rows(&self) -> usize;
    /// Returns the number of columns.
    fn columns(&self) -> usize;
    /// Calls `visit(first_row, block)` for consecutive blocks, `block` row-major.
    fn for_each(&self, visit: &mut dyn FnMut(usize, &[f32]));
}

/// `Q` (rows x rank) with orthonormal columns, `R = Q' A`, and the energy of `A` in them.
pub(super) struct Sketch {
    /// Orthonormal columns in order of decreasing weighted energy.
    pub(super) q: Mat<f32>,
    /// `Q' A`, row-major, rank x columns.
    pub(super) r: Vec<f32>,
    /// Weighted energy `|q_j' A D|^2` of each direction.
    pub(super) energies: Vec<f64>,
    /// Total weighted energy `|A D|^2`.
    pub(super) total: f64,
}

/// Computes a product in fixed bands of result columns.
///
/// Each band is one sequential product, so the result does not depend on the number of threads.
fn product(out: MatMut<'_, f32>, accum: Accum, a: MatRef<'_, f32>, b: MatRef<'_, f32>) {
    const BAND: usize = 256;
    let columns = out.ncols();
    column_bands(out, columns.div_ceil(BAND)).into_par_iter().for_each(|(first, out)| {
        let width = out.ncols();
        multiply(out, accum, a, b.subcols(first, width), 1.0);
    });
}

/// Orthonormalises the columns in place by two passes of Cholesky QR in double precision.
fn orthonormalise(y: &mut Mat<f32>) {
    for _ in 0..2 {
        let mut tall = Mat::<f64>::from_fn(y.nrows(), y.ncols(), |i, j| f64::from(y[(i, j)]));
        let mut gram = gram(tall.as_ref());
        // A ridge far below the smallest kept energy keeps the factor finite for directions that
        // the sketch does not reach.
        let ridge = 1e-13 * (0..gram.ncols()).map(|j| gram[(j, j)]).fold(0.0, f64::max);
        for j in 0..gram.ncols() {
            gram[(j, j)] += ridge;
        }
        let factor = Cholesky::new(gram).expect("a finite Gram matrix with a ridge is positive definite");
        // Y <- Y L^-T, as the transposed lower solve, band by band.
        let mut transposed = tall.transpose().to_owned();
        factor.whiten(&mut transposed);
        tall = transposed.transpose().to_owned();
        *y = Mat::from_fn(y.nrows(), y.ncols(), |i, j| tall[(i, j)] as f32);
    }
}

/// Computes `Y' Y` band by band.
fn gram(y: MatRef<'_, f64>) -> Mat<f64> {
    let n = y.ncols();
    let mut gram = Mat::zeros(n, n);
    column_bands(gram.as_mut(), n.div_ceil(128)).into_par_iter().for_each(|(first, band)| {
        let width = band.ncols();
        multiply(band, Accum::Replace, y.transpose(), y.subcols(first, width), 1.0);
    });
    gram
}

/// Computes the `rank` left singular directions of `A D` with the most energy.
///
/// `D` is the diagonal of `weights` (one per column). The method is one power iteration on a
/// Gaussian sketch of `rank + oversampling` columns. The result is deterministic for a seed.
pub(super) fn sketch(source: &dyn RowBlocks, weights: &[f32], rank: usize, oversampling: usize, seed: u64) -> Sketch {
    let (rows, columns) = (source.rows(), source.columns());
    let width = (rank + oversampling).min(rows).min(columns);
    let rank = rank.min(width);
    let mut total = 0.0;
    // Y = A D Omega.
    let mut y = Mat::<f32>::zeros(rows, width);
    {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        let mut omega = Mat::<f32>::zeros(columns, width);
        for j in 0..width {
            for (i, &weight) in weights.iter().enumerate() {
                let z: f32 = StandardNormal.sample(&mut rng);
                omega[(i, j)] = z * weight;
            }
        }
        source.for_each(&mut |first, block| {
            let count = block.len() / columns;
            let a = MatRef::from_row_major_slice(block, count, columns);
            product(y.as_mut().subrows_mut(first, count), Accum::Replace, a, omega.as_ref());
            total += block
                .chunks_exact(columns)
                .map(|row| row.iter().zip(weights).map(|(a, w)| f64::from(a * w).powi(2)).sum::<f64>())
                .sum::<f64>();
        });
    }
    orthonormalise(&mut y);
    // Y = A D D A' Y: the power iteration.
    let project = |y: &Mat<f32>| {
        let mut z = Mat::<f32>::zeros(width, columns);
        source.for_each(&mut |first, block| {
            let count = block.len() / columns;
            let a = MatRef::from_row_major_slice(block, count, columns);
            product(z.as_mut(), Accum::Add, y.as_ref().subrows(first, count).transpose(), a);
        });
        z
    };
    {
        let mut z = project(&y);
        for (i, w) in weights.iter().enumerate() {
            z.col_mut(i).iter_mut().for_each(|x| *x *= w * w);
        }
        source.for_each(&mut |first, block| {
            let count = block.len() / columns;
            let a = MatRef::from_row_major_slice(block, count, columns);
            product(y.as_mut().subrows_mut(first, count), Accum::Replace, a, z.as_ref().transpose());
        });
    }
    orthonormalise(&mut y);
    // B = Y' A; rotate to the principal axes of (B D)(B D)'.
    let b = project(&y);
    let weighted = Mat::<f64>::from_fn(columns, width, |i, j| f64::from(b[(j, i)] * weights[i]));
    let (values, vectors) = eigenvectors(gram(weighted.as_ref()).as_ref());
    // Eigenvalues are in ascending order.
    let u = Mat::<f32>::from_fn(width, rank, |i, j| vectors[(i, width - 1 - j)] as f32);
    let energies = (0..rank).map(|j| values[width - 1 - j].max(0.0)).collect();
    let mut q = Mat::<f32>::zeros(rows, rank);
    product(q.as_mut(), Accum::Replace, y.as_ref(), u.as_ref());
    let mut r = vec![0.0; rank * columns];
    product(MatMut::from_row_major_slice_mut(&mut r, rank, columns), Accum::Replace, u.transpose(), b.as_ref());
    Sketch { q, r, energies, total }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::on_threads;

    struct Held(Vec<f32>, usize, usize);

    impl RowBlocks for Held {
        fn rows(&self) -> usize {
            self.1
        }
        fn columns(&self) -> usize {
            self.2
        }
        fn for_each(&self, visit: &mut dyn FnMut(usize, &[f32])) {
            for (i, block) in self.0.chunks(70 * self.2).enumerate() {
                visit(70 * i, block);
            }
        }
    }

    /// Returns rows of rank 20 with decreasing singular values, plus a little noise.
    fn rows() -> Held {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(2);
        let mut normal = |n: usize| -> Vec<f32> { (0..n).map(|_| StandardNormal.sample(&mut rng)).collect() };
        let (n, m) = (300, 500);
        let (left, right, noise) = (normal(n * 20), normal(20 * m), normal(n * m));
        let a = (0..n * m)
            .map(|at| {
                let (i, j) = (at / m, at % m);
                let low: f32 = (0..20).map(|k| left[i * 20 + k] * 0.7_f32.powi(k as i32) * right[k * m + j]).sum();
                low + 1e-4 * noise[at]
            })
            .collect();
        Held(a, n, m)
    }

    #[test]
    fn sketch_keeps_nearly_the_optimal_energy() {
        let source = rows();
        let weights: Vec<f32> = (0..source.2).map(|j| 1.0 + (j % 3) as f32).collect();
        let a = Mat::<f64>::from_fn(source.1, source.2, |i, j| f64::from(source.0[i * source.2 + j] * weights[j]));
        let exact = a.singular_values().unwrap();
        let got = sketch(&source, &weights, 12, 8, 1);
        let best: f64 = exact[..12].iter().map(|s| s * s).sum();
        let kept: f64 = got.energies.iter().sum();
        assert!((kept / best - 1.0).abs() < 1e-4, "{kept} {best}");
        let everything: f64 = exact.iter().map(|s| s * s).sum();
        assert!((got.total / everything - 1.0).abs() < 1e-5);
    }

    #[test]
    fn q_is_orthonormal_and_r_is_the_projection() {
        let source = rows();
        let got = sketch(&source, &vec![1.0; source.2], 25, 5, 1);
        for a in 0..25 {
            for b in 0..25 {
                let dot: f32 = (0..source.1).map(|i| got.q[(i, a)] * got.q[(i, b)]).sum();
                assert!((dot - f32::from(u8::from(a == b))).abs() < 1e-4, "{a} {b} {dot}");
            }
            for j in (0..source.2).step_by(37) {
                let projected: f32 = (0..source.1).map(|i| got.q[(i, a)] * source.0[i * source.2 + j]).sum();
                assert!((projected - got.r[a * source.2 + j]).abs() < 2e-3, "{a} {j}");
            }
        }
    }

    #[test]
    fn result_does_not_depend_on_threads() {
        // Wide enough for the blocked paths of the linear algebra.
        let mut rng = rand_pcg::Pcg64::seed_from_u64(9);
        let (n, m) = (700, 900);
        let source = Held((0..n * m).map(|_| StandardNormal.sample(&mut rng)).collect(), n, m);
        let run = |threads| on_threads(threads, || sketch(&source, &vec![1.0; source.2], 400, 30, 1).r);
        assert_eq!(run(1), run(3));
    }
}
