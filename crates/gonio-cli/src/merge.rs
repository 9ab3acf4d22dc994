//! `gonio merge` merges the exposures of a bracket into one HDR image.

use std::path::{Path, PathBuf};

use anyhow::Result;
use glam::Vec3;
use gonio::bracket::{MergeReport, Merged, MergedPixelStatus};
use gonio::picture::Plane;
use gonio::render::Exposure;
use gonio_app::photograph::{MergedBracket, merge_files};
use gonio_io::atomic::write_file;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::{ExrOptions, encode_exr_with, encode_png, encode_response};
use serde_json::json;

use crate::input::require_extension;
use crate::outcome::Outcome;
use crate::reading::ReadingOptions;
use crate::suggestion::{self, plain};
use gonio_report::canvas::{LINE, fill, legend, place, sheet, text};

/// Options of `gonio merge`.
#[derive(clap::Args)]
pub(crate) struct MergeOptions {
    /// Exposures of one static scene: 8- or 16-bit JPEG, PNG or TIFF files of equal size
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// HDR image to write
    ///
    /// gonio sets pixels without a valid exposure to the value of the EXR attribute clipLevel;
    /// gonio infer ignores and counts them. gonio also writes X.merge.png, which shows the
    /// exposure with the largest weight at each pixel.
    #[arg(short, long, value_name = "X.exr")]
    output: PathBuf,
    /// Write the camera's response curve as text: natural logarithm of the exposure of each code
    #[arg(long, value_name = "FILE.csv")]
    save_response: Option<PathBuf>,
    #[command(flatten)]
    reading: ReadingOptions,
}

pub(crate) fn run(options: &MergeOptions) -> Result<Outcome> {
    require_extension(&options.output, "exr")?;
    let mut warnings = Vec::new();
    let bracket = merge_files(&options.images, &options.reading.reading(), &mut warnings).map_err(plain)?;
    let merged = &bracket.merged;
    let picture = &merged.picture;
    let (alpha, clip_level, space) = (picture.alpha.as_ref(), Some(merged.clip_level), Some(ColourSpace::Rec709));
    let attributes = ExrOptions { alpha, clip_level, space };
    let mut files = vec![
        (options.output.clone(), encode_exr_with(&picture.rgb, &attributes)),
        (options.output.with_extension("merge.png"), encode_png(&draw(&bracket, &options.images))),
    ];
    if let Some(path) = &options.save_response {
        files.push((path.clone(), encode_response(&bracket.merged.response)));
    }
    write_all(&files)?;
    let report = &merged.report;
    let text = format!(
        "{}: {} exposures{}, {}x{} pixels; {} clipped, {} black, {} inconsistent, {} with a quantisation error \
         above 2 %; response curve {}, median difference of the exposures {:.1} %",
        options.output.display(),
        report.corrections.iter().flatten().count(),
        shifted(report),
        picture.rgb.width(),
        picture.rgb.height(),
        report.clipped,
        report.dark,
        report.inconsistent,
        report.quantised,
        if bracket.recovered { "recovered" } else { "specified" },
        100.0 * report.residual
    );
    let output = options.output.display().to_string();
    let mut fields = bracket.document();
    fields["output"] = json!(output);
    Ok(Outcome::new(text, fields).warning(suggestion::worded(&warnings)))
}

/// Describes the alignment of the exposures; empty if none is shifted.
fn shifted(report: &MergeReport) -> String {
    let lengths = report.corrections.iter().flatten().map(|c| f64::from(c.shift.0).hypot(f64::from(c.shift.1)));
    let largest = lengths.clone().fold(0.0, f64::max);
    if largest == 0.0 {
        return String::new();
    }
    format!(" ({} aligned by up to {largest:.0} pixels)", lengths.filter(|length| *length > 0.0).count())
}

/// Writes all files. If one cannot be written, removes the files that this call created.
pub(crate) fn write_all(files: &[(PathBuf, Vec<u8>)]) -> Result<()> {
    let mut made: Vec<&Path> = Vec::new();
    for (path, bytes) in files {
        let is_new = !path.exists();
        if let Err(error) = write_file(path, bytes) {
            for path in made {
                // The write error is reported in any case.
                let _ = std::fs::remove_file(path);
            }
            return Err(error.into());
        }
        if is_new {
            made.push(path);
        }
    }
    Ok(())
}

/// Width of a panel, pixels.
const PANEL: usize = 320;
/// Distance between panels.
const GAP: usize = 16;
const CLIPPED: Vec3 = Vec3::new(1.0, 1.0, 1.0);
const DARK: Vec3 = Vec3::ZERO;
const MOVED: Vec3 = Vec3::new(1.0, 0.0, 0.6);

/// Draws the merged image, the main exposure of each pixel, and the response.
fn draw(bracket: &MergedBracket, paths: &[PathBuf]) -> Plane<Vec3> {
    let Merged { picture, known, report, .. } = &bracket.merged;
    let count = bracket.relative_exposures.len();
    // Ranks by exposure, so that colours run from the shortest to the longest.
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| bracket.relative_exposures[a].total_cmp(&bracket.relative_exposures[b]));
    let rank = |exposure: usize| order.iter().position(|&e| e == exposure).unwrap_or(0);
    let hue = |exposure: usize| rainbow(rank(exposure) as f32 / (count - 1).max(1) as f32);

    let is_known = |i: usize| matches!(known.as_slice()[i], MergedPixelStatus::From(_));
    let exposure = Exposure::by_quantile(&picture.rgb, is_known, 0.9, 0.6);
    let shown = small(&picture.rgb.map(|v| exposure.apply(*v)));
    let origin = small(&known.map(|known| match known {
        MergedPixelStatus::From(exposure) => hue(usize::from(*exposure)),
        MergedPixelStatus::Clipped => CLIPPED,
        MergedPixelStatus::Dark => DARK,
        MergedPixelStatus::Inconsistent => MOVED,
    }));
    let below = (count + 4) * LINE;
    let (top, tall) = (GAP + LINE, shown.height().max(PANEL));
    let mut out = sheet(4 * GAP + 2 * shown.width() + PANEL, top + tall + GAP + below);
    let columns = [GAP, 2 * GAP + shown.width(), 3 * GAP + 2 * shown.width()];
    text(&mut out, columns[0], GAP, "merged");
    text(&mut out, columns[1], GAP, "main exposure");
    text(&mut out, columns[2], GAP, if bracket.recovered { "response (recovered)" } else { "response (specified)" });
    place(&mut out, columns[0], top, &shown);
    place(&mut out, columns[1], top, &origin);
    place(&mut out, columns[2], top, &curves(bracket));
    text(&mut out, columns[2], top + PANEL + 6, "exposure vs. code (one line per decade)");
    let mut row = top + tall + GAP;
    let mut line = |colour: Vec3, label: &str| {
        legend(&mut out, columns[0], row, colour, label);
        row += LINE;
    };
    for &e in &order {
        let name =
            paths.get(e).and_then(|p| p.file_name()).map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let label = match report.corrections[e] {
            None => format!("{name}: left out, contradicts the others"),
            Some(correction) => {
                let (dx, dy) = correction.shift;
                let shift = if (dx, dy) == (0, 0) { String::new() } else { format!(", shifted by {dx}, {dy} pixels") };
                let (amount, pixels) = (bracket.relative_exposures[e], report.pixels_by_exposure[e]);
                let residual = 100.0 * report.residuals[e];
                format!("{name}: relative exposure {amount:.4}, {pixels} pixels, residual {residual:.1} %{shift}")
            }
        };
        line(hue(e), &label);
    }
    line(CLIPPED, &format!("clipped in all exposures: {}", report.clipped));
    line(DARK, &format!("black in all exposures: {}", report.dark));
    line(MOVED, &format!("inconsistent: {}", report.inconsistent));
    out
}

/// Subsamples an image to at most the size of a panel.
fn small(picture: &Plane<Vec3>) -> Plane<Vec3> {
    let (width, height) = picture.size();
    let step = width.max(height).div_ceil(PANEL).max(1);
    Plane::from_fn(width.div_ceil(step), height.div_ceil(step), |x, y| picture[(x * step, y * step)])
}

/// Maps 0..=1 to blue, green, yellow and red.
fn rainbow(x: f32) -> Vec3 {
    const STOPS: [Vec3; 4] =
        [Vec3::new(0.03, 0.1, 0.7), Vec3::new(0.02, 0.5, 0.25), Vec3::new(0.9, 0.6, 0.05), Vec3::new(0.7, 0.05, 0.03)];
    let at = x.clamp(0.0, 1.0) * 3.0;
    let k = (at as usize).min(2);
    STOPS[k].lerp(STOPS[k + 1], at - k as f32)
}

/// Draws the three response curves: four decades of exposure over codes.
fn curves(bracket: &MergedBracket) -> Plane<Vec3> {
    const DECADES: f64 = 4.0;
    let mut out = sheet(PANEL, PANEL);
    for k in 0..=4 {
        let y = (k * (PANEL - 1)) / 4;
        fill(&mut out, (0, y), (PANEL, 1), Vec3::splat(0.05));
        fill(&mut out, (y, 0), (1, PANEL), Vec3::splat(0.05));
    }
    let response = &bracket.merged.response;
    let top = (0..3).map(|c| response.curve(c)[usize::from(response.max())]).fold(f64::MIN, f64::max);
    for (channel, colour) in
        [Vec3::new(0.8, 0.1, 0.08), Vec3::new(0.1, 0.6, 0.1), Vec3::new(0.12, 0.25, 0.9)].iter().enumerate()
    {
        let curve = response.curve(channel);
        let height = |x: usize| {
            let code = x * (curve.len() - 1) / (PANEL - 1);
            let share = (top - curve[code]) / (DECADES * std::f64::consts::LN_10);
            (share * (PANEL - 1) as f64).clamp(0.0, (PANEL - 1) as f64) as usize
        };
        for x in 1..PANEL {
            let (a, b) = (height(x), height(x - 1));
            fill(&mut out, (x, a.min(b)), (2, a.abs_diff(b) + 2), *colour);
        }
    }
    out
}
