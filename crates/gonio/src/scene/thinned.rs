//! Thinning of observations to a few that represent all.

use glam::DVec3;

use super::Observations;
use crate::shape::SurfacePoint;
use crate::sphere::fibonacci_hemisphere;

/// Largest angle between an observation and the grid direction that it represents, in degrees.
const MAX_ANGLE: f64 = 2.0;

/// Smallest number of thinned observations; with fewer, all are subsampled evenly by index.
const FEWEST: usize = 200;

impl Observations {
    /// Selects up to about `count` of the observations, evenly over the normals in the view frame.
    ///
    /// Near each direction of an even grid, selects the observation of the highest
    /// [trust](Self::effective_weights), discounted by its distance. If there are no more than
    /// `count`, selects all with a value.
    pub(crate) fn thinned(&self, count: usize) -> Self {
        self.select(&evenly(&self.points, &self.effective_weights(), count))
    }
}

/// Returns the indices, ascending, of up to about `rows` of the points of positive weight.
fn evenly(points: &[SurfacePoint], weights: &[f64], rows: usize) -> Vec<usize> {
    let used: Vec<usize> = (0..points.len()).filter(|&i| weights[i] > 0.0).collect();
    if used.len() <= rows {
        return used;
    }
    let normals: Vec<(usize, DVec3)> = used.iter().map(|&i| (i, points[i].in_view())).collect();
    let (reach, width) = (MAX_ANGLE.to_radians().cos(), MAX_ANGLE.to_radians().powi(2));
    // 83 % of the hemisphere lies within 80 degrees.
    let mut near: Vec<usize> = fibonacci_hemisphere(rows * 6 / 5)
        .filter_map(|direction| {
            let within = normals.iter().filter(|(_, n)| n.dot(direction) > reach);
            // Squared distance, from the cosine, in units of the reach.
            let merit = |(i, n): &(usize, DVec3)| weights[*i] * (1.0 - 2.0 * (1.0 - n.dot(direction)) / width);
            within.max_by(|a, b| merit(a).total_cmp(&merit(b))).map(|(i, _)| *i)
        })
        .collect();
    near.sort_unstable();
    near.dedup();
    if near.len() >= FEWEST { near } else { used.iter().copied().step_by(used.len().div_ceil(rows)).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::ball;

    #[test]
    fn takes_all_of_few_points_except_those_without_weight() {
        let points = ball(300);
        let weights: Vec<f64> = (0..300).map(|i| f64::from(i % 3 != 0)).collect();
        let want: Vec<usize> = (0..300).filter(|i| i % 3 != 0).collect();
        assert_eq!(evenly(&points, &weights, 400), want);
    }

    #[test]
    fn thins_many_points_evenly() {
        let points = ball(12_000);
        let taken = evenly(&points, &[1.0; 12_000], 1600);
        assert!((1500..=1920).contains(&taken.len()), "{}", taken.len());
        let gap = fibonacci_hemisphere(500)
            .filter(|n| n.z > 0.2)
            .map(|n| taken.iter().map(|&i| points[i].normal.dot(n)).fold(-1.0, f64::max).acos().to_degrees());
        assert!(gap.fold(0.0, f64::max) < 4.0);
    }

    #[test]
    fn prefers_neighbours_of_larger_weight() {
        let points = ball(12_000);
        let weights: Vec<f64> = (0..12_000).map(|i| if i % 2 == 0 { 1.0 } else { 0.2 }).collect();
        let taken = evenly(&points, &weights, 1600);
        let poor = taken.iter().filter(|&&i| i % 2 == 1).count();
        assert!(poor < taken.len() / 20, "{poor} of {}", taken.len());
    }
}
