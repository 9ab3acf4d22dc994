//! `gonio light` converts a photograph of a mirror ball to a lat-long environment map.

use std::path::PathBuf;

use anyhow::{Result, bail};
use gonio::scene::Circle;
use gonio_app::{ProbePhotographs, ProgressLog, Reading, Scene, Shape, ShapeKind, Source, light_probe};
use serde_json::json;

use crate::input::{self, numbers, require_extension};
use crate::merge::write_all;
use crate::outcome::Outcome;
use crate::progress::ProgressLine;
use crate::reading::ReadingOptions;
use crate::scene::parse_circle;
use crate::space::OutputSpace;
use crate::suggestion::{self, plain};

/// Options of `gonio light`.
#[derive(clap::Args)]
pub(crate) struct LightOptions {
    /// HDR photograph of a mirror ball, or exposures of one scene; use - for standard input
    ///
    /// EXR, Radiance HDR and PFM contain linear radiance. gonio also accepts 8- and 16-bit PNG,
    /// TIFF and JPEG, but warns that highlights are probably clipped. gonio merges several
    /// exposures (8- or 16-bit JPEG, PNG or TIFF) like gonio merge.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// Environment map to write: lat-long, in camera coordinates
    ///
    /// gonio also writes X.light.png, which marks the ignored pixels of the ball and the
    /// interpolated parts of the map.
    #[arg(short, long, value_name = "X.exr")]
    output: PathBuf,
    /// Mask of the ball: an image that is white on the ball and black elsewhere
    ///
    /// Without a mask, gonio detects the ball by the alpha channel, a uniform background, or edges.
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// Outline of the ball in pixels from the top left corner; replaces automatic detection
    #[arg(long, value_name = "X,Y,RADIUS", value_parser = parse_circle, conflicts_with = "camera")]
    circle: Option<Circle>,
    /// Camera parameters of the photographs (docs/camera.md) [default: an orthographic camera]
    #[arg(long, value_name = "FILE.json")]
    camera: Option<PathBuf>,
    /// Reflectance of the ball at normal incidence: one number, or one per channel
    ///
    /// Chrome has about 0.55 and polished silver 0.95. The reflectance rises to 1 at the rim.
    #[arg(long, value_name = "R|R,G,B", default_value = "1", value_parser = parse_reflectance)]
    reflectance: Reflectance,
    /// Rows of the map, a power of two from 8 to 4096 [default: about the ball's radius in pixels]
    #[arg(long, value_name = "N")]
    rows: Option<usize>,
    /// Second photograph of the ball, ideally after moving the camera around it by 90 degrees
    ///
    /// Repeat the option for each exposure of the second photograph.
    #[arg(long, value_name = "FILE")]
    second: Vec<PathBuf>,
    /// Angle from the first to the second camera around the ball, in degrees [default: estimated]
    ///
    /// Positive angles are counterclockwise as seen from above: the second camera is to the right
    /// of the first. By default, gonio estimates the angle at which both environment maps agree
    /// best.
    #[arg(long, value_name = "DEGREES", requires = "second", allow_negative_numbers = true)]
    second_azimuth: Option<f64>,
    /// Mask of the ball in the second photograph
    #[arg(long, value_name = "FILE", requires = "second")]
    second_mask: Option<PathBuf>,
    /// Outline of the ball in the second photograph, in pixels from the top left corner
    #[arg(long, value_name = "X,Y,RADIUS", requires = "second", value_parser = parse_circle, conflicts_with = "camera")]
    second_circle: Option<Circle>,
    #[command(flatten)]
    reading: ReadingOptions,
    /// Radiance at which the camera clips [default: the maximum, if many pixels share it]
    #[arg(long, value_name = "VALUE")]
    clip: Option<f32>,
    #[command(flatten)]
    space: OutputSpace,
}

/// Reflectance of each channel at normal incidence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reflectance(pub(crate) [f64; 3]);

pub(crate) fn parse_reflectance(text: &str) -> Result<Reflectance, String> {
    let channels = match numbers(text).as_deref() {
        Some(&[all]) => Some([all; 3]),
        Some(&[r, g, b]) => Some([r, g, b]),
        _ => None,
    };
    let channels = channels.filter(|c| c.iter().all(|share| *share > 0.0 && *share <= 1.0));
    channels
        .map(Reflectance)
        .ok_or_else(|| "expected one number above 0 and at most 1, or three such numbers, R,G,B".into())
}

impl LightOptions {
    fn scene(&self, files: &[PathBuf], mask: Option<&PathBuf>, circle: Option<Circle>) -> Result<Scene> {
        let reading: Reading = self.reading.reading();
        Ok(Scene {
            name: input::name(files),
            photograph: input::photograph_source(files)?,
            reading,
            clip: self.clip,
            mask: mask.cloned().map(Source::File),
            one_material: true,
            force: false,
            reference: None,
            shape: Shape { camera: self.camera.clone().map(Source::File), ..Shape::of(ShapeKind::Sphere(circle)) },
        })
    }

    fn mirror(&self) -> Result<ProbePhotographs> {
        let second = || self.scene(&self.second, self.second_mask.as_ref(), self.second_circle);
        Ok(ProbePhotographs {
            first: self.scene(&self.images, self.mask.as_ref(), self.circle)?,
            second: if self.second.is_empty() { None } else { Some((second()?, self.second_azimuth)) },
            reflectance: self.reflectance.0,
            rows: self.rows,
        })
    }
}

pub(crate) fn run(options: &LightOptions) -> Result<Outcome> {
    let output = &options.output;
    require_extension(output, "exr")?;
    if options.images.iter().chain(&options.second).any(|image| image == output) {
        bail!("{}: the output would overwrite the photograph; specify another name", output.display());
    }
    let line = ProgressLine::new("reading");
    let listener = |stage, fraction| line.report(stage, fraction);
    let probe = light_probe(options.mirror()?, &ProgressLog::new("reading", &listener)).map_err(plain)?;
    line.finish();
    let (map, picture) = probe.encode(options.space.space());
    let drawn = output.with_extension("light.png");
    write_all(&[(output.clone(), map), (drawn.clone(), picture)])?;
    let document = &probe.document;
    let number = |value: &serde_json::Value| value.as_f64().unwrap_or_default();
    let views = &document["views"];
    let second = if views.is_object() {
        format!(
            "; second view at {:.1} degrees ({}), views differ by {:.1} %",
            number(&views["azimuth_degrees"]),
            if views["estimated"] == true { "estimated" } else { "specified" },
            100.0 * number(&views["difference"])
        )
    } else {
        String::new()
    };
    let text = format!(
        "{}: environment map of {}x{} pixels from a ball with a radius of {:.0} pixels and reflectance {}; gonio \
         interpolated {:.1} % of all directions, which the ball does not show{second}; see {}",
        output.display(),
        probe.light.width(),
        probe.light.height(),
        number(&document["photograph"]["radius_pixels"]),
        options.reflectance,
        100.0 * number(&document["unseen"]),
        drawn.display(),
    );
    let fields = json!({ "output": output.display().to_string(), "picture": drawn.display().to_string() });
    let mut outcome = Outcome::new(text, fields).warning(suggestion::worded(&probe.warnings));
    if let serde_json::Value::Object(document) = probe.document {
        outcome.fields.extend(document);
    }
    outcome.fields.insert("colorspace".into(), json!({ "output": options.space.space().name() }));
    Ok(outcome)
}

impl std::fmt::Display for Reflectance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            [r, g, b] if r == g && g == b => write!(f, "{r}"),
            [r, g, b] => write!(f, "{r},{g},{b}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflectance_is_one_number_or_three() {
        assert_eq!(parse_reflectance("0.6"), Ok(Reflectance([0.6; 3])));
        assert_eq!(parse_reflectance("0.9, 0.8,1"), Ok(Reflectance([0.9, 0.8, 1.0])));
        for wrong in ["", "0", "1.1", "0.5,0.5", "nan", "-1", "silver", "1,1,0"] {
            assert!(parse_reflectance(wrong).is_err(), "{wrong}");
        }
        assert_eq!(parse_reflectance("0.6").unwrap().to_string(), "0.6");
    }
}
