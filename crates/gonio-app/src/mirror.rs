//! The light of a photograph that also shows a mirror ball.

use gonio::lighting::EnvironmentMap;
use gonio::picture::Picture;
use gonio::probe::{ProbeSettings, Reflectance, View, probe};
use gonio::scene::{Circle, Detection, ObjectShape, outline_of_ball};
use gonio::suggestion::Suggestion;

use crate::inpaint::inpaint_ball;
use crate::regions::Regions;
use crate::scene::LoadedScene;
use crate::{AppError, Warning};

/// Largest coordinate of an outline, in pixels.
const MAX_COORDINATE: f64 = 1e7;

/// A mirror ball in the photograph of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorBall {
    /// Its outline.
    pub circle: Circle,
    /// Its reflectance at normal incidence for red, green and blue, above 0 and at most 1.
    pub reflectance: [f64; 3],
}

impl MirrorBall {
    /// Estimates the light from the ball in the photograph of a scene. If the object of the scene
    /// is a ball to be detected, detects it beside the mirror ball.
    ///
    /// # Errors
    /// If the mirror ball has too few usable pixels, or no other ball is detected. The error names
    /// the faulty input.
    pub(crate) fn light(
        &self,
        scene: &mut LoadedScene,
        regions: Option<&Regions>,
        warnings: &mut Vec<Warning>,
    ) -> Result<EnvironmentMap, AppError> {
        let (name, picture) = (scene.name(), scene.picture());
        let to_error = |error: gonio::probe::ProbeError| {
            AppError::of(name, format!("mirror ball: {error}")).with([Suggestion::MirrorBall])
        };
        let reflectance = Reflectance::new(self.reflectance).map_err(|error| AppError::new(error.to_string()))?;
        let size = picture.rgb.size();
        let Circle { x, y, radius } = self.circle;
        if [x, y, radius].iter().any(|v| v.is_nan() || v.abs() > MAX_COORDINATE) {
            let problem = format!("mirror ball: the outline {x},{y},{radius} is not in the photograph");
            return Err(AppError::of(name, problem).with([Suggestion::MirrorBall]));
        }
        let object = match &scene.camera {
            None => ObjectShape::Sphere(Some(self.circle)),
            Some(camera) => ObjectShape::Ball(*camera),
        };
        let disk = self.circle.coverage(size);
        let view = View::of(&opaque(picture), Some(&disk), &object, scene.photograph.clip).map_err(to_error)?;
        let found = probe(&view, None, &ProbeSettings { reflectance, rows: None }).map_err(to_error)?;
        let of_ball = view.warnings().into_iter().chain(found.report.warnings());
        warnings.extend(of_ball.map(|warning| Warning::from(format!("{name}: mirror ball: {warning}"))));
        let is_ball = matches!(scene.object, ObjectShape::Sphere(_));
        let is_masked = scene.mask.is_some() || matches!(regions, Some(Regions::Labels(_) | Regions::Circles(_)));
        if matches!(regions, Some(Regions::Balls)) {
            let problem = "several balls beside a mirror ball cannot be detected; specify their outlines";
            return Err(AppError::of(name, problem));
        }
        if !is_ball && !is_masked {
            let problem = "a photograph with a mirror ball requires a mask of the object, unless the object is a ball";
            return Err(AppError::of(name, problem).with([Suggestion::Mask]));
        }
        if matches!(scene.object, ObjectShape::Sphere(None)) && !matches!(regions, Some(Regions::Circles(_))) {
            let (circle, _) = outline_of_ball(&inpaint_ball(picture, &self.circle), scene.mask.as_ref())
                .map_err(|error| AppError::of_scene(name, &error).within("object beside the mirror ball"))?;
            scene.object = ObjectShape::Sphere(Some(circle));
        }
        Ok(found.light)
    }

    /// Checks that the detected object is not the mirror ball.
    ///
    /// # Errors
    /// If the object covers the centre of the mirror ball.
    pub(crate) fn check_apart(&self, detection: &Detection, name: &str) -> Result<(), AppError> {
        let (width, height) = detection.size();
        let place = |v: f64, side: usize| (v.max(0.0) as usize).min(side.saturating_sub(1));
        if detection.contains(place(self.circle.x, width), place(self.circle.y, height)) {
            let problem = "the mirror ball is a part of the object; specify the object by its outline or a mask";
            return Err(AppError::of(name, problem).with([Suggestion::MirrorBall]));
        }
        Ok(())
    }
}

/// Returns the picture without its alpha channel, which may be zero on the mirror ball.
fn opaque(picture: &Picture) -> Picture {
    Picture { rgb: picture.rgb.clone(), alpha: None }
}
