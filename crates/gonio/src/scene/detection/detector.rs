//! Observations of an object, for each kind of shape.

use std::sync::Arc;

use glam::Vec3;

use super::{DetectedShape, Detection, Inaccurate, NormalMap, PositionMap};
use crate::picture::{Picture, Plane};
use crate::scene::circle::outline;
use crate::scene::components::{components, largest_component};
use crate::scene::flat_background::flat_background;
use crate::scene::observed::check_size;
use crate::scene::{Circle, ObservationSettings, Observations, Orientation, SceneError, SceneWarning, SurfaceView};
use crate::shape::{GeometryBuffer, Inflation, Mesh, MeshDefects, PosedSurface, Tracer};

/// Length of an edge of a position mesh, relative to the median, above which the edge is a step.
const DEPTH_STEP: f64 = 8.0;

/// Smallest overlap of surface and mask; below it, the surface is misaligned.
const MIN_OVERLAP: f64 = 0.93;
/// Overlap below which a warning reports the misalignment.
const GOOD_OVERLAP: f64 = 0.97;
/// Width in pixels of a rim around the object that may differ without misalignment: small objects
/// are mostly rim.
const RIM_WIDTH: f64 = 1.5;

/// Expected error of inflated normals, in radians: 20 degrees.
const INFLATED: f64 = 0.35;

/// Inputs of the detection that do not depend on the shape.
pub(super) struct Detector<'a> {
    pub(super) picture: &'a Picture,
    pub(super) coverage: Option<Plane<f32>>,
    /// Whether the coverage is a given mask.
    pub(super) masked: bool,
    pub(super) settings: &'a ObservationSettings,
}

impl Detector<'_> {
    pub(super) fn circle(self, circle: Circle) -> Result<Detection, SceneError> {
        let observations = Observations::of_sphere(self.picture, &circle, self.coverage.as_ref(), self.settings)?;
        Ok(self.detection(observations, DetectedShape::Circle(circle)))
    }

    pub(super) fn surface(self, placed: PosedSurface, found: DetectedShape) -> Result<Detection, SceneError> {
        check_size("camera image", placed.camera.size, self.picture.rgb.size())?;
        let buffer = GeometryBuffer::of(placed.surface.as_ref(), &placed.camera);
        let mut scene_warnings = Vec::new();
        if let Some(coverage) = &self.coverage {
            let Overlap { share: overlap, is_rim, is_part } = Overlap::of(coverage, &buffer.distances);
            let is_aligned = is_rim || (self.masked && is_part);
            if overlap < MIN_OVERLAP && !is_aligned && !self.settings.force {
                return Err(SceneError::Misaligned { overlap, default_camera: placed.default_camera });
            }
            if overlap < GOOD_OVERLAP && !is_aligned {
                scene_warnings.push(SceneWarning::Misaligned { overlap });
            }
        }
        if 20 * buffer.back_facing > buffer.visible {
            scene_warnings.push(SceneWarning::BackFacing { inside: buffer.back_facing, visible: buffer.visible });
        }
        let view =
            SurfaceView { normals: &buffer.normals, camera: Some(&placed.camera), distances: Some(&buffer.distances) };
        let observations = Observations::of_view(self.picture, &view, self.coverage.as_ref(), self.settings)?;
        Ok(Detection {
            normals: Some(buffer.normals),
            placed: Some(placed),
            pixels: Some((buffer.visible, buffer.back_facing)),
            scene_warnings,
            ..self.detection(observations, found)
        })
    }

    /// Observes the surface that is inflated from the coverage.
    pub(super) fn inflated(self) -> Result<Detection, SceneError> {
        let inside = self.coverage.as_ref().map(solid).transpose()?;
        let inflation = inside.as_ref().and_then(Inflation::of).ok_or(SceneError::NoOutline)?;
        let normals = inflation.normals();
        let view = SurfaceView { normals: &normals, camera: None, distances: None };
        let observations = Observations::of_view(self.picture, &view, self.coverage.as_ref(), self.settings)?;
        let inaccurate = Some(Inaccurate { error: INFLATED, camera: None });
        let picture = self.picture;
        let detection = Detection {
            normals: Some(normals),
            estimated_normals: true,
            inaccurate,
            ..self.detection(observations, DetectedShape::Outline(inflation.depth()))
        };
        Ok(detection.made_consistent(picture))
    }

    pub(super) fn normals(self, view: NormalMap) -> Result<Detection, SceneError> {
        let NormalMap { mut normals, camera, positions, trusted, error } = view;
        let mut scene_warnings = Vec::new();
        if self.coverage.is_none()
            && let Some(background) = flat_background(&normals)
        {
            let pixels = normals.as_mut_slice().iter_mut().zip(background.as_slice()).filter(|(_, b)| **b);
            let pixels = pixels.map(|(normal, _)| *normal = Vec3::ZERO).count();
            scene_warnings.push(SceneWarning::FlatBackground { pixels });
        }
        if normals.size() == self.picture.rgb.size()
            && let Some(it) = Orientation::of(&normals, self.coverage.as_ref())?.contradiction()
        {
            if !trusted {
                return Err(SceneError::Contradiction(it));
            }
            scene_warnings.push(SceneWarning::Contradiction(it));
        }
        let view = SurfaceView { normals: &normals, camera: camera.as_ref(), distances: None };
        let observations = Observations::of_view(self.picture, &view, self.coverage.as_ref(), self.settings)?;
        let (placed, defects) = positions.map(|map| self.surface_of(map, camera.is_none())).transpose()?.unzip();
        // Shadows of a position map belong to its normals.
        let is_inaccurate = error > 0.0 && placed.is_none();
        let picture = self.picture;
        let detection = Detection {
            normals: Some(normals),
            placed,
            inaccurate: is_inaccurate.then_some(Inaccurate { error, camera }),
            scene_warnings,
            ..self.detection(observations, DetectedShape::Normals(defects))
        };
        Ok(detection.made_consistent(picture))
    }

    /// Builds the surface of a position map, cut to the object.
    fn surface_of(
        &self,
        PositionMap { mut positions, camera }: PositionMap,
        default_camera: bool,
    ) -> Result<(PosedSurface, MeshDefects), SceneError> {
        let size = self.picture.rgb.size();
        check_size("depth or position map", positions.size(), size)?;
        if let Some(coverage) = &self.coverage {
            let cut = positions.as_slice().iter().zip(coverage.as_slice()).map(|(p, c)| p.filter(|_| *c >= 0.5));
            positions = Plane::from_vec(size.0, size.1, cut.collect());
        }
        let (mesh, defects) = Mesh::of_positions(&positions, DEPTH_STEP)?;
        Ok((PosedSurface { surface: Arc::new(Tracer::new(mesh)), camera, default_camera }, defects))
    }

    fn detection(self, observations: Observations, found: DetectedShape) -> Detection {
        Detection {
            observations,
            coverage: self.coverage,
            shape: found,
            reliability: None,
            normals: None,
            estimated_normals: false,
            size: self.picture.rgb.size(),
            settings: *self.settings,
            placed: None,
            inaccurate: None,
            pixels: None,
            scene_warnings: Vec::new(),
        }
    }
}

/// Returns the pixels of the largest part of a coverage. Holes of at most a thousandth of its
/// pixels are filled: they are faults of the mask.
///
/// # Errors
/// Those of the outline of a coverage, for example if it covers nothing or everything.
fn solid(coverage: &Plane<f32>) -> Result<Plane<bool>, SceneError> {
    outline(coverage)?;
    let largest = largest_component(coverage.size(), |at| coverage[at] >= 0.5).ok_or(SceneError::NoOutline)?;
    let part = largest.mask(0, coverage.size());
    let mut filled = part.clone();
    for hole in components(part.size(), true, |at| !part[at]) {
        if 1000 * hole.len() <= largest.len() {
            hole.pixels().for_each(|at| filled[at] = true);
        }
    }
    Ok(filled)
}

/// Overlap of a mask and the silhouette of a surface.
struct Overlap {
    /// Number of pixels in both, over the number of pixels in either.
    share: f64,
    /// Whether mask and silhouette differ by at most the number of pixels in a rim of width
    /// [`RIM_WIDTH`] around the mask.
    is_rim: bool,
    /// Whether the two overlap and at most that many mask pixels are outside the silhouette. A mask
    /// may select a part of the object.
    is_part: bool,
}

impl Overlap {
    fn of(coverage: &Plane<f32>, distances: &Plane<f32>) -> Self {
        let (width, height) = coverage.size();
        let covered = |x: usize, y: usize| coverage[(x, y)] >= 0.5;
        let (mut either, mut shared, mut masked, mut border) = (0_usize, 0_usize, 0_usize, 0_usize);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let (covers, is_visible) = (covered(x, y), distances[(x, y)].is_finite());
            either += usize::from(covers || is_visible);
            shared += usize::from(covers && is_visible);
            masked += usize::from(covers);
            let at_border = (x > 0 && covered(x - 1, y) != covers) || (y > 0 && covered(x, y - 1) != covers);
            border += usize::from(at_border);
        }
        let rim = RIM_WIDTH * border as f64;
        Self {
            share: shared as f64 / either.max(1) as f64,
            is_rim: (either - shared) as f64 <= rim,
            is_part: (masked - shared) as f64 <= rim && shared > 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::scene::ObjectShape;
    use crate::shape::{Camera, Ellipsoid, Projection};
    use crate::suggestion::Suggestion;

    /// A disk of this radius in a picture of 100 pixels, shifted to the right.
    fn disk(radius: f64, shift: f64) -> impl Fn(usize, usize) -> bool {
        move |x, y| (x as f64 - 49.5 - shift).hypot(y as f64 - 49.5) < radius
    }

    fn overlap(mask: impl Fn(usize, usize) -> bool, surface: impl Fn(usize, usize) -> bool) -> Overlap {
        let coverage = Plane::from_fn(100, 100, |x, y| if mask(x, y) { 1.0 } else { 0.0 });
        let distances = Plane::from_fn(100, 100, |x, y| if surface(x, y) { 1.0 } else { f32::INFINITY });
        Overlap::of(&coverage, &distances)
    }

    #[test]
    fn accepts_rims_and_parts_of_the_object() {
        let same = overlap(disk(30.0, 0.0), disk(30.0, 0.0));
        assert!(same.share == 1.0 && same.is_rim && same.is_part);
        // Small objects are mostly rim.
        let small = overlap(disk(10.0, 0.0), disk(11.0, 0.0));
        assert!(small.share < MIN_OVERLAP && small.is_rim, "{}", small.share);
        let shifted = overlap(disk(30.0, 0.0), disk(30.0, 8.0));
        assert!(shifted.share < MIN_OVERLAP && !shifted.is_rim && !shifted.is_part, "{}", shifted.share);
        let part = overlap(disk(12.0, 5.0), disk(30.0, 0.0));
        assert!(part.share < MIN_OVERLAP && !part.is_rim && part.is_part, "{}", part.share);
        assert!(!overlap(disk(12.0, 0.0), |_, _| false).is_part);
    }

    #[test]
    fn a_misplaced_shape_suggests_a_camera_only_if_none_was_given() {
        let size = (100, 100);
        let camera = Camera::new(Projection::Orthographic { pixels_per_unit: 30.0 }, (0.0, 0.0), size).unwrap();
        let of = |default_camera: bool| {
            let surface = Arc::new(Ellipsoid::sphere(DVec3::new(1.0, 0.0, -5.0), 1.0).unwrap());
            let object = ObjectShape::Surface(PosedSurface { surface, camera, default_camera });
            let mask = Plane::from_fn(100, 100, |x, y| if disk(30.0, 0.0)(x, y) { 1.0 } else { 0.0 });
            let picture = Picture { rgb: Plane::from_fn(100, 100, |_, _| Vec3::ONE), alpha: None };
            let refused = Detection::of(&picture, Some(mask), object, &ObservationSettings::default()).err().unwrap();
            assert!(matches!(refused, SceneError::Misaligned { .. }), "{refused}");
            refused.suggestions().contains(&Suggestion::Camera)
        };
        assert!(of(true) && !of(false));
    }

    #[test]
    fn masks_keep_the_largest_part_without_pinholes() {
        let mask = Plane::from_fn(120, 100, |x, y| {
            let r = (x as f64 - 50.0).hypot(y as f64 - 50.0);
            let opening = (40..52).contains(&x) && (30..42).contains(&y);
            let is_inside = (r < 40.0 && !opening && (x, y) != (60, 60)) || x > 115;
            if is_inside { 1.0 } else { 0.0 }
        });
        let part = solid(&mask).unwrap();
        assert!(part[(60, 60)] && !part[(45, 35)] && !part[(118, 50)] && part[(20, 50)]);
        assert!(solid(&mask.map(|_| 0.0)).is_err() && solid(&mask.map(|_| 1.0)).is_err());
    }
}
