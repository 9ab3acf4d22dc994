//! The two ends of a posterior along the direction that changes the look of the material most.

use faer::Mat;
use glam::DQuat;
use gonio_linalg::product;

use super::ALBEDO;
use crate::appearance::Lattice;
use crate::inference::learnt::peak_height;
use crate::lighting::studio_light;
use crate::parallel;
use crate::reflectance::{BivariateTable, CELLS, angles_of};
use crate::render::{IntegratorSettings, LightTree, Relighter};

/// Rows of the light.
const ROWS: usize = 32;

/// Step between the points of the sphere that are used.
const POINTS: usize = 2;

/// Accuracy of the pictures. It need not be high, since only their differences matter.
const ACCURACY: IntegratorSettings = IntegratorSettings { tolerance: 0.5, max_cells: 4_000 };

/// Share of the draws, those nearest to the mean picture, that determine the component. The errors
/// of the draws have heavy tails, and a few outliers would determine it otherwise.
const USUAL: f64 = 0.9;

/// Shares of the ranks of the [`Ends::examples`].
const EXAMPLES: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

/// Steps of the power iteration.
const POWER_STEPS: usize = 50;

/// Ends of the 90 % interval of a posterior.
///
/// Draws are rendered as spheres in a studio light. The first principal component of the cube roots
/// of these pictures (their lightness, roughly) is the direction of the posterior that changes the
/// look most. The ends are the expected logarithms of the BRDF at the 5 and 95 % quantiles of this
/// component.
#[derive(Clone, Debug, PartialEq)]
pub struct Ends {
    /// Dull and glossy end, in 1/sr, with albedo [`ALBEDO`].
    pub tables: [BivariateTable; 2],
    /// Five draws of increasing component, in 1/sr, with albedo [`ALBEDO`].
    pub examples: Vec<BivariateTable>,
    /// Region of the BRDF in which the ends differ most.
    pub region: BrdfRegion,
    /// Factor by which they differ there, at least one.
    pub factor: f64,
}

/// Region of a BRDF.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BrdfRegion {
    /// Half angles below 2 degrees and difference angles below 45.
    Peak,
    /// Half angles of 5 to 20 degrees and difference angles below 45.
    Haze,
    /// Half angles of 30 to 60 degrees and difference angles below 45.
    Body,
    /// Half angles below 60 degrees and difference angles of 60 to 75.
    Grazing,
}

impl BrdfRegion {
    const ALL: [Self; 4] = [Self::Peak, Self::Haze, Self::Body, Self::Grazing];

    /// Returns the name of the region.
    pub fn name(self) -> &'static str {
        match self {
            Self::Peak => "height of the peak",
            Self::Haze => "haze around the peak",
            Self::Body => "body",
            Self::Grazing => "reflection at grazing angles",
        }
    }

    fn contains(self, cell: usize) -> bool {
        let (h, d) = angles_of(cell);
        let (h, d) = (h.to_degrees(), d.to_degrees());
        match self {
            Self::Peak => h < 2.0 && d < 45.0,
            Self::Haze => (5.0..20.0).contains(&h) && d < 45.0,
            Self::Body => (30.0..60.0).contains(&h) && d < 45.0,
            Self::Grazing => h < 60.0 && (60.0..75.0).contains(&d),
        }
    }

    /// Returns the mean difference of the logarithms of two tables.
    fn log_ratio(self, [low, high]: &[BivariateTable; 2]) -> f64 {
        let cells = (0..CELLS).filter(|cell| self.contains(*cell));
        let log = |table: &BivariateTable, cell: usize| f64::from(table.as_slice()[cell].max(1e-12)).ln();
        let (sum, count) = cells.fold((0.0, 0.0), |(sum, n), c| (sum + log(high, c) - log(low, c), n + 1.0));
        sum / count
    }
}

impl Ends {
    /// Computes the ends of equally likely draws of equal albedo.
    ///
    /// # Panics
    /// If there are fewer than two draws.
    pub(super) fn of(draws: &[BivariateTable]) -> Self {
        assert!(draws.len() > 1);
        let pictures = lightness(draws);
        let distance = |at: &usize| pictures[*at].iter().map(|x| x * x).sum::<f64>();
        let mut usual: Vec<usize> = (0..draws.len()).collect();
        usual.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        usual.truncate(((USUAL * draws.len() as f64) as usize).max(2));
        usual.sort_unstable();
        let draws: Vec<&BivariateTable> = usual.iter().map(|at| &draws[*at]).collect();
        let pictures = centred(usual.iter().map(|at| pictures[*at].clone()).collect());
        let count = draws.len() as f64;
        let logs: Vec<Vec<f64>> =
            parallel::map(&draws, |t| t.as_slice().iter().map(|v| f64::from(v.max(1e-12)).ln()).collect());
        let mean: Vec<f64> = parallel::map_range(CELLS, |c| logs.iter().map(|l| l[c]).sum::<f64>() / count);
        let gloss = centred(draws.iter().map(|table| vec![peak_height(table).ln()]).collect()).concat();
        let scores = first_component(&pictures, &gloss);
        let mut sorted: Vec<usize> = (0..draws.len()).collect();
        sorted.sort_by(|a, b| scores[*a].total_cmp(&scores[*b]));
        let ranked = |share: f64| sorted[((share * count) as usize).min(sorted.len() - 1)];
        let variance = scores.iter().map(|s| s * s).sum::<f64>().max(1e-300);
        let end = |share: f64| {
            let score = scores[ranked(share)];
            let cell = |c: usize| {
                let covariance: f64 = logs.iter().zip(&scores).map(|(l, s)| (l[c] - mean[c]) * s).sum();
                (mean[c] + score * covariance / variance).exp() as f32
            };
            let values = parallel::map_range(CELLS, cell);
            BivariateTable::from_vec(values).with_normal_albedo(ALBEDO).0
        };
        let tables = [end(0.05), end(0.95)];
        let ratios = BrdfRegion::ALL.map(|region| (region, region.log_ratio(&tables).abs()));
        let (region, log) = ratios.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("there are regions");
        let examples = EXAMPLES.map(|share| draws[ranked(share)].with_normal_albedo(ALBEDO).0).to_vec();
        Self { tables, examples, region, factor: log.exp() }
    }
}

/// Returns the cube roots of the radiance of a sphere of each draw, each pixel minus its mean.
fn lightness(draws: &[BivariateTable]) -> Vec<Vec<f64>> {
    let points: Vec<_> = Lattice::new().points(DQuat::IDENTITY).into_iter().step_by(POINTS).collect();
    let light = LightTree::of_map(&studio_light(ROWS));
    let relighter = Relighter::new(&points, &draws[..1], &light, &ACCURACY);
    let picture = |table| relighter.render(table).into_iter().map(|v| v.max(0.0).cbrt()).collect();
    centred(parallel::map(draws, picture))
}

/// Subtracts the mean of each column.
fn centred(mut rows: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    for column in 0..rows[0].len() {
        let mean = rows.iter().map(|row| row[column]).sum::<f64>() / rows.len() as f64;
        rows.iter_mut().for_each(|row| row[column] -= mean);
    }
    rows
}

/// Returns the scores of the first principal component of centred rows, by power iteration.
///
/// The iteration starts from `start`, and the scores correlate positively with it.
fn first_component(rows: &[Vec<f64>], start: &[f64]) -> Vec<f64> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let matrix = Mat::from_fn(rows[0].len(), rows.len(), |i, j| rows[j][i]);
    let gram = product(matrix.transpose(), matrix.as_ref());
    let unit = |v: Vec<f64>| {
        let length = dot(&v, &v).sqrt();
        // Draws without differences have no direction.
        if length > 0.0 { v.into_iter().map(|x| x / length).collect() } else { v }
    };
    let mut scores = unit(start.to_vec());
    for _ in 0..POWER_STEPS {
        scores = unit((0..rows.len()).map(|j| dot(gram.col_as_slice(j), &scores)).collect());
    }
    let sign = if dot(&scores, start) < 0.0 { -1.0 } else { 1.0 };
    scores.into_iter().map(|s| sign * s).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    /// Only the height of the peak varies between the draws.
    #[test]
    fn ends_follow_the_planted_direction() {
        let normal = |i: usize| 2.0 * ((i as f64 + 0.5) / 64.0 - 0.5);
        let lobes: Vec<BivariateTable> =
            (0..64).map(|i| testing::lobe(0.1, 3.0 * normal(i).exp(), 0.15).with_normal_albedo(ALBEDO).0).collect();
        let ends = Ends::of(&lobes);
        let want = [6, 57].map(|i| peak_height(&lobes[i]));
        for (end, want) in ends.tables.iter().zip(want) {
            assert!((end.normal_albedo() - ALBEDO).abs() < 1e-4);
            let got = peak_height(end);
            assert!((got / want).ln().abs() < 0.15, "{got} {want}");
        }
        // At equal albedo, a higher peak leaves less to the body, whose logarithm changes most.
        assert_eq!(ends.region, BrdfRegion::Body);
        assert!(ends.examples.windows(2).all(|pair| peak_height(&pair[0]) < peak_height(&pair[1])));
        let same = Ends::of(&[lobes[0].clone(), lobes[0].clone()]);
        assert!((same.factor - 1.0).abs() < 1e-6);
    }

    #[test]
    fn components_match_a_planted_direction() {
        let (u, v) = ([1.0, -2.0, 0.5], [2.0, 1.0, 0.0]);
        let column = |values: [f64; 5]| centred(values.map(|v| vec![v]).to_vec()).concat();
        let scores = column([-3.0, 1.0, 0.2, 4.0, -1.0]);
        let noise = column([0.3, -0.2, 0.1, 0.0, -0.3]);
        let rows: Vec<Vec<f64>> =
            scores.iter().zip(&noise).map(|(s, n)| (0..3).map(|k| s * u[k] + n * v[k]).collect()).collect();
        let start = column([1.0, 0.0, 0.0, -1.0, 0.5]);
        let got = first_component(&rows, &start);
        let length = scores.iter().map(|s| s * s).sum::<f64>().sqrt();
        // The start is anti-correlated with the scores.
        for (got, want) in got.iter().zip(&scores) {
            assert!((got + want / length).abs() < 0.02, "{got} {want}");
        }
    }
}
