//! Image of a mirror ball with its usable pixels.

use glam::{DVec3, Vec3};

use super::ball::MirrorBall;
use super::unwrap::CAMERA;
use super::{ProbeError, Reflectance};
use crate::picture::{Picture, Plane};
use crate::scene::{COVERED, ObjectShape, PixelStatus, check_size, clip_level, is_clipped};

/// Width of the ignored rim, in pixels: pixels there mix the ball with its background.
const RIM_WIDTH: f64 = 1.5;
/// Additional width, as a share of the radius, within which an error of the outline changes
/// directions too much.
const RIM_SHARE: f64 = 0.005;

/// A picture of a mirror ball.
pub struct View {
    rgb: Plane<Vec3>,
    ball: MirrorBall,
    statuses: Plane<PixelStatus>,
    /// Cosine between normal and view direction at the inner edge of the rim.
    min_cosine: f64,
}

/// Light from one direction in a view.
pub(super) struct Sample {
    /// Radiance that arrives at the ball from this direction.
    pub(super) radiance: DVec3,
    /// Cosine between normal and view direction at the point that reflects it.
    pub(super) cosine: f64,
}

impl View {
    /// Detects the ball in a picture and its usable pixels.
    ///
    /// The ball is given by `mask`, else by the alpha channel, a plain background, or its edges.
    /// `clip` is the radiance at or above which a channel is clipped; without it, the largest value
    /// is the clip level if many pixels share it.
    ///
    /// # Errors
    /// Errors of the outline if it must be detected; a mask of another size;
    /// [`ProbeError::NotABall`] if the object is neither [`ObjectShape::Sphere`] nor
    /// [`ObjectShape::Ball`].
    pub fn of(
        picture: &Picture,
        mask: Option<&Plane<f32>>,
        object: &ObjectShape,
        clip: Option<f32>,
    ) -> Result<Self, ProbeError> {
        let (width, height) = picture.rgb.size();
        if let Some(mask) = mask {
            check_size("mask", mask.size(), (width, height))?;
        }
        let ball = MirrorBall::find(picture, mask, object)?;
        let within = 1.0 - (RIM_WIDTH / ball.pixels() + RIM_SHARE);
        let min_cosine = (1.0 - within * within).sqrt();
        let covered = mask.or(picture.varying_alpha());
        let status = |x: usize, y: usize| {
            let Some(seen) = ball.reflection_at((x as f64 + 0.5, y as f64 + 0.5)) else { return PixelStatus::Outside };
            if covered.is_some_and(|c| c[(x, y)].is_nan() || c[(x, y)] < COVERED) {
                return PixelStatus::Outside;
            }
            let sound = if seen.cosine < min_cosine { PixelStatus::Edge } else { PixelStatus::Used };
            PixelStatus::fault(picture.rgb[(x, y)]).unwrap_or(sound)
        };
        let mut statuses = Plane::from_fn(width, height, status);
        let level = clip_level(&picture.rgb, &statuses.map(|status| *status == PixelStatus::Used), clip);
        for (status, colour) in statuses.as_mut_slice().iter_mut().zip(picture.rgb.as_slice()) {
            if *status == PixelStatus::Used && is_clipped(*colour, level) {
                *status = PixelStatus::Clipped;
            }
        }
        Ok(Self { rgb: picture.rgb.clone(), ball, statuses, min_cosine })
    }

    /// Returns the ball.
    pub fn ball(&self) -> &MirrorBall {
        &self.ball
    }

    /// Returns the picture.
    pub fn rgb(&self) -> &Plane<Vec3> {
        &self.rgb
    }

    /// Returns the status of each pixel.
    ///
    /// The status is [`PixelStatus::Used`]; [`PixelStatus::Clipped`], for pixels that are used with
    /// their clipped value; [`PixelStatus::Edge`] at the rim; [`PixelStatus::Outside`]; or the
    /// fault of a value that is not a radiance.
    pub fn statuses(&self) -> &Plane<PixelStatus> {
        &self.statuses
    }

    /// Whether a pixel shows the camera that took the picture, or directions close to it.
    ///
    /// Such pixels have a reduced weight if another view shows the same direction.
    pub fn shows_camera(&self, (x, y): (usize, usize)) -> bool {
        let seen = self.ball.reflection_at((x as f64 + 0.5, y as f64 + 0.5));
        seen.is_some_and(|seen| seen.direction.angle_between(self.ball.axis()) < CAMERA.1)
    }

    /// Returns the number of pixels with one of these statuses.
    pub fn count(&self, statuses: &[PixelStatus]) -> usize {
        self.statuses.as_slice().iter().filter(|status| statuses.contains(status)).count()
    }

    /// Returns the light from a direction, interpolated between pixel centres.
    ///
    /// Returns `None` if the view does not show the direction.
    pub(super) fn sample(&self, direction: DVec3, reflectance: &Reflectance) -> Option<Sample> {
        let place = self.ball.place_of(direction)?;
        if place.cosine < self.min_cosine {
            return None;
        }
        let (width, height) = self.rgb.size();
        let (x, y) = (place.at.0 - 0.5, place.at.1 - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (mut sum, mut weight) = (DVec3::ZERO, 0.0);
        for (row, down) in [(top, 1.0 - (y - top)), (top + 1.0, y - top)] {
            for (column, right) in [(left, 1.0 - (x - left)), (left + 1.0, x - left)] {
                let inside = row >= 0.0 && column >= 0.0 && row < height as f64 && column < width as f64;
                if !inside {
                    continue;
                }
                let at = (column as usize, row as usize);
                if matches!(self.statuses[at], PixelStatus::Used | PixelStatus::Clipped | PixelStatus::Edge) {
                    // Channels outside the gamut of a file may be negative; light is not.
                    sum += right * down * self.rgb[at].as_dvec3().max(DVec3::ZERO);
                    weight += right * down;
                }
            }
        }
        let radiance = sum / weight / reflectance.at(place.cosine);
        (weight > 0.25).then_some(Sample { radiance, cosine: place.cosine })
    }
}
