//! Trained model: priors learnt from captured lights and measured materials (paper 3.1 and 3.2).

use thiserror::Error;

use crate::appearance::disk::{CHANNELS, DISK_SIDE, GLOBALS};
use crate::colour::ColourModel;
use crate::inference::learnt::LearntPosterior;
use crate::lighting::{CoefficientPrior, LightPrior, PriorGroup};
use crate::reflectance::{CELLS, ReflectanceBasis, THETA_D};

/// Prior of light, basis of reflectance and posterior of materials, with their provenance.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// `p(l)`, eq. 5.
    pub light: LightPrior,
    /// `phi_k` and `p(f)`, eq. 6.
    pub reflectance: ReflectanceBasis,
    /// `p(F | I)` learnt from simulated photographs: the default method.
    pub learnt: Option<LearntPosterior>,
    /// Human-readable description of training data and settings.
    pub provenance: String,
}

/// Error in a model.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ModelError {
    /// The prior has no scales, or too many for memory.
    #[error("the light prior has {0} scales; 1 to {MAX_SCALES} are supported")]
    Scales(u32),
    /// The number of groups does not match the number of scales.
    #[error("the light prior has {got} groups, but {scales} scales require {expected}")]
    Groups {
        /// Groups present.
        got: usize,
        /// Scales of the prior.
        scales: u32,
        /// Groups that the scales require.
        expected: usize,
    },
    /// Weights and variances of a mixture differ in number, or are missing.
    #[error("light group \"{group}\" has {weights} weights and {variances} variances")]
    Components {
        /// Label of the group.
        group: String,
        /// Weights of its mixture.
        weights: usize,
        /// Variances of its mixture.
        variances: usize,
    },
    /// Weights of a mixture that are not positive or do not sum to one.
    #[error("the weights of light group \"{group}\" are {weights:?}; they must be positive and sum to one")]
    Weights {
        /// Label of the group.
        group: String,
        /// Its weights.
        weights: Vec<f64>,
    },
    /// A variance that is zero, negative or not finite.
    #[error("light group \"{group}\" has a variance of {variance}")]
    Variance {
        /// Label of the group.
        group: String,
        /// The variance.
        variance: f64,
    },
    /// Location or threshold of a rectified Gaussian is not finite.
    #[error("light group \"{group}\" has location {location} and threshold {threshold}")]
    Rectified {
        /// Label of the group.
        group: String,
        /// Its location.
        location: f64,
        /// Its threshold.
        threshold: f64,
    },
    /// There is no basis function.
    #[error("the reflectance basis is empty")]
    EmptyBasis,
    /// The number of rates differs from the number of functions.
    #[error("the reflectance basis has {functions} functions and {rates} rates")]
    Rates {
        /// Functions.
        functions: usize,
        /// Rates.
        rates: usize,
    },
    /// A rate that is zero, negative or not finite.
    #[error("the rate of basis function {function} is {rate}")]
    Rate {
        /// Index of the function.
        function: usize,
        /// Its rate.
        rate: f64,
    },
    /// A value of a function that is negative or not finite.
    #[error("basis function {function} is {value} at cell (theta_h {theta_h}, theta_d {theta_d})")]
    Function {
        /// Index of the function.
        function: usize,
        /// Index of the cell in `theta_h`.
        theta_h: usize,
        /// Index of the cell in `theta_d`.
        theta_d: usize,
        /// The value.
        value: f32,
    },
    /// The number of coefficients of a material differs from the number of functions.
    #[error("material \"{material}\" has {got} coefficients for {functions} functions")]
    Coefficients {
        /// Name of the material.
        material: String,
        /// Its coefficients.
        got: usize,
        /// Functions.
        functions: usize,
    },
    /// The parts of the posterior of materials are inconsistent.
    #[error("the posterior of materials is invalid: {0}")]
    Posterior(#[from] PosteriorFault),
    /// A material whose scale is not positive, or with a coefficient that is negative or not
    /// finite.
    #[error("material \"{material}\" has a scale or coefficient of {value}")]
    Material {
        /// Name of the material.
        material: String,
        /// The value.
        value: f64,
    },
}

/// Fault of a posterior of materials.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PosteriorFault {
    /// A part has another length than expected.
    #[error("{0} has {1} values instead of {2}")]
    Length(&'static str, usize, usize),
    /// A value that is not finite.
    #[error("{0} has values that are not finite")]
    NotFinite(&'static str),
    /// A part is empty.
    #[error("it has no {0}")]
    Empty(&'static str),
    /// A range that is not finite, or whose end lies below its beginning.
    #[error("feature {0} has an invalid range")]
    Range(usize),
    /// A colour model with another number of coordinates, values that are not finite, or variances
    /// that are not positive.
    #[error(
        "its colour model has matrices of the wrong size, values that are not finite, or variances that are not \
         positive"
    )]
    Colours,
}

/// Largest number of scales of a prior: a grid of 16384 texels per side.
const MAX_SCALES: u32 = 14;

/// Tolerance of the sum of the weights, which are sums over many samples divided by their total.
const WEIGHT_TOLERANCE: f64 = 1e-6;

impl Model {
    /// Returns the colour model, if there is one.
    pub(crate) fn colours(&self) -> Option<&ColourModel> {
        self.learnt.as_ref().and_then(|learnt| learnt.colours.as_ref())
    }

    /// Checks that lengths match, weights and variances are proper, and all values are finite.
    ///
    /// # Errors
    /// The first inconsistency.
    pub fn check(&self) -> Result<(), ModelError> {
        check_light(&self.light)?;
        check_reflectance(&self.reflectance)?;
        match &self.learnt {
            Some(learnt) => check_posterior(learnt),
            None => Ok(()),
        }
    }
}

fn positive(x: f64) -> bool {
    x > 0.0 && x.is_finite()
}

/// Checks a light prior.
///
/// # Errors
/// The first inconsistency.
pub fn check_light(prior: &LightPrior) -> Result<(), ModelError> {
    let scales = prior.scales;
    // This check comes first, since the others take time and memory in proportion to the scales.
    if !(1..=MAX_SCALES).contains(&scales) {
        return Err(ModelError::Scales(scales));
    }
    let groups = PriorGroup::all(scales);
    if prior.groups.len() != groups.len() {
        return Err(ModelError::Groups { got: prior.groups.len(), scales, expected: groups.len() });
    }
    for (density, group) in prior.groups.iter().zip(groups) {
        check_density(density, group)?;
    }
    Ok(())
}

fn check_density(density: &CoefficientPrior, group: PriorGroup) -> Result<(), ModelError> {
    let label = || group.label();
    let variances: &[f64] = match density {
        CoefficientPrior::Mixture(m) => {
            if m.weights.is_empty() || m.weights.len() != m.variances.len() {
                let (weights, variances) = (m.weights.len(), m.variances.len());
                return Err(ModelError::Components { group: label(), weights, variances });
            }
            let sum: f64 = m.weights.iter().sum();
            if !m.weights.iter().all(|&w| positive(w)) || (sum - 1.0).abs() > WEIGHT_TOLERANCE {
                return Err(ModelError::Weights { group: label(), weights: m.weights.clone() });
            }
            &m.variances
        }
        CoefficientPrior::Rectified(r) => {
            if !r.location.is_finite() || !r.threshold.is_finite() {
                let (location, threshold) = (r.location, r.threshold);
                return Err(ModelError::Rectified { group: label(), location, threshold });
            }
            std::slice::from_ref(&r.variance)
        }
    };
    match variances.iter().find(|&&v| !positive(v)) {
        Some(&variance) => Err(ModelError::Variance { group: label(), variance }),
        None => Ok(()),
    }
}

/// Checks a reflectance basis.
///
/// # Errors
/// The first inconsistency.
pub fn check_reflectance(basis: &ReflectanceBasis) -> Result<(), ModelError> {
    let functions = basis.len();
    if functions == 0 {
        return Err(ModelError::EmptyBasis);
    }
    if basis.rates.len() != functions {
        return Err(ModelError::Rates { functions, rates: basis.rates.len() });
    }
    if let Some(function) = basis.rates.iter().position(|&r| !positive(r)) {
        return Err(ModelError::Rate { function, rate: basis.rates[function] });
    }
    for (function, table) in basis.functions.iter().enumerate() {
        let values = table.as_slice();
        if let Some(cell) = (0..CELLS).find(|&c| !(values[c] >= 0.0 && values[c].is_finite())) {
            let (theta_h, theta_d, value) = (cell / THETA_D, cell % THETA_D, values[cell]);
            return Err(ModelError::Function { function, theta_h, theta_d, value });
        }
    }
    for m in &basis.materials {
        let material = || m.name.clone();
        if m.coefficients.len() != functions {
            return Err(ModelError::Coefficients { material: material(), got: m.coefficients.len(), functions });
        }
        let bad = m.coefficients.iter().find(|&&f| !(f >= 0.0 && f.is_finite()));
        if let Some(&value) = Some(&m.scale).filter(|&&s| !positive(s)).or(bad) {
            return Err(ModelError::Material { material: material(), value });
        }
    }
    Ok(())
}

/// Checks a posterior of materials.
///
/// # Errors
/// The first inconsistency.
pub fn check_posterior(posterior: &LearntPosterior) -> Result<(), ModelError> {
    let length = |what, got: usize, expected: usize| {
        if got == expected { Ok(()) } else { Err(PosteriorFault::Length(what, got, expected)) }
    };
    let finite = |what, values: &[f32]| {
        if values.iter().all(|v| v.is_finite()) { Ok(()) } else { Err(PosteriorFault::NotFinite(what)) }
    };
    let filled = |what, there: bool| if there { Ok(()) } else { Err(PosteriorFault::Empty(what)) };
    let LearntPosterior { names, measured, prior, latent_space: coordinates, widths, encoder, ranges, colours } =
        posterior;
    let dimensions = coordinates.axes.len();
    filled("materials", !names.is_empty())?;
    filled("coordinates", dimensions > 0)?;
    filled("materials of the prior", !prior.coordinates.is_empty())?;
    for table in [&coordinates.mean, widths].into_iter().chain(&coordinates.axes) {
        length("a table", table.len(), CELLS)?;
        finite("a table", table)?;
    }
    length("the list of material coordinates", measured.coordinates.len(), names.len())?;
    let outputs = encoder.shape().outputs;
    for candidates in [measured, prior] {
        let count = candidates.coordinates.len();
        length("the list of material embeddings", candidates.embeddings.len(), count)?;
        length("the list of importance weights", candidates.log_importance.len(), count)?;
        finite("the list of importance weights", &candidates.log_importance)?;
        for (coordinates, embedding) in candidates.coordinates.iter().zip(&candidates.embeddings) {
            length("a list of coordinates", coordinates.len(), dimensions)?;
            length("an embedding", embedding.len(), outputs)?;
            finite("a list of coordinates", coordinates)?;
            finite("an embedding", embedding)?;
        }
    }
    let shape = encoder.shape();
    length("a side of the encoder's image", shape.side, DISK_SIDE)?;
    length("a cell of the encoder's image", shape.channels, CHANNELS)?;
    length("the list of global image features", shape.globals, GLOBALS)?;
    length("the list of feature ranges", ranges.len(), shape.hidden.last().copied().unwrap_or(0))?;
    let proper = |(low, high): &(f32, f32)| low.is_finite() && high.is_finite() && low <= high;
    if let Some(feature) = ranges.iter().position(|range| !proper(range)) {
        return Err(PosteriorFault::Range(feature).into());
    }
    match colours {
        Some(colours) if !colours.is_proper(dimensions) => Err(PosteriorFault::Colours.into()),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use super::*;
    use crate::reflectance::TrainingMaterial;
    use crate::testing::lobe;

    static MODEL: LazyLock<Model> = LazyLock::new(|| {
        let reflectance = ReflectanceBasis {
            functions: vec![lobe(1.0, 0.0, 1.0), lobe(0.0, 1.0, 0.02_f64.sqrt())],
            rates: vec![2.0, 30.0],
            materials: vec![TrainingMaterial { name: "chalk".into(), scale: 0.3, coefficients: vec![0.9, 0.0] }],
        };
        Model { light: crate::testing::toy_prior(8), reflectance, learnt: None, provenance: "toys".into() }
    });

    fn check(spoil: impl FnOnce(&mut Model), message: &str) {
        let mut model = MODEL.clone();
        assert_eq!(model.check(), Ok(()));
        spoil(&mut model);
        let error = model.check().unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }

    fn mixture(model: &mut Model) -> &mut crate::lighting::ScaleMixture {
        match &mut model.light.groups[3] {
            CoefficientPrior::Mixture(m) => m,
            CoefficientPrior::Rectified(_) => panic!("group 3 is a mixture"),
        }
    }

    #[test]
    fn rejects_groups_that_do_not_match_the_scales() {
        check(|m| m.light.scales = 0, "0 scales");
        check(|m| m.light.scales = u32::MAX, "4294967295 scales");
        check(|m| m.light.scales = 4, "15 groups, but 4 scales require 16");
    }

    #[test]
    fn rejects_improper_densities() {
        check(|m| mixture(m).weights.clear(), "0 weights and 2 variances");
        check(|m| mixture(m).weights[0] += 0.1, "must be positive and sum to one");
        check(|m| mixture(m).weights = vec![1.5, -0.5], "must be positive and sum to one");
        check(|m| mixture(m).weights[1] = f64::NAN, "must be positive and sum to one");
        check(|m| mixture(m).variances[1] = 0.0, "\"2 horizontal above\" has a variance of 0");
        check(|m| mixture(m).variances[0] = f64::INFINITY, "variance of inf");
        let rectified = |location, variance| {
            CoefficientPrior::Rectified(crate::lighting::RectifiedGaussian { location, variance, threshold: -0.1 })
        };
        check(|m| m.light.groups[0] = rectified(f64::NAN, 1.0), "location NaN");
        check(|m| m.light.groups[0] = rectified(0.0, -1.0), "variance of -1");
    }

    #[test]
    fn rejects_inconsistent_bases() {
        check(|m| m.reflectance.functions.clear(), "empty");
        check(|m| m.reflectance.rates.push(1.0), "2 functions and 3 rates");
        check(|m| m.reflectance.rates[1] = 0.0, "rate of basis function 1 is 0");
        check(
            |m| m.reflectance.functions[1].as_mut_slice()[91] = -1.0,
            "function 1 is -1 at cell (theta_h 1, theta_d 1)",
        );
        check(|m| m.reflectance.functions[0].as_mut_slice()[5] = f32::NAN, "is NaN");
        check(|m| m.reflectance.materials[0].coefficients.push(1.0), "\"chalk\" has 3 coefficients");
        check(|m| m.reflectance.materials[0].coefficients[1] = -1.0, "coefficient of -1");
        check(|m| m.reflectance.materials[0].scale = 0.0, "scale or coefficient of 0");
    }
}
