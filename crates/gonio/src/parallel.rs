//! Parallel maps.
//!
//! The compiler translates each parallel iterator of rayon to some 4,000 lines of LLVM code. The
//! maps here share one loop over a function pointer, so that the library compiles faster.

use std::sync::{Mutex, PoisonError};

use rayon::iter::{IntoParallelIterator, ParallelIterator};

/// Largest number of parts into which a map is divided.
const PARTS: usize = 256;

/// Applies a function to each item in parallel, and returns the results in the order of the items.
pub fn map<'a, A: Sync, T: Send>(items: &'a [A], f: impl Fn(&'a A) -> T + Sync) -> Vec<T> {
    map_range(items.len(), |at| f(&items[at]))
}

/// Applies a function to each of the numbers from zero to `count - 1` in parallel, and returns the
/// results in the order of the numbers.
pub fn map_range<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let size = count.div_ceil(PARTS).max(1);
    let parts: Vec<Mutex<Vec<T>>> = (0..count.div_ceil(size)).map(|_| Mutex::new(Vec::new())).collect();
    for_each(parts.len(), &|at| {
        let part = (at * size..count.min((at + 1) * size)).map(&f).collect();
        *parts[at].lock().unwrap_or_else(PoisonError::into_inner) = part;
    });
    let mut all = Vec::with_capacity(count);
    for part in parts {
        all.append(&mut part.into_inner().unwrap_or_else(PoisonError::into_inner));
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
        }
    }

    #[test]
    #[should_panic(expected = "at 300")]
    fn a_panic_is_propagated() {
        map_range(1000, |i| assert!(i != 300, "at {i}"));
    }
}
