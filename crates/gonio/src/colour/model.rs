//! Posterior of the colours of body, highlight and light.

use super::chroma::Chroma;
use super::clues::{CLUES, Clues};
use super::gaussian::solve;
use super::parts::TwoColours;
use serde::{Deserialize, Serialize};

/// Shares of the highlight at which readings are learnt; between them they are interpolated over
/// the logit of the share.
pub(super) const NODES: [f64; 4] = [0.05, 0.2, 0.5, 0.85];

/// Variance of a given chroma of the light: a grey card is read to about two percent.
const GIVEN: f64 = 0.02 * 0.02;

/// Quantile of a standard normal at 95 %.
const NINETY: f64 = 1.645;

/// A normal distribution of a chroma.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Normal {
    /// Its mean, `(ln R/G, ln B/G)`.
    pub mean: [f64; 2],
    /// Its covariance.
    pub covariance: [[f64; 2]; 2],
}

/// Linear reading of a chroma from the [`Clues`]: the first clue plus weighted differences of the
/// others from the first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Weights for each node of the highlight's share and each clue but the first.
    pub weights: [[f64; CLUES - 1]; NODES.len()],
    /// Offsets added for each node.
    pub offsets: [[f64; 2]; NODES.len()],
}

/// Prior of colours, and their readings from a photograph. Learnt by [`ColourModel::learn`], and
/// part of a [`LearntPosterior`](crate::inference::learnt::LearntPosterior).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColourModel {
    /// Reading of the chroma of the body plus that of the light.
    pub body: Reading,
    /// Reading of the chroma of the highlight plus that of the light.
    pub highlight: Reading,
    /// Covariance of the error of both readings, that of the body first, for each node.
    pub noise: [[[f64; 4]; 4]; NODES.len()],
    /// Prior of lights, as [`white_chroma`](super::white_chroma).
    pub light: Normal,
    /// Prior of bodies.
    pub bodies: Normal,
    /// Prior of white highlights.
    pub white: Normal,
    /// Slope of a coloured highlight's difference from the mean white highlight over that of the
    /// body.
    pub follows: f64,
    /// Standard deviation of the residual of that regression.
    pub apart: f64,
    /// Logit of the probability of a coloured highlight: a constant, and a factor of the logit of
    /// the highlight's share.
    pub coloured: [f64; 2],
}

/// Posterior of the colours given a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourPosterior {
    /// Chromas of body, highlight and light, one after the other.
    pub mean: [f64; 6],
    /// Covariance of these chromas.
    pub covariance: [[f64; 6]; 6],
    /// Probability that the highlight is coloured as the body is.
    pub coloured: f64,
}

/// Interpolation weights of the [`NODES`] at a share.
pub(super) fn places(share: f64) -> [f64; NODES.len()] {
    let logit = |x: f64| (x / (1.0 - x)).ln();
    let x = share.clamp(NODES[0], NODES[NODES.len() - 1]);
    let right = (1..NODES.len() - 1).find(|&k| x <= NODES[k]).unwrap_or(NODES.len() - 1);
    let (low, high) = (logit(NODES[right - 1]), logit(NODES[right]));
    let at = (logit(x) - low) / (high - low);
    let mut out = [0.0; NODES.len()];
    out[right - 1] = 1.0 - at;
    out[right] = at;
    out
}

/// Logit of a share, which is kept between 0.001 and 0.999.
pub(super) fn logit(share: f64) -> f64 {
    let share = share.clamp(1e-3, 1.0 - 1e-3);
    (share / (1.0 - share)).ln()
}

impl Reading {
    /// Chroma read from the clues.
    pub fn of(&self, clues: &Clues) -> Chroma {
        let [first, others @ ..] = &clues.chromas;
        let mut out = first.0;
        for (place, (weights, offset)) in places(clues.share).into_iter().zip(self.weights.iter().zip(&self.offsets)) {
            for c in 0..2 {
                let moved: f64 = weights.iter().zip(others).map(|(w, x)| w * (x.0[c] - first.0[c])).sum();
                out[c] += place * (moved + offset[c]);
            }
        }
        Chroma(out)
    }
}

/// Joint normal distribution of body, highlight and light.
struct Joint {
    mean: [f64; 6],
    covariance: [[f64; 6]; 6],
}

impl Joint {
    /// Conditions on two readings that are sums with the light. Also returns the logarithm of their
    /// density, without the constant.
    fn given(mut self, readings: &[f64; 4], noise: &[[f64; 4]; 4]) -> (Self, f64) {
        // Reading o is the sum of entry o and the light.
        let cross: Vec<[f64; 4]> =
            (0..6).map(|i| std::array::from_fn(|o| self.covariance[i][o] + self.covariance[i][4 + o % 2])).collect();
        let of_readings: Vec<Vec<f64>> =
            (0..4).map(|o| (0..4).map(|p| cross[o][p] + cross[4 + o % 2][p] + noise[o][p]).collect()).collect();
        let gap: [f64; 4] = std::array::from_fn(|o| readings[o] - self.mean[o] - self.mean[4 + o % 2]);
        // Right sides: the gap, then the cross covariances with the six unknowns.
        let mut sides: Vec<[f64; 7]> =
            (0..4).map(|o| std::array::from_fn(|m| if m == 0 { gap[o] } else { cross[m - 1][o] })).collect();
        let log_determinant = solve(&of_readings, &mut sides);
        let square: f64 = (0..4).map(|o| gap[o] * sides[o][0]).sum();
        for (i, cross) in cross.iter().enumerate() {
            self.mean[i] += cross.iter().zip(&sides).map(|(c, side)| c * side[0]).sum::<f64>();
            for j in 0..6 {
                self.covariance[i][j] -= cross.iter().zip(&sides).map(|(c, side)| c * side[1 + j]).sum::<f64>();
            }
        }
        (self, -0.5 * (square + log_determinant))
    }
}

impl ColourModel {
    /// Whether all numbers are finite and all variances positive.
    pub(crate) fn is_proper(&self) -> bool {
        let Self { body, highlight, noise, light, bodies, white, follows, apart, coloured } = self;
        let readings = [body, highlight].into_iter();
        let of_readings = readings.flat_map(|r| r.weights.as_flattened().iter().chain(r.offsets.as_flattened()));
        let of_priors =
            [light, bodies, white].into_iter().flat_map(|n| n.mean.iter().chain(n.covariance.as_flattened()));
        let single = [follows, apart].into_iter().chain(coloured);
        let all = of_readings.chain(of_priors).chain(single).chain(noise.as_flattened().as_flattened());
        let variances = noise.iter().flat_map(|node| (0..4).map(|i| node[i][i]));
        let spreads = [light, bodies, white].into_iter().flat_map(|n| [n.covariance[0][0], n.covariance[1][1]]);
        all.copied().all(f64::is_finite) && variances.chain(spreads).all(|v| v > 0.0)
    }

    /// Computes the posterior given the clues and, where it is known, the chroma of the light (see
    /// [`white_chroma`](super::white_chroma)).
    pub fn posterior(&self, clues: &Clues, light: Option<Chroma>) -> ColourPosterior {
        let (body, highlight) = (self.body.of(clues).0, self.highlight.of(clues).0);
        let readings = [body[0], body[1], highlight[0], highlight[1]];
        let mut noise = [[0.0; 4]; 4];
        for (place, of_node) in places(clues.share).into_iter().zip(&self.noise) {
            (0..16).for_each(|at| noise[at / 4][at % 4] += place * of_node[at / 4][at % 4]);
        }
        let odds = self.coloured[0] + self.coloured[1] * logit(clues.share);
        // log p(white) and log p(coloured), without overflow.
        let log_prior = [-odds, odds].map(|x| -(-x.abs()).exp().ln_1p() + x.min(0.0));
        let found = [false, true].map(|coloured| self.prior(coloured, light).given(&readings, &noise));
        let scores = [log_prior[0] + found[0].1, log_prior[1] + found[1].1];
        let coloured = 1.0 / (1.0 + (scores[0] - scores[1]).exp());
        let weights = [1.0 - coloured, coloured];
        let mut mean = [0.0; 6];
        for (weight, (joint, _)) in weights.iter().zip(&found) {
            (0..6).for_each(|i| mean[i] += weight * joint.mean[i]);
        }
        let mut covariance = [[0.0; 6]; 6];
        for (weight, (joint, _)) in weights.iter().zip(&found) {
            for i in 0..6 {
                for j in 0..6 {
                    let between = (joint.mean[i] - mean[i]) * (joint.mean[j] - mean[j]);
                    covariance[i][j] += weight * (joint.covariance[i][j] + between);
                }
            }
        }
        ColourPosterior { mean, covariance, coloured }
    }

    fn prior(&self, coloured: bool, light: Option<Chroma>) -> Joint {
        let (mut mean, mut covariance) = ([0.0; 6], [[0.0; 6]; 6]);
        for i in 0..2 {
            let (body, white) = (self.bodies.mean[i], self.white.mean[i]);
            mean[i] = body;
            mean[2 + i] = if coloured { white + self.follows * (body - white) } else { white };
            mean[4 + i] = light.map_or(self.light.mean[i], |light| light.0[i]);
            for j in 0..2 {
                let bodies = self.bodies.covariance[i][j];
                let own = if i == j { 1.0 } else { 0.0 };
                covariance[i][j] = bodies;
                covariance[2 + i][2 + j] = if coloured {
                    covariance[2 + i][j] = self.follows * bodies;
                    covariance[i][2 + j] = self.follows * bodies;
                    self.follows.powi(2) * bodies + own * self.apart.powi(2)
                } else {
                    self.white.covariance[i][j]
                };
                covariance[4 + i][4 + j] = if light.is_some() { own * GIVEN } else { self.light.covariance[i][j] };
            }
        }
        Joint { mean, covariance }
    }
}

impl ColourPosterior {
    /// Estimate of the colours: the posterior mean.
    pub fn colours(&self) -> TwoColours {
        TwoColours { body: self.chroma(0), highlight: self.chroma(2) }
    }

    /// Adds an error of this variance to the chromas of body and highlight.
    pub(crate) fn add_error(&mut self, variance: f64) {
        (0..4).for_each(|i| self.covariance[i][i] += variance);
    }

    /// Posterior mean of the light's chroma.
    pub fn light(&self) -> Chroma {
        self.chroma(4)
    }

    fn chroma(&self, at: usize) -> Chroma {
        Chroma([self.mean[at], self.mean[at + 1]])
    }

    /// 90 % intervals, from 5 to 95 %, of both components of body, highlight and light, as for a
    /// normal distribution.
    pub fn intervals(&self) -> [[f64; 2]; 6] {
        std::array::from_fn(|i| {
            let reach = NINETY * self.covariance[i][i].max(0.0).sqrt();
            [self.mean[i] - reach, self.mean[i] + reach]
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Model whose readings are the first clue for the body and the fine detail for the highlight.
    pub(crate) fn plain() -> ColourModel {
        let reading = |weight: f64| {
            let mut weights = [[0.0; CLUES - 1]; NODES.len()];
            weights.iter_mut().for_each(|node| node[2] = weight);
            Reading { weights, offsets: [[0.0; 2]; NODES.len()] }
        };
        let round = |sd: f64| [[sd * sd, 0.0], [0.0, sd * sd]];
        let mut noise = [[[0.0; 4]; 4]; NODES.len()];
        noise.iter_mut().for_each(|node| (0..4).for_each(|i| node[i][i] = 1e-4));
        ColourModel {
            body: reading(0.0),
            highlight: reading(1.0),
            noise,
            light: Normal { mean: [0.0; 2], covariance: round(0.2) },
            bodies: Normal { mean: [0.4, -0.4], covariance: round(0.9) },
            white: Normal { mean: [0.0; 2], covariance: round(0.02) },
            follows: 1.0,
            apart: 0.1,
            coloured: [-2.0, 0.5],
        }
    }

    fn clues(body: [f64; 2], highlight: [f64; 2]) -> Clues {
        let mut chromas = [Chroma(body); CLUES];
        chromas[3] = Chroma(highlight);
        Clues { chromas, share: 0.3 }
    }

    #[test]
    fn places_are_between_neighbours() {
        assert_eq!(places(0.0), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(places(1.0), [0.0, 0.0, 0.0, 1.0]);
        let middle = places(0.3);
        assert!((middle.iter().sum::<f64>() - 1.0).abs() < 1e-12 && middle[1] > 0.0 && middle[2] > 0.0);
    }

    #[test]
    fn a_white_highlight_tells_the_light() {
        // Red body, orange light: both readings are shifted alike.
        let light = [0.25, -0.2];
        let found = plain().posterior(&clues([1.2 + light[0], -0.5 + light[1]], light), None);
        assert!(found.coloured < 0.1, "{found:?}");
        assert!(found.light().distance(Chroma(light)) < 0.05, "{found:?}");
        assert!(found.colours().body.distance(Chroma([1.2, -0.5])) < 0.07, "{found:?}");
        assert!(found.colours().highlight.distance(Chroma([0.0, 0.0])) < 0.03);
    }

    #[test]
    fn a_light_that_is_known_is_taken_off() {
        // Gold: highlight and body alike, which no white light explains.
        let gold = [0.5, -0.9];
        let light = [0.3, -0.3];
        let seen = [gold[0] + light[0], gold[1] + light[1]];
        let blind = plain().posterior(&clues(seen, seen), None);
        assert!(blind.coloured > 0.9, "{blind:?}");
        let found = plain().posterior(&clues(seen, seen), Some(Chroma(light)));
        let error = |p: &ColourPosterior| p.colours().body.distance(Chroma(gold));
        assert!(error(&found) < 0.03 && error(&blind) > 0.2, "{found:?}");
        let wide = |p: &ColourPosterior| p.intervals()[0][1] - p.intervals()[0][0];
        assert!(wide(&found) < 0.2 && wide(&blind) > 0.5, "{} {}", wide(&found), wide(&blind));
    }

    /// Compares with the formula for one dimension: without cross terms each channel is a separate
    /// problem.
    #[test]
    fn the_update_is_the_closed_form() {
        let mut model = plain();
        model.coloured = [-50.0, 0.0];
        // Without a reading of the highlight, the body is the reading minus the light, weighted by
        // precision.
        model.noise.iter_mut().for_each(|node| (2..4).for_each(|i| node[i][i] = 1e6));
        let found = model.posterior(&clues([1.0, -1.0], [0.0, 0.0]), None);
        let gain = 0.81 / (0.81 + 0.04 + 1e-4);
        assert!((found.mean[0] - (0.4 + gain * (1.0 - 0.4))).abs() < 1e-6, "{found:?}");
        assert!((found.covariance[0][0] - 0.81 * (1.0 - gain)).abs() < 1e-6, "{found:?}");
        assert!((found.mean[4] - 0.04 / 0.81 * gain * 0.6).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn improper_models_are_told() {
        assert!(plain().is_proper());
        assert!(!ColourModel { apart: f64::NAN, ..plain() }.is_proper());
        assert!(!ColourModel { white: Normal { mean: [0.0; 2], covariance: [[0.0; 2]; 2] }, ..plain() }.is_proper());
    }
}
