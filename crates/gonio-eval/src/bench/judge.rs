//! The errors of an estimate, and the record that is kept of them.

use std::collections::BTreeMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::Vec3;
use gonio::reflectance::BivariateTable;
use gonio::render::Relighter;
use serde::{Deserialize, Serialize};

use super::estimators::{Estimate, Estimator, Report};
use super::grid::{Protocol, Unit};
use super::renders::Render;
use super::stage::Stage;
use crate::metrics::{Gloss, brdf_error, coverage, mean, relight};

/// One cell of the grid: the result of one estimator on one photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Record {
    /// Hash of everything that the cell depends on; a record with another key is ignored.
    pub(crate) key: String,
    pub(crate) protocol: Protocol,
    pub(crate) material: String,
    pub(crate) light: String,
    pub(crate) estimator: Estimator,
    /// Whether the photograph was rendered from the full table.
    pub(crate) full_table: bool,
    /// Errors in each of the lights that the estimate was relit in.
    pub(crate) relight: Vec<Relit>,
    /// Rms logarithmic error over the domain.
    pub(crate) brdf: Option<f64>,
    /// Highlight of the estimate and of the reference.
    pub(crate) gloss: Option<[Gloss; 2]>,
    /// Share of the trusted cells whose reference lies in the 50 % and in the 90 % interval.
    pub(crate) coverage: Option<[f64; 2]>,
    /// Share of the energy of the image that no light on the grid can produce.
    pub(crate) left_over: f64,
    /// Seconds of one core.
    pub(crate) seconds: f64,
    pub(crate) report: Report,
    /// Reason why there is no estimate.
    pub(crate) failure: Option<String>,
    /// The photograph as its observations show it, a PNG in base64.
    pub(crate) photograph: String,
    /// The estimate on a sphere in the first of the lights, at the exposure of the reference, a PNG
    /// in base64.
    pub(crate) picture: String,
}

/// Errors in one light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Relit {
    pub(crate) light: String,
    /// `min_s |s I^ - I| / |I|`.
    pub(crate) relative: f64,
    /// Rms of the logarithm of the ratio.
    pub(crate) log: f64,
}

impl Record {
    /// Mean relight error over the lights; one, that of a black picture, without an estimate.
    pub(crate) fn relative(&self) -> f64 {
        if self.relight.is_empty() { 1.0 } else { mean(&self.relight.iter().map(|r| r.relative).collect::<Vec<_>>()) }
    }

    /// Mean logarithmic relight error; that of a black picture (ln 101 at a pixel of mean
    /// brightness) without an estimate.
    pub(crate) fn log(&self) -> f64 {
        if self.relight.is_empty() {
            101.0_f64.ln()
        } else {
            mean(&self.relight.iter().map(|r| r.log).collect::<Vec<_>>())
        }
    }

    /// Path of the record's file, relative to the folder of cells.
    pub(crate) fn file(&self) -> String {
        file(self.protocol, &self.material, &self.light, self.estimator)
    }
}

/// Path of a record's file, relative to the folder of cells.
pub(crate) fn file(protocol: Protocol, material: &str, light: &str, estimator: Estimator) -> String {
    format!("{}/{material}/{light}/{}.json", protocol.id(), estimator.id())
}

/// Ground truth that estimates from one photograph are compared with.
pub(crate) struct Reference<'a> {
    pub(crate) unit: &'a Unit,
    pub(crate) name: &'a str,
    pub(crate) full_table: bool,
    pub(crate) truth: &'a BivariateTable,
    pub(crate) stage: &'a Stage,
    /// Name, relighting operator and reference picture of each light.
    pub(crate) lights: Vec<(&'a str, &'a Relighter, &'a Render)>,
    pub(crate) left_over: f64,
    /// The photograph, as in [`Record::photograph`].
    pub(crate) photograph: String,
}

impl Reference<'_> {
    /// Judges an estimate that took `seconds`.
    pub(crate) fn judge(
        &self,
        estimator: Estimator,
        key: String,
        seconds: f64,
        estimate: Result<Estimate, anyhow::Error>,
    ) -> Record {
        let (estimate, failure) = match estimate {
            Ok(estimate) => {
                let finite = |t: &BivariateTable| t.as_slice().iter().all(|v| v.is_finite() && *v >= 0.0);
                let sound = estimate.table.as_ref().is_some_and(|t| finite(t) && t.normal_albedo() > 0.0);
                if sound {
                    (estimate, None)
                } else {
                    (Estimate::default(), Some("the estimate is missing, black, negative or not finite".to_owned()))
                }
            }
            Err(error) => (Estimate::default(), Some(format!("{error:#}"))),
        };
        let table = estimate.table.as_ref();
        let mut picture = String::new();
        let mut errors = Vec::new();
        for (at, (light, relighter, reference)) in self.lights.iter().enumerate() {
            let Some(table) = table else { break };
            let values = relighter.render(table);
            let error = relight(&self.stage.counted(&values), &self.stage.counted(&reference.luminance));
            errors.push(Relit { light: (*light).to_owned(), relative: error.relative, log: error.log });
            if at == 0 {
                picture = encoded(self.stage, &values, error.scale, reference);
            }
        }
        Record {
            key,
            protocol: self.unit.protocol,
            material: self.name.to_owned(),
            light: self.unit.light.clone(),
            estimator,
            full_table: self.full_table,
            relight: errors,
            brdf: table.map(|t| brdf_error(t, self.truth)),
            gloss: table.map(|t| [Gloss::of(t), Gloss::of(self.truth)]),
            coverage: table.zip(estimate.quantiles.as_ref()).map(|(t, q)| coverage(t, q, self.truth)),
            left_over: self.left_over,
            seconds,
            report: estimate.report,
            failure,
            photograph: self.photograph.clone(),
            picture,
        }
    }
}

/// Encodes `scale * values` in the colour and at the exposure of `like` as a PNG in base64.
pub(crate) fn encoded(stage: &Stage, values: &[f64], scale: f64, like: &Render) -> String {
    let exposure = stage.exposure(&like.luminance);
    STANDARD.encode(stage.png(values, scale, exposure, Vec3::from_array(like.colour)))
}

/// Records by protocol, material, light and estimator.
pub(crate) type Records = BTreeMap<(Protocol, String, String, Estimator), Record>;
