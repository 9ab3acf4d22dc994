//! `gonio light`: a photograph of a mirror ball to the light around it.

use std::path::PathBuf;

use anyhow::{Result, bail};
use gonio::scene::Circle;
use gonio_app::{Form, Journal, Mirror, Reading, Scene, Shape, Source, light_probe};
use serde_json::json;

use crate::input;
use crate::merge::write_all;
use crate::outcome::Outcome;
use crate::progress::Stages;
use crate::reading::ReadingOptions;
use crate::remedy::{self, plain};
use crate::scene::parse_circle;
use crate::space::OutputSpace;

/// Options of `gonio light`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// HDR photograph of a mirror ball, or exposures of one scene; - is standard input
    ///
    /// EXR, Radiance HDR and PFM are read as they are; PNG, TIFF and JPEG with a warning. Several
    /// exposures (8 or 16-bit JPEG, PNG, TIFF) are merged as by gonio merge.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// Light map to write: lat-long, in coordinates of the camera. What was done is drawn to a
    /// .light.png beside it
    #[arg(short, long, value_name = "X.exr")]
    output: PathBuf,
    /// Where the ball is: a picture that is bright on it; without one, the alpha channel or a
    /// plain background tells, or the edges of the ball
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// The ball's outline in pixels, centre from the top left corner, if it is not to be found
    #[arg(long, value_name = "X,Y,RADIUS", value_parser = parse_circle, conflicts_with = "camera")]
    circle: Option<Circle>,
    /// The camera (docs/camera.md), if it is near; of both photographs if there are two
    #[arg(long, value_name = "FILE.json")]
    camera: Option<PathBuf>,
    /// Share of the light that the ball reflects where it is seen from the front, one number or one
    /// for each colour; it rises to 1 at the rim. Chrome has about 0.55, polished silver 0.95
    #[arg(long, value_name = "R|R,G,B", default_value = "1", value_parser = parse_reflectance)]
    reflectance: Reflectance,
    /// Rows of the map, a power of two from 8 to 4096; about the ball's radius in pixels if not
    /// given
    #[arg(long, value_name = "N")]
    rows: Option<usize>,
    /// Photograph of the same ball from another side, best a quarter turn away; give it again for
    /// each further exposure of it
    #[arg(long, value_name = "FILE")]
    second: Vec<PathBuf>,
    /// Angle by which the second camera went around the ball, in degrees, counterclockwise as seen
    /// from above (to the right of the first); found from what both show if not given
    #[arg(long, value_name = "DEGREES", requires = "second", allow_negative_numbers = true)]
    second_yaw: Option<f64>,
    /// The mask of the second photograph
    #[arg(long, value_name = "FILE", requires = "second")]
    second_mask: Option<PathBuf>,
    /// The ball's outline in the second photograph
    #[arg(long, value_name = "X,Y,RADIUS", requires = "second", value_parser = parse_circle, conflicts_with = "camera")]
    second_circle: Option<Circle>,
    #[command(flatten)]
    reading: ReadingOptions,
    /// Radiance at which the camera clips; found by itself where many pixels share the maximum
    #[arg(long, value_name = "VALUE")]
    clip: Option<f32>,
    #[command(flatten)]
    space: OutputSpace,
}

/// Reflectance of each channel at normal incidence.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Reflectance([f64; 3]);

fn parse_reflectance(text: &str) -> Result<Reflectance, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|s| s.trim().parse()).collect();
    let channels = match numbers.as_deref() {
        Ok(&[all]) => Some([all; 3]),
        Ok(&[r, g, b]) => Some([r, g, b]),
        _ => None,
    };
    let channels = channels.filter(|c| c.iter().all(|share| *share > 0.0 && *share <= 1.0));
    channels.map(Reflectance).ok_or_else(|| "give one number above 0 and up to 1, or three, R,G,B".into())
}

impl Options {
    fn scene(&self, files: &[PathBuf], mask: Option<&PathBuf>, circle: Option<Circle>) -> Result<Scene> {
        let reading: Reading = self.reading.reading();
        Ok(Scene {
            name: input::name(files),
            shots: input::shots(files)?,
            reading,
            clip: self.clip,
            mask: mask.cloned().map(Source::File),
            keep_colours: true,
            reference: None,
            shape: Shape { camera: self.camera.clone().map(Source::File), ..Shape::of(Form::Sphere(circle)) },
        })
    }

    fn mirror(&self) -> Result<Mirror> {
        let second = || self.scene(&self.second, self.second_mask.as_ref(), self.second_circle);
        Ok(Mirror {
            first: self.scene(&self.images, self.mask.as_ref(), self.circle)?,
            second: if self.second.is_empty() { None } else { Some((second()?, self.second_yaw)) },
            reflectance: self.reflectance.0,
            rows: self.rows,
        })
    }
}

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    let output = &options.output;
    if output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("exr")) {
        bail!("{}: write to a name ending in .exr", output.display());
    }
    if options.images.iter().chain(&options.second).any(|image| image == output) {
        bail!("{}: is the photograph itself; write to another name", output.display());
    }
    let line = Stages::new("reading");
    let listener = |stage, fraction| line.at(stage, fraction);
    let probe = light_probe(options.mirror()?, &Journal::new("reading", &listener)).map_err(plain)?;
    line.finish();
    let (map, picture) = probe.encode(options.space.space());
    let drawn = output.with_extension("light.png");
    write_all(&[(output.clone(), map), (drawn.clone(), picture)])?;
    let notes = &probe.notes;
    let number = |value: &serde_json::Value| value.as_f64().unwrap_or_default();
    let views = &notes["views"];
    let second = if views.is_object() {
        format!(
            "; second view {:.1} degrees around ({}), both differ by {:.1} %",
            number(&views["turn_degrees"]),
            if views["found"] == true { "found" } else { "given" },
            100.0 * number(&views["difference"])
        )
    } else {
        String::new()
    };
    let text = format!(
        "{}: light of {}x{} pixels from a ball of {:.0} pixels radius, reflectance {}; {:.1} % of all directions are \
         not seen and filled{second}; see {}",
        output.display(),
        probe.light.width(),
        probe.light.height(),
        number(&notes["photograph"]["radius_pixels"]),
        options.reflectance,
        100.0 * number(&notes["unseen"]),
        drawn.display(),
    );
    let fields = json!({ "output": output.display().to_string(), "picture": drawn.display().to_string() });
    let mut outcome = Outcome::new(text, fields).warning(remedy::worded(&probe.warnings));
    if let serde_json::Value::Object(notes) = probe.notes {
        outcome.fields.extend(notes);
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
    fn reflectances_are_one_number_or_three() {
        assert_eq!(parse_reflectance("0.6"), Ok(Reflectance([0.6; 3])));
        assert_eq!(parse_reflectance("0.9, 0.8,1"), Ok(Reflectance([0.9, 0.8, 1.0])));
        for wrong in ["", "0", "1.1", "0.5,0.5", "nan", "-1", "silver", "1,1,0"] {
            assert!(parse_reflectance(wrong).is_err(), "{wrong}");
        }
        assert_eq!(parse_reflectance("0.6").unwrap().to_string(), "0.6");
    }
}
