//! The light of a photograph that also shows a mirror ball.

use glam::Vec3;
use gonio::lighting::EnvironmentMap;
use gonio::picture::{Picture, Plane};
use gonio::probe::{ProbeSettings, Reflectance, View, probe};
use gonio::scene::{Circle, Detection, Object, outline_of_ball};
use gonio::suggestion::Suggestion;

use crate::mask::disk_of;
use crate::regions::Regions;
use crate::scene::LoadedScene;
use crate::{AppError, Warning};

/// Width around the outline of a mirror ball that is erased with it: a share of the radius, and
/// pixels.
const MARGIN: (f64, f64) = (0.03, 2.0);
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
            AppError::of(name, format!("mirror ball: {error}")).with(Suggestion::MirrorBall)
        };
        let reflectance = Reflectance::new(self.reflectance).map_err(|error| AppError::new(error.to_string()))?;
        let size = picture.rgb.size();
        let Circle { x, y, radius } = self.circle;
        if [x, y, radius].iter().any(|v| v.is_nan() || v.abs() > MAX_COORDINATE) {
            let problem = format!("mirror ball: the outline {x},{y},{radius} is not in the photograph");
            return Err(AppError::of(name, problem).with(Suggestion::MirrorBall));
        }
        let object = match &scene.camera {
            None => Object::Sphere(Some(self.circle)),
            Some(camera) => Object::Ball(*camera),
        };
        let disk = disk_of(&self.circle, size);
        let view = View::of(&opaque(picture), Some(&disk), &object, scene.photograph.clip).map_err(to_error)?;
        let found = probe(&view, None, &ProbeSettings { reflectance, rows: None }).map_err(to_error)?;
        let oddities = view.scene_warnings().into_iter().chain(found.report.scene_warnings());
        warnings.extend(oddities.map(|odd| Warning::from(format!("{name}: mirror ball: {odd}"))));
        let is_ball = matches!(scene.object, Object::Sphere(_));
        let is_masked = scene.mask.is_some() || matches!(regions, Some(Regions::Labels(_) | Regions::Circles(_)));
        if matches!(regions, Some(Regions::Balls)) {
            let problem = "several balls beside a mirror ball cannot be detected; specify their outlines";
            return Err(AppError::of(name, problem));
        }
        if !is_ball && !is_masked {
            let problem = "a photograph with a mirror ball requires a mask of the object, unless the object is a ball";
            return Err(AppError::of(name, problem).with(Suggestion::Mask));
        }
        if matches!(scene.object, Object::Sphere(None)) && !matches!(regions, Some(Regions::Circles(_))) {
            let (circle, _) = outline_of_ball(&inpaint_ball(picture, &self.circle), scene.mask.as_ref())
                .map_err(|error| AppError::of_scene(name, &error).within("object beside the mirror ball"))?;
            scene.object = Object::Sphere(Some(circle));
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
            return Err(AppError::of(name, problem).with(Suggestion::MirrorBall));
        }
        Ok(())
    }
}

/// Returns the picture without its alpha channel, which may be zero on the mirror ball.
fn opaque(picture: &Picture) -> Picture {
    Picture { rgb: picture.rgb.clone(), alpha: None }
}

/// Returns the picture without a ball: each row is interpolated between both sides of the ball, so
/// that no edge remains.
fn inpaint_ball(picture: &Picture, circle: &Circle) -> Picture {
    let (width, height) = picture.rgb.size();
    let radius = circle.radius * (1.0 + MARGIN.0) + MARGIN.1;
    let mut erased = picture.clone();
    for y in 0..height {
        let half = (radius * radius - (y as f64 + 0.5 - circle.y).powi(2)).max(0.0).sqrt();
        if half == 0.0 {
            continue;
        }
        let column = |x: f64| x.clamp(0.0, width as f64) as usize;
        let (first, end) = (column(circle.x - half), column((circle.x + half).ceil()));
        let side = |x: Option<usize>| x.filter(|x| *x < width).map(|x| picture.rgb[(x, y)]);
        let (left, right) = (side(first.checked_sub(1)), side(Some(end)));
        for x in first..end {
            let share = (x - first + 1) as f32 / (end - first + 1) as f32;
            erased.rgb[(x, y)] = match (left, right) {
                // Exact for a uniform background, which is detected by equal values.
                (Some(left), Some(right)) => left + (right - left) * share,
                (Some(one), None) | (None, Some(one)) => one,
                (None, None) => Vec3::ZERO,
            };
        }
    }
    erased.alpha = picture.alpha.as_ref().map(|alpha| {
        Plane::from_fn(width, height, |x, y| {
            let is_erased = (x as f64 + 0.5 - circle.x).hypot(y as f64 + 0.5 - circle.y) < radius;
            if is_erased { 0.0 } else { alpha[(x, y)] }
        })
    });
    erased
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_balls(background: impl Fn(usize) -> f32) -> (Picture, Circle, Circle) {
        let (mirror, matte) = (Circle { x: 70.0, y: 60.0, radius: 40.0 }, Circle { x: 180.0, y: 64.0, radius: 45.0 });
        let within = |c: &Circle, x: usize, y: usize| {
            ((x as f64 + 0.5 - c.x) / c.radius).hypot((y as f64 + 0.5 - c.y) / c.radius)
        };
        let rgb = Plane::from_fn(250, 128, |x, y| {
            let (a, b) = (within(&mirror, x, y), within(&matte, x, y));
            if a < 1.0 {
                Vec3::splat(if (x / 7 + y / 5) % 2 == 0 { 3.0 } else { 0.2 })
            } else if b < 1.0 {
                Vec3::splat((1.0 - b * b).sqrt() as f32 + 0.1)
            } else {
                Vec3::splat(background(x))
            }
        });
        (Picture { rgb, alpha: None }, mirror, matte)
    }

    #[test]
    fn the_other_ball_is_detected() {
        for slope in [0.0001, 0.0] {
            let (picture, mirror, matte) = two_balls(|x| 0.02 + slope * x as f32);
            let (found, _) = outline_of_ball(&inpaint_ball(&picture, &mirror), None).unwrap();
            let off = (found.x - matte.x).hypot(found.y - matte.y) + (found.radius - matte.radius).abs();
            assert!(off < 1.0, "{slope} {found:?}");
        }
    }

    #[test]
    fn pixels_beside_the_erased_ball_do_not_change() {
        let (picture, mirror, _) = two_balls(|x| 0.02 + 0.0001 * x as f32);
        let alpha = Some(picture.rgb.map(|_| 1.0));
        let erased = inpaint_ball(&Picture { alpha, ..picture.clone() }, &mirror);
        for y in 0..128 {
            for x in 0..250 {
                let r = (x as f64 + 0.5 - mirror.x).hypot(y as f64 + 0.5 - mirror.y);
                if r > 1.1 * mirror.radius + 3.0 {
                    assert_eq!(erased.rgb[(x, y)], picture.rgb[(x, y)]);
                } else if r < mirror.radius {
                    assert!(erased.rgb[(x, y)].x < 0.05 && erased.alpha.as_ref().unwrap()[(x, y)] == 0.0);
                }
            }
        }
        // A ball that the border of the picture cuts.
        let cut = inpaint_ball(&picture, &Circle { x: -5.0, y: 130.0, radius: 30.0 });
        assert!(cut.rgb.as_slice().iter().all(|v| v.is_finite()));
    }
}
