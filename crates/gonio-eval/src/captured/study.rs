//! Estimates of the default method from each photograph of an object.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, bail};
use gonio::estimate::{
    Alignment, Colouring, ColouringRule, Diagnostic, Estimate, KnownLightEstimate, MaterialEstimate,
    estimate_known_light,
};
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio::scene::{Detection, NormalMap, ObjectShape, ObservationSettings};
use serde::Serialize;

use super::colour::RgbErrors;
use super::errors::{self, Reflectance};
use super::multi_view::{self, MultiViewErrors};
use super::object::{Captured, map_of};
use super::slice::Cell;
use crate::metrics::{Relight, mean};
use crate::silhouettes::estimate_detected;

/// Errors of one estimate.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Errors {
    /// Error against the measured slice.
    pub(super) slice: f64,
    /// Mean relight error of the predictions of the object's other photographs; NaN if there is
    /// only one photograph.
    pub(super) relight: f64,
    /// Log version of the relight error.
    pub(super) relight_log: f64,
}

/// Results of the estimate from one photograph.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Record {
    pub(super) object: String,
    pub(super) photograph: String,
    pub(super) estimate: Errors,
    pub(super) lambert: Errors,
    /// Errors of the measured slice itself.
    pub(super) measured: Errors,
    /// Errors of the measured slice averaged over the difference angle.
    pub(super) profile: Errors,
    /// [`errors::gloss`] of the measurement.
    pub(super) gloss_measured: f64,
    /// Gloss of the estimate.
    pub(super) gloss_estimate: f64,
    /// 5, 50 and 95 % quantiles of the gloss under the posterior.
    pub(super) gloss: [f64; 3],
    /// Shares of the measured slice inside the 50 and 90 % intervals.
    pub(super) coverage: [f64; 2],
    /// RGB relight errors.
    pub(super) rgb: RgbErrors,
    /// Misfit of light and material together.
    pub(super) misfit: f64,
    /// Warnings of the program about the estimate.
    pub(super) warnings: Vec<String>,
    /// Seconds from the decoded picture to the estimated material and light.
    pub(super) seconds: f64,
}

impl Record {
    /// Whether the 90 % interval of the gloss contains the measured gloss.
    pub(super) fn gloss_held(&self) -> bool {
        (self.gloss[0]..=self.gloss[2]).contains(&self.gloss_measured)
    }
}

/// Inputs of an estimate besides photograph and mask.
#[derive(Clone, Copy, Debug)]
pub(super) struct EstimateInputs {
    /// The scanned normals; otherwise, the shape is inflated from the mask.
    pub(super) normals: bool,
    /// The lights of the photograph.
    pub(super) light: bool,
}

/// A record and the estimated material.
pub(super) struct EvaluatedEstimate {
    pub(super) record: Record,
    pub(super) material: MaterialEstimate,
}

/// An object, and the errors of three references: Lambertian, measured slice, and its profile.
pub(super) struct ObjectEvaluation<'a> {
    object: &'a Captured,
    cells: Vec<Cell>,
    lambert: ReferenceErrors,
    measured: ReferenceErrors,
    profile: ReferenceErrors,
}

/// Slice error, and the errors of the prediction of each photograph.
struct ReferenceErrors {
    slice: f64,
    predictions: Vec<Relight>,
}

impl ReferenceErrors {
    fn of(object: &Captured, cells: &[Cell], f: Reflectance<'_>) -> Self {
        Self { slice: errors::slice_error(cells, f), predictions: errors::predictions(object, f) }
    }

    /// Returns the errors averaged over all photographs other than `photograph`.
    fn without(&self, photograph: usize) -> Errors {
        let others = |f: fn(&Relight) -> f64| {
            let errors = self.predictions.iter().enumerate().filter(|(i, _)| *i != photograph);
            mean(&errors.map(|(_, e)| f(e)).collect::<Vec<f64>>())
        };
        Errors { slice: self.slice, relight: others(|e| e.relative), relight_log: others(|e| e.log) }
    }
}

impl<'a> ObjectEvaluation<'a> {
    /// Measures the errors of the references.
    pub(super) fn new(object: &'a Captured) -> Result<Self> {
        let cells = object.slice.judged();
        if cells.is_empty() {
            bail!("measured_bivariate.npz: no cell has enough observations");
        }
        let profile = object.slice.profile();
        Ok(Self {
            lambert: ReferenceErrors::of(object, &cells, &|_, _| 1.0),
            measured: ReferenceErrors::of(object, &cells, &|h, d| object.slice.eval(h, d)),
            profile: ReferenceErrors::of(object, &cells, &|h, _| profile(h)),
            object,
            cells,
        })
    }

    /// Returns the estimates from all photographs, in order, and the error messages of photographs
    /// without an estimate.
    ///
    /// `given` are the inputs of the estimates besides photograph and mask.
    pub(super) fn estimates(&self, model: &Model, given: EstimateInputs) -> (Vec<EvaluatedEstimate>, Vec<String>) {
        let (mut estimates, mut refused) = (Vec::new(), Vec::new());
        for (index, photograph) in self.object.photographs.iter().enumerate() {
            let title = format!("{}, {}", self.object.name, photograph.name);
            match self.estimate(index, model, given) {
                Ok(estimate) => {
                    eprintln!("{title}: {:.1} s", estimate.record.seconds);
                    estimates.push(estimate);
                }
                Err(problem) => refused.push(format!("{title}: {problem:#}")),
            }
        }
        (estimates, refused)
    }

    /// Measures the errors of the estimates from several photographs together.
    ///
    /// # Errors
    /// If an estimate has no quantiles.
    pub(super) fn several(&self, model: &Model, estimates: &[EvaluatedEstimate]) -> Result<MultiViewErrors> {
        let ones: Vec<&MaterialEstimate> = estimates.iter().map(|estimate| &estimate.material).collect();
        MultiViewErrors::of(&self.object.name, &self.cells, model, &ones)
    }

    fn estimate(&self, photograph: usize, model: &Model, given: EstimateInputs) -> Result<EvaluatedEstimate> {
        let start = Instant::now();
        let found = estimate(self.object, photograph, model, given)?;
        let record = self.record(photograph, &found, start.elapsed().as_secs_f64())?;
        Ok(EvaluatedEstimate { record, material: found.material })
    }

    fn record(&self, photograph: usize, found: &ObjectEstimate, seconds: f64) -> Result<Record> {
        let ObjectEstimate { material, misfit, diagnostics, colouring, median } = found;
        let (object, cells, table) = (self.object, &self.cells, &material.table);
        let quantiles = multi_view::quantiles(material)?;
        Ok(Record {
            object: object.name.clone(),
            photograph: object.photographs[photograph].name.clone(),
            estimate: ReferenceErrors::of(object, cells, &|h, d| table.eval(h, d)).without(photograph),
            lambert: self.lambert.without(photograph),
            measured: self.measured.without(photograph),
            profile: self.profile.without(photograph),
            gloss_measured: errors::measured_gloss(object, cells),
            gloss_estimate: errors::gloss(cells, &|h, d| table.eval(h, d)),
            gloss: gloss_quantiles(material, cells),
            coverage: errors::coverage(cells, table, &quantiles),
            rgb: RgbErrors::of(object, photograph, (table, colouring, median)),
            misfit: *misfit,
            warnings: diagnostics.iter().map(ToString::to_string).collect(),
            seconds,
        })
    }
}

/// An estimate and its diagnostics.
struct ObjectEstimate {
    material: MaterialEstimate,
    misfit: f64,
    diagnostics: Vec<Diagnostic>,
    colouring: Colouring,
    /// The median colour of the photograph.
    median: Colouring,
}

/// Estimates as the program does with `--mask mask.png`. With `given`, it also has the options
/// `--normals normal.exr` or `--shape outline`, and `--light`.
fn estimate(object: &Captured, photograph: usize, model: &Model, given: EstimateInputs) -> Result<ObjectEstimate> {
    let normals =
        || NormalMap { normals: object.normals.clone(), camera: None, positions: None, trusted: false, error: 0.0 };
    let mut detection = Detection::of(
        &object.photographs[photograph].picture,
        Some(object.mask.clone()),
        if given.normals { ObjectShape::Normals(Arc::new(normals())) } else { ObjectShape::Outline },
        &ObservationSettings::default(),
    )?;
    let median = |detection: &Detection, table: &BivariateTable| {
        Colouring::of(model, &detection.observations, table, &ColouringRule::Median)
    };
    if given.light {
        let map = map_of(&object.photographs[photograph].lights)?;
        let given = (&map, Alignment::Small);
        let found = estimate_known_light(model, &detection.observations, given, &ColouringRule::default(), &|_| ())?;
        let (diagnostics, median) = (found.diagnostics(), median(&detection, &found.material.table));
        let KnownLightEstimate { material, misfit, colouring, .. } = found;
        return Ok(ObjectEstimate { material, misfit, diagnostics, colouring, median });
    }
    let found = estimate_detected(model, &object.photographs[photograph].picture, &mut detection)?;
    let (diagnostics, median) = (found.diagnostics(), median(&detection, &found.material.table));
    let Estimate { material, light, colouring, .. } = found;
    Ok(ObjectEstimate { material, misfit: light.misfit, diagnostics, colouring, median })
}

/// Computes the 5, 50 and 95 % quantiles of [`errors::gloss`] under the posterior.
fn gloss_quantiles(material: &MaterialEstimate, cells: &[Cell]) -> [f64; 3] {
    let number = |table: &BivariateTable| errors::gloss(cells, &|h, d| table.eval(h, d));
    let quantiles = material.posterior.number_quantiles(number, &[0.05, 0.5, 0.95]);
    [quantiles[0], quantiles[1], quantiles[2]]
}
