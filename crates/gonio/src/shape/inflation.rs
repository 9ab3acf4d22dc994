//! Inflation of an outline: a smooth surface with a given silhouette.
//!
//! The squared height `u` above the plane of the outline solves the Poisson equation `-Δu = 4` on
//! the object, with `u = 0` on the outline, where the surface turns away from the camera. The
//! solution for a circle is the sphere with this outline; that for an ellipse is an ellipsoid. The
//! height is `z = d sqrt(u)`. The factor `d` is `sqrt(2 / λ)` on average, where `λ` is the larger
//! principal curvature of `u`. Thus a long object is as deep as it is wide: an ellipse becomes the
//! spheroid about its longer axis, and a strip becomes a cylinder.
//!
//! Squared heights avoid the infinite slopes of heights at the outline (inflated silhouettes:
//! Prasad & Fitzgibbon 2006; Igarashi et al. 1999).

use glam::Vec3;

use crate::picture::Plane;

/// Relative residual at which a solution has converged.
const TOLERANCE: f64 = 1e-4;
/// Largest number of iterations on each level of the pyramid.
const ITERATIONS: usize = 400;
/// Longer side in pixels above which the solution of the next coarser level is nearly exact, and
/// the largest number of iterations there.
const LARGE: (usize, usize) = (1024, 20);
/// Side of the smallest level of the pyramid, in pixels.
const COARSEST: usize = 24;

/// A surface that is inflated from a silhouette.
#[derive(Clone, Debug, PartialEq)]
pub struct Inflation {
    /// Squared heights for a depth factor of one, in pixels squared; zero off the object.
    squares: Plane<f64>,
    /// Depth factor: 1 for a circle, `sqrt(1/2)` for a strip.
    depth: f64,
}

impl Inflation {
    /// Inflates the silhouette of an object. Where the border of the picture cuts the object, the
    /// surface continues as its mirror image.
    ///
    /// Returns `None` if no pixel is inside.
    pub fn of(inside: &Plane<bool>) -> Option<Self> {
        if !inside.as_slice().contains(&true) {
            return None;
        }
        let squares = solve(inside);
        let depth = depth(&squares);
        Some(Self { squares, depth })
    }

    /// Returns the depth factor, in `sqrt(1/2)..=1`.
    pub fn depth(&self) -> f64 {
        self.depth
    }

    /// Returns the unit normals: x right, y up, z towards the camera; zero off the object.
    pub fn normals(&self) -> Plane<Vec3> {
        let (width, height) = self.squares.size();
        Plane::from_fn(width, height, |x, y| {
            let square = self.squares[(x, y)];
            if square <= 0.0 {
                return Vec3::ZERO;
            }
            // The gradient of d sqrt(u) is d grad u / (2 sqrt(u)).
            let (right, down) = slopes(&self.squares, x, y);
            let half = 0.5 * self.depth;
            Vec3::new(-(half * right) as f32, (half * down) as f32, square.sqrt() as f32).normalize()
        })
    }
}

/// Returns the value at a pixel beside `(x, y)`. The value beyond the outline is the negative of
/// that at `(x, y)`, which makes the solution zero halfway between them; the border of the picture
/// mirrors the values.
fn beside(values: &Plane<f64>, (x, y): (usize, usize), (dx, dy): (isize, isize)) -> f64 {
    let own = values[(x, y)];
    let (Some(x), Some(y)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else { return own };
    if x >= values.width() || y >= values.height() {
        return own;
    }
    let other = values[(x, y)];
    if other > 0.0 { other } else { -own }
}

/// Returns the derivatives to the right and downwards.
fn slopes(values: &Plane<f64>, x: usize, y: usize) -> (f64, f64) {
    let at = |by| beside(values, (x, y), by);
    (0.5 * (at((1, 0)) - at((-1, 0))), 0.5 * (at((0, 1)) - at((0, -1))))
}

/// Returns the square root of the mean of `2 / λ`, with weights `u`, where `λ` is the larger
/// principal curvature of `u`.
fn depth(squares: &Plane<f64>) -> f64 {
    let (width, height) = squares.size();
    let (mut sum, mut weights) = (0.0, 0.0);
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            let own = squares[(x, y)];
            let at = |dx: usize, dy: usize| squares[(x + dx - 1, y + dy - 1)];
            let around = [at(0, 0), at(1, 0), at(2, 0), at(0, 1), at(2, 1), at(0, 2), at(1, 2), at(2, 2)];
            if own <= 0.0 || around.iter().any(|value| *value <= 0.0) {
                continue;
            }
            let across = 2.0 * own - at(0, 1) - at(2, 1);
            let along = 2.0 * own - at(1, 0) - at(1, 2);
            let mixed = 0.25 * (at(0, 0) + at(2, 2) - at(2, 0) - at(0, 2));
            let larger = 0.5 * (across + along) + (0.5 * (across - along)).hypot(mixed);
            // The curvatures sum to four. At concave parts of the outline, one of them is negative.
            sum += own * 2.0 / larger.clamp(2.0, 4.0);
            weights += own;
        }
    }
    if weights > 0.0 { (sum / weights).sqrt() } else { 1.0 }
}

/// Solves the Poisson equation, from coarse to fine.
fn solve(inside: &Plane<bool>) -> Plane<f64> {
    let (width, height) = inside.size();
    let start = if width.max(height) <= COARSEST {
        inside.map(|inside| if *inside { 1.0 } else { 0.0 })
    } else {
        let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
        let quarter = |x: usize, y: usize| {
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| (2 * x + dx, 2 * y + dy));
            let known = four.iter().filter(|(x, y)| *x < width && *y < height);
            2 * known.clone().filter(|at| inside[**at]).count() >= known.count()
        };
        let coarse = solve(&Plane::from_fn(half_width, half_height, quarter));
        // In pixels half as wide, squares are four times as large.
        Plane::from_fn(width, height, |x, y| {
            if !inside[(x, y)] {
                return 0.0;
            }
            let place = |at: usize, side: usize| {
                let near = at / 2;
                let far = if at.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(side - 1) };
                (near, far)
            };
            let ((nx, fx), (ny, fy)) = (place(x, half_width), place(y, half_height));
            let blended = 9.0 * coarse[(nx, ny)] + 3.0 * (coarse[(fx, ny)] + coarse[(nx, fy)]) + coarse[(fx, fy)];
            0.25 * blended
        })
    };
    refine(inside, start)
}

/// Improves a solution by conjugate gradients.
fn refine(inside: &Plane<bool>, start: Plane<f64>) -> Plane<f64> {
    let (width, height) = inside.size();
    let places: Vec<usize> = (0..width * height).filter(|&at| inside.as_slice()[at]).collect();
    // Index of the pixel in each direction: among the unknowns, outside, or beyond the border.
    let mut index = vec![usize::MAX; width * height];
    places.iter().enumerate().for_each(|(i, &at)| index[at] = i);
    let around: Vec<[usize; 4]> = places
        .iter()
        .enumerate()
        .map(|(i, &at)| {
            let (x, y) = (at % width, at / width);
            let next = |is_there: bool, by: isize| if is_there { index[at.wrapping_add_signed(by)] } else { i };
            let row = width as isize;
            [next(x > 0, -1), next(x + 1 < width, 1), next(y > 0, -row), next(y + 1 < height, row)]
        })
        .collect();
    let product = |values: &[f64]| -> Vec<f64> {
        let row = |(around, own): (&[usize; 4], &f64)| {
            around.iter().map(|&at| own - values.get(at).copied().unwrap_or(-own)).sum::<f64>()
        };
        around.iter().zip(values).map(row).collect()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut values: Vec<f64> = places.iter().map(|&at| start.as_slice()[at]).collect();
    let mut residual: Vec<f64> = product(&values).iter().map(|made| 4.0 - made).collect();
    let mut direction = residual.clone();
    let mut size = dot(&residual, &residual);
    let small = 16.0 * TOLERANCE * TOLERANCE * values.len() as f64;
    let most = if width.max(height) > LARGE.0 { LARGE.1 } else { ITERATIONS };
    for _ in 0..most {
        if size <= small {
            break;
        }
        let image = product(&direction);
        let curvature = dot(&direction, &image);
        if curvature <= 0.0 {
            // Nothing of the outline is in the picture: the equation has no solution.
            break;
        }
        let step = size / curvature;
        values.iter_mut().zip(&direction).for_each(|(value, d)| *value += step * d);
        residual.iter_mut().zip(&image).for_each(|(r, i)| *r -= step * i);
        let new = dot(&residual, &residual);
        direction.iter_mut().zip(&residual).for_each(|(d, r)| *d = r + new / size * *d);
        size = new;
    }
    let mut solved = Plane::from_fn(width, height, |_, _| 0.0);
    // The exact solution is positive: the operator is an M-matrix.
    places.iter().zip(values).for_each(|(&at, value)| solved.as_mut_slice()[at] = value.max(f64::MIN_POSITIVE));
    solved
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Angle in degrees between the inflated normals and those of an ellipsoid at pixels less than
    /// `within` of the way to the outline: mean and maximum.
    fn errors(size: (usize, usize), axes: (f64, f64), depth: f64, within: f64) -> (f64, f64) {
        let place = |x: usize, y: usize| {
            let (width, height) = (size.0 as f64, size.1 as f64);
            ((x as f64 + 0.5 - 0.5 * width) / axes.0, (0.5 * height - y as f64 - 0.5) / axes.1)
        };
        let inside = Plane::from_fn(size.0, size.1, |x, y| place(x, y).0.hypot(place(x, y).1) < 1.0);
        let normals = Inflation::of(&inside).unwrap().normals();
        let (mut sum, mut most, mut count) = (0.0, 0.0_f64, 0.0);
        for y in 0..size.1 {
            for x in 0..size.0 {
                let (u, v) = place(x, y);
                assert_eq!(normals[(x, y)] != Vec3::ZERO, inside[(x, y)]);
                if u.hypot(v) < within {
                    let height = (1.0 - u * u - v * v).sqrt();
                    let exact = glam::DVec3::new(u / axes.0, v / axes.1, height / depth).normalize();
                    let error = normals[(x, y)].as_dvec3().angle_between(exact).to_degrees();
                    (sum, most, count) = (sum + error, most.max(error), count + 1.0);
                }
            }
        }
        (sum / count, most)
    }

    #[test]
    fn a_circle_becomes_a_ball() {
        let (mean, most) = errors((220, 200), (90.0, 90.0), 90.0, 0.95);
        assert!(mean < 0.5 && most < 2.0, "{mean} {most}");
    }

    #[test]
    fn an_ellipse_becomes_the_spheroid_about_its_longer_axis() {
        let (mean, most) = errors((300, 160), (140.0, 70.0), 70.0, 0.95);
        assert!(mean < 0.7 && most < 3.0, "{mean} {most}");
        let (mean, most) = errors((100, 320), (40.0, 150.0), 40.0, 0.9);
        assert!(mean < 1.0 && most < 3.0, "{mean} {most}");
    }

    #[test]
    fn a_strip_across_the_picture_becomes_a_cylinder() {
        let inside = Plane::from_fn(200, 120, |_, y| (20..100).contains(&y));
        let inflated = Inflation::of(&inside).unwrap();
        assert!((inflated.depth() - 0.5_f64.sqrt()).abs() < 1e-4, "{}", inflated.depth());
        for y in [25, 40, 59] {
            let exact = (40.0_f64.powi(2) - (y as f64 + 0.5 - 60.0).powi(2)).sqrt();
            let height = inflated.depth() * inflated.squares[(100, y)].sqrt();
            assert!((height / exact - 1.0).abs() < 0.01, "{y}: {height} {exact}");
        }
    }

    #[test]
    fn the_solution_satisfies_the_equation() {
        // A ring with a notch: holes and concave corners.
        let inside = Plane::from_fn(90, 70, |x, y| {
            let r = (x as f64 - 44.0).hypot(y as f64 - 34.0);
            (10.0..30.0).contains(&r) && !(x > 60 && (30..36).contains(&y))
        });
        let squares = solve(&inside);
        let mut worst = 0.0_f64;
        for y in 0..70 {
            for x in 0..90 {
                let at = |by| beside(&squares, (x, y), by);
                if inside[(x, y)] {
                    let sum: f64 = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(at).iter().sum();
                    worst = worst.max((4.0 * squares[(x, y)] - sum - 4.0).abs());
                }
            }
        }
        assert!(worst < 0.01, "{worst}");
        assert_eq!(Inflation::of(&Plane::from_fn(8, 8, |_, _| false)), None);
        // Without an outline, there is nothing to inflate, but no panic.
        assert!(Inflation::of(&Plane::from_fn(40, 40, |_, _| true)).is_some());
    }
}
