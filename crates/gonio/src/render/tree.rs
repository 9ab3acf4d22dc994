//! Light as a tree of cells, each with its mean radiance and the deviation of its parts from it.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3, Vec3};

use crate::lighting::EnvironmentMap;
use crate::sphere::direction_of_lat_long;

/// A rectangle of a lat-long map, `u, v` in 0..=1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rectangle {
    u: f64,
    v: f64,
    du: f64,
    dv: f64,
}

/// Cell of a light, with the quantities that the integrator requires.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub(super) rectangle: Rectangle,
    /// Unit direction of the centre.
    pub(super) centre: DVec3,
    /// Upper bound (radians) of the angle from the centre to any point of the cell.
    pub(super) radius: f64,
    /// Solid angle, sr.
    pub(super) solid_angle: f64,
    /// Mean radiance.
    pub(super) mean: Vec3,
    /// Mean absolute deviation of the radiance from the mean, largest channel.
    pub(super) deviation: f32,
    /// Index of the first child and number of children, which are consecutive.
    ///
    /// `None` if the light in the cell is constant.
    children: Option<(u32, u32)>,
}

/// A piecewise constant light, as a quadtree.
#[derive(Clone, Debug)]
pub struct LightTree {
    nodes: Vec<Cell>,
    rotation: DQuat,
    /// Number of rows of a lat-long map of this resolution.
    rows: usize,
}

impl Cell {
    /// Creates a cell of constant radiance.
    fn new(r: Rectangle, mean: Vec3) -> Self {
        let (top, bottom) = ((PI * r.v).cos(), (PI * (r.v + r.dv)).cos());
        // `v` is the latitude that halves the solid angle.
        let v = (0.5 * (top + bottom)).clamp(-1.0, 1.0).acos() / PI;
        let widest = if r.v < 0.5 && r.v + r.dv > 0.5 { 1.0 } else { (PI * r.v).sin().max((PI * (r.v + r.dv)).sin()) };
        let tall = PI * (v - r.v).max(r.v + r.dv - v);
        let wide = 0.5 * TAU * r.du * widest;
        Self {
            rectangle: r,
            centre: direction_of_lat_long(r.u + 0.5 * r.du, v),
            radius: tall.hypot(wide).min(PI),
            solid_angle: TAU * r.du * (top - bottom),
            mean,
            deviation: 0.0,
            children: None,
        }
    }

    /// Returns width and height in radians.
    fn extent(&self) -> (f64, f64) {
        let tall = PI * self.rectangle.dv;
        (self.solid_angle / tall, tall)
    }
}

impl LightTree {
    /// Builds the tree of a lat-long map, exact to its pixels.
    pub fn of_map(map: &EnvironmentMap) -> Self {
        let (width, height) = map.radiance().size();
        let mut tree =
            Self { nodes: Vec::with_capacity(width * height * 4 / 3 + 8), rotation: DQuat::IDENTITY, rows: height };
        let whole = [0, width, 0, height];
        let root = leaf(whole, (width, height));
        tree.nodes.push(root);
        tree.fill(0, whole, (width, height), &|x, y| map.radiance()[(x, y)]);
        tree
    }

    /// Fills node `at`, which covers pixels `x0..x1` by `y0..y1`, and its descendants.
    fn fill(&mut self, at: usize, range: [usize; 4], size: (usize, usize), value: &dyn Fn(usize, usize) -> Vec3) {
        let [x0, x1, y0, y1] = range;
        if x1 - x0 == 1 && y1 - y0 == 1 {
            self.nodes[at].mean = value(x0, y0);
            return;
        }
        // Halves a rectangle along both sides, or only along the side that is longer than a pixel.
        let halves =
            |a: usize, b: usize| if b - a > 1 { vec![(a, (a + b) / 2), ((a + b) / 2, b)] } else { vec![(a, b)] };
        let parts: Vec<[usize; 4]> = halves(y0, y1)
            .into_iter()
            .flat_map(|(ya, yb)| halves(x0, x1).into_iter().map(move |(xa, xb)| [xa, xb, ya, yb]))
            .collect();
        let first = self.nodes.len();
        for part in &parts {
            self.nodes.push(leaf(*part, size));
        }
        for (i, part) in parts.iter().enumerate() {
            self.fill(first + i, *part, size, value);
        }
        let children = &self.nodes[first..first + parts.len()];
        let total: f64 = children.iter().map(|c| c.solid_angle).sum();
        let mean = children.iter().map(|c| c.mean * (c.solid_angle / total) as f32).sum::<Vec3>();
        let deviation = children
            .iter()
            .map(|c| (c.deviation + (c.mean - mean).abs().max_element()) * (c.solid_angle / total) as f32)
            .sum();
        let node = &mut self.nodes[at];
        node.mean = mean;
        node.deviation = deviation;
        node.children = Some((first as u32, parts.len() as u32));
    }

    /// Sets the rotation of the light relative to its original orientation.
    pub fn set_rotation(&mut self, turn: DQuat) {
        self.rotation = turn;
    }

    pub(super) fn root(&self) -> Cell {
        self.placed(self.nodes[0])
    }

    fn placed(&self, cell: Cell) -> Cell {
        Cell { centre: self.rotation * cell.centre, ..cell }
    }

    /// Returns the parts of a cell: its children, or four quarters of constant radiance.
    pub(super) fn divide(&self, cell: &Cell) -> impl Iterator<Item = Cell> + '_ {
        let (stored, made) = match cell.children {
            Some((first, count)) => (&self.nodes[first as usize..(first + count) as usize], None),
            None => (&self.nodes[..0], Some(*cell)),
        };
        let quarters = made.into_iter().flat_map(|cell| {
            let Rectangle { u, v, du, dv } = cell.rectangle;
            let (du, dv) = (0.5 * du, 0.5 * dv);
            [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
                .map(|(a, b)| Cell::new(Rectangle { u: u + a * du, v: v + b * dv, du, dv }, cell.mean))
        });
        stored.iter().copied().chain(quarters).map(|cell| self.placed(cell))
    }

    /// Returns the number of rows of a lat-long map of about this resolution.
    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    pub(super) fn turn(&self) -> DQuat {
        self.rotation
    }

    /// Calls `take` with direction, radiance and solid angle of samples of the unrotated light.
    ///
    /// Samples are at most `step` radians apart. Only every `parts`-th leaf cell is sampled,
    /// starting with number `part`.
    pub(super) fn samples(&self, step: f64, part: usize, parts: usize, mut take: impl FnMut(DVec3, Vec3, f64)) {
        let leaves = self.nodes.iter().filter(|cell| cell.children.is_none());
        for cell in leaves.skip(part).step_by(parts) {
            let Rectangle { u, v, du, dv } = cell.rectangle;
            let (wide, tall) = cell.extent();
            let number = |extent: f64| (extent / step).ceil().max(1.0) as usize;
            let (columns, rows) = (number(wide), number(tall));
            let along = |from: f64, length: f64, i: usize, n: usize| from + length * (i as f64 + 0.5) / n as f64;
            let solid_angle = cell.solid_angle / (columns * rows) as f64;
            let across: Vec<f64> = (0..columns).map(|column| along(u, du, column, columns)).collect();
            // Horizontal directions of all columns: rows of a lat-long map share their
            // trigonometry.
            let level: Vec<DVec3> = across.iter().map(|&u| direction_of_lat_long(u, 0.5)).collect();
            for v in (0..rows).map(|row| along(v, dv, row, rows)) {
                let (sin, cos) = (PI * v).sin_cos();
                for level in &level {
                    take(DVec3::new(sin * level.x, cos, sin * level.z), cell.mean, solid_angle);
                }
            }
        }
    }

    /// Returns the mean radiance over the sphere.
    pub fn mean(&self) -> Vec3 {
        self.nodes[0].mean
    }
}

/// Returns the black cell of pixels `x0..x1` by `y0..y1`.
fn leaf([x0, x1, y0, y1]: [usize; 4], (width, height): (usize, usize)) -> Cell {
    let (w, h) = (width as f64, height as f64);
    let rectangle =
        Rectangle { u: x0 as f64 / w, v: y0 as f64 / h, du: (x1 - x0) as f64 / w, dv: (y1 - y0) as f64 / h };
    Cell::new(rectangle, Vec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Plane;

    fn check(tree: &LightTree) {
        let mut stack = vec![tree.root()];
        let (mut solid_angle, mut leaves) = (0.0, 0);
        while let Some(cell) = stack.pop() {
            assert!((cell.centre.length() - 1.0).abs() < 1e-9);
            if cell.children.is_none() {
                solid_angle += cell.solid_angle;
                leaves += 1;
                // Quarters of a leaf lie within its radius and add up to its solid angle.
                let quarters: Vec<Cell> = tree.divide(&cell).collect();
                let sum: f64 = quarters.iter().map(|c| c.solid_angle).sum();
                assert!((sum / cell.solid_angle - 1.0).abs() < 0.05, "{sum} {}", cell.solid_angle);
                for q in quarters {
                    assert!(q.centre.angle_between(cell.centre) <= cell.radius + 1e-9);
                }
            } else {
                for child in tree.divide(&cell) {
                    assert!(child.centre.angle_between(cell.centre) <= cell.radius + 1e-9);
                    stack.push(child);
                }
            }
        }
        assert!((solid_angle / (4.0 * PI) - 1.0).abs() < 2e-3, "{solid_angle} over {leaves}");
    }

    #[test]
    fn cells_tile_the_sphere() {
        // Tests sides that are not powers of two as well.
        for height in [16, 15] {
            let picture = Plane::from_fn(2 * height, height, |x, y| Vec3::splat((x * y % 7) as f32 + 0.1));
            check(&LightTree::of_map(&EnvironmentMap::new(picture).unwrap()));
        }
    }

    #[test]
    fn rotated_light_matches_rotated_map() {
        let map = EnvironmentMap::new(Plane::from_fn(32, 16, |x, y| Vec3::splat((x + 3 * y) as f32))).unwrap();
        // A shift by three columns is a rotation about the vertical axis, right-handed from +z to
        // +x.
        let turn = DQuat::from_rotation_y(-TAU * 3.0 / 32.0);
        let (turned, mut tree) = (LightTree::of_map(&map.shifted_columns(3)), LightTree::of_map(&map));
        tree.set_rotation(turn);
        let leaves = |tree: &LightTree| {
            let (mut stack, mut out) = (vec![tree.root()], Vec::new());
            while let Some(cell) = stack.pop() {
                if cell.children.is_some() {
                    stack.extend(tree.divide(&cell));
                } else {
                    out.push((cell.centre, cell.mean.x));
                }
            }
            out
        };
        let (found, expected) = (leaves(&tree), leaves(&turned));
        for (centre, mean) in found {
            let nearest = expected.iter().min_by(|a, b| a.0.distance(centre).total_cmp(&b.0.distance(centre))).unwrap();
            assert!(nearest.0.distance(centre) < 1e-9 && nearest.1 == mean, "{centre} {mean} {nearest:?}");
        }
    }

    #[test]
    fn constant_light_has_no_deviation() {
        let tree = LightTree::of_map(&EnvironmentMap::new(Plane::from_fn(32, 16, |_, _| Vec3::ONE)).unwrap());
        assert!(tree.root().deviation < 1e-5);
        assert!((tree.mean() - Vec3::ONE).abs().max_element() < 1e-5);
    }
}
