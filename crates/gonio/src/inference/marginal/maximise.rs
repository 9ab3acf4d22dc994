//! The best reflectance near a start.

use std::f64::consts::TAU;

use super::lbfgs::Memory;
use super::point::{Point, State};
use super::{Evidence, EvidenceSettings, LightOperator, Marginal, MarginalError};
use crate::transfer::Bilinear;

/// How [`Marginal::maximise`] climbs, and the prior that holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct MaximiseSettings {
    /// Iterations at most.
    pub max_iterations: usize,
    /// Converged when two iterations in a row each raise the objective by less than this, in nats.
    pub tolerance: f64,
    /// Coefficients of the start below this share of the largest are raised to it: at zero, `log f`
    /// has no gradient.
    pub floor: f64,
    /// Rates of the exponential priors `lambda_k exp(-lambda_k f_k)` (K); empty for none.
    pub rates: Vec<f64>,
    /// Standard deviation of `log f_k` around the start, of a Gaussian prior; `None` for none.
    pub width: Option<f64>,
    /// How the evidence of the start is found, and whether exposure and noise are known.
    pub evidence: EvidenceSettings,
}

impl Default for MaximiseSettings {
    fn default() -> Self {
        Self {
            max_iterations: 60,
            tolerance: 1e-2,
            floor: 1e-3,
            rates: Vec::new(),
            width: None,
            evidence: EvidenceSettings::default(),
        }
    }
}

/// Where [`Marginal::maximise`] ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Maximum {
    /// `f` (K), positive.
    pub reflectance: Vec<f64>,
    /// The evidence there; its `trace` and `converged` are those of the iterations over `f`.
    pub evidence: Evidence,
    /// `Evidence::objective` plus the log prior of `f`: what no iteration lowers.
    pub objective: f64,
}

/// Longest change of a logarithm in one iteration.
const LONGEST: f64 = 1.0;

/// `log p(f)` and its derivatives in `log f`.
struct ReflectancePrior<'a> {
    centre: &'a [f64],
    settings: &'a MaximiseSettings,
}

impl ReflectancePrior<'_> {
    fn log(&self, log_f: &[f64]) -> f64 {
        let rates: f64 = self.settings.rates.iter().zip(log_f).map(|(rate, f)| rate.ln() - rate * f.exp()).sum();
        let width = self.settings.width.map_or(0.0, |w| {
            let at = |(f, c): (&f64, &f64)| -0.5 * (((f - c) / w).powi(2) + (TAU * w * w).ln());
            log_f.iter().zip(self.centre).map(at).sum()
        });
        rates + width
    }

    fn add_gradient(&self, log_f: &[f64], gradient: &mut [f64]) {
        for (out, (rate, f)) in gradient.iter_mut().zip(self.settings.rates.iter().zip(log_f)) {
            *out -= rate * f.exp();
        }
        if let Some(w) = self.settings.width {
            for (out, (f, c)) in gradient.iter_mut().zip(log_f.iter().zip(self.centre)) {
                *out -= (f - c) / (w * w);
            }
        }
    }
}

/// One climb: variables are `log f` and whichever of `log g`, `log b` are not known.
struct Climb<'a> {
    marginal: &'a Marginal<'a>,
    bilinear: &'a Bilinear,
    prior: ReflectancePrior<'a>,
    settings: &'a EvidenceSettings,
}

/// The objective at a point of a climb with its scales fixed, and its gradient.
struct Slope {
    state: State,
    objective: f64,
    gradient: Vec<f64>,
    /// What expectation maximisation makes of the scales.
    squares: Vec<f64>,
}

impl Climb<'_> {
    fn variables(&self, log_f: &[f64], state: &State) -> Vec<f64> {
        let mut x = log_f.to_vec();
        x.extend(self.settings.exposure.is_none().then_some(state.log_g));
        x.extend(self.settings.noise.is_none().then_some(state.log_b));
        x
    }

    fn state(&self, x: &[f64], from: &State) -> State {
        let mut rest = x[self.bilinear.k()..].iter();
        let mut state = from.clone();
        if self.settings.exposure.is_none() {
            state.log_g = *rest.next().expect("a variable for the exposure");
        }
        if self.settings.noise.is_none() {
            state.log_b = *rest.next().expect("a variable for the noise");
        }
        state
    }

    /// The objective at `x`; with its gradient where it is more than `above`, and with the best
    /// exposure for the ratio of signal to noise unless `still`.
    fn look(&self, x: &[f64], from: &State, still: bool, above: f64) -> Option<Slope> {
        let (log_f, state) = (&x[..self.bilinear.k()], self.state(x, from));
        let f: Vec<f64> = log_f.iter().map(|f| f.exp()).collect();
        let design = self.marginal.design(&LightOperator::of_reflectance(self.bilinear, &f));
        let mut point = Point::new(self.marginal, &design, state, self.settings, still)?;
        let objective = point.objective + self.prior.log(log_f);
        if objective < above || !objective.is_finite() {
            return None;
        }
        let slope = point.gradient(self.marginal);
        let mut gradient = slope.reflectance(self.bilinear);
        gradient.iter_mut().zip(&f).for_each(|(d, f)| *d *= f);
        self.prior.add_gradient(log_f, &mut gradient);
        if self.settings.exposure.is_none() {
            let rate = self.marginal.hyper.exposure_rate;
            gradient.push(slope.log_exposure + 1.0 - rate * point.state.log_g.exp());
        }
        if self.settings.noise.is_none() {
            let hyper = &self.marginal.hyper;
            gradient.push(slope.log_precision + hyper.noise_shape - hyper.noise_rate * point.state.log_b.exp());
        }
        Some(Slope { objective, gradient, squares: point.squares(), state: point.state })
    }
}

impl Marginal<'_> {
    /// Maximises the objective of [`Evidence`] plus the log prior of reflectance, as a density of
    /// `f` or with [`MaximiseSettings::width`] of `log f`, over `log f` from a `start` (K, at least
    /// one positive).
    ///
    /// Every iteration is a step of limited-memory BFGS over reflectance, exposure and noise with
    /// the scales of light fixed, then a step of expectation maximisation; neither lowers the
    /// objective. It finds a local maximum, and nothing in it is random.
    ///
    /// # Errors
    /// As [`Self::evidence`], for the start.
    ///
    /// # Panics
    /// If `start` does not have K coefficients, one of them positive and none negative, or there
    /// are other than K rates.
    pub fn maximise(
        &self,
        bilinear: &Bilinear,
        start: &[f64],
        settings: &MaximiseSettings,
    ) -> Result<Maximum, MarginalError> {
        let k = bilinear.k();
        let largest = start.iter().copied().fold(0.0, f64::max);
        assert!(start.len() == k && largest > 0.0 && start.iter().all(|f| *f >= 0.0), "a start of {k} coefficients");
        assert!(settings.rates.is_empty() || settings.rates.len() == k, "{} rates", settings.rates.len());
        let centre: Vec<f64> = start.iter().map(|f| f.max(settings.floor * largest).ln()).collect();
        let prior = ReflectancePrior { centre: &centre, settings };
        let climb = Climb { marginal: self, bilinear, prior, settings: &settings.evidence };
        let at = |log_f: &[f64]| {
            let f: Vec<f64> = log_f.iter().map(|f| f.exp()).collect();
            LightOperator::of_reflectance(bilinear, &f)
        };
        let first = self.evidence(&at(&centre), &settings.evidence)?;
        let mut x = climb.variables(&centre, &first.state);
        let mut now = climb.look(&x, &first.state, true, f64::NEG_INFINITY).ok_or(MarginalError::NotFinite)?;
        let mut memory = Memory::new();
        let mut trace = vec![now.objective];
        let mut small = 0;
        while trace.len() <= settings.max_iterations && small < 2 {
            let Some((step, mut next)) = step(&climb, &x, &now, &memory) else {
                if memory.is_empty() {
                    small = 2;
                }
                memory.forget();
                continue;
            };
            x.iter_mut().zip(&step).for_each(|(x, s)| *x += s);
            memory.learn(step, next.gradient.iter().zip(&now.gradient).map(|(a, b)| a - b).collect());
            let before = now.objective;
            // The scales follow; by round-off alone could that be lower.
            let scales = State { squares: std::mem::take(&mut next.squares), ..next.state.clone() };
            if let Some(better) = climb.look(&x, &scales, false, next.objective) {
                x = climb.variables(&x[..k], &better.state);
                next = better;
            } else {
                next.squares = scales.squares;
            }
            small = if next.objective - before < settings.tolerance { small + 1 } else { 0 };
            trace.push(next.objective);
            now = next;
            if small == 2 {
                // Other components of the mixtures may fit better by now.
                let design = self.design(&at(&x[..k]));
                let again = self.climb(&design, now.state.clone(), &settings.evidence)?;
                let there = climb.variables(&x[..k], &again.state);
                if let Some(better) = climb.look(&there, &again.state, false, now.objective + settings.tolerance) {
                    x = climb.variables(&x[..k], &better.state);
                    trace.push(better.objective);
                    now = better;
                    memory.forget();
                    small = 0;
                }
            }
        }
        let log_f = &x[..k];
        let operator = at(log_f);
        let design = self.design(&operator);
        let last = Point::new(self, &design, now.state.clone(), &settings.evidence, true);
        let mut last = last.ok_or(MarginalError::NotFinite)?;
        last.find_variances();
        let evidence = self.answer(&last, trace, small >= 2);
        Ok(Maximum { reflectance: log_f.iter().map(|f| f.exp()).collect(), evidence, objective: now.objective })
    }
}

/// A step that raises the objective enough, by halving; `None` if there is none in this direction.
fn step(climb: &Climb<'_>, x: &[f64], now: &Slope, memory: &Memory) -> Option<(Vec<f64>, Slope)> {
    let mut direction = memory.direction(&now.gradient);
    let rise: f64 = direction.iter().zip(&now.gradient).map(|(d, g)| d * g).sum();
    if rise.is_nan() || rise <= 0.0 {
        return None;
    }
    let longest = direction.iter().fold(0.0_f64, |top, d| top.max(d.abs()));
    // The first step of a climb knows no scale.
    let limit = if memory.is_empty() { 0.1 * LONGEST } else { LONGEST };
    let shrink = (limit / longest).min(1.0);
    direction.iter_mut().for_each(|d| *d *= shrink);
    let mut alpha = 1.0;
    for _ in 0..25 {
        let moved: Vec<f64> = x.iter().zip(&direction).map(|(x, d)| x + alpha * d).collect();
        let enough = now.objective + 1e-4 * alpha * shrink * rise;
        if let Some(next) = climb.look(&moved, &now.state, true, enough) {
            return Some((direction.iter().map(|d| alpha * d).collect(), next));
        }
        alpha *= 0.5;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::tests::planted;

    fn alike(a: &[f64], b: &[f64]) -> f64 {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
    }

    #[test]
    fn the_maximum_is_near_what_was_planted_and_nothing_lowers_the_objective() {
        let planted = planted(400, 3, 0.01, 21);
        let problem = planted.problem();
        let marginal = Marginal::of_problem(&problem);
        let settings =
            MaximiseSettings { rates: vec![1.0; 3], max_iterations: 400, tolerance: 1e-7, ..Default::default() };
        let start = [0.7, 0.7, 0.7];
        let got = marginal.maximise(&planted.image.bilinear, &start, &settings).unwrap();
        assert!(got.evidence.trace.windows(2).all(|w| w[1] >= w[0]), "{:?}", got.evidence.trace);
        assert!(got.evidence.converged, "{:?}", got.evidence.trace);
        assert!(alike(&got.reflectance, &planted.f) > 0.999, "{:?} {:?}", got.reflectance, planted.f);
        // The evidence of the answer is what a climb from there finds, or more.
        let prior: f64 = got.reflectance.iter().map(|f| -f).sum();
        assert!((got.evidence.objective + prior - got.objective).abs() < 1e-6 * got.objective.abs());
        let operator = LightOperator::of_reflectance(&planted.image.bilinear, &got.reflectance);
        let slope = marginal.gradient(&operator, &got.evidence).unwrap().reflectance(&planted.image.bilinear);
        let rise: Vec<f64> = slope.iter().zip(&got.reflectance).map(|(d, f)| (d - 1.0) * f).collect();
        assert!(rise.iter().all(|d| d.abs() < 0.5), "{rise:?}");
    }

    #[test]
    fn a_narrow_prior_holds_the_start() {
        let planted = planted(100, 3, 0.05, 21);
        let problem = planted.problem();
        let marginal = Marginal::of_problem(&problem);
        let start = [0.7, 0.0, 0.7];
        let moved = |width| {
            let settings = MaximiseSettings { width: Some(width), ..Default::default() };
            let got = marginal.maximise(&planted.image.bilinear, &start, &settings).unwrap().reflectance;
            (got[0] / 0.7).ln().abs().max((got[1] / 0.7e-3).ln().abs()).max((got[2] / 0.7).ln().abs())
        };
        let (narrow, wide) = (moved(1e-3), moved(1.0));
        assert!(narrow < 0.01 && wide > 0.1, "{narrow} {wide}");
    }
}
