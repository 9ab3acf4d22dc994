//! What a photograph shows, and where.

use anyhow::{Context, Result, bail};
use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::scene::{Circle, ObservationSettings, Observations, background_coverage, find_sphere};
use serde_json::json;

use super::{Options, Shape};

/// What the picture shows, and where.
pub(super) struct Scene {
    pub(super) observations: Observations,
    pub(super) coverage: Option<Plane<f32>>,
    pub(super) circle: Option<Circle>,
    pub(super) normals: Option<Plane<Vec3>>,
    pub(super) notes: serde_json::Value,
}

/// Finds the object and samples the picture on it.
pub(super) fn observe(
    options: &Options,
    picture: &Picture,
    clip: Option<f32>,
    warnings: &mut Vec<String>,
) -> Result<Scene> {
    let name = || options.image.display().to_string();
    let mask = options.mask.as_deref().map(gonio_io::picture::read_mask).transpose()?;
    if let (Some(mask), Some(path)) = (&mask, &options.mask)
        && mask.size() != picture.rgb.size()
    {
        let ((w, h), (pw, ph)) = (mask.size(), picture.rgb.size());
        bail!("{}: the mask is {w}x{h}, the photograph {pw}x{ph}; give one of the same size", path.display());
    }
    let coverage = mask.or_else(|| picture.alpha.clone()).or_else(|| background_coverage(&picture.rgb));
    let settings = ObservationSettings { clip, ..ObservationSettings::default() };
    let (observations, circle, normals) = if let Some(path) = &options.normals {
        let normals = gonio_io::normals::read_normals(path)?;
        let found = Observations::of_normals(picture, &normals, coverage.as_ref(), &settings).with_context(|| {
            let mask = options.mask.as_ref().map(|mask| format!(" and {}", mask.display())).unwrap_or_default();
            format!("{} with {}{mask}", name(), path.display())
        })?;
        (found, None, Some(normals))
    } else {
        let Shape::Sphere = options.shape;
        let circle = match (&options.circle, &coverage) {
            (Some(circle), _) => *circle,
            (None, Some(coverage)) => {
                // What is wrong with an outline is wrong with the file it comes from.
                let origin = || options.mask.as_ref().map_or_else(name, |mask| mask.display().to_string());
                find_sphere(coverage).with_context(origin)?.circle
            }
            (None, None) => bail!(
                "{}: no alpha channel and no constant background to tell the ball from; give --mask FILE or --circle X,Y,RADIUS",
                name()
            ),
        };
        let found = Observations::of_sphere(picture, &circle, coverage.as_ref(), &settings).with_context(name)?;
        (found, Some(circle), None)
    };
    let report = &observations.report;
    if report.clipped_pixels > 0 {
        warnings.push(format!(
            "{}: {} of {} pixels on the object are clipped and left out",
            name(),
            report.clipped_pixels,
            report.observed_pixels
        ));
    }
    let notes = json!({ "report": report, "circle": circle });
    Ok(Scene { observations, coverage, circle, normals, notes })
}
