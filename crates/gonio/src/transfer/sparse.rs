//! The light transport operator of a BRDF with a narrow lobe, stored sparsely.
//!
//! The lobe of a glossy material covers few texels of a fine grid, and the rest of the BRDF is
//! smooth. A row therefore stores weights of the texels near the mirror direction, and of larger
//! cells elsewhere. Each weight is that of the mean radiance of its cell.

use std::ops::Range;

use super::quadrature::CellSums;
use super::{InterleavedTables, Quadrature, QuadratureSettings};
use crate::parallel;
use crate::reflectance::BivariateTable;
use crate::shape::{Points, Visibility};
use crate::sphere::OctahedralMap;

/// Level of the largest cells, of which there are 16 per side, on finer grids.
const COARSEST: u32 = 4;

/// Number of parts into which the rows are divided; constant, so that results do not depend on the
/// number of threads.
const PARTS: usize = 16;

/// Operator `T` (points x texels) of one BRDF.
#[derive(Debug)]
pub struct SparseTransfer {
    /// Level of the texels, of which there are `2^level` per side.
    level: u32,
    points: usize,
    /// The rows, in [`PARTS`] parts.
    parts: Vec<Rows>,
}

/// Consecutive rows.
#[derive(Debug, Default)]
struct Rows {
    /// End of each row in `cells` and `weights`.
    ends: Vec<usize>,
    /// Indices of cells, as in [`CellSums`].
    cells: Vec<u32>,
    /// Weight of the mean radiance of each cell.
    weights: Vec<f32>,
}

impl Rows {
    fn ranges(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| start..end)
    }
}

impl SparseTransfer {
    /// Computes the operator of a table (1/sr), for lights of `side * side` texels.
    ///
    /// # Panics
    /// If the side is not a power of two from 4 to 512, or the visibility of the points has a
    /// finer grid or another map.
    pub fn new(points: Points<'_>, table: &BivariateTable, map: OctahedralMap, side: usize) -> Self {
        assert!(side.is_power_of_two() && (4..=512).contains(&side), "a grid of {side} texels per side");
        let Points { points, visibility } = points;
        assert!(visibility.is_none_or(|v| v.side() <= side && v.map() == map), "visibility on another grid");
        let level = side.ilog2();
        let quadrature = Quadrature::new(map, side, QuadratureSettings::default());
        let table = InterleavedTables::new(std::slice::from_ref(table));
        let parts = parallel::map_range(PARTS, |part| {
            let mut rows = Rows::default();
            let mut sums = CellSums::new(level);
            for at in range_of(part, points.len()) {
                quadrature.integrate_cells(&points[at], &table, COARSEST.min(level), &mut sums);
                sums.drain(|cell, weight| {
                    let weight = weight * visibility.map_or(1.0, |v| open_share(v, at, cell));
                    if weight > 0.0 {
                        rows.cells.push(cell as u32);
                        rows.weights.push(weight);
                    }
                });
                rows.ends.push(rows.cells.len());
            }
            rows
        });
        Self { level, points: points.len(), parts }
    }

    /// Computes the image `T l` (points) of the radiance `l` of the texels.
    ///
    /// # Panics
    /// If there are not `side * side` texels.
    pub fn image(&self, texels: &[f32]) -> Vec<f32> {
        let means = self.means(texels);
        let part = |rows: &Rows| -> Vec<f32> {
            let row = |range: Range<usize>| {
                let entries = rows.cells[range.clone()].iter().zip(&rows.weights[range]);
                entries.map(|(&cell, weight)| weight * means[cell as usize]).sum()
            };
            rows.ranges().map(row).collect()
        };
        parallel::map(&self.parts, part).concat()
    }

    /// Computes `T' e` (texels) of an image `e`.
    ///
    /// # Panics
    /// If there is not one value for each point.
    pub fn adjoint(&self, image: &[f32]) -> Vec<f32> {
        assert_eq!(image.len(), self.points);
        let parts = parallel::map_range(PARTS, |part| {
            let rows = &self.parts[part];
            let mut sums = vec![0.0; CellSums::first_of(self.level + 1)];
            for (range, value) in rows.ranges().zip(&image[range_of(part, self.points)]) {
                for (&cell, weight) in rows.cells[range.clone()].iter().zip(&rows.weights[range]) {
                    sums[cell as usize] += weight * value;
                }
            }
            sums
        });
        let mut sums = vec![0.0; CellSums::first_of(self.level + 1)];
        for part in &parts {
            sums.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
        for level in COARSEST..self.level {
            for cell in CellSums::first_of(level)..CellSums::first_of(level + 1) {
                let quarter = 0.25 * sums[cell];
                quarters(cell, level).into_iter().for_each(|next| sums[next] += quarter);
            }
        }
        sums.split_off(CellSums::first_of(self.level))
    }

    /// Returns the means of the texels over the cells of all levels.
    fn means(&self, texels: &[f32]) -> Vec<f32> {
        assert_eq!(texels.len(), 1 << (2 * self.level));
        let mut means = vec![0.0; CellSums::first_of(self.level)];
        means.extend(texels);
        for level in (COARSEST..self.level).rev() {
            for cell in CellSums::first_of(level)..CellSums::first_of(level + 1) {
                means[cell] = quarters(cell, level).into_iter().map(|next| 0.25 * means[next]).sum();
            }
        }
        means
    }
}

/// Returns the rows of a part.
fn range_of(part: usize, rows: usize) -> Range<usize> {
    rows * part / PARTS..rows * (part + 1) / PARTS
}

/// Returns the four cells of the next level that a cell consists of.
fn quarters(cell: usize, level: u32) -> [usize; 4] {
    let (x, y) = place_of(cell, level);
    let next = |(i, j)| CellSums::first_of(level + 1) + ((2 * y + j) << (level + 1)) + 2 * x + i;
    [(0, 0), (1, 0), (0, 1), (1, 1)].map(next)
}

/// Returns column and row of a cell on its level.
fn place_of(cell: usize, level: u32) -> (usize, usize) {
    let at = cell - CellSums::first_of(level);
    (at & ((1 << level) - 1), at >> level)
}

/// Returns the mean open share of a cell from a point.
fn open_share(visibility: &Visibility, point: usize, cell: usize) -> f32 {
    let level = (0..).find(|&level| cell < CellSums::first_of(level + 1)).expect("levels have no end");
    let (x, y) = place_of(cell, level);
    let grid = visibility.side().ilog2();
    let side = visibility.side();
    if level >= grid {
        let up = level - grid;
        return visibility.share(point, (y >> up) * side + (x >> up));
    }
    let wide = 1 << (grid - level);
    let texels = (0..wide * wide).map(|k| (y * wide + k / wide) * side + x * wide + k % wide);
    texels.map(|texel| visibility.share(point, texel)).sum::<f32>() / (wide * wide) as f32
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::shape::{SurfacePoint, VisibilityPoint};
    use crate::testing::{ball, on_threads};

    const MAP: OctahedralMap = OctahedralMap::EqualArea;
    const SIDE: usize = 64;

    /// A sharp lobe on a diffuse reflection.
    fn table() -> BivariateTable {
        BivariateTable::from_fn(|h, _| 0.2 + 30.0 / (1.0 + (h / 0.02_f64).powi(2)).powi(2))
    }

    /// A light that is dark but for a lamp and a bright half.
    fn texels() -> Vec<f32> {
        (0..SIDE * SIDE).map(|t| if t == 700 { 300.0 } else { 1.0 + ((t % SIDE) / (SIDE / 2)) as f32 }).collect()
    }

    fn visible() -> Vec<SurfacePoint> {
        ball(80).into_iter().filter(|p| p.normal.z > 0.2).collect()
    }

    #[test]
    fn images_match_the_dense_quadrature() {
        let points = visible();
        let transfer = SparseTransfer::new((&points).into(), &table(), MAP, SIDE);
        let dense = Quadrature::new(MAP, SIDE, QuadratureSettings::default());
        let tables = InterleavedTables::new(&[table()]);
        let (texels, got) = (texels(), transfer.image(&texels()));
        let mut weights = 0;
        for (point, got) in points.iter().zip(&got) {
            let mut row = vec![0.0; SIDE * SIDE];
            dense.integrate(point, &tables, &mut row);
            weights += row.iter().filter(|w| **w > 0.0).count();
            let want: f32 = row.iter().zip(&texels).map(|(w, l)| w * l).sum();
            assert!((got / want - 1.0).abs() < 0.02, "{got} {want} at {}", point.normal);
        }
        let stored: usize = transfer.parts.iter().map(|rows| rows.weights.len()).sum();
        assert!(4 * stored < weights, "{stored} weights instead of {weights}");
    }

    #[test]
    fn coarse_grids_have_cells_of_one_size() {
        let (points, table) = (visible(), table());
        for side in [4, 8, 16] {
            let transfer = SparseTransfer::new((&points).into(), &table, MAP, side);
            assert!(transfer.parts.iter().flat_map(|rows| &rows.weights).all(|weight| *weight > 0.0));
            let (image, all) = (transfer.image(&vec![1.0; side * side]), transfer.adjoint(&vec![1.0; points.len()]));
            assert!((image.iter().sum::<f32>() / all.iter().sum::<f32>() - 1.0).abs() < 1e-4, "{side}");
        }
    }

    #[test]
    fn adjoint_has_the_inner_products_of_the_image() {
        let points = visible();
        let transfer = SparseTransfer::new((&points).into(), &table(), MAP, SIDE);
        let e: Vec<f32> = (0..points.len()).map(|i| ((7 * i) % 11) as f32 - 3.0).collect();
        let inner = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let (image, adjoint) = (transfer.image(&texels()), transfer.adjoint(&e));
        let (left, right) = (inner(&image, &e), inner(&texels(), &adjoint));
        assert!((left / right - 1.0).abs() < 1e-5, "{left} {right}");
        assert_eq!(on_threads(1, || transfer.adjoint(&e)), on_threads(3, || transfer.adjoint(&e)));
    }

    #[test]
    fn occluded_texels_send_no_light() {
        use crate::shape::{BuiltInShape, Tracer};
        let tracer = Tracer::new(BuiltInShape::Bowl.mesh(30).unwrap());
        let points = [SurfacePoint { normal: DVec3::new(0.3, 0.1, 0.9).normalize(), view: DVec3::Z }];
        let from = VisibilityPoint { from: DVec3::new(0.3, 0.0, -0.5), normal: points[0].normal };
        for side in [8, 32] {
            let visibility = Visibility::trace(&tracer, &[from], MAP, side, &|_| ());
            let shadowed = SparseTransfer::new(Points::new(&points, Some(&visibility)), &table(), MAP, SIDE);
            let mut row = vec![0.0; SIDE * SIDE];
            let quadrature = Quadrature::new(MAP, SIDE, QuadratureSettings::default());
            quadrature.integrate(&points[0], &InterleavedTables::new(&[table()]), &mut row);
            let wide = SIDE / side;
            let open = |t: usize| visibility.share(0, t / SIDE / wide * side + t % SIDE / wide);
            let (all, want): (f32, f32) =
                (row.iter().sum(), row.iter().enumerate().map(|(t, weight)| weight * open(t)).sum());
            let got = shadowed.image(&[1.0; SIDE * SIDE])[0];
            assert!(want < 0.9 * all && (got / want - 1.0).abs() < 0.02, "{got} {want} {all}");
        }
    }
}
