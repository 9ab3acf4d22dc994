//! Observations of a surface: its points and their values in the picture.

use std::borrow::Cow;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::cells::SurfaceGeometry;
use super::circle::MIN_BALL_RADIUS;
use super::observed::{COVERED, ObservedColour, check_size};
use super::repair::repaired;
use super::status::{PixelClassification, classify_pixels};
use super::{Circle, PixelStatus, SceneError};
use crate::appearance::Sample;
use crate::parallel;
use crate::picture::{Picture, Plane, luminance};
use crate::shape::Visibility;
use crate::shape::{Points, SurfacePoint};
use crate::sphere::fibonacci_hemisphere;
use crate::transfer::MIN_POINTS;

/// Smallest share of the interpolation weight that the valid pixels around a point must have if the
/// others are faulty.
const MIN_WEIGHT: f32 = 0.5;

/// Settings for sampling a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObservationSettings {
    /// Number of normals on the visible hemisphere, before those beyond `max_angle` are dropped;
    /// with a normal map, the largest number of pixels, also before that step.
    pub normals: usize,
    /// Largest angle between normal and view, in radians, exclusive. Beyond 80 degrees, the picture
    /// contains little information.
    pub max_angle: f64,
    /// Angle from the vertical axis (+y or -y of the camera) within which normals of a sphere are
    /// dropped, in radians. The paper's octahedral map has poles on this axis, where Haar squares
    /// approximate the light poorly. Zero drops no normals.
    #[serde(default)]
    pub pole_angle: f64,
    /// Radiance at or above which a channel is clipped (for integer pictures, the full scale).
    /// `None` detects the level: the largest value of the object, if at least 12 pixels and 0.02 %
    /// of the observed ones have exactly that value.
    pub clip: Option<f32>,
    /// Whether to treat the object as one material. By default, regions of another colour
    /// (stickers) and a second paint are ignored if they can be distinguished safely from
    /// highlights and reflections.
    #[serde(default)]
    pub one_material: bool,
    /// Whether to accept a surface whose silhouette differs from that of the object.
    #[serde(default)]
    pub force: bool,
}

impl Default for ObservationSettings {
    /// The values of the paper, except the pole angle: an equal-area map has no poles.
    fn default() -> Self {
        Self {
            normals: 12_000,
            max_angle: 80.0_f64.to_radians(),
            pole_angle: 0.0,
            clip: None,
            one_material: false,
            force: false,
        }
    }
}

impl ObservationSettings {
    /// Returns the settings of the paper: 12,000 normals, of which the limits leave about 8,600.
    ///
    /// The paper states this number, not the angle.
    pub fn of_paper() -> Self {
        Self { pole_angle: 34.4_f64.to_radians(), ..Self::default() }
    }
}

/// Counts of the points and pixels of a picture by status.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObservationReport {
    /// Points of the surface: `used + clipped + outside + faulty + other_colour + in_shadow`.
    pub points: usize,
    /// Points with a value.
    pub used: usize,
    /// Points without a value because a pixel they need is clipped.
    pub clipped: usize,
    /// Points without a value because a pixel they need is uncovered or outside the picture.
    pub outside: usize,
    /// Points without a value because pixels they need are negative, NaN, infinite or outliers.
    pub faulty: usize,
    /// Points without a value because a pixel they need is of another colour or paint.
    pub other_colour: usize,
    /// Pixels of the observed part of the object.
    pub observed_pixels: usize,
    /// Observed pixels whose values are used: all that are not ignored for a reason below. The
    /// points are interpolated between pixels, so a small picture has fewer used pixels than
    /// points.
    pub used_pixels: usize,
    /// Observed pixels that are clipped.
    pub clipped_pixels: usize,
    /// Radiance at or above which a channel counts as clipped, given or detected.
    pub clip_level: Option<f32>,
    /// Observed pixels of negative luminance, which are ignored.
    pub negative: usize,
    /// Observed pixels with a channel that is NaN or infinite, which are ignored.
    pub not_finite: usize,
    /// Observed pixels with a channel far from the pixels around it (hot and dead pixels,
    /// fireflies), which are ignored.
    pub outliers: usize,
    /// Observed pixels that differ from the pixels around them as much as outliers, but are used
    /// because the object reflects sharply or glitters.
    pub possible_outliers: usize,
    /// Observed pixels that are used although a channel is negative: the luminance is positive, and
    /// the channel counts as zero in the colour.
    pub negative_channels: usize,
    /// Observed pixels in regions of another colour, or on or near a second paint, which are
    /// ignored.
    pub other_colour_pixels: usize,
    /// Observed pixels of a second paint, which are used after conversion to the first.
    pub converted_pixels: usize,
    /// Ratio of the reflectance (luminance) of the second paint to that of the first, if the object
    /// has a pattern of two paints.
    pub pattern_ratio: Option<f64>,
    /// Covered pixels whose normal is missing (shorter than 0.1, or not finite); 0 for a sphere.
    pub without_normal: usize,
    /// Covered pixels skipped because their normal is not a unit vector; 0 for a sphere.
    pub not_unit: usize,
    /// Covered pixels skipped because their normal faces away; 0 for a sphere.
    pub facing_away: usize,
    /// Covered pixels skipped because the surface ends, steps back or folds next to them; 0 for a
    /// sphere.
    pub at_edges: usize,
    /// Covered pixels skipped because they are far darker than all their neighbours: dust, dead
    /// pixels; 0 for a sphere.
    pub dark_outliers: usize,
    /// Points without a value because the edge of a shadow of the object itself may lie on them, or
    /// because the object occludes most of their light.
    pub in_shadow: usize,
}

/// Points of a surface and their values in a picture; all vectors run over the same points.
#[derive(Clone, Debug, PartialEq)]
pub struct Observations {
    /// Points of the surface; they do not depend on the radiance.
    pub points: Vec<SurfacePoint>,
    /// Position `(x, y)` of each point in the picture, in pixels from its top left corner.
    pub pixels: Vec<(f64, f64)>,
    /// Luminance of each point on the scale of the picture; `None` if the point is not observed.
    pub values: Vec<Option<f64>>,
    /// Linear RGB radiance of each point, where it has a value.
    pub colours: Vec<Option<Vec3>>,
    /// Weight of each value, in 0..=1: its inverse variance relative to that of the model's error.
    pub weights: Vec<f64>,
    /// Visible directions of each point; `None` without self-shadowing ([`Self::shadowed_by`]).
    pub visibility: Option<Visibility>,
    /// Share of the light of a uniform sky that reaches each point, in 0..=1; one without
    /// occlusion.
    pub sky_view: Vec<f64>,
    /// Counts of the points and pixels by status.
    pub report: ObservationReport,
    /// Status of each pixel, if any pixel on the object is ignored or converted.
    pub statuses: Option<Arc<Plane<PixelStatus>>>,
    /// Reflectance of each pixel relative to that of the estimated paint, in linear RGB, if the
    /// object has a pattern of two paints. Zero where it is unknown: on small regions of a third
    /// paint. Meaningless off the object.
    pub albedo_map: Option<Arc<Plane<Vec3>>>,
    /// One sample per usable pixel, each with its normal. Single faulty pixels have values
    /// interpolated from their neighbours. Empty after [`Self::of_points`] and [`Self::select`].
    pub dense: Vec<Sample>,
}

/// Returns the points at which `of_sphere` samples a sphere. Plans use them without a picture.
///
/// The normals are those of a Fibonacci lattice of the visible hemisphere up to
/// [`ObservationSettings::max_angle`] and outside [`ObservationSettings::pole_angle`], seen from
/// +z.
pub fn sphere_points(settings: &ObservationSettings) -> Vec<SurfacePoint> {
    let (least, pole) = (settings.max_angle.cos(), settings.pole_angle.cos());
    let kept = move |n: &DVec3| n.z > least && n.y.abs() < pole;
    let normals = fibonacci_hemisphere(settings.normals).filter(kept);
    normals.map(|normal| SurfacePoint { normal, view: DVec3::Z }).collect()
}

impl Observations {
    /// Builds observations of points on a distant convex surface from their linear RGB radiance.
    ///
    /// For simulations without a picture.
    ///
    /// # Panics
    /// If `points` and `rgb` differ in number.
    pub fn of_points(points: Vec<SurfacePoint>, rgb: &[Vec3]) -> Self {
        assert_eq!(points.len(), rgb.len());
        let count = points.len();
        Self {
            points,
            pixels: vec![(0.0, 0.0); count],
            values: rgb.iter().map(|rgb| Some(f64::from(luminance(*rgb)))).collect(),
            colours: rgb.iter().copied().map(Some).collect(),
            weights: vec![1.0; count],
            visibility: None,
            sky_view: vec![1.0; count],
            report: ObservationReport::default(),
            statuses: None,
            albedo_map: None,
            dense: Vec::new(),
        }
    }

    /// Returns the points with their visibility, in the form that the operator requires.
    pub fn points_with_visibility(&self) -> Points<'_> {
        Points::new(&self.points, self.visibility.as_ref())
    }

    /// Returns the weight of each observation among others of the same normal.
    ///
    /// This is the weight of its value, reduced where much of the light is occluded, because
    /// interreflections replace part of that light. Zero without a value.
    pub fn effective_weights(&self) -> Vec<f64> {
        let each = self.values.iter().zip(&self.weights).zip(&self.sky_view);
        each.map(|((value, weight), open)| if value.is_some() { weight * open.powi(4) } else { 0.0 }).collect()
    }

    /// Selects some of the observations by their indices; the report is not changed.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn select(&self, indices: &[usize]) -> Self {
        fn some<T: Clone>(all: &[T], indices: &[usize]) -> Vec<T> {
            indices.iter().map(|&i| all[i].clone()).collect()
        }
        Self {
            points: some(&self.points, indices),
            pixels: some(&self.pixels, indices),
            values: some(&self.values, indices),
            colours: some(&self.colours, indices),
            weights: some(&self.weights, indices),
            visibility: self.visibility.as_ref().map(|v| v.select(indices)),
            sky_view: some(&self.sky_view, indices),
            report: self.report,
            statuses: self.statuses.clone(),
            albedo_map: self.albedo_map.clone(),
            dense: Vec::new(),
        }
    }

    /// Returns [`Self::dense`], or one sample per point with a value if that is empty.
    pub fn samples(&self) -> Cow<'_, [Sample]> {
        if !self.dense.is_empty() {
            return Cow::Borrowed(&self.dense);
        }
        let each = self.points.iter().zip(self.values.iter().zip(&self.colours)).zip(self.effective_weights());
        each.filter_map(|((point, (value, rgb)), weight)| {
            let sample = Sample::of(point.in_view(), (*value)?, weight);
            Some(rgb.map_or(sample, |rgb| sample.coloured(rgb)))
        })
        .collect()
    }

    /// Observes a sphere whose outline is `circle`, at the points of [`sphere_points`].
    ///
    /// A value is the bilinear interpolation of the picture at the projection of the point. It is a
    /// point sample even if the picture is finer than the lattice. Averaging over a lattice cell
    /// (1.3 degrees) would broaden and dim highlights that are half a degree wide. The operator,
    /// which evaluates the reflectance at one normal per point, could not explain them.
    ///
    /// A point has no value if one of its four pixels is clipped, outside the picture, not entirely
    /// within the circle, covered by less than 0.99, or of another colour. Faulty pixels (negative
    /// luminance, NaN, infinite, outliers) are skipped if the others have at least half of the
    /// weight. Without `coverage`, the alpha channel of the picture is used, if it has one.
    ///
    /// # Errors
    /// [`SceneError::BadCircle`]; [`SceneError::Sizes`]; [`SceneError::BadPixels`] when more than
    /// half of the pixels within reach of the points are faulty, or when the others give too few
    /// points; [`SceneError::TooFewPoints`] when fewer than 50 points have a value;
    /// [`SceneError::Black`].
    pub(crate) fn of_sphere(
        picture: &Picture,
        circle: &Circle,
        coverage: Option<&Plane<f32>>,
        settings: &ObservationSettings,
    ) -> Result<Self, SceneError> {
        let Circle { x, y, radius } = *circle;
        // No picture has more than 10^7 pixels along a side, and `f64` resolves much less than a
        // pixel at this size.
        let sane = x.abs() < 1e7 && y.abs() < 1e7 && radius < 1e7;
        if !(sane && radius >= MIN_BALL_RADIUS) {
            return Err(SceneError::BadCircle { x, y, radius, min: MIN_BALL_RADIUS });
        }
        let rgb = &picture.rgb;
        let coverage = coverage.or(picture.varying_alpha());
        if let Some(coverage) = coverage {
            check_size("mask", coverage.size(), rgb.size())?;
        }
        let region = sphere_region(rgb.size(), circle, coverage, settings);
        let normal = |at: (usize, usize)| sphere_normal(circle, at);
        let surface = SurfaceGeometry { normal: &normal, convex: true };
        let mut judged = classify_pixels(rgb, &region, settings, &surface, ObservationReport::default())?;
        let converted = judged.converted.take();
        Self::of_classified(converted.as_ref().unwrap_or(rgb), circle, settings, judged)
    }

    /// Samples the same pixels of a sphere in a picture with other values, such as one without
    /// spots. `self` are observations without converted pixels from [`Self::of_sphere`], with the
    /// same circle, coverage and settings. Pixels keep their status, and the report its counts.
    ///
    /// # Errors
    /// [`SceneError::Black`].
    pub(super) fn with_values(
        &self,
        picture: &Picture,
        circle: &Circle,
        coverage: Option<&Plane<f32>>,
        settings: &ObservationSettings,
    ) -> Result<Self, SceneError> {
        let status = |inside: &bool| if *inside { PixelStatus::Used } else { PixelStatus::Outside };
        let all_used = || {
            let coverage = coverage.or(picture.varying_alpha());
            sphere_region(picture.rgb.size(), circle, coverage, settings).map(status)
        };
        let statuses = self.statuses.as_deref().cloned().unwrap_or_else(all_used);
        let albedo_map = self.albedo_map.as_deref().cloned();
        let judged = PixelClassification { statuses, report: self.report, albedo_map, converted: None };
        Self::of_classified(&picture.rgb, circle, settings, judged)
    }

    /// Samples the sphere at its points and in every used pixel.
    fn of_classified(
        rgb: &Plane<Vec3>,
        circle: &Circle,
        settings: &ObservationSettings,
        judged: PixelClassification,
    ) -> Result<Self, SceneError> {
        let Circle { x, y, radius } = *circle;
        let (width, height) = rgb.size();
        let points = sphere_points(settings);
        let pixels: Vec<(f64, f64)> =
            points.iter().map(|p| (x + radius * p.normal.x, y - radius * p.normal.y)).collect();
        let observed = pixels.iter().map(|&at| sample(rgb, &judged.statuses, at)).collect();
        let normal = |at: (usize, usize)| sphere_normal(circle, at);
        let dense = parallel::flat_map_range(width * height, |i| {
            let value = repaired(rgb, &judged.statuses, i)?;
            let normal = normal((i % width, i / width)).as_dvec3();
            Some(Sample::of(normal, f64::from(luminance(value)), 1.0).coloured(value))
        });
        Ok(Self { dense, ..Self::assemble(points, pixels, observed, judged)? })
    }

    /// Assembles observations and counts the points by status.
    pub(super) fn assemble(
        points: Vec<SurfacePoint>,
        pixels: Vec<(f64, f64)>,
        observed: Vec<ObservedColour>,
        PixelClassification { statuses, report, albedo_map, .. }: PixelClassification,
    ) -> Result<Self, SceneError> {
        let colour = |s: &ObservedColour| if let ObservedColour::Colour(colour) = s { Some(*colour) } else { None };
        let count = |which: ObservedColour| observed.iter().filter(|s| **s == which).count();
        let report = ObservationReport {
            points: points.len(),
            used: observed.iter().filter_map(colour).count(),
            clipped: count(ObservedColour::Clipped),
            outside: count(ObservedColour::Outside),
            faulty: count(ObservedColour::Faulty),
            other_colour: count(ObservedColour::OtherColour),
            used_pixels: statuses.as_slice().iter().filter(|status| status.is_used()).count(),
            ..report
        };
        let ObservationReport { used, clipped, outside, faulty, .. } = report;
        if used < MIN_POINTS && used + faulty >= MIN_POINTS {
            return Err(SceneError::bad_pixels(&report));
        }
        if used < MIN_POINTS {
            return Err(SceneError::TooFewPoints { used, clipped, outside });
        }
        // Luminance of the unmodified colours, including negative channels.
        let values: Vec<Option<f64>> = observed.iter().map(|s| colour(s).map(|c| f64::from(luminance(c)))).collect();
        if values.iter().flatten().all(|&value| value <= 0.0) {
            return Err(SceneError::Black);
        }
        let colours = observed.iter().map(|s| colour(s).map(|c| c.max(Vec3::ZERO))).collect();
        let left_out =
            statuses.as_slice().iter().any(|status| !matches!(status, PixelStatus::Used | PixelStatus::Outside));
        let statuses = left_out.then(|| Arc::new(statuses));
        let (weights, open) = (vec![1.0; points.len()], vec![1.0; points.len()]);
        Ok(Self {
            points,
            pixels,
            values,
            colours,
            weights,
            visibility: None,
            sky_view: open,
            report,
            statuses,
            albedo_map: albedo_map.map(Arc::new),
            dense: Vec::new(),
        })
    }
}

/// Marks the pixels of a sphere within reach of the observed points.
fn sphere_region(
    (width, height): (usize, usize),
    circle: &Circle,
    coverage: Option<&Plane<f32>>,
    settings: &ObservationSettings,
) -> Plane<bool> {
    let Circle { x, y, radius } = *circle;
    // Interpolation reaches less than the diagonal of a pixel beyond the outermost point.
    let reach = radius * settings.max_angle.sin() + std::f64::consts::SQRT_2;
    let reach = if settings.max_angle < std::f64::consts::FRAC_PI_2 { reach } else { radius };
    Plane::from_fn(width, height, |column, row| {
        let (dx, dy) = ((column as f64 + 0.5 - x).abs(), (row as f64 + 0.5 - y).abs());
        dx * dx + dy * dy <= reach * reach
            && (dx + 0.5).powi(2) + (dy + 0.5).powi(2) <= radius * radius
            && coverage.is_none_or(|coverage| coverage[(column, row)] >= COVERED)
    })
}

/// Returns the normal of a sphere behind a pixel.
fn sphere_normal(circle: &Circle, (column, row): (usize, usize)) -> Vec3 {
    let Circle { x, y, radius } = *circle;
    let (nx, ny) = ((column as f64 + 0.5 - x) / radius, (y - row as f64 - 0.5) / radius);
    DVec3::new(nx, ny, (1.0 - nx * nx - ny * ny).max(0.0).sqrt()).as_vec3()
}

/// Interpolates bilinearly at `(x, y)` between the centres of the four nearest pixels.
fn sample(rgb: &Plane<Vec3>, statuses: &Plane<PixelStatus>, (x, y): (f64, f64)) -> ObservedColour {
    let (x, y) = (x - 0.5, y - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let inside = left >= 0.0 && top >= 0.0 && left + 1.0 < rgb.width() as f64 && top + 1.0 < rgb.height() as f64;
    if !inside {
        return ObservedColour::Outside;
    }
    let (s, t) = ((x - left) as f32, (y - top) as f32);
    let (column, row) = (left as usize, top as usize);
    let four = [(column, row), (column + 1, row), (column, row + 1), (column + 1, row + 1)];
    let any = |which: PixelStatus| four.iter().any(|&at| statuses[at] == which);
    if any(PixelStatus::Outside) {
        return ObservedColour::Outside;
    } else if any(PixelStatus::Clipped) {
        return ObservedColour::Clipped;
    } else if any(PixelStatus::OtherColour) {
        return ObservedColour::OtherColour;
    } else if four.iter().any(|&at| statuses[at].is_faulty()) {
        let weights = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t];
        let sound = four.iter().zip(weights).filter(|(at, _)| !statuses[**at].is_faulty());
        let (sum, weight) = sound.fold((Vec3::ZERO, 0.0), |(sum, all), (at, w)| (sum + w * rgb[*at], all + w));
        return if weight >= MIN_WEIGHT { ObservedColour::Colour(sum / weight) } else { ObservedColour::Faulty };
    }
    let [a, b, c, d] = four.map(|at| rgb[at]);
    ObservedColour::Colour(a.lerp(b, s).lerp(c.lerp(d, s), t))
}

#[cfg(test)]
mod tests;
