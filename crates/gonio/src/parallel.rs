//! Parallel maps.
//!
//! The compiler translates each parallel iterator of rayon to some 4,000 lines of LLVM code. The
//! maps here share one loop over a function pointer, so that the library compiles faster.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::iter::{IntoParallelIterator, ParallelIterator};

/// Largest number of parts into which a map is divided.
const PARTS: usize = 256;

/// Applies a function to each item in parallel, and returns the results in the order of the items.
pub(crate) fn map<'a, A: Sync, T: Send>(items: &'a [A], f: impl Fn(&'a A) -> T + Sync) -> Vec<T> {
    map_range(items.len(), |at| f(&items[at]))
}

/// Applies a function to each of the numbers from zero to `count - 1` in parallel, and returns the
/// results in the order of the numbers.
pub(crate) fn map_range<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    in_parts(count, |part| part.map(&f).collect())
}

/// Applies a function as [`map_range`] does, and joins the lists that it returns.
pub(crate) fn flat_map_range<I: IntoIterator<Item: Send>>(count: usize, f: impl Fn(usize) -> I + Sync) -> Vec<I::Item> {
    in_parts(count, |part| part.flat_map(&f).collect())
}

/// Applies a function to ranges of the numbers from zero to `count - 1` in parallel, and joins the
/// lists that it returns.
fn in_parts<T: Send>(count: usize, f: impl Fn(Range<usize>) -> Vec<T> + Sync) -> Vec<T> {
    let size = count.div_ceil(PARTS).max(1);
    let parts: Vec<Mutex<Vec<T>>> = (0..count.div_ceil(size)).map(|_| Mutex::new(Vec::new())).collect();
    for_each(parts.len(), &|at| {
        let part = f(at * size..count.min((at + 1) * size));
        *parts[at].lock().unwrap_or_else(PoisonError::into_inner) = part;
    });
    let parts: Vec<Vec<T>> =
        parts.into_iter().map(|part| part.into_inner().unwrap_or_else(PoisonError::into_inner)).collect();
    let mut all = Vec::with_capacity(parts.iter().map(Vec::len).sum());
    for part in parts {
        all.extend(part);
    }
    all
}

fn for_each(count: usize, f: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(f);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_have_the_order_of_the_items() {
        for count in [0, 1, 2, 255, 256, 257, 1000, 1024] {
            let items: Vec<usize> = (0..count).map(|i| 7 * i + 3).collect();
            assert_eq!(map_range(count, |i| 7 * i + 3), items);
            let doubled: Vec<usize> = items.iter().map(|i| 2 * i).collect();
            assert_eq!(map(&items, |i| 2 * i), doubled);
            let odd: Vec<usize> = items.iter().copied().filter(|i| i % 2 == 1).collect();
            assert_eq!(flat_map_range(count, |i| (items[i] % 2 == 1).then_some(items[i])), odd);
        }
    }

    #[test]
    #[should_panic(expected = "at 300")]
    fn a_panic_is_propagated() {
        map_range(1000, |i| assert!(i != 300, "at {i}"));
    }
}
