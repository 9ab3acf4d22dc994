//! Estimates an environment map from photographs of a mirror ball.

use std::sync::Arc;

use glam::Vec3;
use gonio::picture::Plane;
use gonio::probe::{ProbeError, ProbeSettings, ProbeWarning, Reflectance, SecondView, View, probe};
use gonio::scene::PixelStatus;
use gonio::suggestion::Suggestion;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::{InputSpace, encode_exr_in, encode_png};
use gonio_io::result::{self, Bracket};
use gonio_report::probe::draw;
use serde_json::{Value, json};

use crate::scene::LoadedScene;
use crate::{AppError, Photograph, ProgressLog, Scene, Warning, spaces};

/// A mirror ball in one photograph or two.
#[derive(Clone, Debug)]
pub struct ProbePhotographs {
    /// The photograph; its shape is a sphere.
    pub first: Scene,
    /// Second photograph, and the angle from the first to the second camera around the ball, in
    /// degrees counterclockwise as seen from above; estimated if `None`.
    pub second: Option<(Scene, Option<f64>)>,
    /// Reflectance of the ball at normal incidence for red, green and blue, above 0 and at most 1.
    pub reflectance: [f64; 3],
    /// Rows of the map, a power of two from 8 to 4096; set by the radius of the ball if `None`.
    pub rows: Option<usize>,
}

/// An estimated environment map.
#[derive(Clone, Debug)]
pub struct LightProbe {
    /// The light: a lat-long map of linear radiance in the space of the first camera.
    pub light: Plane<Vec3>,
    /// Observed share of each texel, 0..=1; the rest is filled.
    pub coverage: Plane<f32>,
    /// Diagnostic picture, as linear display values: the photographs with their ignored pixels, and
    /// the map with its filled parts.
    pub picture: Plane<Vec3>,
    /// Numbers by name.
    pub document: Value,
    /// Warnings.
    pub warnings: Vec<Warning>,
}

impl LightProbe {
    /// Encodes the map as OpenEXR in a colour space, and the picture as PNG.
    pub fn encode(&self, space: ColourSpace) -> (Vec<u8>, Vec<u8>) {
        (encode_exr_in(&self.light, None, space), encode_png(&self.picture))
    }
}

/// Reads the photographs, detects the ball in each and unwraps it. Reports the stages `reading` and
/// `unwrapping`.
///
/// # Errors
/// If a file cannot be read, no ball is detected, it has too few usable pixels, or settings are
/// invalid. The error names the faulty input.
pub fn light_probe(mirror: ProbePhotographs, progress_log: &ProgressLog<'_>) -> Result<LightProbe, AppError> {
    let mut warnings = Vec::new();
    let reflectance = Reflectance::new(mirror.reflectance).map_err(|error| AppError::new(error.to_string()))?;
    let settings = ProbeSettings { reflectance, rows: mirror.rows };
    let own = |suggestion| suggestion;
    let first = ObservedBall::of(mirror.first, &own, &mut warnings, progress_log)?;
    let second = match mirror.second {
        None => None,
        Some((scene, degrees)) => Some((ObservedBall::of(scene, &of_second, &mut warnings, progress_log)?, degrees)),
    };
    progress_log.report("unwrapping", 0.0);
    let all = || std::iter::once(&first).chain(second.as_ref().map(|(source, _)| source));
    let names = all().map(|source| source.name.clone()).collect::<Vec<_>>().join(" and ");
    for source in all() {
        warnings.extend(source.view.warnings().iter().map(|found| warning(&source.name, found)));
    }
    let mut document = json!({ "photograph": first.document() });
    if let Some((second, _)) = &second {
        document["second"] = second.document();
    }
    let (name, first) = (first.name, first.view);
    let second =
        second.map(|(source, degrees)| SecondView { view: source.view, azimuth: degrees.map(f64::to_radians) });
    let found = probe(&first, second.as_ref(), &settings).map_err(|error| {
        let about_settings = matches!(error, ProbeError::Rows { .. } | ProbeError::Angle);
        let problem = match &second {
            _ if about_settings => AppError::new(error.to_string()),
            Some(_) => AppError::of(&names, &error),
            None => AppError::of(&name, &error),
        };
        problem.with(error.suggestions())
    })?;
    warnings.extend(found.report.warnings().iter().map(|found| warning(&names, found)));
    if let (Some(document), Value::Object(report)) = (document.as_object_mut(), json!(found.report)) {
        document.extend(report);
    }
    let views: Vec<&View> = std::iter::once(&first).chain(second.as_ref().map(|second| &second.view)).collect();
    let picture = draw(&views, &found);
    Ok(LightProbe { light: found.light.radiance().clone(), coverage: found.coverage, picture, document, warnings })
}

fn warning(name: &str, found: &ProbeWarning) -> Warning {
    Warning::from(format!("{name}: {found}"))
}

/// Returns the suggestion for the second photograph that corresponds to one for the first.
fn of_second(suggestion: Suggestion) -> Suggestion {
    match suggestion {
        Suggestion::Outline | Suggestion::OneOf(_) => Suggestion::SecondOutline,
        Suggestion::Mask => Suggestion::SecondMask,
        other => other,
    }
}

/// A photograph with its detected ball.
struct ObservedBall {
    name: String,
    view: View,
    bracket: Option<Bracket>,
    space: Option<InputSpace>,
}

impl ObservedBall {
    /// Reads a photograph and detects its ball. `suggestion` maps suggestions for the first
    /// photograph to those for this one.
    fn of(
        scene: Scene,
        suggestion: &dyn Fn(Suggestion) -> Suggestion,
        warnings: &mut Vec<Warning>,
        progress_log: &ProgressLog<'_>,
    ) -> Result<Self, AppError> {
        let name = scene.name.clone();
        let LoadedScene { photograph, mask, object, names, .. } = scene.load(warnings, progress_log)?;
        let Photograph { picture, clip, bracket, space } = Arc::unwrap_or_clone(photograph);
        let view = View::of(&picture, mask.as_ref(), &object, clip).map_err(|error| {
            let problem = match &error {
                ProbeError::Scene(scene) => AppError::of(names.origin(scene), &error),
                _ => AppError::of(&name, &error),
            };
            problem.for_shape(names.takes_circle).with(error.suggestions().into_iter().map(suggestion))
        })?;
        Ok(Self { name, view, bracket, space })
    }

    /// Returns the detected ball and the status of its pixels.
    fn document(&self) -> Value {
        let ball = self.view.ball();
        let mut document = json!({
            "image": self.name,
            "radius_pixels": ball.pixels(),
            "used": self.view.count(&[PixelStatus::Used, PixelStatus::Clipped]),
            "clipped": self.view.count(&[PixelStatus::Clipped]),
            "faulty": self.view.count(&[PixelStatus::Negative, PixelStatus::NotFinite]),
            "rim": self.view.count(&[PixelStatus::Edge]),
        });
        match ball.circle() {
            Some(circle) => document["circle"] = json!(result::Circle::from(circle)),
            None => {
                let (centre, radius) = ball.sphere();
                document["ball"] = json!({ "centre": centre.to_array(), "radius": radius });
            }
        }
        if let Some(space) = &self.space {
            document["colorspace"] = spaces::input_document(space);
        }
        if let Some(bracket) = &self.bracket {
            document["bracket"] = json!(bracket);
        }
        document
    }
}
