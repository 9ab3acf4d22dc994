//! Inner loops of the quadrature.

/// Number of `f32` values in a SIMD register for which the loops are laid out.
pub(super) const LANES: usize = 4;

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

#[cfg(test)]
mod tests {
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
}
