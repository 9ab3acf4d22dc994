//! Inner loops, written so that the compiler vectorises them for any processor.

/// Number of `f32` values in a SIMD register for which the loops are laid out.
pub(super) const LANES: usize = 4;

/// Runs `f` compiled for the widest vector instructions of this processor.
///
/// Only code that is inlined into `f` benefits; closures that are too large are not inlined.
#[inline]
pub(crate) fn dispatch<R>(f: impl pulp::NullaryFnOnce<Output = R>) -> R {
    pulp::Arch::new().dispatch(f)
}

/// Computes `out += w0 a0 + w1 a1 + w2 a2 + w3 a3`.
///
/// All slices have the same length, a multiple of [`LANES`].
#[inline(always)]
pub(super) fn add_four(out: &mut [f32], a: [&[f32]; 4], w: [f32; 4]) {
    let blocks = out.chunks_exact_mut(LANES).zip(a[0].chunks_exact(LANES)).zip(a[1].chunks_exact(LANES));
    for (((out, a), b), (c, d)) in blocks.zip(a[2].chunks_exact(LANES).zip(a[3].chunks_exact(LANES))) {
        for lane in 0..LANES {
            out[lane] += w[0] * a[lane] + w[1] * b[lane] + w[2] * c[lane] + w[3] * d[lane];
        }
    }
}

/// Returns `asin(sqrt(x))` for `x` in 0..=1, to 2e-7.
///
/// This is half an angle, computed from the square of half its chord.
#[inline(always)]
pub(super) fn asin_of_sqrt(x: f32) -> f32 {
    // Chebyshev fit of asin(s)/s in s^2 on 0..=0.501, relative error 1.2e-7; above, asin(s) = pi/2
    // - asin(sqrt(1 - s^2)).
    let x = x.clamp(0.0, 1.0);
    let t = x.min(1.0 - x);
    let p = 0.102_355_18 * t - 0.057_12;
    let p = p * t + 0.062_079_45;
    let p = p * t + 0.038_523_074;
    let p = p * t + 0.075_546_14;
    let p = p * t + 0.166_648_7;
    let p = p * t + 1.0;
    let low = p * t.sqrt();
    if x <= 0.5 { low } else { std::f32::consts::FRAC_PI_2 - low }
}

/// Number of independent partial sums of a dot product.
///
/// Enough to hide the latency of two adders of eight `f64` each.
const PARTIAL: usize = 16;

/// Computes `sum_i a_i x_i` in double precision.
#[inline(always)]
pub(crate) fn dot<A: Copy + Into<f64>>(a: &[A], x: &[f64]) -> f64 {
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
pub(crate) fn axpy<A: Copy + Into<f64>>(alpha: f64, a: &[A], y: &mut [f64]) {
    debug_assert_eq!(a.len(), y.len());
    for (y, &a) in y.iter_mut().zip(a) {
        *y += alpha * a.into();
    }
}

/// Computes `y += a * b`, element by element.
#[inline(always)]
pub(crate) fn add_product(a: &[f32], b: &[f64], y: &mut [f64]) {
    debug_assert!(a.len() == y.len() && b.len() == y.len());
    for ((y, &a), b) in y.iter_mut().zip(a).zip(b) {
        *y += f64::from(a) * b;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn asin_of_sqrt_is_accurate() {
        for i in 0..=100_000 {
            let x = i as f32 / 100_000.0;
            let exact = f64::from(x).sqrt().asin();
            assert!((f64::from(asin_of_sqrt(x)) - exact).abs() < 4e-7, "{x}");
        }
        let tiny = 1e-12_f32;
        assert!((f64::from(asin_of_sqrt(tiny)) / f64::from(tiny).sqrt() - 1.0).abs() < 3e-7);
    }

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
