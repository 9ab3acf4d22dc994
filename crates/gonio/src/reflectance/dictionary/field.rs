//! Smooth random factors over the two angles, by which drawn materials differ from mixtures.
//!
//! Reconstructed tables and formulas span few dimensions; real measurements do not. Fits of sixteen
//! axes of 141 reconstructed materials to the project's four RGL files leave errors of 0.2 to 0.5
//! in the logarithm. These errors are correlated over about 6 rows and 10 columns of the table. The
//! bodies of the RGL materials brighten or darken towards grazing half angles by up to a factor of
//! six.

use std::sync::LazyLock;

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::super::table::{CELLS, THETA_D, THETA_H, theta_d_of, theta_h_of};

/// Knots of the coarse and the fine part along the rows (half angle) and columns (difference
/// angle).
const KNOTS: [(usize, usize); 2] = [(7, 5), (17, 11)];

/// Standard deviation of each part in the logarithm, at the half angles of [`HALF_ANGLES`] and a
/// difference angle of zero.
const DEVIATIONS: [[f64; 5]; 2] = [[0.15, 0.18, 0.25, 0.4, 0.6], [0.15, 0.15, 0.15, 0.18, 0.22]];

/// Half angles in degrees at which [`DEVIATIONS`] are given; deviations are linear between them.
const HALF_ANGLES: [f64; 5] = [0.0, 8.0, 20.0, 45.0, 80.0];

/// Growth of the deviation from a difference angle of 0 to 90 degrees, quadratic in the angle.
const GROWTH: f64 = 1.2;

/// Mean and standard deviation of the logarithm of the body's change from a half angle of
/// [`GRAZING`]`.0` to [`GRAZING`]`.1` degrees.
const SLOPE: (f64, f64) = (-0.35, 0.8);

/// Range of half angles over which the body brightens or darkens, in degrees.
const GRAZING: (f64, f64) = (20.0, 75.0);

/// Range of the amplitudes of a material's field relative to [`DEVIATIONS`] and [`SLOPE`].
const AMPLITUDES: (f64, f64) = (0.35, 1.6);

/// Smooth random factors of the cells of a table: `exp` of a Gaussian random field of two scales
/// and of a slope towards grazing half angles.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialField {
    /// Coefficients of the coarse knots, then of the fine ones, row by row.
    coefficients: Vec<f32>,
    /// Logarithm of the change of the body between the half angles of [`GRAZING`].
    slope: f32,
}

impl MaterialField {
    /// Draws a field.
    pub(super) fn draw(rng: &mut Pcg64) -> Self {
        let amplitude = rng.random_range(AMPLITUDES.0.ln()..AMPLITUDES.1.ln()).exp();
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let slope = (amplitude * (SLOPE.0 + SLOPE.1 * normal())) as f32;
        let count: usize = KNOTS.iter().map(|(rows, columns)| rows * columns).sum();
        Self { coefficients: (0..count).map(|_| (amplitude * normal()) as f32).collect(), slope }
    }

    /// Returns the logarithm of the factor of each cell.
    pub(super) fn logs(&self) -> Vec<f32> {
        let mut logs: Vec<f32> = SHAPE.slope.iter().flat_map(|s| [self.slope * s; THETA_D]).collect();
        let mut rest = self.coefficients.as_slice();
        for (part, (rows, columns)) in SHAPE.parts.iter().zip(KNOTS) {
            let coefficients;
            (coefficients, rest) = rest.split_at(rows * columns);
            part.add(coefficients, columns, &part.deviations, &mut logs);
        }
        logs
    }
}

/// Standard deviations of the coarse and the fine part of [`unit_field`]; the sum of their squares
/// is one.
const UNIT_PARTS: [f32; 2] = [0.8, 0.6];

/// Draws a smooth random field of variance one in every cell.
///
/// It is correlated over as many rows and columns as a [`MaterialField`].
pub(crate) fn unit_field(rng: &mut Pcg64) -> Vec<f32> {
    let mut field = vec![0.0; CELLS];
    for ((part, (rows, columns)), deviation) in SHAPE.parts.iter().zip(KNOTS).zip(UNIT_PARTS) {
        let coefficients: Vec<f32> = (0..rows * columns).map(|_| StandardNormal.sample(rng)).collect();
        part.add(&coefficients, columns, &[deviation; CELLS], &mut field);
    }
    field
}

/// Quantities that all fields share.
struct Shape {
    parts: [Part; 2],
    /// Share of the slope at each row.
    slope: Vec<f32>,
}

static SHAPE: LazyLock<Shape> = LazyLock::new(|| {
    let (from, to) = GRAZING;
    let slope = |i| ((theta_h_of(i).to_degrees() - from) / (to - from)).clamp(0.0, 1.0) as f32;
    Shape { parts: [0, 1].map(Part::new), slope: (0..THETA_H).map(slope).collect() }
});

/// Cubic B-splines of one scale.
struct Part {
    /// First knot and the weights of four knots for each row.
    rows: Vec<(usize, [f32; 4])>,
    /// First knot and the weights of four knots for each column.
    columns: Vec<(usize, [f32; 4])>,
    /// Standard deviation of each cell.
    deviations: Vec<f32>,
}

impl Part {
    fn new(part: usize) -> Self {
        let deviation = |c: usize| {
            let (h, d) = (theta_h_of(c / THETA_D).to_degrees(), theta_d_of(c % THETA_D).to_degrees());
            (at_half_angle(&DEVIATIONS[part], h) * (1.0 + GROWTH * (d / 90.0).powi(2))) as f32
        };
        let (rows, columns) = KNOTS[part];
        Self {
            rows: splines(THETA_H, rows),
            columns: splines(THETA_D, columns),
            deviations: (0..CELLS).map(deviation).collect(),
        }
    }

    /// Adds the sum of splines times the deviation of each cell.
    fn add(&self, coefficients: &[f32], width: usize, deviations: &[f32], logs: &mut [f32]) {
        for ((row, (first, weights)), logs) in self.rows.iter().enumerate().zip(logs.chunks_exact_mut(THETA_D)) {
            let mut along = vec![0.0; width];
            for (k, weight) in weights.iter().enumerate() {
                let knots = &coefficients[(first + k) * width..][..width];
                along.iter_mut().zip(knots).for_each(|(sum, c)| *sum += weight * c);
            }
            let deviations = &deviations[row * THETA_D..];
            for ((log, (first, weights)), deviation) in logs.iter_mut().zip(&self.columns).zip(deviations) {
                let sum: f32 = weights.iter().zip(&along[*first..]).map(|(w, c)| w * c).sum();
                *log += deviation * sum;
            }
        }
    }
}

/// Returns the linear interpolation of a profile over [`HALF_ANGLES`].
fn at_half_angle(profile: &[f64; 5], degrees: f64) -> f64 {
    let segment = HALF_ANGLES[1..4].iter().filter(|angle| **angle <= degrees).count();
    let (from, to) = (HALF_ANGLES[segment], HALF_ANGLES[segment + 1]);
    let share = ((degrees - from) / (to - from)).clamp(0.0, 1.0);
    profile[segment] + share * (profile[segment + 1] - profile[segment])
}

/// Returns the weights of uniform cubic B-splines with `knots` coefficients at `cells` samples,
/// scaled so that independent coefficients of variance one give sums of variance one.
fn splines(cells: usize, knots: usize) -> Vec<(usize, [f32; 4])> {
    let weights = |cell: usize| {
        let at = cell as f64 / (cells - 1) as f64 * (knots - 3) as f64;
        let first = (at as usize).min(knots - 4);
        let t = at - first as f64;
        let cubic = [
            (1.0 - t).powi(3),
            3.0 * t.powi(3) - 6.0 * t * t + 4.0,
            -3.0 * t.powi(3) + 3.0 * t * t + 3.0 * t + 1.0,
            t.powi(3),
        ];
        let norm = cubic.iter().map(|w| w * w).sum::<f64>().sqrt();
        (first, cubic.map(|w| (w / norm) as f32))
    };
    (0..cells).map(weights).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn fields_have_the_stated_deviation_and_are_smooth() {
        let mut rng = Pcg64::seed_from_u64(1);
        let logs: Vec<Vec<f32>> = (0..4000).map(|_| MaterialField::draw(&mut rng).logs()).collect();
        let mean = |of: &dyn Fn(&[f32]) -> f64| logs.iter().map(|l| of(l)).sum::<f64>() / logs.len() as f64;
        // Mean square of amplitudes that are uniform in the logarithm.
        let (low, high) = AMPLITUDES;
        let square = (high * high - low * low) / (2.0 * (high / low).ln());
        for (row, column) in [(4, 10), (30, 0), (45, 45), (70, 20), (80, 80)] {
            let cell = row * THETA_D + column;
            let (h, d) = (theta_h_of(row).to_degrees(), theta_d_of(column).to_degrees());
            let growth = 1.0 + GROWTH * (d / 90.0).powi(2);
            let parts = DEVIATIONS.map(|profile| (growth * at_half_angle(&profile, h)).powi(2));
            let grazing = ((h - GRAZING.0) / (GRAZING.1 - GRAZING.0)).clamp(0.0, 1.0);
            let slope = grazing * grazing * (SLOPE.0.powi(2) + SLOPE.1.powi(2));
            let want = square * (parts[0] + parts[1] + slope);
            let got = mean(&|l| f64::from(l[cell]).powi(2));
            assert!((got / want - 1.0).abs() < 0.1, "{row} {column}: {got} {want}");
        }
        // Neighbouring cells are strongly correlated, distant cells nearly uncorrelated.
        let (here, next, far) = (40 * THETA_D + 40, 41 * THETA_D + 41, 5 * THETA_D + 5);
        let product = |a: usize, b: usize| mean(&|l| f64::from(l[a]) * f64::from(l[b]));
        let correlation = |a, b| product(a, b) / (product(a, a) * product(b, b)).sqrt();
        assert!(correlation(here, next) > 0.97, "{}", correlation(here, next));
        assert!(correlation(here, far).abs() < 0.12, "{}", correlation(here, far));
    }

    #[test]
    fn unit_fields_have_variance_one_and_are_smooth() {
        let mut rng = Pcg64::seed_from_u64(3);
        let fields: Vec<Vec<f32>> = (0..400).map(|_| unit_field(&mut rng)).collect();
        for cell in [0, 44, 30 * THETA_D + 10, 89 * THETA_D + 89] {
            let variance = fields.iter().map(|f| f64::from(f[cell]).powi(2)).sum::<f64>() / 400.0;
            assert!((0.75..1.25).contains(&variance), "{cell}: {variance}");
        }
        let steps = fields.iter().flat_map(|f| f.windows(2).take(THETA_D - 1).map(|w| (w[1] - w[0]).abs()));
        assert!(steps.fold(0.0, f32::max) < 0.9);
    }
}
