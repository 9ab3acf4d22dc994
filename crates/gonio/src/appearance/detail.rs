//! Detail finer than the cells of the disk: highlights of less than a degree.
//!
//! A photograph of a thousand pixels across has dozens of pixels in a cell. One number describes
//! their finest structure: the distance of the quarters of a cell from the plane through the
//! neighbouring cells. It is invariant to rotations; with texture, its level follows from the
//! scatter.

use super::disk::{DISK_SIDE, on_disk};

/// Computes the root mean square distance of the quarters of each cell from a plane.
///
/// `values` and `counts` are those of the cells. The plane has the mean of the quarters. Its slopes
/// are the smaller of the slopes to the cells on either side (minmod), so the plane never
/// overshoots these cells. The slopes are zero if one of these cells has no count. The result is
/// `None` off the disk and where `quarters` returns `None`.
pub(crate) fn details(
    values: &[f32],
    counts: &[f32],
    quarters: impl Fn(usize) -> Option<[f32; 4]>,
) -> Vec<Option<f32>> {
    let slope = |cell: usize, step: usize| {
        let known = |c: usize| on_disk(c) && counts[c] > 0.0;
        if !known(cell - step) || !known(cell + step) {
            return 0.0;
        }
        let (before, after) = (values[cell] - values[cell - step], values[cell + step] - values[cell]);
        if before * after <= 0.0 { 0.0 } else { before.abs().min(after.abs()).copysign(after) }
    };
    // No cell at the border of the square is on the disk.
    let detail = |cell: usize| {
        let quarters = quarters(cell).filter(|_| on_disk(cell))?;
        let mean = 0.25 * quarters.iter().sum::<f32>();
        // The centre of a quarter is a quarter of a cell from the centre of the cell.
        let (x, y) = (0.25 * slope(cell, 1), 0.25 * slope(cell, DISK_SIDE));
        let plane = [-x - y, x - y, y - x, x + y];
        // Squares of single precision overflow for radiance above 1e19.
        let squares = quarters.iter().zip(plane).map(|(q, p)| f64::from(q - mean - p).powi(2));
        Some((0.25 * squares.sum::<f64>()).sqrt() as f32)
    };
    (0..DISK_SIDE * DISK_SIDE).map(detail).collect()
}

#[cfg(test)]
mod tests {
    use super::super::disk::{centre, quarters};
    use super::*;

    fn of(f: impl Fn(f32, f32) -> f32) -> Vec<Option<f32>> {
        let fine = |cell: usize| quarters(cell).map(|(x, y)| f(x, y));
        let values: Vec<f32> = (0..DISK_SIDE * DISK_SIDE).map(|c| 0.25 * fine(c).iter().sum::<f32>()).collect();
        details(&values, &vec![1.0; DISK_SIDE * DISK_SIDE], |c| Some(fine(c)))
    }

    fn inner() -> impl Iterator<Item = usize> {
        (0..DISK_SIDE * DISK_SIDE).filter(|&c| centre(c).0.hypot(centre(c).1) < 0.9)
    }

    #[test]
    fn planes_have_no_detail() {
        let plane = of(|x, y| 2.0 + x - 0.7 * y);
        assert!(inner().all(|c| plane[c].unwrap() < 1e-6));
        assert_eq!(plane[0], None);
    }

    #[test]
    fn alternating_quarters_are_entirely_detail() {
        // The plane through the cells is flat.
        let sign = |v: f32| if (((v + 1.0) * DISK_SIDE as f32) as usize).is_multiple_of(2) { 1.0 } else { -1.0 };
        let board = of(|x, y| 2.0 + 0.3 * sign(x) * sign(-y));
        assert!(inner().all(|c| (board[c].unwrap() - 0.3).abs() < 1e-6));
    }

    #[test]
    fn narrow_highlights_have_more_detail() {
        let most = |width: f32| {
            let lobe = of(|x, y| (-(x * x + y * y) / (width * width)).exp());
            inner().filter_map(|c| lobe[c]).fold(0.0, f32::max)
        };
        // Widths of 0.6, 1.1 and 2.3 degrees.
        let [fine, middle, wide] = [0.01, 0.02, 0.04].map(most);
        assert!(fine > 1.5 * middle && middle > 2.5 * wide, "{fine} {middle} {wide}");
    }
}
