//! Products, triangular systems and Cholesky factors of matrices, on one thread.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::traits::math_utils::one;
use faer::traits::{ComplexField, Conjugate};
use faer::{Accum, Mat, MatMut, MatRef, Par};

/// Clears the upper halves of the vector registers.
///
/// The kernels of faer leave values in them. Until they are cleared, Intel processors switch slowly
/// between ordinary code and the vectorised mathematical functions of the C library: a logarithm
/// takes 178 ns instead of 16 ns. The functions of this crate clear the registers. Code that calls
/// other functions of faer should clear them afterwards.
#[inline]
pub fn clear_registers() {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V3::try_new() {
        simd.avx._mm256_zeroupper();
    }
}

/// Computes `out = alpha A B`, or adds it to `out`.
///
/// # Panics
/// If the sizes differ.
#[expect(clippy::disallowed_methods, reason = "clears the registers")]
pub fn multiply<T: ComplexField + Conjugate<Canonical = T>>(
    out: MatMut<'_, T>,
    accum: Accum,
    a: MatRef<'_, T>,
    b: MatRef<'_, T>,
    alpha: T,
) {
    matmul(out, accum, a, b, alpha, Par::Seq);
    clear_registers();
}

/// Returns `A B`.
///
/// # Panics
/// If the sizes differ.
pub fn product<T: ComplexField + Conjugate<Canonical = T>>(a: MatRef<'_, T>, b: MatRef<'_, T>) -> Mat<T> {
    let mut out = Mat::zeros(a.nrows(), b.ncols());
    multiply(out.as_mut(), Accum::Replace, a, b, one());
    out
}

/// Replaces `X` by `L^-1 X`.
#[expect(clippy::disallowed_methods, reason = "clears the registers")]
pub(crate) fn solve_lower(lower: MatRef<'_, f64>, x: MatMut<'_, f64>) {
    solve_lower_triangular_in_place(lower, x, Par::Seq);
    clear_registers();
}

/// Replaces `X` by `U^-1 X`.
#[expect(clippy::disallowed_methods, reason = "clears the registers")]
pub(crate) fn solve_upper(upper: MatRef<'_, f64>, x: MatMut<'_, f64>) {
    solve_upper_triangular_in_place(upper, x, Par::Seq);
    clear_registers();
}

/// Replaces the lower triangle of a matrix by its Cholesky factor. Returns `None` if the matrix is
/// not positive definite.
pub(crate) fn factorise(matrix: MatMut<'_, f64>) -> Option<()> {
    let scratch = cholesky_in_place_scratch::<f64>(matrix.nrows(), Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    let found = cholesky_in_place(matrix, Default::default(), Par::Seq, MemStack::new(&mut memory), Default::default());
    clear_registers();
    found.ok().map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn multiply_adds_and_replaces() {
        let a = Mat::<f32>::from_fn(3, 4, |i, j| (i + 2 * j) as f32);
        let mut out = Mat::<f32>::from_fn(3, 3, |_, _| 1.0);
        multiply(out.as_mut(), Accum::Add, a.as_ref(), a.transpose(), 2.0);
        for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
            let sum: f32 = (0..4).map(|k| a[(i, k)] * a[(j, k)]).sum();
            assert_eq!(out[(i, j)], 1.0 + 2.0 * sum);
        }
        let b = Mat::<f64>::from_fn(3, 3, |i, j| (2 * i + j) as f64);
        assert_eq!(product(b.as_ref(), Mat::identity(3, 3).as_ref()), b);
    }

    #[cfg(target_arch = "x86_64")]
    mod registers {
        use std::arch::x86_64::_xgetbv;

        use super::*;
        use crate::{Cholesky, eigenvectors, solve_positive, weighted_gram};

        /// Whether the upper halves of vector registers are in use, by the register XINUSE of the
        /// processor. `None` if the processor does not report it.
        fn in_use() -> Option<bool> {
            #[target_feature(enable = "xsave")]
            fn read() -> u64 {
                // SAFETY: processors with XSAVEC have this register.
                #[expect(unsafe_code, reason = "no library reads this register")]
                unsafe {
                    _xgetbv(1)
                }
            }
            if !(is_x86_feature_detected!("xsave") && is_x86_feature_detected!("xsavec")) {
                return None;
            }
            // SAFETY: the line above checks for XSAVE.
            #[expect(unsafe_code, reason = "no library reads this register")]
            let bits = unsafe { read() };
            // The halves of registers of 256 and of 512 bits.
            Some(bits & (1 << 2 | 1 << 6) != 0)
        }

        #[test]
        #[expect(clippy::disallowed_methods, reason = "the state after a kernel of faer is tested")]
        fn every_function_clears_the_registers() {
            let size = 150;
            let b = Mat::<f64>::from_fn(size, size, |i, j| ((7 * i + 3 * j) % 11) as f64 - 4.0);
            matmul(Mat::zeros(size, size).as_mut(), Accum::Replace, b.as_ref(), b.as_ref(), 1.0, Par::Seq);
            let after_faer = in_use();
            clear_registers();
            // Without a difference, the processor does not track these registers.
            if (after_faer, in_use()) != (Some(true), Some(false)) {
                eprintln!("skipped: this processor or its kernels do not show registers in use: {after_faer:?}");
                return;
            }
            let h = product(b.as_ref(), b.transpose()) + Mat::<f64>::identity(size, size);
            let factor = Cholesky::new(h.clone()).unwrap();
            let single = Mat::<f32>::from_fn(size, size, |i, j| b[(i, j)] as f32);
            let right = vec![1.0; size];
            let functions: [(&str, &dyn Fn()); 8] = [
                ("multiply in single precision", &|| {
                    let mut out = single.clone();
                    multiply(out.as_mut(), Accum::Add, single.as_ref(), single.as_ref(), 1.0);
                }),
                ("product", &|| drop(product(b.as_ref(), b.as_ref()))),
                ("Cholesky::new", &|| drop(Cholesky::new(h.clone()))),
                ("Cholesky::solve_all", &|| drop(factor.solve_all(&b))),
                ("Cholesky::inverse_of_lower", &|| drop(factor.inverse_of_lower())),
                ("eigenvectors", &|| drop(eigenvectors(h.as_ref()))),
                ("solve_positive", &|| drop(solve_positive(h.clone(), &right))),
                ("weighted_gram", &|| drop(weighted_gram(b.as_ref(), &right))),
            ];
            for (name, function) in functions {
                function();
                assert_eq!(in_use(), Some(false), "after {name}");
            }
        }
    }
}
