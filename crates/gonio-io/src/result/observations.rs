//! Sections on the photograph and the object in it.

use gonio::bracket::MergeReport;
use gonio::scene::{self, ObservationReport};
use gonio::shape::{self, MeshDefects};
use serde::{Deserialize, Serialize};

/// Copies fields of equal names from a type of the library. The pattern is exhaustive, so a new
/// field of the library causes an error of compilation.
macro_rules! same_fields {
    ($value:expr, $source:ident { $($field:ident),* }) => {{
        let $source { $($field),* } = $value;
        Self { $($field),* }
    }};
}

/// The detected object and the status of the pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Observations {
    /// Shape of the object.
    pub shape: Shape,
    /// Reliability of a ball that gonio detected by its edges.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detection: Option<DetectionReport>,
    /// Pixels of a traced surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surface: Option<SurfacePixels>,
    /// Self-shadowing of a surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visibility: Option<Visibility>,
    /// Number of pixels and sample points by status.
    pub report: PixelCounts,
}

/// Shape of the object. Positions are in pixels from the top left corner; directions are in camera
/// coordinates: x right, y up, z towards the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Shape {
    /// A ball under an orthographic camera.
    Sphere {
        /// Its outline.
        circle: Circle,
    },
    /// A ball under a given camera.
    Ball {
        /// Its centre. Under a perspective camera, its distance is set to one: the outline
        /// determines only the direction.
        centre: [f64; 3],
        /// The camera.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        projection: Option<Projection>,
    },
    /// An ellipsoid under an orthographic camera.
    Ellipsoid {
        /// Its outline.
        ellipse: Ellipse,
        /// Semi-axis towards the camera, in pixels.
        depth_axis: f64,
    },
    /// A surface inflated from its outline.
    Outline {
        /// Factor from the heights of the smooth inflation to those of the surface.
        depth_factor: f64,
        /// Whether gonio refined the normals.
        refined: bool,
    },
    /// A mesh.
    Mesh {
        /// Name of the mesh.
        mesh: String,
        /// Defects of the mesh.
        defects: MeshReport,
        /// The camera.
        projection: Projection,
        /// Where the camera axis meets the picture, in pixels.
        principal_point: [f64; 2],
        /// Matrix from camera coordinates to those of the world (without a pose, those of the
        /// mesh), by rows.
        camera_to_world: [[f64; 4]; 4],
    },
    /// A normal map.
    Normals {
        /// Name of the depth or position map.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        geometry: Option<String>,
        /// Defects of the surface from that map.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        defects: Option<MeshReport>,
        /// The camera.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        projection: Option<Projection>,
        /// Whether gonio refined the normals; absent for exact normals.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        refined: Option<bool>,
    },
}

/// A circle in the picture, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Circle {
    /// Column of the centre.
    pub x: f64,
    /// Row of the centre.
    pub y: f64,
    /// Radius.
    pub radius: f64,
}

impl From<scene::Circle> for Circle {
    fn from(scene::Circle { x, y, radius }: scene::Circle) -> Self {
        Self { x, y, radius }
    }
}

/// An ellipse in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Ellipse {
    /// Column and row of the centre.
    pub centre: [f64; 2],
    /// Longer and shorter semi-axis, in pixels.
    pub axes: [f64; 2],
    /// Angle in radians from the rightward direction to the longer axis, counterclockwise.
    pub angle: f64,
}

impl From<&scene::Ellipse> for Ellipse {
    fn from(scene::Ellipse { centre, axes, angle }: &scene::Ellipse) -> Self {
        Self { centre: [centre.0, centre.1], axes: [axes.0, axes.1], angle: *angle }
    }
}

/// Projection of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Projection {
    /// Parallel rays.
    Orthographic {
        /// Pixels per unit of length.
        pixels_per_unit: f64,
    },
    /// Rays from the camera.
    Perspective {
        /// Focal length in pixels.
        focal: f64,
    },
}

impl From<shape::Projection> for Projection {
    fn from(projection: shape::Projection) -> Self {
        match projection {
            shape::Projection::Orthographic { pixels_per_unit } => Self::Orthographic { pixels_per_unit },
            shape::Projection::Perspective { focal } => Self::Perspective { focal },
        }
    }
}

/// Reliability of a ball that gonio detected by its edges.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DetectionReport {
    /// Share of the outline that coincides with an edge, 0..=1.
    pub support: f64,
    /// Weight of the next candidate circle without the edges that the ball explains, relative to
    /// the weight of the ball.
    pub runner_up: f64,
    /// Standard error of the centre and the radius in pixels; absent if there are too few edges.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub standard_error: Option<f64>,
}

/// Pixels of a traced surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SurfacePixels {
    /// Number of pixels that show the surface.
    pub pixels: usize,
    /// Number of those that show it from behind.
    pub back_facing: usize,
}

/// Self-shadowing of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Visibility {
    /// Whether the object occludes light from itself.
    pub occluded: bool,
    /// Memory of the visible directions, in bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<usize>,
}

/// Defects of a mesh or of positions, none of which makes it unusable.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct MeshReport {
    /// Number of triangles used.
    pub triangles: usize,
    /// Number of triangles without area, which gonio removes.
    pub degenerate: usize,
    /// Number of edges with only one triangle; zero for a closed surface.
    pub open_edges: usize,
    /// Number of edges with three triangles or more.
    pub non_manifold_edges: usize,
    /// Number of edges whose triangles are oriented inconsistently.
    pub inconsistent_edges: usize,
    /// Whether the surface is closed and its triangles face inwards.
    pub inside_out: bool,
    /// Number of triangles whose normals contradict the order of their corners.
    pub inconsistent_normals: usize,
    /// Whether gonio computed the normals, because those of the file are missing or unusable.
    pub normals_computed: bool,
}

impl From<&MeshDefects> for MeshReport {
    fn from(defects: &MeshDefects) -> Self {
        same_fields!(
            *defects,
            MeshDefects {
                triangles,
                degenerate,
                open_edges,
                non_manifold_edges,
                inconsistent_edges,
                inside_out,
                inconsistent_normals,
                normals_computed
            }
        )
    }
}

/// Number of pixels and sample points by status. Sample points are the points of the object at
/// which gonio samples the photograph; they lie between pixels if the picture is small.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct PixelCounts {
    /// Sample points, the sum of the next six numbers.
    pub points: usize,
    /// Points with a value.
    pub used: usize,
    /// Points without a value because a pixel is clipped.
    pub clipped: usize,
    /// Points without a value because a pixel is uncovered or outside the picture.
    pub outside: usize,
    /// Points without a value because pixels are negative, NaN, infinite or outliers.
    pub faulty: usize,
    /// Points without a value because a pixel is of another colour or paint.
    pub other_colour: usize,
    /// Points without a value because of self-shadowing.
    pub in_shadow: usize,
    /// Pixels on the object.
    pub observed_pixels: usize,
    /// Pixels on the object that gonio uses.
    pub used_pixels: usize,
    /// Pixels on the object that are clipped.
    pub clipped_pixels: usize,
    /// Radiance at which a channel counts as clipped, specified or detected.
    pub clip_level: Option<f32>,
    /// Ignored pixels of negative luminance.
    pub negative: usize,
    /// Ignored pixels with a channel that is NaN or infinite.
    pub not_finite: usize,
    /// Ignored pixels with a channel far from those of their neighbours.
    pub outliers: usize,
    /// Pixels that differ from their neighbours like outliers, but are used because the object has
    /// sharp reflections.
    pub possible_outliers: usize,
    /// Used pixels with a negative channel, which counts as zero.
    pub negative_channels: usize,
    /// Ignored pixels in regions of another colour, or on or near a second paint.
    pub other_colour_pixels: usize,
    /// Pixels of a second paint that are used after conversion to the first.
    pub converted_pixels: usize,
    /// Ratio of the reflectance (luminance) of the second paint to that of the first, if the object
    /// has a pattern of two paints.
    pub pattern_ratio: Option<f64>,
    /// Pixels without a normal.
    pub without_normal: usize,
    /// Ignored pixels whose normal is not a unit vector.
    pub not_unit: usize,
    /// Ignored pixels whose normal faces away from the camera.
    pub facing_away: usize,
    /// Ignored pixels next to an edge or fold of the surface.
    pub at_edges: usize,
    /// Ignored pixels far darker than all their neighbours.
    pub dark_outliers: usize,
}

impl From<&ObservationReport> for PixelCounts {
    fn from(report: &ObservationReport) -> Self {
        same_fields!(
            *report,
            ObservationReport {
                points,
                used,
                clipped,
                outside,
                faulty,
                other_colour,
                observed_pixels,
                used_pixels,
                clipped_pixels,
                clip_level,
                negative,
                not_finite,
                outliers,
                possible_outliers,
                negative_channels,
                other_colour_pixels,
                converted_pixels,
                pattern_ratio,
                without_normal,
                not_unit,
                facing_away,
                at_edges,
                dark_outliers,
                in_shadow
            }
        )
    }
}

/// Merge of the exposures of a bracket.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Bracket {
    /// Relative exposures; the longest is 1.
    pub exposures: Vec<f64>,
    /// Whether gonio recovered the response of the camera from the bracket.
    pub recovered_response: bool,
    /// Number of pixels by status, and disagreements between exposures.
    pub report: BracketReport,
}

/// Number of merged pixels by status, and disagreements between exposures.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(default)]
pub struct BracketReport {
    /// Number of pixels.
    pub pixels: usize,
    /// Number of pixels clipped in every exposure.
    pub clipped: usize,
    /// Number of pixels black in every exposure.
    pub dark: usize,
    /// Number of pixels whose exposures disagree.
    pub inconsistent: usize,
    /// Number of known pixels with an uncertainty of more than 2 % from rounding alone.
    pub quantised: usize,
    /// Number of pixels whose radiance comes mostly from each exposure.
    pub pixels_by_exposure: Vec<usize>,
    /// Relative excess of each exposure's brightness over that expected from its time, relative to
    /// the next shorter exposure; zero for exposures that are left out.
    pub time_errors: Vec<f64>,
    /// Correction of each exposure; null for exposures that are left out because they contradict
    /// the others.
    pub corrections: Vec<Option<Correction>>,
    /// Median relative disagreement of each exposure with the merged values; zero for exposures
    /// that are left out.
    pub residuals: Vec<f64>,
    /// Median relative disagreement over all exposures.
    pub residual: f64,
}

/// Correction of an exposure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Correction {
    /// Columns and rows by which the scene is displaced relative to the first exposure.
    pub shift: [i32; 2],
    /// Factor of each channel.
    pub gain: [f64; 3],
    /// Veiling glare of each channel, in units of the response.
    pub veiling_glare: [f64; 3],
}

impl From<&MergeReport> for BracketReport {
    fn from(report: &MergeReport) -> Self {
        let correction = |c: &gonio::bracket::ExposureCorrection| Correction {
            shift: [c.shift.0, c.shift.1],
            gain: c.gain,
            veiling_glare: c.veiling_glare,
        };
        Self {
            pixels: report.pixels,
            clipped: report.clipped,
            dark: report.dark,
            inconsistent: report.inconsistent,
            quantised: report.quantised,
            pixels_by_exposure: report.pixels_by_exposure.clone(),
            time_errors: report.time_errors.clone(),
            corrections: report.corrections.iter().map(|c| c.as_ref().map(correction)).collect(),
            residuals: report.residuals.clone(),
            residual: report.residual,
        }
    }
}
