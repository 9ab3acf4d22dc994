//! The errors of an estimate, and their record.

use std::collections::BTreeMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::Vec3;
use gonio::colour::ChromaField;
use gonio::reflectance::BivariateTable;
use gonio::render::Relighter;
use serde::{Deserialize, Serialize};

use super::estimators::{Estimate, Estimator, Report};
use super::grid::{Protocol, Unit, id};
use super::renders::Render;
use super::test_sphere::TestSphere;
use crate::colour::picture;
use crate::metrics::{Gloss, RgbRelight, brdf_error, coverage, luminances, mean, relight, relight_rgb};

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
    /// Reason for a missing estimate.
    pub(crate) failure: Option<String>,
    /// The photograph at its observed points, a PNG in base64.
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
    /// Errors in RGB.
    pub(crate) rgb: RgbErrors,
}

/// RGB relight errors of one luminance estimate in several colours, with one scale for all
/// channels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct RgbErrors {
    /// In the estimated colours, or in the median colour if the estimator has no colours.
    pub(crate) estimate: f64,
    /// In the median colour of the photograph: the paper's display rule.
    pub(crate) median: f64,
    /// In grey.
    pub(crate) grey: f64,
    /// In the true chroma of every cell: an oracle.
    pub(crate) true_chroma: f64,
    /// Distance of the chroma of the mean pixel from the true one, `(ln R/G, ln B/G)`, for
    /// `estimate`.
    pub(crate) mean_chroma: f64,
}

impl Record {
    /// Mean relight error over the lights. Without an estimate: one, the error of a black picture.
    pub(crate) fn relative(&self) -> f64 {
        if self.relight.is_empty() { 1.0 } else { mean(&self.relight.iter().map(|r| r.relative).collect::<Vec<_>>()) }
    }

    /// Mean logarithmic relight error. Without an estimate: the error of a black picture, ln 101 at
    /// a pixel of mean brightness.
    pub(crate) fn log(&self) -> f64 {
        if self.relight.is_empty() {
            101.0_f64.ln()
        } else {
            mean(&self.relight.iter().map(|r| r.log).collect::<Vec<_>>())
        }
    }

    /// Mean of an RGB error over the lights. Without an estimate: one, the error of a black
    /// picture.
    pub(crate) fn rgb(&self, error: fn(&RgbErrors) -> f64) -> f64 {
        if self.relight.is_empty() {
            1.0
        } else {
            mean(&self.relight.iter().map(|r| error(&r.rgb)).collect::<Vec<_>>())
        }
    }

    /// Mean distance of the mean chroma over the lights; `None` without an estimate.
    pub(crate) fn mean_chroma(&self) -> Option<f64> {
        (!self.relight.is_empty()).then(|| self.rgb(|errors| errors.mean_chroma))
    }

    /// Path of the record's file, relative to the folder of cells.
    pub(crate) fn file(&self) -> String {
        file(self.protocol, &self.material, &self.light, self.estimator)
    }
}

/// Path of a record's file, relative to the folder of cells.
pub(crate) fn file(protocol: Protocol, material: &str, light: &str, estimator: Estimator) -> String {
    format!("{}/{material}/{light}/{}.json", id(&protocol), id(&estimator))
}

/// Ground truth that estimates from one photograph are compared with.
pub(crate) struct GroundTruth<'a> {
    pub(crate) unit: &'a Unit,
    pub(crate) name: &'a str,
    pub(crate) full_table: bool,
    /// Luminance table of the true material, and its chroma.
    pub(crate) truth: (&'a BivariateTable, &'a ChromaField),
    /// Median colour of the photograph, of luminance one.
    pub(crate) median: Vec3,
    pub(crate) stage: &'a TestSphere,
    /// Name, relighting operators of red, green and blue, and reference picture of each light.
    pub(crate) lights: Vec<(&'a str, &'a [Relighter; 3], &'a Render)>,
    pub(crate) left_over: f64,
    /// The photograph, as in [`Record::photograph`].
    pub(crate) photograph: String,
}

impl GroundTruth<'_> {
    /// Measures the errors of an estimate that took `seconds`.
    pub(crate) fn evaluate(
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
        let (truth, _) = self.truth;
        let mut shown = String::new();
        let mut errors = Vec::new();
        for (at, &(light, relighters, reference)) in self.lights.iter().enumerate() {
            let Some(table) = table else { break };
            let reference = reference.colours();
            let coloured = self.coloured(table, estimate.chroma.as_ref(), relighters);
            let counted = |picture: &[Vec3]| self.stage.counted(picture);
            let against = |picture: &[Vec3]| relight_rgb(&counted(picture), &counted(&reference));
            let luminance = relight(&luminances(&counted(&coloured.luminance)), &luminances(&counted(&reference)));
            let RgbRelight { relative: estimate, mean_chroma } = against(&coloured.estimate);
            let [median, grey, true_chroma] =
                [&coloured.median, &coloured.luminance, &coloured.true_chroma].map(|picture| against(picture).relative);
            let rgb = RgbErrors { estimate, median, grey, true_chroma, mean_chroma };
            errors.push(Relit { light: light.to_owned(), relative: luminance.relative, log: luminance.log, rgb });
            if at == 0 {
                shown = encoded(self.stage, &coloured.estimate, luminance.scale, &reference);
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
            brdf: table.map(|t| brdf_error(t, truth)),
            gloss: table.map(|t| [Gloss::of(t), Gloss::of(truth)]),
            coverage: table.zip(estimate.quantiles.as_ref()).map(|(t, q)| coverage(t, q, truth)),
            left_over: self.left_over,
            seconds,
            report: estimate.report,
            failure,
            photograph: self.photograph.clone(),
            picture: shown,
        }
    }

    /// Relights a luminance table in several colours.
    fn coloured(&self, table: &BivariateTable, chroma: Option<&ChromaField>, relighters: &[Relighter; 3]) -> Coloured {
        let in_field = |field: &ChromaField| picture(relighters, &field.tables(table));
        let luminance = in_field(&ChromaField::GREY);
        let median: Vec<Vec3> = luminance.iter().map(|rgb| *rgb * self.median).collect();
        Coloured {
            estimate: chroma.map_or_else(|| median.clone(), in_field),
            true_chroma: in_field(self.truth.1),
            median,
            luminance,
        }
    }
}

/// Pictures of a luminance table under one light, in several colours.
struct Coloured {
    estimate: Vec<Vec3>,
    median: Vec<Vec3>,
    true_chroma: Vec<Vec3>,
    /// In grey.
    luminance: Vec<Vec3>,
}

/// Encodes `scale` times a picture at the exposure of `like` as a PNG in base64.
pub(crate) fn encoded(stage: &TestSphere, picture: &[Vec3], scale: f64, like: &[Vec3]) -> String {
    STANDARD.encode(stage.png(picture, scale, stage.exposure(&luminances(like))))
}

/// Records by protocol, material, light and estimator.
pub(crate) type Records = BTreeMap<(Protocol, String, String, Estimator), Record>;

#[cfg(test)]
mod tests {
    use gonio::colour::Chroma;
    use gonio::lighting::EnvironmentMap;
    use gonio::picture::Plane;
    use gonio::render::LightTree;

    use super::*;
    use crate::bench::DRAFT;

    /// Renders a material of one colour in a light of one colour. Correct colours have no error;
    /// the error of wrong colours is the sine of the angle between the colours.
    #[test]
    fn rgb_errors_match_planted_colours() {
        let of_light = Vec3::new(0.5, 1.0, 0.8);
        let map = EnvironmentMap::new(Plane::from_fn(16, 8, |_, y| of_light * (1.0 + y as f32))).unwrap();
        let table = BivariateTable::from_fn(|h, _| 0.1 + 2.0 * (-(h / 0.2).powi(2)).exp());
        let (chroma, wrong) = (Chroma([0.8, -0.6]), Chroma([-0.5, 0.4]));
        let field = ChromaField::uniform(chroma);
        let stage = TestSphere::new(20);
        let tree = LightTree::of_map(&map);
        let relighters = Relighter::of_channels(&stage.points, std::slice::from_ref(&table), &tree, &DRAFT);
        let truth = picture(&relighters, &field.tables(&table));
        let render = Render { rgb: truth.iter().map(|rgb| rgb.to_array()).collect() };
        let median = chroma.rgb().as_vec3() * of_light;
        let unit = Unit { protocol: Protocol::All, material: 0, light: "l".into() };
        let reference = GroundTruth {
            unit: &unit,
            name: "m",
            full_table: true,
            truth: (&table, &field),
            median,
            stage: &stage,
            lights: vec![("light", &relighters, &render)],
            left_over: 0.0,
            photograph: String::new(),
        };
        let judged = |chroma: Option<ChromaField>| {
            let estimate = Estimate { table: Some(table.scaled(7.0)), chroma, ..Estimate::default() };
            reference.evaluate(Estimator::Learnt, "k".into(), 0.0, Ok(estimate))
        };
        let sine = |a: Vec3, b: Vec3| f64::from(a.cross(b).length() / a.length() / b.length());
        let true_colour = of_light * chroma.rgb().as_vec3();
        let right = judged(Some(field.clone()));
        assert!(right.relative() < 1e-5 && right.rgb(|e| e.estimate) < 1e-5, "{right:?}");
        assert!(right.mean_chroma().unwrap() < 1e-5 && right.rgb(|e| e.true_chroma) < 1e-5, "{right:?}");
        // The median colour of the photograph contains the colour of the light, which relighting
        // applies again.
        let double = judged(None);
        let want = sine(of_light * median, true_colour);
        assert!((double.rgb(|e| e.estimate) - want).abs() < 1e-5 && double.rgb(|e| e.median) > 0.1, "{double:?}");
        let shown = judged(Some(ChromaField::uniform(wrong)));
        let want = sine(of_light * wrong.rgb().as_vec3(), true_colour);
        assert!((shown.rgb(|e| e.estimate) - want).abs() < 1e-5, "{shown:?} {want}");
        assert!((shown.mean_chroma().unwrap() - wrong.distance(chroma)).abs() < 1e-4, "{shown:?}");
        assert!((shown.rgb(|e| e.grey) - sine(of_light, true_colour)).abs() < 1e-5, "{shown:?}");
        // Without an estimate the picture is black.
        let failed = reference.evaluate(Estimator::Learnt, "k".into(), 0.0, Err(anyhow::anyhow!("no")));
        assert!(failed.rgb(|e| e.estimate) == 1.0 && failed.mean_chroma().is_none());
    }
}
