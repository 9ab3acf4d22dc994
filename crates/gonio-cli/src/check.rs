//! `gonio check` shows the object and the pixels that `gonio infer` would use.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use gonio_app::{CheckError, CheckResult, MeasuredReference, ProgressLog, check};
use gonio_io::atomic::write_file;
use gonio_io::picture::{encode_png_signed, is_signed};
use gonio_io::result::ReferenceKind;
use serde_json::json;

use crate::input::{self, require_extension};
use crate::outcome::Outcome;
use crate::progress::ProgressLine;
use crate::scene::SceneOptions;
use crate::suggestion::{self, plain};

/// Signature in written images, which marks them as replaceable.
const SIGNATURE: &str = "gonio check";

/// Options of `gonio check`.
#[derive(clap::Args)]
#[command(after_help = "Example: gonio check photo.exr --mask mask.png")]
pub(crate) struct CheckOptions {
    #[command(flatten)]
    scene: SceneOptions,
    /// Image to write [default: IMAGE-check.png beside the photograph]
    ///
    /// The image shows the outline of the object and all ignored pixels, such as clipped and faulty
    /// ones. If the detection is ambiguous, it shows the candidate circles with numbers. gonio
    /// replaces the default image only if gonio check wrote it.
    #[arg(short, long, value_name = "X.png", help_heading = "Output")]
    output: Option<PathBuf>,
}

impl CheckOptions {
    /// Returns the path of the image: the specified one, or the default beside the photograph.
    fn output(&self) -> Result<PathBuf> {
        let image = self.scene.image();
        if let Some(output) = &self.output {
            require_extension(output, "png")?;
            if self.scene.images.contains(output) {
                bail!("{}: the output would overwrite the photograph; specify another name", output.display());
            }
            return Ok(output.clone());
        }
        if input::is_stdin(&image) {
            bail!("standard input has no default output; specify one with -o X.png");
        }
        let problem = "was not written by gonio check; specify another name with -o X.png";
        input::check_default(beside(&image), |output| is_signed(output, SIGNATURE), problem)
    }
}

/// Returns the default image of a photograph: `ball.exr-check.png` for `ball.exr`. Photographs that
/// differ only in their extension have different images.
fn beside(image: &Path) -> PathBuf {
    let mut name = image.file_name().unwrap_or_default().to_owned();
    name.push("-check.png");
    image.with_file_name(name)
}

pub(crate) fn run(options: &CheckOptions) -> Result<Outcome> {
    let output = options.output()?;
    let (scene, regions) = (options.scene.scene()?, options.scene.regions());
    let name = scene.name.clone();
    let line = ProgressLine::new("reading");
    let listener = |stage, fraction| line.report(stage, fraction);
    let progress_log = ProgressLog::new("reading", &listener);
    let checked = match check(scene, regions, &progress_log) {
        Ok(checked) => checked,
        Err(CheckError { problem, candidates: None }) => return Err(plain(problem)),
        Err(CheckError { problem, candidates: Some(picture) }) => {
            write_file(&output, &encode_png_signed(&picture, SIGNATURE))?;
            bail!("{}; see {}", plain(problem), output.display());
        }
    };
    progress_log.report("drawing", 0.0);
    write_file(&output, &encode_png_signed(&checked.draw(), SIGNATURE))?;
    line.finish();
    let output = output.display().to_string();
    let text = format!("{}see {output}", describe(&checked, &name));
    let mut fields = checked.document();
    fields["output"] = json!(output);
    fields["image"] = json!(name);
    Ok(Outcome::new(text, fields).described_warnings(suggestion::worded(&checked.warnings)))
}

/// Describes the reference in a photograph in one line.
fn describe_reference(reference: &MeasuredReference) -> String {
    let [r, g, b] = reference.light.chroma().rgb().to_array();
    let (kind, corners) = match reference.section(None).kind {
        ReferenceKind::WhitePatch(_) => ("white patch", None),
        ReferenceKind::GreyCard(_) => ("grey card", None),
        ReferenceKind::GreyBall { .. } => ("grey ball", None),
        ReferenceKind::ColourChart { corners, .. } => ("colour chart", Some(corners)),
    };
    let corners = corners.map_or_else(String::new, |corners| {
        format!(", corner patches {}", corners.map(|(x, y)| format!("{x:.1},{y:.1}")).join(","))
    });
    format!("{kind}: linear RGB colour of the light {r:.3},{g:.3},{b:.3}{corners}\n")
}

/// Describes a photograph and each of its objects.
fn describe(checked: &CheckResult, name: &str) -> String {
    let (width, height) = checked.photograph.picture.rgb.size();
    let mut lines = format!("{name}: {width}x{height} pixels\n");
    let reference = checked.objects.first().and_then(|object| object.scene.reference.as_ref());
    lines += &reference.map(describe_reference).unwrap_or_default();
    for object in &checked.objects {
        let report = &object.scene.detection.observations.report;
        let of = object.name.as_ref().map(|name| format!("region {name}: ")).unwrap_or_default();
        lines += &format!(
            "{of}{}, {:.1} % of the image\n{of}{} pixels on the object; {} clipped, {} invalid (negative, NaN or infinite), {} outliers\n",
            object.outline(),
            100.0 * object.coverage(),
            report.observed_pixels,
            report.clipped_pixels,
            report.negative + report.not_finite,
            report.outliers,
        );
    }
    lines
}
