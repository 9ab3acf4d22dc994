//! Connected components of pixels.

use std::ops::Range;

use crate::picture::Plane;

/// Iterates over the neighbours of a pixel within a plane of `size`: four, or eight with the
/// diagonals.
pub(super) fn neighbours(
    (x, y): (usize, usize),
    (width, height): (usize, usize),
    diagonals: bool,
) -> impl Iterator<Item = (usize, usize)> {
    const STEPS: [(isize, isize); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)];
    STEPS[..if diagonals { 8 } else { 4 }].iter().filter_map(move |&(dx, dy)| {
        let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
        (x < width && y < height).then_some((x, y))
    })
}

/// Iterates over the pixels of the outermost rows and columns, each once.
pub(super) fn border((width, height): (usize, usize)) -> impl Iterator<Item = (usize, usize)> {
    (0..height).flat_map(move |y| {
        let step = if y == 0 || y + 1 == height { 1 } else { width.saturating_sub(1).max(1) };
        (0..width).step_by(step).map(move |x| (x, y))
    })
}

/// A connected set of pixels, stored as runs within rows, in row-major order.
pub(super) struct Component {
    runs: Vec<Run>,
    /// Number of pixels.
    count: usize,
}

/// Consecutive pixels of one row.
struct Run {
    row: usize,
    columns: Range<usize>,
}

impl Component {
    /// Returns the number of pixels.
    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// Iterates over the pixels in row-major order.
    pub(super) fn pixels(&self) -> impl Iterator<Item = (usize, usize)> {
        self.runs.iter().flat_map(|run| run.columns.clone().map(|x| (x, run.row)))
    }

    /// Returns a mask of this size with the pixels at most `reach` rows and columns away.
    ///
    /// # Panics
    /// If the set does not fit into the mask.
    pub(super) fn mask(&self, reach: usize, (width, height): (usize, usize)) -> Plane<bool> {
        let mut plane = Plane::from_vec(width, height, vec![false; width * height]);
        self.runs.iter().for_each(|run| run.mark(reach, &mut plane));
        plane
    }
}

impl Run {
    /// Marks the pixels at most `reach` rows and columns away.
    fn mark(&self, reach: usize, plane: &mut Plane<bool>) {
        let (width, height) = plane.size();
        let columns = self.columns.start.saturating_sub(reach)..(self.columns.end + reach).min(width);
        for row in self.row.saturating_sub(reach)..(self.row + reach + 1).min(height) {
            plane.as_mut_slice()[row * width..][columns.clone()].fill(true);
        }
    }
}

/// Returns the connected sets of `open` pixels, by their first pixels in row-major order.
///
/// Pixels are connected to the four pixels beside, above and below, with `diagonals` to all eight
/// around. Rows are joined run by run (Rosenfeld and Pfaltz 1966).
pub(super) fn components(
    size: (usize, usize),
    diagonals: bool,
    open: impl Fn((usize, usize)) -> bool,
) -> Vec<Component> {
    let (runs, mut sets) = runs(size, diagonals, open);
    let mut components: Vec<Component> = Vec::new();
    let mut number = vec![usize::MAX; runs.len()];
    for (at, run) in runs.into_iter().enumerate() {
        let root = sets.root(at);
        if number[root] == usize::MAX {
            number[root] = components.len();
            components.push(Component { runs: Vec::new(), count: 0 });
        }
        let component = &mut components[number[root]];
        component.count += run.columns.len();
        component.runs.push(run);
    }
    components
}

/// Returns the runs of open pixels in row-major order, and the sets of connected runs by their
/// indices.
fn runs(
    (width, height): (usize, usize),
    diagonals: bool,
    open: impl Fn((usize, usize)) -> bool,
) -> (Vec<Run>, DisjointSets) {
    let (mut runs, mut sets) = (Vec::<Run>::new(), DisjointSets::default());
    let reach = usize::from(diagonals);
    // First run of the row above that can touch the next run.
    let mut above = 0;
    for row in 0..height {
        let first = runs.len();
        let mut x = 0;
        while x < width {
            let start = x;
            while x < width && open((x, row)) {
                x += 1;
            }
            if start < x {
                let columns = start..x;
                let own = sets.add();
                // Runs above that end before this one starts cannot touch later runs either.
                while above < first && runs[above].columns.end + reach <= start {
                    above += 1;
                }
                let touching = runs[above..first].iter().take_while(|run| run.columns.start < columns.end + reach);
                (above..).zip(touching).for_each(|(other, _)| sets.join(other, own));
                runs.push(Run { row, columns });
            }
            x += 1;
        }
        above = first;
    }
    (runs, sets)
}

/// Disjoint sets of numbers from zero on. The root of a set is its smallest number.
#[derive(Default)]
struct DisjointSets {
    parents: Vec<usize>,
}

impl DisjointSets {
    /// Adds a set with one new number, and returns the number.
    fn add(&mut self) -> usize {
        self.parents.push(self.parents.len());
        self.parents.len() - 1
    }

    fn root(&mut self, mut at: usize) -> usize {
        while self.parents[at] != at {
            // Halves the path, so that later searches are short.
            self.parents[at] = self.parents[self.parents[at]];
            at = self.parents[at];
        }
        at
    }

    fn join(&mut self, one: usize, other: usize) {
        let (one, other) = (self.root(one), self.root(other));
        self.parents[one.max(other)] = one.min(other);
    }
}

/// Returns a mask of the `open` pixels that are connected to the border of the picture through open
/// pixels, and their number.
pub(super) fn connected_to_border(
    (width, height): (usize, usize),
    diagonals: bool,
    open: impl Fn((usize, usize)) -> bool,
) -> (Plane<bool>, usize) {
    let (runs, mut sets) = runs((width, height), diagonals, open);
    let mut is_outer = vec![false; runs.len()];
    for (at, Run { row, columns }) in runs.iter().enumerate() {
        if *row == 0 || row + 1 == height || columns.start == 0 || columns.end == width {
            is_outer[sets.root(at)] = true;
        }
    }
    let mut reached = Plane::from_vec(width, height, vec![false; width * height]);
    let mut count = 0;
    for (at, run) in runs.iter().enumerate() {
        if is_outer[sets.root(at)] {
            run.mark(0, &mut reached);
            count += run.columns.len();
        }
    }
    (reached, count)
}

/// Returns the largest 4-connected set of `open` pixels.
///
/// Among sets of equal size, returns the topmost.
pub(super) fn largest_component(size: (usize, usize), open: impl Fn((usize, usize)) -> bool) -> Option<Component> {
    let larger = |best: Component, next: Component| if next.len() > best.len() { next } else { best };
    components(size, false, open).into_iter().reduce(larger)
}

/// Returns `set` with its holes filled.
///
/// Holes are the pixels that cannot be reached from the border of the picture around `set`.
pub(super) fn fill_holes(set: &Plane<bool>) -> Plane<bool> {
    let (mut filled, _) = connected_to_border(set.size(), true, |at| !set[at]);
    filled.as_mut_slice().iter_mut().for_each(|reached| *reached = !*reached);
    filled
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    fn plane(rows: &[&str]) -> Plane<bool> {
        Plane::from_fn(rows[0].len(), rows.len(), |x, y| rows[y].as_bytes()[x] == b'#')
    }

    #[test]
    fn finds_the_largest_component_and_fills_its_holes() {
        let mask = plane(&["#.....", "..###.", "..#.#.", "..###.", "......", "##...#"]);
        let largest = largest_component(mask.size(), |at| mask[at]).unwrap();
        assert_eq!(largest.len(), 8);
        let component = largest.mask(0, mask.size());
        assert_eq!(component, plane(&["......", "..###.", "..#.#.", "..###.", "......", "......"]));
        assert_eq!(largest.mask(1, mask.size()), plane(&[".#####", ".#####", ".#####", ".#####", ".#####", "......"]));
        let filled = fill_holes(&component);
        assert_eq!(filled, plane(&["......", "..###.", "..###.", "..###.", "......", "......"]));
        assert!(largest_component((3, 2), |_| false).is_none());
    }

    /// Compares random sets with a search from each pixel.
    #[test]
    fn components_match_a_search() {
        let mut rng = Pcg64::seed_from_u64(4);
        for (case, share) in [0.2, 0.4, 0.5, 0.6, 0.8].into_iter().cycle().take(60).enumerate() {
            let size = (rng.random_range(1..30), rng.random_range(1..30));
            let set = Plane::from_fn(size.0, size.1, |_, _| rng.random_bool(share));
            let diagonals = case % 2 == 0;
            let mut visited = set.map(|_| false);
            let mut want = Vec::new();
            for seed in (0..size.0 * size.1).map(|i| (i % size.0, i / size.0)) {
                let mut part = if set[seed] && !visited[seed] { vec![seed] } else { continue };
                visited[seed] = true;
                let mut next = 0;
                while next < part.len() {
                    for at in neighbours(part[next], size, diagonals).filter(|at| set[*at]) {
                        if !std::mem::replace(&mut visited[at], true) {
                            part.push(at);
                        }
                    }
                    next += 1;
                }
                part.sort_by_key(|(x, y)| (*y, *x));
                want.push(part);
            }
            let got = components(size, diagonals, |at| set[at]);
            let pixels: Vec<Vec<_>> = got.iter().map(|component| component.pixels().collect()).collect();
            assert_eq!(pixels, want, "{size:?} {diagonals}");
            let mut reached = set.map(|_| false);
            let is_outer = |part: &&Vec<_>| border(size).any(|at| part.contains(&at));
            want.iter().filter(is_outer).flatten().for_each(|at| reached[*at] = true);
            let count = reached.as_slice().iter().filter(|reached| **reached).count();
            assert_eq!(connected_to_border(size, diagonals, |at| set[at]), (reached, count));
        }
    }

    #[test]
    fn the_border_has_each_pixel_once() {
        for (size, count) in [((5, 4), 14), ((1, 4), 4), ((4, 1), 4), ((2, 2), 4), ((0, 0), 0), ((1, 1), 1)] {
            let mut all: Vec<_> = border(size).collect();
            all.sort_unstable();
            all.dedup();
            assert_eq!((all.len(), border(size).count()), (count, count), "{size:?}");
        }
    }
}
