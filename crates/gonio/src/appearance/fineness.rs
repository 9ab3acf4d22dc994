//! Detail of an image that is finer than the texels of a light.

use super::disk::{DISK_SIDE, DiskImage};

/// Side of a block in cells: 3.6 degrees of the normal at the centre, over which the mirror
/// direction turns by about one texel of a light of 32 x 32.
const BLOCK: usize = 4;

/// Returns the largest share of an image that a light of 32 x 32 texels cannot resolve.
///
/// The share is the root mean square of the deviations of observed cells from the mean of their
/// block, relative to that of the image. It holds for any material.
pub fn fineness(image: &DiskImage) -> f64 {
    let (mut residual, mut all) = (0.0, 0.0);
    for block in 0..(DISK_SIDE / BLOCK).pow(2) {
        let (row, column) = (block / (DISK_SIDE / BLOCK) * BLOCK, block % (DISK_SIDE / BLOCK) * BLOCK);
        let cells = (0..BLOCK * BLOCK).map(|i| (row + i / BLOCK) * DISK_SIDE + column + i % BLOCK);
        let seen: Vec<f64> =
            cells.filter(|&cell| image.counts[cell] > 0.0).map(|cell| f64::from(image.values[cell])).collect();
        let mean = seen.iter().sum::<f64>() / seen.len().max(1) as f64;
        residual += seen.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        all += seen.iter().map(|value| value * value).sum::<f64>();
    }
    (residual / f64::max(all, f64::MIN_POSITIVE)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::appearance::disk::{centre, on_disk};

    fn image(value: impl Fn(f32, f32) -> f32) -> DiskImage {
        let at = |cell: usize| if on_disk(cell) { 1.0 } else { 0.0 };
        let counts: Vec<f32> = (0..DISK_SIDE * DISK_SIDE).map(at).collect();
        let values = (0..DISK_SIDE * DISK_SIDE).map(|cell| at(cell) * value(centre(cell).0, centre(cell).1)).collect();
        DiskImage::of_cells(values, counts, vec![None; DISK_SIDE * DISK_SIDE], 0.0)
    }

    #[test]
    fn smooth_images_have_low_and_fine_patterns_high_fineness() {
        assert!(fineness(&image(|_, _| 0.7)) < 1e-6);
        assert!(fineness(&image(|x, y| 1.0 + 0.5 * x - 0.3 * y)) < 0.02);
        // Stripes of one cell: half of the energy is in the mean of each block.
        let stripes = fineness(&image(|x, _| if (((x + 1.0) * 64.0) as usize).is_multiple_of(2) { 1.0 } else { 0.0 }));
        assert!((stripes - 0.5_f64.sqrt()).abs() < 0.02, "{stripes}");
        // Stripes that are two blocks wide.
        assert!(fineness(&image(|x, _| if (((x + 1.0) * 8.0) as usize).is_multiple_of(2) { 1.0 } else { 0.0 })) < 0.1);
    }
}
