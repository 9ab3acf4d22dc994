//! Smooth shading: low polynomials of the normal.
//!
//! Shading by distant light is smooth over the normals. These polynomials span the spherical
//! harmonics up to their degree.

use faer::Mat;
use glam::{DVec3, Vec3};
use gonio_linalg::{axpy, solve_positive, weighted_gram};

/// Relative ridge of the least squares: directions that no normal determines remain zero.
const RIDGE: f64 = 1e-7;

/// Polynomials of the normals of many cells, one column per cell; the first is constant.
pub(crate) struct ShadingBasis {
    columns: Mat<f64>,
}

/// Shading with a step between two paints.
pub(super) struct TwoPaints {
    /// Shading of each cell, as if it had the first paint.
    pub(super) shading: Vec<DVec3>,
    /// Difference of the second paint from the first.
    pub(super) step: DVec3,
}

impl ShadingBasis {
    /// Evaluates `(degree + 1)^2` polynomials at each unit normal.
    pub(crate) fn new(normals: &[Vec3], degree: usize) -> Self {
        let mut columns = Mat::zeros((degree + 1) * (degree + 1), normals.len());
        for (i, normal) in normals.iter().enumerate() {
            columns.col_as_slice_mut(i).copy_from_slice(&polynomials(normal.as_dvec3(), degree));
        }
        Self { columns }
    }

    /// Returns the differences between pairs of cells, without the constant.
    pub(super) fn differences(&self, pairs: &[(usize, usize)]) -> Self {
        let mut columns = Mat::zeros(self.columns.nrows() - 1, pairs.len());
        for (k, (i, j)) in pairs.iter().enumerate() {
            let (from, to) = (&self.columns.col_as_slice(*i)[1..], &self.columns.col_as_slice(*j)[1..]);
            let difference = columns.col_as_slice_mut(k).iter_mut();
            difference.zip(from.iter().zip(to)).for_each(|(difference, (from, to))| *difference = to - from);
        }
        Self { columns }
    }

    /// Returns the sum of all functions but the constant at each cell, for the coefficients of
    /// their differences.
    pub(super) fn without_constant(&self, coefficients: &[DVec3]) -> Vec<DVec3> {
        self.sums(1, coefficients)
    }

    /// Returns the sum of all functions at each cell.
    pub(crate) fn values(&self, coefficients: &[DVec3]) -> Vec<DVec3> {
        self.sums(0, coefficients)
    }

    fn sums(&self, first: usize, coefficients: &[DVec3]) -> Vec<DVec3> {
        let sum = |i: usize| {
            let functions = &self.columns.col_as_slice(i)[first..];
            functions.iter().zip(coefficients).map(|(x, c)| *x * *c).sum()
        };
        (0..self.columns.ncols()).map(sum).collect()
    }

    /// Fits coefficients to `values` by weighted least squares.
    pub(crate) fn fit(&self, values: &[DVec3], weights: &[f64]) -> Option<Vec<DVec3>> {
        least_squares(&self.columns, values, weights)
    }

    /// Fits shading and a step of the cells in `other`.
    pub(super) fn fit_two(&self, values: &[DVec3], other: &[bool], weights: &[f64]) -> Option<TwoPaints> {
        let size = self.columns.nrows();
        let mut columns = Mat::zeros(size + 1, self.columns.ncols());
        for (i, other) in other.iter().enumerate() {
            let column = columns.col_as_slice_mut(i);
            column[..size].copy_from_slice(self.columns.col_as_slice(i));
            column[size] = f64::from(u8::from(*other));
        }
        let mut coefficients = least_squares(&columns, values, weights)?;
        let step = coefficients.pop()?;
        Some(TwoPaints { shading: self.values(&coefficients), step })
    }
}

/// Returns the products of Legendre polynomials of x and y, of total degree up to `degree`, and
/// the products of total degree below `degree` times z.
pub(super) fn polynomials(normal: DVec3, degree: usize) -> Vec<f64> {
    let legendre = |x: f64| {
        let mut all = vec![1.0, x];
        for n in 1..degree {
            let n_real = n as f64;
            all.push(((2.0 * n_real + 1.0) * x * all[n] - n_real * all[n - 1]) / (n_real + 1.0));
        }
        all
    };
    let (along_x, along_y) = (legendre(normal.x), legendre(normal.y));
    let mut all = Vec::with_capacity((degree + 1) * (degree + 1));
    for (i, a) in along_x.iter().enumerate().take(degree + 1) {
        for (j, b) in along_y.iter().enumerate().take(degree + 1 - i) {
            all.push(a * b);
            if i + j < degree {
                all.push(a * b * normal.z);
            }
        }
    }
    all
}

/// Returns the degree of each of these polynomials.
pub(super) fn degrees(degree: usize) -> impl Iterator<Item = usize> {
    (0..=degree).flat_map(move |i| {
        (0..=degree - i).flat_map(move |j| [i + j, i + j + 1].into_iter().take(1 + usize::from(i + j < degree)))
    })
}

/// Solves weighted least squares for three channels; one column per value.
fn least_squares(columns: &Mat<f64>, values: &[DVec3], weights: &[f64]) -> Option<Vec<DVec3>> {
    let size = columns.nrows();
    let mut gram = weighted_gram(columns.as_ref(), weights);
    let ridge = RIDGE * (0..size).map(|i| gram[(i, i)]).fold(0.0, f64::max);
    (0..size).for_each(|i| gram[(i, i)] += ridge);
    let mut right = [0, 1, 2].map(|_| vec![0.0; size]);
    for (i, (value, weight)) in values.iter().zip(weights).enumerate() {
        for (c, right) in right.iter_mut().enumerate() {
            axpy(weight * value[c], columns.col_as_slice(i), right);
        }
    }
    let [x, y, z] = right.map(|right| solve_positive(gram.clone(), &right));
    let (x, y, z) = (x?, y?, z?);
    Some((0..size).map(|i| DVec3::new(x[i], y[i], z[i])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::fibonacci_hemisphere;

    fn normals() -> Vec<Vec3> {
        fibonacci_hemisphere(800).map(|normal| normal.as_vec3()).collect()
    }

    #[test]
    fn polynomials_span_the_harmonics_of_their_degree() {
        let normals = normals();
        let basis = ShadingBasis::new(&normals, 4);
        assert_eq!(basis.columns.nrows(), 25);
        // A harmonic of degree 4: 35 z^4 - 30 z^2 + 3.
        let values: Vec<DVec3> =
            normals.iter().map(|n| DVec3::splat(f64::from(35.0 * n.z.powi(4) - 30.0 * n.z.powi(2) + 3.0))).collect();
        let weights = vec![1.0; values.len()];
        let error = |degree: usize| {
            let basis = ShadingBasis::new(&normals, degree);
            let found = basis.values(&basis.fit(&values, &weights).unwrap());
            found.iter().zip(&values).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
        };
        assert!(error(4) < 0.01 && error(3) > 0.1, "{} {}", error(4), error(3));
    }

    #[test]
    fn polynomials_are_odd_or_even_as_their_degree() {
        let normal = DVec3::new(0.3, -0.5, 0.81);
        let (there, opposite) = (polynomials(normal, 6), polynomials(-normal, 6));
        let degrees: Vec<usize> = degrees(6).collect();
        assert_eq!((degrees.len(), degrees.iter().max()), (there.len(), Some(&6)));
        for (degree, (a, b)) in degrees.iter().zip(there.iter().zip(&opposite)) {
            let sign = if degree % 2 == 0 { 1.0 } else { -1.0 };
            assert!((a - sign * b).abs() < 1e-12, "degree {degree}: {a} {b}");
        }
    }

    #[test]
    fn a_step_on_shading_is_recovered() {
        let normals = normals();
        let other: Vec<bool> = normals.iter().map(|n| (6.0 * n.x).floor() as i32 % 2 == 0).collect();
        let step = DVec3::new(-1.0, 0.5, 0.2);
        let shading = |n: &Vec3| DVec3::new(1.0, 2.0, 0.5) * f64::from(n.y + 0.3 * n.x * n.z);
        let values: Vec<DVec3> =
            normals.iter().zip(&other).map(|(n, other)| shading(n) + if *other { step } else { DVec3::ZERO }).collect();
        let found = ShadingBasis::new(&normals, 3).fit_two(&values, &other, &vec![1.0; values.len()]).unwrap();
        assert!(found.step.distance(step) < 1e-4, "{}", found.step);
        assert!(found.shading.iter().zip(&normals).all(|(s, n)| s.distance(shading(n)) < 1e-3));
    }
}
