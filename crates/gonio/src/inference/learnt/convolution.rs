//! Convolutions as products of matrices.
//!
//! Neighbourhoods are gathered into rows, one tile at a time, so that a tile stays in cache.
//!
//! Activations have their channels last, `[image][row][column][channel]`; weights are
//! `[row][column][input][output]`, so that a gathered neighbourhood times the weights is a cell of
//! the output.

use std::ops::Range;

use faer::{Accum, MatMut, MatRef};
use gonio_linalg::{dispatch, multiply};

/// Bytes of gathered neighbourhoods in one tile.
const TILE: usize = 1 << 18;

/// Geometry of a convolution of square images, padded with zeros by `(kernel - 1) / 2`. A dense
/// layer has side and kernel 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Convolution {
    /// Cells along a side of the input, a multiple of the stride.
    pub side: usize,
    /// Channels of the input.
    pub inputs: usize,
    /// Channels of the output.
    pub outputs: usize,
    /// Cells along a side of the window.
    pub kernel: usize,
    /// Distance between neighbouring windows, in cells of the input.
    pub stride: usize,
}

impl Convolution {
    /// Geometry of an affine map of vectors.
    pub fn dense(inputs: usize, outputs: usize) -> Self {
        Self { side: 1, inputs, outputs, kernel: 1, stride: 1 }
    }

    /// Cells along a side of the output.
    pub fn side_after(&self) -> usize {
        self.side / self.stride
    }

    /// Numbers in one image of the input.
    pub fn input_len(&self) -> usize {
        self.side * self.side * self.inputs
    }

    /// Numbers in one image of the output.
    pub fn output_len(&self) -> usize {
        self.side_after().pow(2) * self.outputs
    }

    /// Numbers in a neighbourhood: rows of the matrix of weights, whose columns are the outputs.
    pub fn neighbourhood(&self) -> usize {
        self.kernel * self.kernel * self.inputs
    }

    /// Adds the convolution of images `[image][side][side][inputs]` to `out`,
    /// `[image][side_after][side_after][outputs]`.
    ///
    /// # Panics
    /// If the lengths do not match the geometry and a whole number of images. [`Self::backward`]
    /// panics under the same conditions.
    pub fn forward(&self, images: &[f32], weights: &[f32], out: &mut [f32]) {
        let count = self.check(images, weights, out);
        let weights = MatRef::from_row_major_slice(weights, self.neighbourhood(), self.outputs);
        let mut room = self.room(count);
        for lines in self.tiles(count) {
            let cells = lines.len() * self.side_after();
            let patches = self.gather(images, lines.clone(), &mut room);
            let patches = MatRef::from_row_major_slice(patches, cells, self.neighbourhood());
            let out = MatMut::from_row_major_slice_mut(self.lines_mut(out, lines), cells, self.outputs);
            multiply(out, Accum::Add, patches, weights, 1.0);
        }
    }

    /// Adds the gradient in the weights and, if `to_images` is given, that in the images.
    ///
    /// `back` is the gradient in the output.
    pub fn backward(
        &self,
        images: &[f32],
        weights: &[f32],
        back: &[f32],
        to_weights: &mut [f32],
        mut to_images: Option<&mut [f32]>,
    ) {
        let count = self.check(images, weights, back);
        assert_eq!(to_weights.len(), weights.len());
        let weights = MatRef::from_row_major_slice(weights, self.neighbourhood(), self.outputs);
        let mut room = self.room(count);
        for lines in self.tiles(count) {
            let cells = lines.len() * self.side_after();
            let line = self.side_after() * self.outputs;
            let back = MatRef::from_row_major_slice(&back[lines.start * line..lines.end * line], cells, self.outputs);
            let patches = self.gather(images, lines.clone(), &mut room);
            let patches = MatRef::from_row_major_slice(patches, cells, self.neighbourhood());
            let product = MatMut::from_row_major_slice_mut(to_weights, self.neighbourhood(), self.outputs);
            multiply(product, Accum::Add, patches.transpose(), back, 1.0);
            if let Some(to_images) = to_images.as_deref_mut() {
                assert_eq!(to_images.len(), images.len());
                let room = &mut room[..cells * self.neighbourhood()];
                let product = MatMut::from_row_major_slice_mut(room, cells, self.neighbourhood());
                multiply(product, Accum::Replace, back, weights.transpose(), 1.0);
                dispatch(|| self.scatter(room, lines, to_images));
            }
        }
    }

    fn check(&self, images: &[f32], weights: &[f32], out: &[f32]) -> usize {
        let count = images.len() / self.input_len();
        assert_eq!(images.len(), count * self.input_len());
        assert_eq!(weights.len(), self.neighbourhood() * self.outputs);
        assert_eq!(out.len(), count * self.output_len());
        count
    }

    /// Iterates over the tiles: ranges of lines of output cells, counted through all images.
    fn tiles(&self, count: usize) -> impl Iterator<Item = Range<usize>> + use<> {
        let (lines, tile) = (count * self.side_after(), self.lines_in_tile());
        (0..lines.div_ceil(tile)).map(move |t| t * tile..lines.min((t + 1) * tile))
    }

    fn lines_in_tile(&self) -> usize {
        (TILE / (4 * self.neighbourhood() * self.side_after())).max(1)
    }

    fn room(&self, count: usize) -> Vec<f32> {
        let lines = self.lines_in_tile().min(count * self.side_after());
        vec![0.0; lines * self.side_after() * self.neighbourhood()]
    }

    fn lines_mut<'a>(&self, out: &'a mut [f32], lines: Range<usize>) -> &'a mut [f32] {
        let line = self.side_after() * self.outputs;
        &mut out[lines.start * line..lines.end * line]
    }

    /// Calls `visit` for each row of the windows of the lines.
    ///
    /// The arguments describe the part of the row inside the image: its start in `images`, its
    /// start in the neighbourhoods, and its length. For rows outside the image, the length is zero
    /// and only the start in the neighbourhoods is valid.
    #[inline(always)]
    fn each_row(&self, lines: Range<usize>, mut visit: impl FnMut(usize, usize, usize)) {
        let (after, pad) = (self.side_after(), (self.kernel - 1) / 2);
        let mut patch = 0;
        for line in lines {
            let (image, y) = (line / after, line % after);
            for x in 0..after {
                let first = (x * self.stride) as isize - pad as isize;
                let from = first.max(0) as usize;
                let to = ((first + self.kernel as isize) as usize).min(self.side);
                let shift = (from as isize - first) as usize;
                for row in 0..self.kernel {
                    let at = (y * self.stride + row).wrapping_sub(pad);
                    let length = if at < self.side { (to - from) * self.inputs } else { 0 };
                    let source = if at < self.side { (image * self.side + at) * self.side + from } else { 0 };
                    visit(source * self.inputs, patch + (row * self.kernel + shift) * self.inputs, length);
                }
                patch += self.neighbourhood();
            }
        }
    }

    /// Gathers the neighbourhoods of the cells of the lines, one after the other.
    fn gather<'a>(&self, images: &[f32], lines: Range<usize>, room: &'a mut [f32]) -> &'a [f32] {
        let room = &mut room[..lines.len() * self.side_after() * self.neighbourhood()];
        let line = self.kernel * self.inputs;
        self.each_row(lines, |source, patch, length| {
            if length < line {
                let start = patch - patch % line;
                room[start..start + line].fill(0.0);
            }
            room[patch..patch + length].copy_from_slice(&images[source..source + length]);
        });
        room
    }

    /// Adds neighbourhoods to the places in the images from which they were gathered.
    #[inline(always)]
    fn scatter(&self, patches: &[f32], lines: Range<usize>, images: &mut [f32]) {
        self.each_row(lines, |source, patch, length| {
            let to = &mut images[source..source + length];
            to.iter_mut().zip(&patches[patch..patch + length]).for_each(|(to, p)| *to += p);
        });
    }
}

/// `1 / (1 + e^-x)` by a polynomial that compilers turn into vector instructions (Cephes' `expf`),
/// accurate to about 2e-7.
#[inline(always)]
fn sigmoid(x: f32) -> f32 {
    // 1.5 * 2^23: adding it rounds to an integer, which the lowest bits contain.
    const ROUND: f32 = 12_582_912.0;
    let t = (-x).clamp(-87.0, 87.0);
    let rounded = t * std::f32::consts::LOG2_E + ROUND;
    let n = rounded - ROUND;
    let r = t - n * 0.693_359_4 + n * 2.121_944_4e-4;
    let mut p = 1.987_569_1e-4;
    for c in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 0.166_666_65, 0.5] {
        p = p * r + c;
    }
    let power = f32::from_bits((rounded.to_bits() << 23).wrapping_add(0x3f80_0000));
    1.0 / (1.0 + (p * r * r + r + 1.0) * power)
}

/// `x sigmoid(x)` (Elfwing et al. 2018), in place.
pub fn silu(values: &mut [f32]) {
    dispatch(|| values.iter_mut().for_each(|x| *x *= sigmoid(*x)));
}

/// Replaces inputs of [`silu`] by its slope at these inputs times a gradient.
///
/// # Panics
/// If the two differ in length.
pub fn silu_backward(values: &mut [f32], back: &[f32]) {
    assert_eq!(values.len(), back.len());
    dispatch(|| {
        for (x, b) in values.iter_mut().zip(back) {
            let s = sigmoid(*x);
            *x = b * s * (1.0 + *x * (1.0 - s));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(count: usize, step: f32) -> Vec<f32> {
        (0..count).map(|i| (i as f32 * step).sin()).collect()
    }

    fn geometries() -> [Convolution; 5] {
        [
            Convolution { side: 8, inputs: 3, outputs: 5, kernel: 4, stride: 2 },
            Convolution { side: 6, inputs: 2, outputs: 3, kernel: 3, stride: 2 },
            Convolution { side: 5, inputs: 2, outputs: 4, kernel: 3, stride: 1 },
            Convolution { side: 64, inputs: 40, outputs: 2, kernel: 3, stride: 1 },
            Convolution::dense(7, 3),
        ]
    }

    #[test]
    fn a_convolution_is_the_sum_over_its_window() {
        for c in geometries() {
            let images = wave(2 * c.input_len(), 0.37);
            let weights = wave(c.neighbourhood() * c.outputs, 0.73);
            let mut out = vec![1.0; 2 * c.output_len()];
            c.forward(&images, &weights, &mut out);
            let (after, pad) = (c.side_after(), (c.kernel - 1) / 2);
            for (at, got) in out.iter().enumerate().step_by(1 + out.len() / 500) {
                let (cell, o) = (at / c.outputs, at % c.outputs);
                let (image, y, x) = (cell / after / after, cell / after % after, cell % after);
                let mut want = 1.0;
                for (ky, kx) in (0..c.kernel * c.kernel).map(|k| (k / c.kernel, k % c.kernel)) {
                    let (row, column) = ((y * c.stride + ky).wrapping_sub(pad), (x * c.stride + kx).wrapping_sub(pad));
                    if row < c.side && column < c.side {
                        for i in 0..c.inputs {
                            want += images[((image * c.side + row) * c.side + column) * c.inputs + i]
                                * weights[((ky * c.kernel + kx) * c.inputs + i) * c.outputs + o];
                        }
                    }
                }
                assert!((got - want).abs() < 1e-4, "{c:?} {at}: {got} {want}");
            }
        }
    }

    /// The map is linear in images and in weights, so products with the gradients equal products
    /// with the output.
    #[test]
    fn backward_is_the_adjoint_of_forward() {
        let dot = |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum() };
        for c in geometries() {
            let images = wave(3 * c.input_len(), 0.37);
            let weights = wave(c.neighbourhood() * c.outputs, 0.73);
            let back = wave(3 * c.output_len(), 0.91);
            let mut out = vec![0.0; back.len()];
            c.forward(&images, &weights, &mut out);
            let (mut to_weights, mut to_images) = (vec![0.0; weights.len()], vec![0.0; images.len()]);
            c.backward(&images, &weights, &back, &mut to_weights, Some(&mut to_images));
            let want = dot(&out, &back);
            for got in [dot(&weights, &to_weights), dot(&images, &to_images)] {
                assert!((got - want).abs() < 1e-3 * (1.0 + want.abs()), "{c:?} {got} {want}");
            }
        }
    }

    #[test]
    fn silu_and_its_slope_match_their_formulas() {
        let values: Vec<f32> = (-4000..4000).map(|i| i as f32 * 0.03).collect();
        let (mut got, mut slope) = (values.clone(), values.clone());
        silu(&mut got);
        silu_backward(&mut slope, &vec![1.0; values.len()]);
        for ((x, got), slope) in values.iter().map(|x| f64::from(*x)).zip(got).zip(slope) {
            let s = 1.0 / (1.0 + (-x).exp());
            assert!((f64::from(got) - x * s).abs() < 1e-6 * (1.0 + x.abs()), "{x}");
            assert!((f64::from(slope) - s * (1.0 + x * (1.0 - s))).abs() < 1e-5, "{x}");
        }
        let mut odd = [f32::NAN, f32::INFINITY, -1e30];
        silu(&mut odd);
        assert!(odd[0].is_nan() && odd[1] == f32::INFINITY && odd[2].abs() < 1e-6);
    }
}
