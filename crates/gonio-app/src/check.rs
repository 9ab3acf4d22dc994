//! Checks a photograph before inference: detects the object and faulty pixels.

use std::sync::Arc;

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::scene::{Circle, DetectedShape};
use gonio_report::check::{draw, draw_candidates};
use serde_json::{Value, json};

use crate::regions::{Regions, region_masks, shows_several_balls};
use crate::scene::{Observing, RegionMask};
use crate::{AppError, ObservedScene, Photograph, ProgressLog, Scene, Warning, spaces};

/// Result of checking a photograph.
pub struct CheckResult {
    /// The photograph.
    pub photograph: Arc<Photograph>,
    /// The objects, or the regions of one.
    pub objects: Vec<DetectedObject>,
    /// Warnings about the photograph.
    pub warnings: Vec<Warning>,
}

/// A detected object or region.
pub struct DetectedObject {
    /// Its name, if there are several.
    pub name: Option<String>,
    /// Its position and the status of its pixels.
    pub scene: ObservedScene,
}

/// Error of a check.
pub struct CheckError {
    /// The error.
    pub problem: AppError,
    /// The photograph with numbered candidate circles, as linear display values.
    pub candidates: Option<Plane<Vec3>>,
}

impl From<AppError> for CheckError {
    fn from(problem: AppError) -> Self {
        Self { problem, candidates: None }
    }
}

impl CheckError {
    fn of(problem: AppError, picture: &Picture) -> Self {
        let circles = problem.candidates();
        let candidates = (!circles.is_empty()).then(|| draw_candidates(picture, circles));
        Self { problem, candidates }
    }
}

/// Detects the objects that [`infer_all`](crate::regions::infer_all) would use. Reports the stage
/// `reading`.
///
/// # Errors
/// If a file cannot be read, or an object is not detected or has too few usable pixels. The error
/// names the faulty input.
pub fn check(
    scene: Scene,
    regions: Option<Regions>,
    progress_log: &ProgressLog<'_>,
) -> Result<CheckResult, CheckError> {
    let mut warnings = Vec::new();
    let scene = scene.load(&mut warnings, progress_log)?;
    let regions = regions.or_else(|| shows_several_balls(&scene).then_some(Regions::Balls));
    let mut observe =
        |region: Option<&RegionMask>| scene.observe(region, Observing::default(), &mut warnings, progress_log);
    let objects = match &regions {
        None => {
            let observed = observe(None).map_err(|problem| CheckError::of(problem, scene.picture()))?;
            vec![DetectedObject { name: None, scene: observed }]
        }
        Some(regions) => {
            let mut objects = Vec::new();
            let parts = region_masks(&scene, regions).map_err(|problem| CheckError::of(problem, scene.picture()))?;
            for part in parts {
                let observed =
                    observe(Some(&part)).map_err(|problem| problem.within(&format!("region {}", part.name)))?;
                objects.push(DetectedObject { name: Some(part.name), scene: observed });
            }
            objects
        }
    };
    Ok(CheckResult { photograph: scene.photograph, objects, warnings })
}

impl CheckResult {
    /// Draws outlines, clipped and faulty pixels on the photograph, as linear display values.
    pub fn draw(&self) -> Plane<Vec3> {
        let detections: Vec<_> = self.objects.iter().map(|object| &object.scene.detection).collect();
        draw(&self.photograph.picture, &detections)
    }

    /// Returns all numbers by name.
    pub fn document(&self) -> Value {
        let (width, height) = self.photograph.picture.rgb.size();
        let object = |object: &DetectedObject| {
            let mut document = json!(object.scene.observations());
            document["name"] = json!(object.name);
            document["coverage"] = json!(object.coverage());
            document["reference"] = json!(object.scene.reference.as_ref().map(|reference| reference.section(None)));
            document
        };
        let space = self.photograph.space.as_ref().map(spaces::input_document);
        json!({ "width": width, "height": height, "colorspace": space, "objects": self.objects.iter().map(object).collect::<Vec<_>>() })
    }
}

impl DetectedObject {
    /// Returns the fraction of the image that the object covers.
    pub fn coverage(&self) -> f64 {
        let detection = &self.scene.detection;
        let (width, height) = self.scene.photograph.picture.rgb.size();
        let inside = (0..width * height).filter(|i| detection.contains(i % width, i / width));
        inside.count() as f64 / (width * height).max(1) as f64
    }

    /// Describes the detected shape.
    pub fn outline(&self) -> String {
        match &self.scene.detection.shape {
            DetectedShape::Circle(circle) => {
                let Circle { x, y, radius } = circle;
                let sure = self.scene.detection.reliability.map(|sure| format!(", {sure}")).unwrap_or_default();
                format!("ball, circle {x:.1},{y:.1},{radius:.1} (x, y, radius in pixels){sure}")
            }
            DetectedShape::Ball(centre) => {
                format!(
                    "ball with centre in direction {:.2},{:.2},{:.2} in camera coordinates",
                    centre.x, centre.y, centre.z
                )
            }
            DetectedShape::Ellipse(ellipse, depth) => {
                format!(
                    "ellipsoid, semi-axes {:.1} and {:.1} pixels, {depth:.1} pixels along the optical axis",
                    ellipse.axes.0, ellipse.axes.1
                )
            }
            DetectedShape::Outline(depth) => format!("surface inflated from the outline, depth factor {depth:.2}"),
            DetectedShape::Surface => "mesh".to_owned(),
            DetectedShape::Normals(_) => "shape from a normal map".to_owned(),
        }
    }
}
