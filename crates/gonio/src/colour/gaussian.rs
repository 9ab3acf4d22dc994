//! Small dense systems.

/// Solves `a x = b` for a symmetric positive definite `a` (rows) and several right sides `b` (as
/// many rows as `a`), in place of `b`, by the Cholesky factor. Returns the logarithm of the
/// determinant; pivots below a trillionth of the largest diagonal are raised to that.
pub(super) fn solve<const M: usize>(a: &[Vec<f64>], b: &mut [[f64; M]]) -> f64 {
    let n = a.len();
    let least = 1e-12 * (0..n).map(|i| a[i][i]).fold(1e-300, f64::max);
    let mut factor = vec![vec![0.0; n]; n];
    let mut log_determinant = 0.0;
    for i in 0..n {
        for j in 0..=i {
            let inner: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
            factor[i][j] = if i == j { (a[i][i] - inner).max(least).sqrt() } else { (a[i][j] - inner) / factor[j][j] };
        }
        log_determinant += 2.0 * factor[i][i].ln();
    }
    // Forward, then back, all right sides at once.
    let less = |b: &mut [[f64; M]], i: usize, k: usize, times: f64| {
        let other = b[k];
        b[i].iter_mut().zip(other).for_each(|(x, y)| *x -= times * y);
    };
    for i in 0..n {
        (0..i).for_each(|k| less(b, i, k, factor[i][k]));
        b[i].iter_mut().for_each(|x| *x /= factor[i][i]);
    }
    for i in (0..n).rev() {
        (i + 1..n).for_each(|k| less(b, i, k, factor[k][i]));
        b[i].iter_mut().for_each(|x| *x /= factor[i][i]);
    }
    log_determinant
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_is_solved() {
        let a = vec![vec![4.0, 2.0, 0.4], vec![2.0, 3.0, -1.0], vec![0.4, -1.0, 2.0]];
        let want = [[1.0, 0.5], [-2.0, 0.0], [3.0, 1.0]];
        let mut b: Vec<[f64; 2]> =
            a.iter().map(|row| [0, 1].map(|m| row.iter().zip(&want).map(|(a, x)| a * x[m]).sum())).collect();
        let log_determinant = solve(&a, &mut b);
        assert!(b.iter().zip(&want).all(|(x, y)| (x[0] - y[0]).abs() + (x[1] - y[1]).abs() < 1e-12));
        // By the rule of Sarrus.
        let determinant: f64 = 24.0 - 0.8 - 0.8 - 0.48 - 4.0 - 8.0;
        assert!((log_determinant - determinant.ln()).abs() < 1e-12);
    }
}
