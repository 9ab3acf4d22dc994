//! Learning of a [`ColourModel`] from photographs of known materials and lights.

use super::chroma::Chroma;
use super::clues::{CLUES, Clues};
use super::gaussian::solve;
use super::model::{ColourModel, NODES, Normal, Reading, logit, places};
use super::parts::TwoColours;

/// A photograph whose material and light are known.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Clues of the photograph.
    pub clues: Clues,
    /// The material's colours.
    pub colours: TwoColours,
    /// The light's chroma, as [`white_chroma`](super::white_chroma).
    pub light: Chroma,
}

/// Error of a reading beyond which its weight falls (Huber).
const HUBER: f64 = 0.3;

/// Number of rounds of reweighting.
const ROUNDS: usize = 3;

/// Weak penalty on the squared weights of the clues.
const RIDGE: f64 = 3e-4;

/// Error of both readings together beyond which a sample counts less for the noise: it is of a
/// material of more than two colours.
const WILD: f64 = 1.2;

/// Noise of materials outside the training set, over that of those inside.
const UNSEEN: f64 = 1.15;

/// Distance from the median highlight beyond which a highlight is coloured.
const COLOURED: f64 = 0.3;

/// Factor on the spread of the chromas of coloured highlights, since there are few of them.
const FEW: f64 = 1.4;

/// Number of unknowns of a reading.
const UNKNOWNS: usize = (CLUES + 1) * NODES.len();

impl ColourModel {
    /// Learns the model from samples in which every material and every light is as frequent as any
    /// other.
    ///
    /// Readings are fitted by least squares with Huber's weights; their noise is the second moment
    /// of the residuals; the priors are the moments of lights and materials, and the probability of
    /// a coloured highlight is a logistic regression.
    ///
    /// # Panics
    /// If there are no samples.
    pub fn learn(samples: &[Sample]) -> Self {
        assert!(!samples.is_empty(), "nothing to learn from");
        let plus = |a: Chroma, b: Chroma| [a.0[0] + b.0[0], a.0[1] + b.0[1]];
        let body = fit(samples, &|s| plus(s.colours.body, s.light));
        let highlight = fit(samples, &|s| plus(s.colours.highlight, s.light));
        let noise = noise(samples, &body, &highlight);
        let of = |chroma: fn(&Sample) -> Chroma| samples.iter().map(move |s| chroma(s).0).collect::<Vec<_>>();
        let highlights = of(|s| s.colours.highlight);
        let middle = [0, 1].map(|c| {
            let mut values: Vec<f64> = highlights.iter().map(|h| h[c]).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        });
        let coloured = |s: &Sample| s.colours.highlight.distance(Chroma(middle)) > COLOURED;
        let (with, without): (Vec<&Sample>, Vec<&Sample>) = samples.iter().partition(|s| coloured(s));
        let white = normal(&without.iter().map(|s| s.colours.highlight.0).collect::<Vec<_>>());
        // Regression of the coloured highlights on their bodies, relative to the mean white
        // highlight.
        let apart =
            |s: &Sample, c: usize| (s.colours.body.0[c] - white.mean[c], s.colours.highlight.0[c] - white.mean[c]);
        let pairs: Vec<(f64, f64)> = with.iter().flat_map(|s| [apart(s, 0), apart(s, 1)]).collect();
        let (product, square) = pairs.iter().fold((0.0, 1e-12), |(p, q), (b, h)| (p + b * h, q + b * b));
        let follows = (product / square).clamp(0.0, 1.0);
        let left: f64 = pairs.iter().map(|(b, h)| (h - follows * b).powi(2)).sum();
        Self {
            noise,
            light: normal(&of(|s| s.light)),
            bodies: normal(&of(|s| s.colours.body)),
            white,
            follows,
            apart: FEW * (left / pairs.len().max(1) as f64).sqrt().max(0.05),
            coloured: logistic(samples, &coloured),
            body,
            highlight,
        }
    }
}

/// Errors of a [`ColourModel`] on materials and lights that it has not learnt from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Median distances of the chromas of body and highlight from the true ones, with the median
    /// colour of the photograph for both.
    pub median: [f64; 2],
    /// The same distances with the estimate.
    pub estimate: [f64; 2],
    /// The same distances with the estimate when the light's chroma is given.
    pub given: [f64; 2],
    /// Share of the true components within their 90 % intervals.
    pub inside: f64,
}

/// Parts that the materials and the lights are divided into; one part of each is left out, in turn.
const FOLDS: usize = 4;

impl LeftOut {
    /// Measures on samples that stand beside the indices of their material and light.
    pub(crate) fn of(samples: &[(usize, usize, Sample)]) -> Self {
        let (mut errors, mut inside, mut count) = ([const { Vec::new() }; 6], 0, 0);
        for (materials, lights) in (0..FOLDS * FOLDS).map(|fold| (fold / FOLDS, fold % FOLDS)) {
            let seen = samples.iter().filter(|(m, l, _)| m % FOLDS != materials && l % FOLDS != lights);
            let seen: Vec<Sample> = seen.map(|(.., s)| s.clone()).collect();
            if seen.is_empty() {
                continue;
            }
            let model = ColourModel::learn(&seen);
            for (.., s) in samples.iter().filter(|(m, l, _)| m % FOLDS == materials && l % FOLDS == lights) {
                let (blind, given) = (model.posterior(&s.clues, None), model.posterior(&s.clues, Some(s.light)));
                let each = [TwoColours::same(s.clues.chromas[1]), blind.colours(), given.colours()];
                for (k, colours) in each.into_iter().enumerate() {
                    errors[2 * k].push(colours.body.distance(s.colours.body));
                    errors[2 * k + 1].push(colours.highlight.distance(s.colours.highlight));
                }
                let truth = s.colours.body.0.into_iter().chain(s.colours.highlight.0);
                inside += blind.intervals().iter().zip(truth).filter(|([low, high], x)| low <= x && x <= high).count();
                count += 4;
            }
        }
        let [a, b, c, d, e, f] = errors.map(|mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
        });
        Self { median: [a, b], estimate: [c, d], given: [e, f], inside: inside as f64 / f64::from(count.max(1)) }
    }
}

fn normal(values: &[[f64; 2]]) -> Normal {
    let n = values.len().max(1) as f64;
    let mean = [0, 1].map(|c| values.iter().map(|v| v[c]).sum::<f64>() / n);
    let moment = |i: usize, j: usize| values.iter().map(|v| (v[i] - mean[i]) * (v[j] - mean[j])).sum::<f64>() / n;
    let tiny = 1e-4;
    Normal { mean, covariance: [[moment(0, 0) + tiny, moment(0, 1)], [moment(1, 0), moment(1, 1) + tiny]] }
}

/// Coefficients of the unknowns in channel `c` of a reading.
fn row(clues: &Clues, c: usize) -> [f64; UNKNOWNS] {
    let mut row = [0.0; UNKNOWNS];
    for (node, place) in places(clues.share).into_iter().enumerate() {
        let at = node * (CLUES + 1);
        for k in 1..CLUES {
            row[at + k - 1] = place * (clues.chromas[k].0[c] - clues.chromas[0].0[c]);
        }
        row[at + CLUES - 1 + c] = place;
    }
    row
}

fn fit(samples: &[Sample], target: &dyn Fn(&Sample) -> [f64; 2]) -> Reading {
    let mut weights = vec![1.0; samples.len()];
    let mut reading = Reading { weights: [[0.0; CLUES - 1]; NODES.len()], offsets: [[0.0; 2]; NODES.len()] };
    for _ in 0..ROUNDS {
        let mut normal = vec![vec![0.0; UNKNOWNS]; UNKNOWNS];
        let mut right = vec![[0.0]; UNKNOWNS];
        for (sample, weight) in samples.iter().zip(&weights) {
            let wanted = target(sample);
            for (c, wanted) in wanted.into_iter().enumerate() {
                let row = row(&sample.clues, c);
                let gap = wanted - sample.clues.chromas[0].0[c];
                for i in (0..UNKNOWNS).filter(|&i| row[i] != 0.0) {
                    right[i][0] += weight * row[i] * gap;
                    (0..=i).for_each(|j| normal[i][j] += weight * row[i] * row[j]);
                }
            }
        }
        (0..UNKNOWNS).for_each(|i| normal[i][i] += RIDGE * samples.len() as f64);
        solve(&normal, &mut right);
        for node in 0..NODES.len() {
            let at = node * (CLUES + 1);
            (0..CLUES - 1).for_each(|k| reading.weights[node][k] = right[at + k][0]);
            (0..2).for_each(|c| reading.offsets[node][c] = right[at + CLUES - 1 + c][0]);
        }
        for (weight, sample) in weights.iter_mut().zip(samples) {
            let error = reading.of(&sample.clues).distance(Chroma(target(sample)));
            *weight = 1.0 / (error / HUBER).max(1.0);
        }
    }
    reading
}

fn noise(samples: &[Sample], body: &Reading, highlight: &Reading) -> [[[f64; 4]; 4]; NODES.len()] {
    let mut sums = [[[0.0; 4]; 4]; NODES.len()];
    let mut totals = [1e-12; NODES.len()];
    for sample in samples {
        let (b, h) = (body.of(&sample.clues).0, highlight.of(&sample.clues).0);
        let light = sample.light.0;
        let error: [f64; 4] = std::array::from_fn(|o| match o {
            0 | 1 => b[o] - sample.colours.body.0[o] - light[o],
            _ => h[o - 2] - sample.colours.highlight.0[o - 2] - light[o - 2],
        });
        let size = error.iter().map(|e| e * e).sum::<f64>().sqrt();
        let weight = (WILD / size.max(WILD)).powi(2);
        for (node, place) in places(sample.clues.share).into_iter().enumerate() {
            totals[node] += weight * place;
            (0..16).for_each(|at| sums[node][at / 4][at % 4] += weight * place * error[at / 4] * error[at % 4]);
        }
    }
    std::array::from_fn(|node| {
        std::array::from_fn(|i| {
            std::array::from_fn(|j| UNSEEN * sums[node][i][j] / totals[node] + if i == j { 1e-4 } else { 0.0 })
        })
    })
}

/// Logistic regression by Newton's method, with a weak pull to zero.
fn logistic(samples: &[Sample], yes: &dyn Fn(&Sample) -> bool) -> [f64; 2] {
    let pull = 0.004 * samples.len() as f64;
    let mut x = [0.0; 2];
    for _ in 0..30 {
        let mut gradient = [-pull * x[0], -pull * x[1]];
        let mut hessian = vec![vec![pull, 0.0], vec![0.0, pull]];
        for sample in samples {
            let input = [1.0, logit(sample.clues.share)];
            let p = 1.0 / (1.0 + (-(x[0] + x[1] * input[1])).exp());
            for i in 0..2 {
                gradient[i] += (f64::from(u8::from(yes(sample))) - p) * input[i];
                (0..2).for_each(|j| hessian[i][j] += p * (1.0 - p) * input[i] * input[j]);
            }
        }
        let mut step = vec![[gradient[0]], [gradient[1]]];
        solve(&hessian, &mut step);
        x = [x[0] + step[0][0], x[1] + step[1][0]];
    }
    x
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    /// Readings planted in the clues are recovered, and with them the colours.
    #[test]
    fn what_was_planted_is_learnt() {
        let mut rng = Pcg64::seed_from_u64(3);
        let mut draw = |sd: f64| sd * Distribution::<f64>::sample(&StandardNormal, &mut rng);
        let sample = |i: usize, draw: &mut dyn FnMut(f64) -> f64| {
            let body = [0.3 + draw(0.8), -0.3 + draw(0.8)];
            let highlight = if i.is_multiple_of(4) { body } else { [0.1 + draw(0.03), draw(0.03)] };
            let light = [draw(0.2), draw(0.3)];
            let mut chromas = [0; CLUES].map(|_| Chroma([draw(0.5), draw(0.5)]));
            let sum = |a: [f64; 2], error: f64, draw: &mut dyn FnMut(f64) -> f64| {
                Chroma([a[0] + light[0] + draw(error), a[1] + light[1] + draw(error)])
            };
            chromas[1] = sum(body, 0.05, draw);
            chromas[3] = sum(highlight, 0.03, draw);
            Sample {
                clues: Clues { chromas, share: 0.02 + 0.96 * (i % 97) as f64 / 97.0 },
                colours: TwoColours { body: Chroma(body), highlight: Chroma(highlight) },
                light: Chroma(light),
            }
        };
        let samples: Vec<Sample> = (0..4000).map(|i| sample(i, &mut draw)).collect();
        let model = ColourModel::learn(&samples);
        for node in 0..NODES.len() {
            assert!((model.body.weights[node][0] - 1.0).abs() < 0.03, "{:?}", model.body);
            assert!((model.highlight.weights[node][2] - 1.0).abs() < 0.03, "{:?}", model.highlight);
            assert!((model.noise[node][0][0].sqrt() - 0.05).abs() < 0.02, "{:?}", model.noise);
        }
        assert!((model.follows - 1.0).abs() < 0.05 && model.coloured[0] < -0.5, "{model:?}");
        // A quarter of the highlights are coloured, and the readings tell which.
        let (mut right, mut inside) = (0, 0);
        for (i, s) in samples.iter().enumerate() {
            let found = model.posterior(&s.clues, None);
            right += usize::from((found.coloured > 0.5) == i.is_multiple_of(4));
            let [low, high] = found.intervals()[0];
            inside += usize::from((low..high).contains(&s.colours.body.0[0]));
        }
        assert!(right > 3200, "{right}");
        assert!((3400..3900).contains(&inside), "{inside}");
    }
}
