//! Inner loops, written so that the compiler vectorises them for any processor.

/// Runs `f` compiled for the widest vector instructions of this processor.
///
/// Only code that is inlined into `f` benefits; closures that are too large are not inlined.
#[inline]
pub fn dispatch<R>(f: impl pulp::NullaryFnOnce<Output = R>) -> R {
    pulp::Arch::new().dispatch(f)
}

/// Number of independent partial sums of a dot product.
///
/// Enough to hide the latency of two adders of eight `f64` each.
const PARTIAL: usize = 16;

/// Computes `sum_i a_i x_i` in double precision.
#[inline(always)]
pub fn dot<A: Copy + Into<f64>>(a: &[A], x: &[f64]) -> f64 {
    debug_assert_eq!(a.len(), x.len());
    let mut sums = [0.0_f64; PARTIAL];
    let (a_blocks, x_blocks) = (a.chunks_exact(PARTIAL), x.chunks_exact(PARTIAL));
    let tail: f64 = a_blocks.remainder().iter().zip(x_blocks.remainder()).map(|(&a, x)| a.into() * x).sum();
    for (a, x) in a_blocks.zip(x_blocks) {
        for lane in 0..PARTIAL {
            sums[lane] += a[lane].into() * x[lane];
        }
    }
    sums.iter().sum::<f64>() + tail
}

/// Computes `y += alpha a`.
#[inline(always)]
pub fn axpy<A: Copy + Into<f64>>(alpha: f64, a: &[A], y: &mut [f64]) {
    debug_assert_eq!(a.len(), y.len());
    for (y, &a) in y.iter_mut().zip(a) {
        *y += alpha * a.into();
    }
}

/// Computes `y += a * b`, element by element.
#[inline(always)]
pub fn add_product(a: &[f32], b: &[f64], y: &mut [f64]) {
    debug_assert!(a.len() == y.len() && b.len() == y.len());
    for ((y, &a), b) in y.iter_mut().zip(a).zip(b) {
        *y += f64::from(a) * b;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn kernels_match_scalar_code(
            pairs in prop::collection::vec((-10.0_f32..10.0, -10.0_f64..10.0), 0..70),
            alpha in -3.0_f64..3.0,
        ) {
            let (a, x): (Vec<f32>, Vec<f64>) = pairs.into_iter().unzip();
            let expected: f64 = a.iter().zip(&x).map(|(&a, x)| f64::from(a) * x).sum();
            let got = dispatch(|| dot(&a, &x));
            prop_assert!((got - expected).abs() < 1e-10 * (1.0 + expected.abs()));
            let (mut y, mut z) = (x.clone(), x.clone());
            dispatch(|| axpy(alpha, &a, &mut y));
            dispatch(|| add_product(&a, &x, &mut z));
            for i in 0..x.len() {
                prop_assert!((y[i] - (x[i] + alpha * f64::from(a[i]))).abs() < 1e-12 * 100.0);
                prop_assert!((z[i] - (x[i] + f64::from(a[i]) * x[i])).abs() < 1e-12 * 100.0);
            }
        }
    }
}
