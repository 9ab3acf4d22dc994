//! Self-shadowing of the observed points.

use glam::DVec3;

use super::{Observations, SceneError};
use crate::shape::{Camera, Surface, Visibility, VisibilityPoint, hit_at};
use crate::sphere::OctahedralMap;
use crate::transfer::MIN_POINTS;

/// Smallest visible share of a uniform sky; below it, the object itself lights the point as much as
/// the environment does.
const MIN_OPEN: f64 = 0.15;
/// Largest share of a uniform sky in texels that are partly open, on a grid of 32 x 32; above it, a
/// point may lie on the edge of a shadow.
const MAX_EDGE: f64 = 0.35;

impl Observations {
    /// Computes the self-shadowing of each point ([`Self::visibility`]) on a grid of texels.
    ///
    /// The grid has `side` x `side` texels. Points with less than 15 % of the sky, or possibly on
    /// the edge of a shadow, lose their value if at least a hundred others keep theirs. The edge of
    /// a shadow may lie on a point with more than 35 % of the sky in texels that are partly open,
    /// on a grid of 32 x 32.
    ///
    /// The points must be pixels of the picture taken by `camera`, like those of [`Self::of_view`].
    /// Without self-shadowing, nothing changes.
    ///
    /// # Errors
    /// [`SceneError::NoSurface`] if a point is not on the surface.
    pub fn shadowed_by(
        &mut self,
        surface: &dyn Surface,
        camera: &Camera,
        (map, side): (OctahedralMap, usize),
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<(), SceneError> {
        if surface.is_convex() {
            return Ok(());
        }
        let points: Option<Vec<VisibilityPoint>> = self
            .pixels
            .iter()
            .zip(&self.points)
            .map(|(&(x, y), point)| {
                let hit = hit_at(surface, camera, x as usize, y as usize)?;
                Some(VisibilityPoint { from: hit.ray_origin, normal: point.normal })
            })
            .collect();
        let points = points.ok_or(SceneError::NoSurface)?;
        let visibility = Visibility::trace(surface, &points, map, side, progress);
        if visibility.is_open() {
            return Ok(());
        }
        let normals: Vec<DVec3> = self.points.iter().map(|p| p.normal).collect();
        let openness = visibility.sky_visibilities(&normals);
        // Edges of shadows are as wide as texels.
        let most = MAX_EDGE * 32.0 / side as f64;
        let poor = |i: &usize| openness[*i].unoccluded < MIN_OPEN || openness[*i].penumbra > most;
        let lost: Vec<usize> = (0..self.points.len()).filter(|i| self.values[*i].is_some()).filter(poor).collect();
        if self.report.used - lost.len() >= 2 * MIN_POINTS {
            for &i in &lost {
                self.values[i] = None;
                self.colours[i] = None;
            }
            self.report.used -= lost.len();
            // Each of these points is one pixel.
            self.report.used_pixels = self.report.used_pixels.saturating_sub(lost.len());
            self.report.in_shadow = lost.len();
        }
        self.sky_view = openness.iter().map(|o| o.unoccluded).collect();
        self.visibility = Some(visibility);
        Ok(())
    }
}
