//! Plane projective maps.

use faer::Mat;
use glam::{DMat3, DVec2, DVec3};
use gonio_linalg::solve_positive;

/// Applies a homography to a point. The result is not finite at the horizon.
pub(super) fn apply(map: &DMat3, point: DVec2) -> DVec2 {
    let p = *map * DVec3::new(point.x, point.y, 1.0);
    DVec2::new(p.x / p.z, p.y / p.z)
}

/// Fits the homography that maps the first point of each pair to the second.
///
/// The fit is by least squares in the coordinates of the second point. `None` with fewer than four
/// pairs, or if they are degenerate.
pub(super) fn fit(pairs: &[(DVec2, DVec2)]) -> Option<DMat3> {
    if pairs.len() < 4 || !pairs.iter().all(|(from, to)| from.is_finite() && to.is_finite()) {
        return None;
    }
    let (source, target) = (normaliser(pairs.iter().map(|p| p.0))?, normaliser(pairs.iter().map(|p| p.1))?);
    let (mut matrix, mut right) = (Mat::<f64>::zeros(8, 8), vec![0.0; 8]);
    for (from, to) in pairs {
        let (p, q) = (apply(&source, *from), apply(&target, *to));
        let rows = [
            ([p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y], q.x),
            ([0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y], q.y),
        ];
        for (row, value) in rows {
            for i in 0..8 {
                right[i] += row[i] * value;
                for j in 0..8 {
                    matrix[(i, j)] += row[i] * row[j];
                }
            }
        }
    }
    let h = solve_positive(matrix, &right)?;
    let map = DMat3::from_cols_array_2d(&[[h[0], h[3], h[6]], [h[1], h[4], h[7]], [h[2], h[5], 1.0]]);
    let map = target.inverse() * map * source;
    (map.is_finite() && map.determinant().abs() > f64::MIN_POSITIVE).then_some(map)
}

/// Returns the map that centres points and scales their root mean square distance to one.
///
/// `None` if all points coincide.
fn normaliser(points: impl Iterator<Item = DVec2> + Clone) -> Option<DMat3> {
    let count = points.clone().count() as f64;
    let mean = points.clone().sum::<DVec2>() / count;
    let size = (points.map(|p| (p - mean).length_squared()).sum::<f64>() / count).sqrt();
    (size > 0.0 && size.is_finite())
        .then(|| DMat3::from_scale(DVec2::splat(size.recip())) * DMat3::from_translation(-mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fits_exactly_and_by_least_squares() {
        let map = DMat3::from_cols_array_2d(&[[50.0, 8.0, 0.01], [-6.0, 44.0, 0.02], [300.0, 200.0, 1.0]]);
        let pair = |x: f64, y: f64| (DVec2::new(x, y), apply(&map, DVec2::new(x, y)));
        let corners = [pair(0.0, 0.0), pair(5.0, 0.0), pair(5.0, 3.0), pair(0.0, 3.0)];
        let all: Vec<_> = (0..24).map(|i| pair((i % 6) as f64, (i / 6) as f64)).collect();
        for pairs in [&corners[..], &all] {
            let found = fit(pairs).unwrap();
            assert!(all.iter().all(|(from, to)| (apply(&found, *from) - *to).length() < 1e-6));
        }
        assert!(fit(&corners[..3]).is_none());
        assert!(fit(&[corners[0]; 4]).is_none());
        let line: Vec<_> = (0..4).map(|i| (corners[i].0, DVec2::splat(i as f64))).collect();
        assert!(fit(&line).is_none_or(|map| map.determinant().abs() < 1e-6));
    }
}
