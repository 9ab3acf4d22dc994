//! Detection of squares that lie on a lattice.

use std::collections::{BTreeMap, VecDeque};

use glam::DVec2;

use super::squares::Square;

/// Number of nearest squares that may be neighbours on a lattice.
const NEIGHBOURS: usize = 8;
/// Largest distance of neighbours relative to the side of a square.
///
/// Patches of the chart are 1.15 sides apart, and lose a rim of one or two pixels to their edges.
const MAX_PITCH: f64 = 2.3;
/// Largest ratio of the sides of neighbouring squares.
const MAX_RATIO: f64 = 1.8;
/// Largest distance of a square from its position on the lattice, relative to that of neighbours.
const MAX_OFF: f64 = 0.22;
/// Largest number of squares that are examined, the largest first.
const MAX_SQUARES: usize = 4_000;

/// Centres of squares by column and row of a lattice.
pub(super) type Lattice = BTreeMap<(i32, i32), DVec2>;

/// Squares in the cells of a grid, for fast lookup near a point.
struct Index<'a> {
    squares: &'a [Square],
    cell: f64,
    cells: BTreeMap<(i64, i64), Vec<usize>>,
}

impl<'a> Index<'a> {
    fn of(squares: &'a [Square], cell: f64) -> Self {
        let mut cells: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
        for (i, square) in squares.iter().enumerate() {
            cells.entry(Self::key(square.centre, cell)).or_default().push(i);
        }
        Self { squares, cell, cells }
    }

    fn key(p: DVec2, cell: f64) -> (i64, i64) {
        ((p.x / cell).floor() as i64, (p.y / cell).floor() as i64)
    }

    /// Returns the squares within a distance of a point.
    fn near(&self, p: DVec2, reach: f64) -> impl Iterator<Item = usize> + '_ {
        let (low, high) = (Self::key(p - reach, self.cell), Self::key(p + reach, self.cell));
        let rows = move |x: i64| (low.1..=high.1).map(move |y| (x, y));
        (low.0..=high.0)
            .flat_map(rows)
            .filter_map(|key| self.cells.get(&key))
            .flatten()
            .copied()
            .filter(move |&i| self.squares[i].centre.distance(p) <= reach)
    }
}

/// Detects lattices of at least `least` squares. Each square belongs to at most one lattice.
pub(super) fn lattices(squares: &[Square], least: usize) -> Vec<Lattice> {
    let mut squares = squares.to_vec();
    squares.sort_by(|a, b| b.side.total_cmp(&a.side));
    squares.truncate(MAX_SQUARES);
    let Some(middle) = squares.get(squares.len() / 2) else { return Vec::new() };
    let index = Index::of(&squares, (2.0 * middle.side).max(1.0));
    let mut taken = vec![false; squares.len()];
    let mut found = Vec::new();
    for seed in 0..squares.len() {
        if taken[seed] {
            continue;
        }
        let grown = bases(&index, seed).into_iter().map(|basis| grow(&index, seed, basis));
        let Some(best) = grown.max_by_key(BTreeMap::len).filter(|best| best.len() >= least) else { continue };
        best.values().for_each(|&i| taken[i] = true);
        found.push(best.into_iter().map(|(cell, i)| (cell, squares[i].centre)).collect());
    }
    found
}

fn alike(a: f64, b: f64) -> bool {
    a.max(b) <= MAX_RATIO * a.min(b)
}

/// Returns pairs of vectors from a square to neighbours, roughly at right angles to each other.
fn bases(index: &Index<'_>, seed: usize) -> Vec<[DVec2; 2]> {
    let own = index.squares[seed];
    let mut near: Vec<DVec2> = index
        .near(own.centre, MAX_PITCH * own.side)
        .filter(|&i| i != seed && alike(index.squares[i].side, own.side))
        .map(|i| index.squares[i].centre - own.centre)
        .filter(|step| step.length() >= own.side)
        .collect();
    near.sort_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    near.truncate(NEIGHBOURS);
    let mut bases = Vec::new();
    for (i, u) in near.iter().enumerate() {
        for v in &near[i + 1..] {
            let cosine = u.dot(*v) / (u.length() * v.length());
            if cosine.abs() < 0.6 && alike(u.length(), v.length()) {
                // The order gives the basis the orientation of the picture's axes.
                bases.push(if u.perp_dot(*v) > 0.0 { [*u, *v] } else { [*v, *u] });
            }
        }
    }
    bases
}

/// Grows a lattice from a square and returns the indices of its squares.
///
/// The basis is updated from square to square, to follow the perspective.
fn grow(index: &Index<'_>, seed: usize, basis: [DVec2; 2]) -> BTreeMap<(i32, i32), usize> {
    let mut lattice = BTreeMap::from([((0, 0), seed)]);
    let mut used = std::collections::BTreeSet::from([seed]);
    let mut open = VecDeque::from([((0, 0), seed, basis)]);
    while let Some(((column, row), at, basis)) = open.pop_front() {
        let own = index.squares[at];
        let reach = MAX_OFF * basis[0].length().min(basis[1].length());
        for (axis, sign) in [(0, 1), (0, -1), (1, 1), (1, -1)] {
            let cell = if axis == 0 { (column + sign, row) } else { (column, row + sign) };
            if lattice.contains_key(&cell) {
                continue;
            }
            let expected = own.centre + f64::from(sign) * basis[axis];
            let next = index
                .near(expected, reach)
                .filter(|i| !used.contains(i) && alike(index.squares[*i].side, own.side))
                .min_by(|&a, &b| {
                    let off = |i: usize| index.squares[i].centre.distance_squared(expected);
                    off(a).total_cmp(&off(b))
                });
            if let Some(next) = next {
                let mut moved = basis;
                moved[axis] = 0.5 * (basis[axis] + f64::from(sign) * (index.squares[next].centre - own.centre));
                lattice.insert(cell, next);
                used.insert(next);
                open.push_back((cell, next, moved));
            }
        }
    }
    lattice
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detects_a_lattice_in_perspective_among_other_squares() {
        let at = |x: f64, y: f64, side: f64| Square { centre: DVec2::new(x, y), side };
        let on = |i: usize| {
            let (u, v) = ((i % 6) as f64, (i / 6) as f64);
            let w = 1.0 + 0.02 * u - 0.01 * v;
            at((100.0 + 30.0 * u + 5.0 * v) / w, (80.0 - 4.0 * u + 28.0 * v) / w, 22.0)
        };
        // Some patches are missing.
        let mut squares: Vec<Square> = (0..24).filter(|i| ![3, 23, 14].contains(i)).map(on).collect();
        squares.extend((0..40).map(|i| at((i * 97 % 400) as f64, (i * 61 % 300) as f64, 5.0 + (i % 7) as f64)));
        let found = lattices(&squares, 10);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].len(), 21);
        let (columns, rows): (Vec<i32>, Vec<i32>) = found[0].keys().copied().unzip();
        let extent = |cells: &[i32]| cells.iter().max().unwrap() - cells.iter().min().unwrap() + 1;
        let mut sides = [extent(&columns), extent(&rows)];
        sides.sort_unstable();
        assert_eq!(sides, [4, 6]);
        assert!(lattices(&[], 10).is_empty());
    }
}
