//! Stepwise inference from a photograph, so that the page can show each result.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::Vec3;
use gonio::estimate::{ColouredMaterial, Colouring, Estimate, EstimateSettings};
use gonio::model::Model;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::MerlTable;
use gonio::scene::{Circle, Detection, ObjectShape, ObservationSettings, SceneError};
use gonio::suggestion::Suggestion;
use gonio_app::document::{self, ShapeOrigin};
use gonio_app::photograph::decode_picture;
use gonio_app::results::{LIGHT, LIGHT_ROWS, RESULT};
use gonio_app::{AS_CAPTURED, Method, Spaces, contradiction};
use gonio_io::picture::ReadOptions;
use gonio_io::result::{self, ResultDocument};
use gonio_io::rgl::{self, Channels};
use gonio_report::panels::builtin_lights;
use gonio_report::report::sphere;
use gonio_report::uncertainty;
use serde_json::{Value, json};

use crate::preview;

/// Largest number of pixels. Decoding and processing them takes a large part of the four gigabytes
/// that a page may use.
const MAX_PIXELS: u64 = 1 << 25;
/// Rows of the built-in lights of the viewer, as in the report.
const ROWS: usize = 64;

/// A file to save.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Product {
    /// The BRDF in the format of the MERL database.
    Merl,
    /// The BRDF for Mitsuba's RGB variants.
    Mitsuba,
    /// The light as a lat-long map.
    Light,
    /// All numbers, as JSON.
    Result,
}

impl Product {
    /// Returns the product with this file name.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "brdf.binary" => Some(Self::Merl),
            "brdf_rgb.bsdf" => Some(Self::Mitsuba),
            LIGHT => Some(Self::Light),
            RESULT => Some(Self::Result),
            _ => None,
        }
    }
}

/// A photograph, and the results so far.
pub struct Session {
    model: Model,
    name: String,
    picture: Picture,
    clip: Option<f32>,
    warnings: Vec<String>,
    detection: Option<Detection>,
    material: Option<ColouredMaterial>,
    /// The last estimate with a light, and its settings.
    estimate: Option<(Estimate, EstimateSettings)>,
}

impl Session {
    /// Decodes a photograph. Only the extension of `name` affects decoding; messages contain the
    /// whole name.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn open(model: Model, name: &str, bytes: &[u8]) -> Result<Self, String> {
        let options = ReadOptions { max_pixels: MAX_PIXELS, ..ReadOptions::default() };
        let mut warnings = Vec::new();
        let decoded =
            decode_picture(Path::new(name), bytes, &options, &mut warnings).map_err(|problem| problem.to_string())?;
        Ok(Self {
            model,
            name: name.to_owned(),
            picture: decoded.picture,
            clip: decoded.full_scale,
            // The page has no settings, so warnings do not suggest any.
            warnings: warnings.iter().map(|warning| warning.worded(&|_| None)).collect(),
            detection: None,
            material: None,
            estimate: None,
        })
    }

    /// Returns the photograph as a PNG of at most `side` pixels per side, with its original size.
    pub fn preview(&self, side: usize) -> Value {
        let (width, height) = self.picture.rgb.size();
        json!({ "width": width, "height": height, "png": png(&preview::preview(&self.picture, side)) })
    }

    /// Detects the ball and samples the photograph on it. A given outline `[x, y, radius]` in
    /// pixels replaces the detection. If no ball is detected, the result has the reason `why` and
    /// possibly a candidate `guess`; the user can then specify an outline.
    ///
    /// # Errors
    /// If the ball has too few usable pixels.
    pub fn observe(&mut self, outline: Option<&[f64]>) -> Result<Value, String> {
        (self.detection, self.material, self.estimate) = (None, None, None);
        let circle = match outline {
            None => None,
            Some(&[x, y, radius]) if radius > 0.0 => Some(Circle { x, y, radius }),
            Some(_) => return Err("an outline consists of a centre and a positive radius".into()),
        };
        let settings = ObservationSettings { clip: self.clip, ..ObservationSettings::default() };
        let detection = match Detection::of(&self.picture, None, ObjectShape::Sphere(circle), &settings) {
            Ok(detection) => detection,
            Err(error) if error.is_of_outline() || error == SceneError::NoOutline => {
                return Ok(json!({ "why": error.to_string() }));
            }
            Err(error @ (SceneError::Several { .. } | SceneError::Unsure { .. })) => {
                return Ok(json!({ "why": error.to_string(), "guess": guess(&error) }));
            }
            Err(error) => return Err(self.blamed(&error)),
        };
        let scene_warnings = detection.scene_warnings.iter().map(ToString::to_string);
        let document = json!({
            "circle": detection.circle(),
            "sure": detection.reliability.map(|sure| sure.to_string()),
            "used": detection.observations.report.used,
            "warnings": self.warnings.iter().cloned().chain(scene_warnings).collect::<Vec<_>>(),
        });
        self.detection = Some(detection);
        Ok(document)
    }

    /// Estimates the material with its colours; returns the data of the viewer and the uncertainty.
    ///
    /// # Errors
    /// If the ball has not been detected yet, or the photograph is black.
    pub fn material(&mut self) -> Result<Value, String> {
        let detection = self.detection.as_ref().ok_or("the ball has not been detected yet")?;
        let found = ColouredMaterial::of(&self.model, &detection.observations, &EstimateSettings::default())
            .map_err(|error| self.blamed(&error))?;
        let ColouredMaterial { material, colouring } = &found;
        let field = colouring.field();
        let [dull, glossy] = &material.ends.tables;
        let views = [("estimate", &material.table), ("dull end (5 %)", dull), ("glossy end (95 %)", glossy)]
            .map(|(name, table)| sphere::material(name, &field.tables(table)));
        let neighbours: Vec<Value> =
            material.posterior.neighbours.iter().map(|n| json!({ "name": n.name, "weight": n.weight })).collect();
        let document = json!({
            "verdict": material.verdict(),
            "undetermined_share": material.undetermined_share,
            "diagnostics": material.diagnostics().iter().map(ToString::to_string).collect::<Vec<_>>(),
            "neighbours": neighbours,
            "coloured": !matches!(colouring, Colouring::Grey | Colouring::GreyPhotograph),
            "materials": views,
            "lights": builtin_lights(ROWS).iter().map(|(name, map)| sphere::light(name, map.radiance())).collect::<Vec<_>>(),
        });
        (self.material, self.estimate) = (Some(found), None);
        Ok(document)
    }

    /// Estimates the light on a grid of `side` texels per side; a coarse grid is faster. The
    /// session keeps the last light. The result includes the diagnostics: on coarser grids than
    /// that of the program, only those of the material, because the misfit there exceeds the
    /// expected one.
    ///
    /// # Errors
    /// If the material has not been estimated yet, the prior does not support the grid, or a light
    /// on the grid of the program does not reproduce the photograph.
    pub fn light(&mut self, side: usize) -> Result<Value, String> {
        let (detection, material) = self.known()?;
        let program = EstimateSettings::default();
        let settings = EstimateSettings { side, ..program };
        let estimate = material
            .with_light(&self.model, &detection.observations, &settings, &|_| ())
            .map_err(|error| self.blamed(&error))?;
        let misfit = estimate.light.misfit;
        let is_final = side == program.side;
        if let Some(error) = contradiction(&self.name, misfit).filter(|_| is_final) {
            self.estimate = None;
            return Err(error.to_string());
        }
        let diagnostics = if is_final { estimate.diagnostics() } else { estimate.material.diagnostics() };
        let radiance = sphere::lit(&estimate.light_in_colour());
        let document = json!({
            "side": side,
            "misfit": misfit,
            "diagnostics": diagnostics.iter().map(ToString::to_string).collect::<Vec<_>>(),
            "png": png(&preview::light(&radiance)),
            "light": sphere::light("estimated light", &radiance),
        });
        self.estimate = Some((estimate, settings));
        Ok(document)
    }

    /// Returns the uncertainty picture as SVG.
    ///
    /// # Errors
    /// If the material has not been estimated yet.
    pub fn uncertainty(&self) -> Result<Vec<u8>, String> {
        let (_, ColouredMaterial { material, .. }) = self.known()?;
        let (mean, width) = (uncertainty::mean(&material.table), uncertainty::width(material));
        Ok(uncertainty::svg(&[&mean, &width], true, "Mean and 90 % interval of each cell").into_string().into_bytes())
    }

    /// Returns an output file. `seconds` is JSON with the times of the steps, for `result.json`.
    ///
    /// # Errors
    /// If its content has not been estimated yet.
    pub fn product(&self, product: Product, seconds: &str) -> Result<Vec<u8>, String> {
        let (_, ColouredMaterial { material, colouring }) = self.known()?;
        let tables = || colouring.field().tables(&material.table);
        Ok(match product {
            Product::Merl => gonio_io::merl::encode(&MerlTable::from_bivariate(tables().each_ref())),
            Product::Mitsuba => rgl::encode(&tables(), &stem(&self.name), Channels::Rgb),
            Product::Light => {
                let (estimate, _) = self.estimated()?;
                gonio_io::picture::encode_exr(&estimate.light_in_colour().to_lat_long(LIGHT_ROWS), None)
            }
            Product::Result => self.result(seconds)?.into_bytes(),
        })
    }

    /// Returns the contents of `result.json` as in `gonio infer`, without entries about other
    /// files.
    fn result(&self, seconds: &str) -> Result<String, String> {
        let (detection, _) = self.known()?;
        let (estimate, settings) = self.estimated()?;
        let scene_warnings = detection.scene_warnings.iter().map(ToString::to_string);
        let diagnostics = estimate.diagnostics();
        let warnings =
            self.warnings.iter().cloned().chain(scene_warnings).chain(diagnostics.iter().map(ToString::to_string));
        let mut document = document::new(Method::Learnt.name());
        document::set_estimate(&mut document, estimate, settings, false);
        // The page does not offer this file.
        document.reflectance.file = None;
        let document = ResultDocument {
            image: Some(self.name.clone()),
            model: document::model(&self.model),
            observations: Some(document::observations(detection, &ShapeOrigin::default(), false)),
            colour: document::colour(&estimate.colouring, AS_CAPTURED),
            colorspace: Spaces::default().section(None),
            warnings: warnings.collect(),
            seconds: serde_json::from_str(seconds).unwrap_or_default(),
            ..document
        };
        Ok(result::encode(&document))
    }

    fn known(&self) -> Result<(&Detection, &ColouredMaterial), String> {
        let detection = self.detection.as_ref().ok_or("the ball has not been detected yet")?;
        let material = self.material.as_ref().ok_or("the material has not been estimated yet")?;
        Ok((detection, material))
    }

    fn estimated(&self) -> Result<&(Estimate, EstimateSettings), String> {
        self.estimate.as_ref().ok_or_else(|| "the light has not been estimated yet".to_owned())
    }

    fn blamed(&self, error: &dyn std::error::Error) -> String {
        format!("{}: {error}", self.name)
    }
}

/// Returns the most probable outline among the candidates of an error.
fn guess(error: &SceneError) -> Option<Circle> {
    error.suggestions().into_iter().find_map(|suggestion| match suggestion {
        Suggestion::OneOf(circles) => circles.first().copied(),
        _ => None,
    })
}

/// Encodes linear display values as the data URL of a PNG.
fn png(picture: &Plane<Vec3>) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(gonio_io::picture::encode_png(picture)))
}

/// Returns the name of a file without its extension.
fn stem(name: &str) -> String {
    Path::new(name).file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Vec<u8> {
        std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../../samples/ball.exr")).unwrap()
    }

    fn model() -> Model {
        gonio_io::model::embedded().unwrap()
    }

    #[test]
    fn a_session_estimates_material_and_light() {
        let mut session = Session::open(model(), "ball.exr", &sample()).unwrap();
        assert!(session.material().unwrap_err().contains("not been detected"));
        let preview = session.preview(100);
        assert!(preview["png"].as_str().unwrap().starts_with("data:image/png;base64,"));
        assert!(session.observe(None).unwrap()["circle"]["radius"].as_f64().unwrap() > 10.0);
        let material = session.material().unwrap();
        assert_eq!(material["materials"].as_array().unwrap().len(), 3);
        assert!(session.product(Product::Light, "{}").is_err());
        let light = session.light(8).unwrap();
        assert_eq!(light["light"]["name"], "estimated light");
        let merl = session.product(Product::Merl, "{}").unwrap();
        assert_eq!(merl.len() as u64, gonio_io::merl::FILE_BYTES);
        let result = session.product(Product::Result, r#"{"ball":0.5}"#).unwrap();
        let result: Value = serde_json::from_slice(&result).unwrap();
        assert_eq!((&result["seconds"]["ball"], &result["settings"]["grid"]), (&json!(0.5), &json!(8)));
        assert_eq!(result["colorspace"]["output"], "rec709");
        assert!(session.product(Product::Mitsuba, "{}").unwrap().len() > 1000);
    }

    #[test]
    fn an_outline_can_be_given_if_the_detection_fails() {
        let grey = Plane::from_fn(64, 64, |x, y| Vec3::splat(1.0 + 0.3 * ((x * 7 + y * 3) % 11) as f32));
        let bytes = gonio_io::picture::encode_exr(&grey, None);
        let mut session = Session::open(model(), "grey.exr", &bytes).unwrap();
        let why = session.observe(None).unwrap()["why"].as_str().unwrap().to_owned();
        assert!(!why.contains("--") && why.len() > 10, "{why}");
        assert!(session.observe(Some(&[1.0])).is_err());
        assert!(session.observe(Some(&[32.0, 32.0, 25.0])).unwrap()["used"].as_u64().unwrap() > 0);
    }

    #[test]
    fn invalid_images_are_rejected_with_a_one_line_error() {
        let refused = Session::open(model(), "ball.exr", b"no picture at all").err().unwrap();
        assert!(refused.starts_with("ball.exr: ") && !refused.contains('\n'), "{refused}");
        let cut = sample();
        assert!(Session::open(model(), "ball.exr", &cut[..cut.len() / 2]).is_err());
    }
}
