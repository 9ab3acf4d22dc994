//! Bound on the evidence at one design, and the expectation maximisation that raises it.

use gonio_linalg::dot;

use super::factor::Design;
use super::point::{Point, State};
use super::{LightInference, LightInferenceError};

/// Settings of [`LightInference::posterior`].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct InferenceSettings {
    /// Largest number of steps of expectation maximisation.
    pub max_steps: usize,
    /// Gain of the objective in one step, in nats, below which the ascent has converged.
    pub tolerance: f64,
    /// A known exposure, positive, in units of the image; `None` to estimate it.
    pub exposure: Option<f64>,
    /// A known standard deviation of the noise, positive, in units of the image; `None` to estimate
    /// it.
    pub noise: Option<f64>,
}

impl Default for InferenceSettings {
    fn default() -> Self {
        Self { max_steps: 60, tolerance: 1e-3, exposure: None, noise: None }
    }
}

impl InferenceSettings {
    pub(super) fn finds_both(&self) -> bool {
        self.exposure.is_none() && self.noise.is_none()
    }
}

/// Evidence of one reflectance from an image, and the posterior of the light given it.
#[derive(Clone, Debug, PartialEq)]
pub struct LightPosterior {
    /// Lower bound of `log p(I | f, g, b)` for the scaled image, in nats, all constants included;
    /// equal to it for mixtures of one component.
    pub bound: f64,
    /// The bound plus `log p(log g)` and `log p(log b)` of those that were estimated. Steps never
    /// lower it, and candidates are compared by it.
    pub objective: f64,
    /// `g`, in units of the image.
    pub exposure: f64,
    /// `b^(-1/2)`, in units of the image.
    pub noise: f64,
    /// Posterior means `<l_m>` (M), DC first.
    pub light: Vec<f64>,
    /// Posterior standard deviations of `l_m` (M), zero for DC.
    pub light_sd: Vec<f64>,
    /// Number of directions of the light determined by the image rather than the prior,
    /// `sum_m (1 - Sigma_mm d_m)`.
    pub effective: f64,
    /// The objective at the start and after every step.
    pub trace: Vec<f64>,
    /// Whether the tolerance was met.
    pub converged: bool,
    pub(super) state: State,
}

/// Largest extension of a step in `log rho`, `rho = b g^2`, beyond the expectation-maximisation
/// step.
const MAX_STEP: f64 = 2.0;

/// Largest factor by which a step is lengthened.
const MAX_STRETCH: f64 = 64.0;

/// Gain of a step, in nats, below which the ascent tries other components of the mixtures.
const SLOW: f64 = 1.0;

/// Largest number of component switches.
const MAX_SWITCHES: usize = 8;

impl LightInference<'_> {
    /// Maximises the bound of a design.
    ///
    /// The ascent starts from the scales of the prior's variances or, if given, from `coarse`: the
    /// posterior of the first coefficients alone. The finer coefficients then start at the scales
    /// of their prior.
    ///
    /// The bound has a local maximum for every choice of components. When the ascent becomes slow,
    /// it selects the best component of each coefficient with all other coefficients fixed. If
    /// these components raise the objective, the ascent continues from there.
    ///
    /// In row form (r rows, M light coefficients), a step costs `r^2 M + r^3 / 3` flops for the
    /// factorisation and `r^2 M` for the posterior variances. A secant lengthens the step of
    /// `log(b g^2)`; if this lowers the objective, the plain step is used.
    ///
    /// # Errors
    /// If the design has values that are not finite, or so large that products overflow.
    ///
    /// # Panics
    /// If the numbers of rows or light coefficients differ from those of the image and the prior.
    pub(super) fn posterior(
        &self,
        design: &Design,
        settings: &InferenceSettings,
        coarse: Option<&LightPosterior>,
    ) -> Result<LightPosterior, LightInferenceError> {
        let (rows, m) = design.matrix.shape();
        assert_eq!(m, self.scales.means().len(), "the design and the prior differ in light coefficients");
        assert_eq!(rows, self.target.len(), "the design and the image differ in rows");
        let start = match coarse {
            None => self.start(design, settings),
            Some(coarse) => {
                let mut state = coarse.state.clone();
                state.squares.extend(&self.scales.prior_squares()[state.squares.len()..]);
                state
            }
        };
        self.maximise(design, start, settings)
    }

    /// Returns the start of the ascent.
    ///
    /// The start uses the prior variances. Unless known, the exposure equates the expected energy
    /// and that of the image, and the noise has standard deviation 0.1 on the scaled image.
    pub(super) fn start(&self, design: &Design, settings: &InferenceSettings) -> State {
        let squares = self.scales.prior_squares();
        let mut energy = 0.0;
        let variances = self.scales.given(&squares).variances;
        for (column, v) in design.matrix.as_ref().col_iter().zip(&variances) {
            energy += v * column.squared_norm_l2();
        }
        let mean_image = design.times(&self.scales.means());
        energy += dot(&mean_image, &mean_image);
        let signal = dot(&self.target, &self.target);
        let log_g = if energy > 0.0 && signal > 0.0 { 0.5 * (signal / energy).ln() } else { 0.0 };
        State {
            squares,
            log_g: settings.exposure.map_or(log_g, |g| (g * self.scale).ln()),
            log_b: settings.noise.map_or(100.0_f64.ln(), |noise| -2.0 * (noise * self.scale).ln()),
        }
    }

    pub(super) fn maximise(
        &self,
        design: &Design,
        start: State,
        settings: &InferenceSettings,
    ) -> Result<LightPosterior, LightInferenceError> {
        let mut now = Point::new(self, design, start, settings).ok_or(LightInferenceError::NotFinite)?;
        now.find_variances();
        let mut trace = vec![now.objective];
        // Factor by which the last step was lengthened. The next factor is at most 4 times this
        // one, and 2 times this one if the secant has no negative slope.
        let mut stretch = 1.0_f64;
        let mut switches = MAX_SWITCHES;
        let (mut converged, mut last) = (false, None::<(f64, f64)>);
        while trace.len() <= settings.max_steps && !converged {
            let plain = now.maximised(self, settings);
            let (at, step) = (now.state.log_rho(), plain.log_rho() - now.state.log_rho());
            let factor = last.map_or(1.0, |(at_last, step_last)| {
                let slope = (step - step_last) / (at - at_last);
                if slope < 0.0 { (-1.0 / slope).clamp(1.0, 4.0 * stretch) } else { 2.0 * stretch }
            });
            last = Some((at, step)).filter(|_| step != 0.0);
            let longer = ((factor - 1.0) * step).clamp(-MAX_STEP, MAX_STEP);
            let mut next = None;
            if longer != 0.0 {
                let bold = Point::new(self, design, plain.stretched(longer, settings), settings);
                next = bold.filter(|bold| bold.objective >= now.objective);
                stretch = if next.is_some() { factor.min(MAX_STRETCH) } else { 1.0 };
            }
            if next.is_none() {
                next = Point::new(self, design, plain, settings);
            }
            // A plain step lowers the objective only by round-off, at convergence.
            let Some(mut next) = next.filter(|next| next.objective >= now.objective) else {
                converged = true;
                break;
            };
            next.find_variances();
            let gain = next.objective - now.objective;
            trace.push(next.objective);
            now = next;
            if gain < SLOW.max(settings.tolerance) && switches > 0 {
                switches -= 1;
                match self.switch_components(design, &now, settings) {
                    Some(next) => {
                        trace.push(next.objective);
                        (now, last, stretch) = (next, None, 1.0);
                        continue;
                    }
                    None => switches = 0,
                }
            }
            converged = gain < settings.tolerance;
        }
        Ok(self.result(&now, trace, converged))
    }

    /// Returns a better point whose mixtures have other components, if there is one.
    ///
    /// It switches all coefficients, or only those whose prior variance the image reduces by at
    /// most 30 % or 5 %; these are nearly independent of each other.
    fn switch_components<'a>(
        &self,
        design: &'a Design,
        now: &Point<'a>,
        settings: &InferenceSettings,
    ) -> Option<Point<'a>> {
        let posterior = now.final_variances();
        [1.0, 0.3, 0.05].into_iter().find_map(|weak| {
            let squares = self.scales.best_in_cavity(&now.given, &now.light, &posterior, &now.state.squares, weak);
            let state = State { squares, ..now.state.clone() };
            let mut next = Point::new(self, design, state, settings)?;
            (next.objective > now.objective + settings.tolerance).then(|| {
                next.find_variances();
                next
            })
        })
    }

    pub(super) fn result(&self, now: &Point<'_>, trace: Vec<f64>, converged: bool) -> LightPosterior {
        let variances = now.final_variances();
        LightPosterior {
            bound: now.bound,
            objective: now.objective,
            exposure: now.state.log_g.exp() / self.scale,
            noise: (-0.5 * now.state.log_b).exp() / self.scale,
            light: now.light.clone(),
            light_sd: variances.iter().map(|v| v.sqrt()).collect(),
            effective: now.effective(),
            trace,
            converged,
            state: now.state.clone(),
        }
    }
}
