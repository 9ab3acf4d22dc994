//! Connected components of pixels.

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

/// Returns the `open` pixels connected to an open pixel `seed`, and marks them as visited. Visited
/// pixels are closed.
fn component(
    seed: (usize, usize),
    visited: &mut Plane<bool>,
    diagonals: bool,
    open: impl Fn((usize, usize)) -> bool,
) -> Vec<(usize, usize)> {
    let size = visited.size();
    let mut part = vec![seed];
    visited[seed] = true;
    let mut next = 0;
    while next < part.len() {
        for at in neighbours(part[next], size, diagonals) {
            if !visited[at] && open(at) {
                visited[at] = true;
                part.push(at);
            }
        }
        next += 1;
    }
    part
}

/// Iterates over the connected sets of `open` pixels, by their first pixels in row-major order.
///
/// The first pixel of a set comes first in it.
pub(super) fn components(
    size: (usize, usize),
    diagonals: bool,
    open: impl Fn((usize, usize)) -> bool,
) -> impl Iterator<Item = Vec<(usize, usize)>> {
    let mut visited = Plane::from_fn(size.0, size.1, |_, _| false);
    let pixels = (0..size.1).flat_map(move |y| (0..size.0).map(move |x| (x, y)));
    pixels.filter_map(move |seed| {
        if visited[seed] || !open(seed) {
            return None;
        }
        Some(component(seed, &mut visited, diagonals, &open))
    })
}

/// Marks in `reached` all pixels connected to `seeds` through `open` pixels; returns their number.
pub(super) fn flood(
    reached: &mut Plane<bool>,
    seeds: impl IntoIterator<Item = (usize, usize)>,
    diagonals: bool,
    open: impl Fn((usize, usize)) -> bool,
) -> usize {
    let mut count = 0;
    for seed in seeds {
        if open(seed) && !reached[seed] {
            count += component(seed, reached, diagonals, &open).len();
        }
    }
    count
}

/// Returns the largest 4-connected set of `open` pixels and its number of pixels.
///
/// Among sets of equal size, returns the topmost.
pub(super) fn largest_component(
    size: (usize, usize),
    open: impl Fn((usize, usize)) -> bool,
) -> Option<(Plane<bool>, usize)> {
    let larger = |best: Vec<_>, next: Vec<_>| if next.len() > best.len() { next } else { best };
    let largest = components(size, false, open).reduce(larger)?;
    let mut component = Plane::from_fn(size.0, size.1, |_, _| false);
    largest.iter().for_each(|at| component[*at] = true);
    Some((component, largest.len()))
}

/// Returns `set` with its holes filled.
///
/// Holes are the pixels that cannot be reached from the border of the picture around `set`.
pub(super) fn fill_holes(set: &Plane<bool>) -> Plane<bool> {
    let mut around = set.map(|_| false);
    flood(&mut around, border(set.size()), true, |at| !set[at]);
    around.map(|reached| !reached)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(rows: &[&str]) -> Plane<bool> {
        Plane::from_fn(rows[0].len(), rows.len(), |x, y| rows[y].as_bytes()[x] == b'#')
    }

    #[test]
    fn finds_the_largest_component_and_fills_its_holes() {
        let mask = plane(&["#.....", "..###.", "..#.#.", "..###.", "......", "##...#"]);
        let (component, count) = largest_component(mask.size(), |at| mask[at]).unwrap();
        assert_eq!(count, 8);
        assert_eq!(component, plane(&["......", "..###.", "..#.#.", "..###.", "......", "......"]));
        let filled = fill_holes(&component);
        assert_eq!(filled, plane(&["......", "..###.", "..###.", "..###.", "......", "......"]));
        assert!(largest_component((3, 2), |_| false).is_none());
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
