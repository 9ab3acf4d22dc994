//! Quadratic prediction of a pixel from the 5 x 5 pixels around it.

/// Offsets of the 24 neighbours of a pixel in the 5 x 5 pixels around it.
pub(in crate::scene) const NEIGHBOURS: [(isize, isize); 24] = {
    let (mut offsets, mut at, mut i) = ([(0, 0); 24], 0, 0);
    while i < 25 {
        if i != 12 {
            offsets[at] = (i % 5 - 2, i / 5 - 2);
            at += 1;
        }
        i += 1;
    }
    offsets
};

/// Number of coefficients of a quadratic of two variables.
const COEFFICIENTS: usize = 6;
/// Smallest number of known neighbours that determine the quadratic and its residuals.
const MIN_KNOWN: u32 = 10;
/// Smallest part of a column, relative to the whole, that the preceding columns do not explain.
const INDEPENDENT: f64 = 1e-6;
/// Smallest share of a neighbour's own value in its residual for the neighbour to be left out.
const MIN_FREEDOM: f64 = 1e-3;

/// Least-squares quadratic through the known neighbours of a pixel.
pub(in crate::scene) struct Stencil {
    /// Orthonormal columns of the design over the known neighbours; zero at the others. The last
    /// row is the pixel itself.
    columns: [[f64; 25]; COEFFICIENTS],
    /// Known neighbours, one bit each.
    known: u32,
}

/// Prediction of a pixel by a [`Stencil`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::scene) struct Prediction {
    /// Predicted value of the pixel.
    pub(in crate::scene) value: f64,
    /// Largest residual of a neighbour.
    pub(in crate::scene) largest: f64,
    /// Standard deviation of the residuals of the neighbours.
    pub(in crate::scene) deviation: f64,
    /// Mean of the neighbours.
    pub(in crate::scene) level: f64,
}

impl Stencil {
    /// Builds the stencil for a set of known neighbours (bit `i` is `NEIGHBOURS[i]`); `None` if
    /// they are too few.
    pub(in crate::scene) fn new(known: u32) -> Option<Self> {
        if known.count_ones() < MIN_KNOWN {
            return None;
        }
        let mut columns = [[0.0; 25]; COEFFICIENTS];
        for k in 0..COEFFICIENTS {
            let entry = |(x, y): (isize, isize)| {
                let (x, y) = (x as f64, y as f64);
                [1.0, x, y, x * x, x * y, y * y][k]
            };
            let mut column = [0.0; 25];
            for (value, offset) in column.iter_mut().zip(NEIGHBOURS.iter().chain([&(0, 0)])) {
                *value = entry(*offset);
            }
            let whole = dot(known, &column, &column);
            // A second pass removes the rounding errors of the first.
            for before in columns[..k].iter().chain(&columns[..k]) {
                let along = dot(known, &column, before);
                column.iter_mut().zip(before).for_each(|(value, b)| *value -= along * b);
            }
            let rest = dot(known, &column, &column);
            if rest > INDEPENDENT * whole {
                let scale = rest.sqrt().recip();
                columns[k] = column.map(|value| scale * value);
            }
        }
        Some(Self { columns, known })
    }

    /// Evaluates the quadratic at the neighbour of index `row`, or at the pixel itself for 24.
    pub(super) fn at(&self, values: &[f64; 24], row: usize) -> f64 {
        let known = || (0..24).filter(|i| self.known >> i & 1 == 1);
        let along = |column: &[f64; 25]| column[row] * known().map(|i| column[i] * values[i]).sum::<f64>();
        self.columns.iter().map(along).sum()
    }

    /// Predicts the pixel from its neighbours, without the one neighbour that fits the others
    /// least.
    ///
    /// The values of unknown neighbours are ignored.
    pub(in crate::scene) fn predict(&self, values: &[f64; 24]) -> Prediction {
        let known = || (0..24).filter(|i| self.known >> i & 1 == 1);
        let mut coefficients = [0.0; COEFFICIENTS];
        for (coefficient, column) in coefficients.iter_mut().zip(&self.columns) {
            *coefficient = known().map(|i| column[i] * values[i]).sum();
        }
        let fitted =
            |row: usize| coefficients.iter().zip(&self.columns).map(|(a, column)| a * column[row]).sum::<f64>();
        let influence = |row: usize, of: usize| self.columns.iter().map(|column| column[row] * column[of]).sum::<f64>();
        // Leaving out neighbour j reduces the sum of squares by r_j^2 / (1 - h_jj).
        let (mut worst, mut most, mut shift) = (None, 0.0, 0.0);
        for i in known() {
            let (residual, freedom) = (values[i] - fitted(i), 1.0 - influence(i, i));
            if freedom > MIN_FREEDOM && residual * residual / freedom > most {
                (worst, most, shift) = (Some(i), residual * residual / freedom, residual / freedom);
            }
        }
        let left_out = |row: usize| worst.map_or(0.0, |j| shift * influence(row, j));
        let (mut largest, mut squares, mut sum, mut count) = (0.0_f64, 0.0, 0.0, 0.0);
        for i in known().filter(|i| Some(*i) != worst) {
            let residual = values[i] - fitted(i) + left_out(i);
            largest = largest.max(residual.abs());
            squares += residual * residual;
            sum += values[i];
            count += 1.0;
        }
        Prediction {
            value: fitted(24) - left_out(24),
            largest,
            deviation: (squares / f64::max(count - COEFFICIENTS as f64, 1.0)).sqrt(),
            level: sum / f64::max(count, 1.0),
        }
    }
}

/// Inner product over the known neighbours.
fn dot(known: u32, a: &[f64; 25], b: &[f64; 25]) -> f64 {
    (0..24).filter(|i| known >> i & 1 == 1).map(|i| a[i] * b[i]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: u32 = (1 << 24) - 1;

    fn quadratic((x, y): (isize, isize)) -> f64 {
        let (x, y) = (x as f64, y as f64);
        3.0 + x - 2.0 * y + 0.3 * x * x - 0.2 * x * y + 0.1 * y * y
    }

    #[test]
    fn predicts_a_quadratic_despite_one_wrong_neighbour() {
        for wrong in 0..24 {
            let mut values = NEIGHBOURS.map(quadratic);
            values[wrong] += 1000.0;
            let found = Stencil::new(ALL).unwrap().predict(&values);
            assert!((found.value - 3.0).abs() < 1e-9 && found.largest < 1e-9, "{wrong}: {found:?}");
        }
    }

    #[test]
    fn predicts_from_one_side() {
        // Only the pixel's column and the two columns on its left are known.
        let known = (0..24).filter(|i| NEIGHBOURS[*i].0 <= 0).fold(0, |known, i| known | 1 << i);
        let mut values = NEIGHBOURS.map(quadratic);
        (0..24).filter(|i| known >> i & 1 == 0).for_each(|i| values[i] = f64::NAN);
        let found = Stencil::new(known).unwrap().predict(&values);
        assert!((found.value - 3.0).abs() < 1e-9 && found.deviation < 1e-9, "{found:?}");
        assert!(Stencil::new(0x1ff).is_none());
    }
}
