//! Interpolation of directions that no view shows.

use glam::DVec3;

/// Brightness added before logarithms are taken, as a share of the mean.
const LOG_FLOOR: f64 = 0.01;

/// A map at one resolution: mean of the logarithms, and the known share of each texel.
struct Level {
    rows: usize,
    values: Vec<DVec3>,
    known: Vec<f64>,
}

impl Level {
    /// Returns the map at half the resolution.
    fn halved(&self) -> Self {
        let (rows, wide) = (self.rows / 2, 2 * self.rows);
        let texel = |i: usize| {
            let (x, y) = (i % (2 * rows), i / (2 * rows));
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(a, b)| (2 * y + b) * wide + 2 * x + a);
            let weight: f64 = four.iter().map(|&at| self.known[at]).sum();
            let sum: DVec3 = four.iter().map(|&at| self.known[at] * self.values[at]).sum();
            (if weight > 0.0 { sum / weight } else { DVec3::ZERO }, (0.5 * weight).min(1.0))
        };
        let (values, known) = (0..2 * rows * rows).map(texel).unzip();
        Self { rows, values, known }
    }

    /// Interpolates at a position in texels; columns are periodic.
    fn at(&self, x: f64, y: f64) -> DVec3 {
        let wide = 2 * self.rows as isize;
        let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
        let (a, b) = (x - 0.5 - left, y - 0.5 - top);
        let value = |column: f64, row: f64| {
            let column = (column as isize).rem_euclid(wide) as usize;
            let row = (row as isize).clamp(0, self.rows as isize - 1) as usize;
            self.values[row * wide as usize + column]
        };
        value(left, top)
            .lerp(value(left + 1.0, top), a)
            .lerp(value(left, top + 1.0).lerp(value(left + 1.0, top + 1.0), a), b)
    }
}

/// Fills a lat-long map of `rows` (a power of two) by twice as many columns.
///
/// The unknown share of each texel is interpolated smoothly from known texels around it; the fewer
/// are known nearby, the farther away they may be.
///
/// The interpolation averages logarithms, so that a lamp next to an unknown region does not spread
/// into it.
pub(super) fn fill(radiance: &mut [DVec3], known: &[f64], rows: usize) {
    let total: f64 = known.iter().sum();
    let mean = radiance.iter().zip(known).map(|(r, k)| *k * *r).sum::<DVec3>() / total.max(f64::MIN_POSITIVE);
    let floor = DVec3::splat(LOG_FLOOR * mean.element_sum() / 3.0).max(DVec3::splat(1e-30));
    let logarithm = |r: &DVec3| (*r + floor).map(f64::ln);
    let mut levels = vec![Level { rows, values: radiance.iter().map(logarithm).collect(), known: known.to_vec() }];
    while levels[levels.len() - 1].rows > 1 {
        levels.push(levels[levels.len() - 1].halved());
    }
    // If only one of the two coarsest texels is known, the other takes its value.
    let mut coarse = levels.pop().unwrap_or(Level { rows: 1, values: vec![], known: vec![] });
    if let ([a, b], [known_a, known_b]) = (&mut coarse.values[..], &coarse.known[..]) {
        if *known_a == 0.0 {
            *a = *b;
        } else if *known_b == 0.0 {
            *b = *a;
        }
    }
    while let Some(mut fine) = levels.pop() {
        for i in 0..fine.values.len() {
            let (x, y) = ((i % (2 * fine.rows)) as f64 + 0.5, (i / (2 * fine.rows)) as f64 + 0.5);
            fine.values[i] = coarse.at(0.5 * x, 0.5 * y).lerp(fine.values[i], fine.known[i].min(1.0));
        }
        coarse = fine;
    }
    for ((radiance, known), value) in radiance.iter_mut().zip(known).zip(&coarse.values) {
        let filled = (value.map(f64::exp) - floor).max(DVec3::ZERO);
        *radiance = *known * *radiance + (1.0 - known) * filled;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fills_holes_from_their_surroundings() {
        let rows = 32;
        let colour = DVec3::new(1.0, 2.0, 3.0);
        let hole = |x: usize, y: usize| (x as f64 - 32.0).hypot(y as f64 - 16.0) < 7.0;
        let known: Vec<f64> = (0..2 * rows * rows).map(|i| if hole(i % 64, i / 64) { 0.0 } else { 1.0 }).collect();
        let mut map: Vec<DVec3> = known.iter().map(|k| *k * colour).collect();
        // A lamp next to the hole keeps its value and does not spread.
        let lamp = 16 * 64 + 40;
        map[lamp] = 1e4 * colour;
        fill(&mut map, &known, rows);
        assert_eq!(map[lamp], 1e4 * colour);
        for (i, value) in map.iter().enumerate().filter(|(i, _)| *i != lamp) {
            assert!((*value / colour).max_element() < 8.0 && (*value / colour).min_element() > 0.9, "{i} {value}");
        }
        let middle = map[16 * 64 + 32] / colour;
        assert!(middle.max_element() < 2.0, "{middle}");
    }

    #[test]
    fn half_a_sphere_is_sufficient() {
        let known: Vec<f64> = (0..2 * 8 * 8).map(|i| if i % 16 < 8 { 1.0 } else { 0.0 }).collect();
        let mut map: Vec<DVec3> = known.iter().map(|k| DVec3::splat(*k)).collect();
        fill(&mut map, &known, 8);
        assert!(map.iter().all(|v| (v.x - 1.0).abs() < 1e-9), "{map:?}");
    }
}
