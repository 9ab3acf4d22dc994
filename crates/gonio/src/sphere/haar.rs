//! Orthonormal two-dimensional Haar transform of a square whose side is a power of two.
//!
//! Coefficient order: 0 is DC; scale `s = 1, 2, ...` (1 the coarsest) takes the `3 * 4^(s-1)`
//! indices from `4^(s-1)` on, first all horizontal wavelets, then vertical, then diagonal, each row
//! by row from the top. So indices 1, 2, 3 are the three coarsest wavelets, and index 2 (the
//! paper's m = 3, counted from one) weighs the top half of the square against the bottom half.

use std::ops::{Add, Mul, Sub};

/// Direction in which a wavelet takes differences.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Orientation {
    /// Right minus left.
    Horizontal,
    /// Top minus bottom.
    Vertical,
    /// Rising diagonal minus falling diagonal, with the sign (+ at top left).
    Diagonal,
}

impl Orientation {
    /// All orientations, in the order of the coefficients.
    pub const ALL: [Self; 3] = [Self::Horizontal, Self::Vertical, Self::Diagonal];
}

/// Scale, orientation and position of a wavelet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wavelet {
    /// Scale, 1 the coarsest.
    pub scale: u32,
    /// Orientation.
    pub orientation: Orientation,
    /// Row of the wavelet's square among the `2^(scale-1)` rows of the scale, 0 at the top.
    pub row: usize,
    /// Column of the wavelet's square.
    pub column: usize,
}

impl Wavelet {
    /// Returns the wavelet of coefficient `index`, or `None` for DC.
    pub fn of_index(index: usize) -> Option<Self> {
        let scale = index.checked_ilog2()? / 2 + 1;
        let block = 1_usize << (2 * (scale - 1));
        let (which, at) = ((index - block) / block, (index - block) % block);
        let side = 1_usize << (scale - 1);
        Some(Self { scale, orientation: Orientation::ALL[which], row: at / side, column: at % side })
    }

    /// Returns whether the support is in the top half of the square.
    ///
    /// `None` at scale 1, whose wavelets cover the whole square.
    pub(crate) fn above_horizon(self) -> Option<bool> {
        (self.scale > 1).then(|| self.row < 1 << (self.scale - 2))
    }
}

/// Floating-point type that can be transformed.
pub trait Real: Copy + From<f32> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {}

impl Real for f32 {}
impl Real for f64 {}

/// Haar transform of squares of one side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Haar {
    side: usize,
}

impl Haar {
    /// Creates the transform of squares of `side` by `side`.
    ///
    /// Returns `None` unless `side` is a power of two, at least 2.
    pub fn new(side: usize) -> Option<Self> {
        (side.is_power_of_two() && side >= 2).then_some(Self { side })
    }

    /// Returns the number of coefficients, `side^2`.
    pub fn coefficients(self) -> usize {
        self.side * self.side
    }

    /// Returns the number of scales, `log2(side)`.
    pub fn scales(self) -> u32 {
        self.side.ilog2()
    }

    /// Transforms the values in `square` to coefficients, in place.
    ///
    /// `square` contains `side * side` values (row-major, row 0 at the top). `scratch` is resized
    /// as needed.
    pub fn forward<T: Real>(self, square: &mut [T], scratch: &mut Vec<T>) {
        let one_half = T::from(0.5);
        assert_eq!(square.len(), self.coefficients());
        // `scratch` contains the averages of the current scale. The details are written directly to
        // their final indices in `square`, from 4^(s-1) on for scale s.
        scratch.clear();
        scratch.extend_from_slice(square);
        let mut side = self.side;
        while side > 1 {
            let half = side / 2;
            let block = half * half;
            for row in 0..half {
                for column in 0..half {
                    let top = 2 * row * side + 2 * column;
                    let (a, b) = (scratch[top], scratch[top + 1]);
                    let (c, d) = (scratch[top + side], scratch[top + side + 1]);
                    let at = row * half + column;
                    square[block + at] = one_half * ((b + d) - (a + c));
                    square[2 * block + at] = one_half * ((a + b) - (c + d));
                    square[3 * block + at] = one_half * ((a + d) - (b + c));
                    // Safe to overwrite: this scale has already read the value at `at`.
                    scratch[at] = one_half * ((a + b) + (c + d));
                }
            }
            side = half;
        }
        square[0] = scratch[0];
    }

    /// Inverts [`Self::forward`].
    pub fn inverse<T: Real>(self, coefficients: &mut [T], scratch: &mut Vec<T>) {
        let one_half = T::from(0.5);
        assert_eq!(coefficients.len(), self.coefficients());
        let mut averages = vec![coefficients[0]];
        for scale in 1..=self.scales() {
            let half = 1_usize << (scale - 1);
            let (side, block) = (2 * half, half * half);
            scratch.clear();
            scratch.resize(side * side, T::from(0.0));
            for row in 0..half {
                for column in 0..half {
                    let at = row * half + column;
                    let mean = averages[at];
                    let [h, v, d] = [1, 2, 3].map(|o| coefficients[o * block + at]);
                    let top = 2 * row * side + 2 * column;
                    scratch[top] = one_half * (mean - h + v + d);
                    scratch[top + 1] = one_half * (mean + h + v - d);
                    scratch[top + side] = one_half * (mean - h - v - d);
                    scratch[top + side + 1] = one_half * (mean + h - v + d);
                }
            }
            std::mem::swap(&mut averages, scratch);
        }
        coefficients.copy_from_slice(&averages);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(n: usize, seed: u64) -> Vec<f32> {
        crate::testing::random(n, seed).into_iter().map(|x| x as f32).collect()
    }

    #[test]
    fn inverse_undoes_forward_and_preserves_energy() {
        for side in [2, 4, 32, 128] {
            let haar = Haar::new(side).unwrap();
            let original = random(side * side, 7);
            let (mut x, mut scratch) = (original.clone(), Vec::new());
            haar.forward(&mut x, &mut scratch);
            let energy = |v: &[f32]| v.iter().map(|x| f64::from(x * x)).sum::<f64>();
            assert!((energy(&x) / energy(&original) - 1.0).abs() < 1e-5, "Parseval at {side}");
            haar.inverse(&mut x, &mut scratch);
            for (a, b) in x.iter().zip(&original) {
                assert!((a - b).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn rejects_sides_that_are_not_powers_of_two() {
        assert!([0, 1, 3, 48].iter().all(|&n| Haar::new(n).is_none()));
    }

    #[test]
    fn coefficient_2_is_top_minus_bottom() {
        let mut square: Vec<f32> = (0..64).map(|i| if i < 32 { 1.0 } else { -1.0 }).collect();
        Haar::new(8).unwrap().forward(&mut square, &mut Vec::new());
        assert_eq!(square[2], 8.0);
        assert!(square.iter().enumerate().all(|(i, &x)| i == 2 || x == 0.0));
    }

    #[test]
    fn wavelets_of_indices_match_their_support() {
        let side = 16;
        let haar = Haar::new(side).unwrap();
        for index in 1..side * side {
            let w = Wavelet::of_index(index).unwrap();
            let mut x = vec![0.0; side * side];
            x[index] = 1.0;
            haar.inverse(&mut x, &mut Vec::new());
            let size = side >> (w.scale - 1);
            for (at, &value) in x.iter().enumerate() {
                let inside = at / side / size == w.row && at % side / size == w.column;
                assert_eq!(value != 0.0, inside, "{index} {w:?}");
            }
            if let Some(above) = w.above_horizon() {
                assert_eq!(above, (w.row * size) < side / 2);
            }
        }
        assert_eq!(Wavelet::of_index(0), None);
    }

    #[test]
    fn coarse_coefficients_do_not_depend_on_the_grid() {
        // Averaging 2x2 texels and scaling by 2 (the measure of a texel) gives the approximation
        // space of the next scale.
        let fine = random(32 * 32, 3);
        let coarse: Vec<f32> = (0..256)
            .map(|i| {
                let top = (i / 16) * 64 + (i % 16) * 2;
                0.5 * (fine[top] + fine[top + 1] + fine[top + 32] + fine[top + 33])
            })
            .collect();
        let (mut a, mut b) = (fine, coarse);
        Haar::new(32).unwrap().forward(&mut a, &mut Vec::new());
        Haar::new(16).unwrap().forward(&mut b, &mut Vec::new());
        for i in 0..256 {
            assert!((a[i] - b[i]).abs() < 1e-5, "{i}");
        }
    }
}
