//! Detection of an object of known shape in an image, with its observations.

mod detector;

use std::sync::Arc;

use glam::{DVec3, Vec3};

use self::detector::Detector;
use super::ball_detection::{corrected, detect_ball};
use super::consistency::refined;
use super::observed::{COVERED, check_size};
use super::spots::{WithoutSpots, without_spots};
use super::view::has_normal;
use super::{
    Circle, Ellipse, ObservationSettings, Observations, OutlineReliability, PixelStatus, SceneError, SceneWarning,
    SurfaceView, coverage_of, find_ball, find_ellipse, outlined,
};
use crate::appearance::scatter;
use crate::picture::{Picture, Plane, luminance};
use crate::shape::{Camera, MeshDefects, PosedSurface, Projection};
use crate::sphere::OctahedralMap;

/// Scatter of pixels that share a normal above which inaccurate normals are refined.
const CONSISTENT: f32 = 0.05;
/// Share of outliers above which a warning reports them; sensor defects cause fewer.
const FEW_OUTLIERS: f64 = 0.001;

/// Positions of a surface pixel by pixel, in coordinates of the camera.
#[derive(Clone)]
pub struct PositionMap {
    /// Position of the surface behind each pixel.
    pub positions: Plane<Option<DVec3>>,
    /// The camera.
    pub camera: Camera,
}

/// Shape of an object, as far as it is known before the detection.
#[derive(Clone)]
pub enum ObjectShape {
    /// A distant ball with its outline; `None` detects the outline.
    Sphere(Option<Circle>),
    /// A ball in front of a camera; its outline gives its position.
    Ball(Camera),
    /// A distant ellipsoid with one axis towards the camera, and the length of that semi-axis in
    /// pixels; `None` assumes the geometric mean of the two visible semi-axes.
    Ellipsoid(Option<f64>),
    /// A distant smooth object of unknown shape, inflated from its outline
    /// ([`Inflation`](crate::shape::Inflation)).
    Outline,
    /// A surface in front of a camera.
    Surface(PosedSurface),
    /// Any shape, given by a normal map.
    Normals(Arc<NormalMap>),
}

/// A normal map with its camera and positions.
#[derive(Clone)]
pub struct NormalMap {
    /// The normals, in camera space: x right, y up, z towards the camera; `ZERO` or not finite
    /// where there is no normal.
    pub normals: Plane<Vec3>,
    /// The camera; `None` for an orthographic one.
    pub camera: Option<Camera>,
    /// Positions of the surface, for its self-shadowing.
    pub positions: Option<PositionMap>,
    /// Whether to skip the consistency checks of the normals.
    pub trusted: bool,
    /// Expected error of the normals, in radians; zero for measured normals.
    pub error: f64,
}

/// Shape of the object, detected or given.
#[derive(Clone, Debug, PartialEq)]
pub enum DetectedShape {
    /// Outline of a ball, given or detected.
    Circle(Circle),
    /// Centre of a ball, in camera coordinates. In perspective, its distance is one, since the
    /// outline determines only the direction and the angular radius; an orthographic camera does
    /// not determine the distance.
    Ball(DVec3),
    /// Outline of an ellipsoid and the length of its semi-axis towards the camera, in pixels.
    Ellipse(Ellipse, f64),
    /// A surface inflated from its outline, with its depth factor
    /// ([`Inflation::depth`](crate::shape::Inflation::depth)).
    Outline(f64),
    /// A given surface.
    Surface,
    /// Given normals, and the defects of their positions.
    Normals(Option<MeshDefects>),
}

/// Observations of an object in a picture, and its location.
pub struct Detection {
    /// The points and their values.
    pub observations: Observations,
    /// Coverage of the pixels by the object, 0..=1, if known.
    pub coverage: Option<Plane<f32>>,
    /// Shape of the object.
    pub shape: DetectedShape,
    /// Reliability of the outline of a ball that was detected by its edges.
    pub reliability: Option<OutlineReliability>,
    /// Normals of the object, unless it is a distant ball.
    pub normals: Option<Plane<Vec3>>,
    /// Whether the normals are inflated from the outline, or refined.
    pub estimated_normals: bool,
    /// The surface and its camera, if known.
    pub placed: Option<PosedSurface>,
    /// Width and height of the picture.
    size: (usize, usize),
    settings: ObservationSettings,
    /// How the normals were observed, if they are inaccurate.
    inaccurate: Option<Inaccurate>,
    /// Number of pixels that show the surface, and number of those that are back-facing, if a
    /// surface was traced.
    pub pixels: Option<(usize, usize)>,
    /// Warnings.
    pub scene_warnings: Vec<SceneWarning>,
}

/// Observation of a surface with inaccurate normals.
#[derive(Clone, Debug)]
struct Inaccurate {
    /// Expected error of a normal, in radians.
    error: f64,
    camera: Option<Camera>,
}

impl Detection {
    /// Detects the object and samples the picture on it.
    ///
    /// The object is given by `mask`, else by the alpha channel of the picture or a plain
    /// background. On any other background, a ball is detected by its edges.
    ///
    /// # Errors
    /// * Errors of the outline ([`SceneError::is_of_outline`]) if the outline must be detected.
    /// * [`SceneError::Several`] and [`SceneError::Unsure`] if the outline is ambiguous.
    /// * Errors of normals and surfaces that are inconsistent or not aligned with the object.
    /// * Errors of pictures with too few valid pixels.
    pub fn of(
        picture: &Picture,
        mask: Option<Plane<f32>>,
        object: ObjectShape,
        settings: &ObservationSettings,
    ) -> Result<Self, SceneError> {
        let size = picture.rgb.size();
        if let Some(mask) = &mask {
            check_size("mask", mask.size(), size)?;
        }
        let masked = mask.is_some();
        let detector = |coverage| Detector { picture, coverage, masked, settings };
        let known = || detector(coverage_of(picture, mask.as_ref()));
        let mut detection = match object {
            ObjectShape::Sphere(Some(circle)) => {
                let mut detection = known().circle(circle)?;
                let corrected = corrected(&picture.rgb, &circle);
                detection.scene_warnings.extend(corrected.map(SceneWarning::Outline));
                detection
            }
            ObjectShape::Sphere(None) => {
                let ball = detect_ball(picture, mask.as_ref())?;
                Detection { reliability: ball.reliability, ..detector(ball.coverage).circle(ball.circle)? }
            }
            ObjectShape::Ball(camera) => {
                let coverage = outlined(picture, mask.as_ref())?;
                let ball = find_ball(&coverage, &camera)?;
                let detector = detector(Some(coverage));
                detector.surface(
                    PosedSurface { surface: Arc::new(ball), camera, default_camera: false },
                    DetectedShape::Ball(ball.centre()),
                )?
            }
            ObjectShape::Ellipsoid(given) => {
                let coverage = outlined(picture, mask.as_ref())?;
                let ellipse = find_ellipse(&coverage)?;
                let depth = given.unwrap_or((ellipse.axes.0 * ellipse.axes.1).sqrt());
                let surface = Arc::new(ellipse.with_depth(depth)?);
                let camera = Camera::new(Projection::Orthographic { pixels_per_unit: 1.0 }, (0.0, 0.0), size)?;
                let detector = detector(Some(coverage));
                let mut detection = detector.surface(
                    PosedSurface { surface, camera, default_camera: false },
                    DetectedShape::Ellipse(ellipse, depth),
                )?;
                if given.is_none() {
                    detection.scene_warnings.push(SceneWarning::UnknownSemiAxis(depth));
                }
                detection
            }
            ObjectShape::Outline => detector(Some(outlined(picture, mask.as_ref())?)).inflated()?,
            ObjectShape::Surface(placed) => known().surface(placed, DetectedShape::Surface)?,
            ObjectShape::Normals(view) => known().normals(Arc::unwrap_or_clone(view))?,
        };
        let report = &detection.observations.report;
        if report.clipped_pixels > 0 {
            let (clipped, observed) = (report.clipped_pixels, report.observed_pixels);
            detection.scene_warnings.push(SceneWarning::Clipped { clipped, observed });
        }
        let report = &detection.observations.report;
        let (negative, not_finite, observed) = (report.negative, report.not_finite, report.observed_pixels);
        if negative + not_finite > 0 {
            detection.scene_warnings.push(SceneWarning::Faulty { negative, not_finite, observed });
        }
        let statuses = detection.observations.statuses.iter();
        let empty: Vec<_> =
            statuses.flat_map(|statuses| SceneWarning::of_empty_channels(&picture.rgb, statuses)).collect();
        detection.scene_warnings.extend(empty);
        let outliers = detection.observations.report.outliers;
        if outliers as f64 > FEW_OUTLIERS * observed as f64 {
            detection.scene_warnings.push(SceneWarning::Outliers { outliers, observed });
        }
        let pixels = detection.observations.report.possible_outliers;
        if pixels > 0 {
            detection.scene_warnings.push(SceneWarning::PossibleOutliers { pixels, observed });
        }
        detection.scene_warnings.extend(SceneWarning::of_paint(&detection.observations.report));
        Ok(detection)
    }

    /// Returns the detection without the small spots of a distant ball, such as dust, scratches and
    /// print: they are replaced by the median of their surroundings. Returns `None` for other
    /// shapes, without spots, and if [`ObservationSettings::one_material`] is set.
    ///
    /// Pixels keep their status. If pixels of a second paint are converted, all pixels are
    /// classified again, because their converted values are not stored.
    ///
    /// Reflections of small lamps can look like spots. Use the result only if the spots mislead the
    /// estimate ([`without_misleading_spots`](crate::estimate::without_misleading_spots)).
    #[must_use]
    pub fn without_spots(&self, picture: &Picture) -> Option<Self> {
        let circle = self.circle().filter(|_| !self.settings.one_material)?;
        let statuses = self.observations.statuses.as_ref();
        let used = Plane::from_fn(self.size.0, self.size.1, |x, y| match statuses {
            Some(statuses) => statuses[(x, y)] == PixelStatus::Used,
            None => self.contains(x, y) && self.coverage.as_ref().is_none_or(|coverage| coverage[(x, y)] >= COVERED),
        });
        let WithoutSpots { rgb, count } = without_spots(&picture.rgb, &used, circle.radius)?;
        let cleaned = Picture { rgb, alpha: picture.alpha.clone() };
        let (coverage, settings) = (self.coverage.as_ref(), &self.settings);
        let observations = if self.observations.report.converted_pixels > 0 {
            Observations::of_sphere(&cleaned, &circle, coverage, settings)
        } else {
            self.observations.with_values(&cleaned, &circle, coverage, settings)
        };
        let mut scene_warnings = self.scene_warnings.clone();
        scene_warnings.push(SceneWarning::Spots { count });
        Some(Self {
            observations: observations.ok()?,
            coverage: self.coverage.clone(),
            shape: self.shape.clone(),
            normals: None,
            placed: None,
            inaccurate: None,
            scene_warnings,
            ..*self
        })
    }

    /// Refines inaccurate normals by the brightness of the pixels. Normals are inaccurate if they
    /// are inflated from an outline, or if their map has an [error](NormalMap::error) and no
    /// positions.
    ///
    /// Use it if the misfit of an estimate shows that the normals are wrong
    /// ([`NORMAL_REFINEMENT_MISFIT`](crate::estimate::NORMAL_REFINEMENT_MISFIT)), and keep the
    /// estimate with the smaller misfit. Returns `None` for accurate normals, and if too few pixels
    /// remain.
    #[must_use]
    pub fn refined(&self, picture: &Picture) -> Option<Self> {
        let (Some(Inaccurate { error, camera }), Some(normals), settings) =
            (&self.inaccurate, &self.normals, &self.settings)
        else {
            return None;
        };
        let statuses = self.observations.statuses.as_ref();
        let brightness = Plane::from_fn(normals.width(), normals.height(), |x, y| {
            let is_used = statuses.is_none_or(|statuses| statuses[(x, y)] == PixelStatus::Used);
            let is_covered = self.coverage.as_ref().is_none_or(|coverage| coverage[(x, y)] >= COVERED);
            let faces = has_normal(normals[(x, y)]) && f64::from(normals[(x, y)].z) > settings.max_angle.cos();
            let value = luminance(picture.rgb[(x, y)]);
            (is_used && is_covered && faces && value.is_finite()).then_some(value)
        });
        let normals = refined(normals, &brightness, *error);
        let view = SurfaceView { normals: &normals, camera: camera.as_ref(), distances: None };
        let observations = Observations::of_view(picture, &view, self.coverage.as_ref(), settings).ok()?;
        // The segmentation of paint depends on the normals.
        let is_kept = |w: &&SceneWarning| !matches!(w, SceneWarning::OtherColour { .. } | SceneWarning::Pattern { .. });
        let kept = self.scene_warnings.iter().filter(is_kept).cloned();
        let scene_warnings = kept.chain(SceneWarning::of_paint(&observations.report)).collect();
        Some(Self {
            observations,
            coverage: self.coverage.clone(),
            shape: self.shape.clone(),
            reliability: self.reliability,
            normals: Some(normals),
            estimated_normals: true,
            size: self.size,
            settings: self.settings,
            placed: None,
            inaccurate: None,
            pixels: self.pixels,
            scene_warnings,
        })
    }

    /// Refines inaccurate normals if pixels that share a normal differ in brightness.
    fn made_consistent(self, picture: &Picture) -> Self {
        let scattered = |detection: &Self| scatter(&detection.observations.samples()).unwrap_or(0.0);
        if self.inaccurate.is_none() || scattered(&self) <= CONSISTENT {
            return self;
        }
        match self.refined(picture) {
            Some(refined) if scattered(&refined) < scattered(&self) => refined,
            _ => self,
        }
    }

    /// Computes self-shadowing if the detection has a surface ([`Observations::shadowed_by`]).
    ///
    /// # Errors
    /// [`SceneError::NoSurface`] if the observations are not those of the surface.
    pub fn shadow(&mut self, grid: (OctahedralMap, usize), progress: &(dyn Fn(f64) + Sync)) -> Result<(), SceneError> {
        match &self.placed {
            Some(placed) => self.observations.shadowed_by(placed.surface.as_ref(), &placed.camera, grid, progress),
            None => Ok(()),
        }
    }

    /// Whether [`Self::refined`] refined the normals.
    pub fn is_refined(&self) -> bool {
        self.estimated_normals && self.inaccurate.is_none()
    }

    /// Returns the width and height of the picture.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Whether the middle of a pixel lies on the object.
    pub fn contains(&self, x: usize, y: usize) -> bool {
        if let Some(circle) = self.circle() {
            let (dx, dy) = (x as f64 + 0.5 - circle.x, y as f64 + 0.5 - circle.y);
            return dx * dx + dy * dy < circle.radius * circle.radius;
        }
        let has_normal = |normals: &Plane<Vec3>| normals[(x, y)].is_finite() && normals[(x, y)] != Vec3::ZERO;
        let covered = |coverage: &Plane<f32>| coverage[(x, y)] >= 0.5;
        self.normals.as_ref().is_none_or(has_normal) && self.coverage.as_ref().is_none_or(covered)
    }

    /// Returns the outline if the object is a distant ball.
    pub fn circle(&self) -> Option<Circle> {
        match self.shape {
            DetectedShape::Circle(circle) => Some(circle),
            _ => None,
        }
    }
}
