//! Options for the shape of the object.

use std::path::PathBuf;

use gonio::scene::Correction;
use gonio::shape::DepthKind;
use gonio_app::{NormalSource, PositionSource, Shape, ShapeKind, Source};

use super::SceneOptions;
use crate::input::numbers;

/// Names of shapes.
#[derive(Clone, Copy, clap::ValueEnum)]
pub(super) enum ShapeName {
    /// A ball, seen orthographically, or in perspective with --camera
    Sphere,
    /// An ellipsoid, seen orthographically along one of its axes
    Ellipsoid,
    /// Any smooth object; gonio inflates a surface from its outline, which is less accurate
    Outline,
}

/// Options that go with `--normals`.
#[derive(clap::Args)]
pub(super) struct NormalOptions {
    /// The y axis of the normals points down, as in DirectX normal maps
    #[arg(long, requires = "normals")]
    normals_flip_y: bool,
    /// The x axis of the normals points left
    #[arg(long, requires = "normals")]
    normals_flip_x: bool,
    /// The z axis of the normals points away from the camera
    #[arg(long, requires = "normals")]
    normals_flip_z: bool,
    /// Order of the axes in the channels of the normal map
    #[arg(long, value_name = "xyz|yxz|zyx|…", default_value = "xyz", requires = "normals", value_parser = parse_order)]
    normals_order: ChannelOrder,
    /// Use the normals even if they fail the consistency checks
    #[arg(long, requires = "normals")]
    trust_normals: bool,
    /// Expected error of the normals, for normals that a network predicts
    ///
    /// If the photograph contradicts the normals, gonio refines them. It turns them by about this
    /// angle at most, towards normals whose pixels have the same brightness. Predicted normals have
    /// errors of 10 to 20 degrees (docs/shapes.md).
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, requires = "normals", value_parser = parse_error,
          hide_default_value = true, conflicts_with_all = ["depth", "positions"])]
    normals_error: f64,
    /// Depth map of the object, to compute self-shadowing
    ///
    /// The format is EXR, NPY or 16-bit PNG.
    #[arg(long, value_name = "FILE", requires = "normals", conflicts_with = "positions")]
    depth: Option<PathBuf>,
    /// Depths at the ends of the code range of a 16-bit depth map
    ///
    /// gonio interpolates linearly between code 0 (NEAR) and code 65535 (FAR). Pixels with exactly
    /// one of these two codes have no surface.
    #[arg(long, value_name = "NEAR,FAR", requires = "depth", value_parser = parse_range, allow_hyphen_values = true)]
    depth_range: Option<(f64, f64)>,
    /// Depths are distances along the viewing rays, not along the optical axis
    #[arg(long, requires = "depth")]
    depth_along_rays: bool,
    /// Position map of the object, to compute self-shadowing
    ///
    /// The format is EXR or NPY; positions are in camera coordinates.
    #[arg(long, value_name = "FILE", requires = "normals")]
    positions: Option<PathBuf>,
}

/// Channels that contain x, y and z.
#[derive(Clone, Copy)]
struct ChannelOrder([usize; 3]);

fn parse_order(text: &str) -> Result<ChannelOrder, String> {
    Correction::order_named(text)
        .map(ChannelOrder)
        .ok_or_else(|| "expected a permutation of xyz, such as yxz or zyx".into())
}

fn parse_error(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|degrees: &f64| (0.0..=45.0).contains(degrees));
    number.ok_or_else(|| "expected an angle from 0 to 45 degrees".into())
}

fn parse_range(text: &str) -> Result<(f64, f64), String> {
    match numbers(text).as_deref() {
        Some(&[near, far]) if near != far && near.is_finite() && far.is_finite() => Ok((near, far)),
        _ => Err("expected two different numbers, NEAR,FAR".into()),
    }
}

impl NormalOptions {
    /// The files of the options.
    pub(super) fn files(&self) -> [&Option<PathBuf>; 2] {
        [&self.depth, &self.positions]
    }

    fn normals(&self, picture: PathBuf) -> NormalSource {
        let kind = if self.depth_along_rays { DepthKind::AlongRay } else { DepthKind::AlongAxis };
        let depth = self.depth.clone().map(|path| PositionSource::Depth(Source::File(path), self.depth_range, kind));
        NormalSource {
            picture: Source::File(picture),
            correction: Correction {
                order: self.normals_order.0,
                flip_x: self.normals_flip_x,
                flip_y: self.normals_flip_y,
                flip_z: self.normals_flip_z,
            },
            trusted: self.trust_normals,
            error: self.normals_error.to_radians(),
            positions: depth
                .or_else(|| self.positions.clone().map(|path| PositionSource::Positions(Source::File(path)))),
        }
    }
}

impl SceneOptions {
    /// Returns the shape that the options describe.
    pub(super) fn shape(&self) -> Shape {
        if let Some(shape) = self.surface.mesh() {
            return shape;
        }
        let form = match (&self.normals, self.shape) {
            (Some(picture), _) => ShapeKind::Normals(Box::new(self.normal_options.normals(picture.clone()))),
            (None, ShapeName::Sphere) => ShapeKind::Sphere(self.circle.first().copied()),
            (None, ShapeName::Ellipsoid) => ShapeKind::Ellipsoid(self.depth_axis),
            (None, ShapeName::Outline) => ShapeKind::Outline,
        };
        Shape { camera: self.surface.camera.clone().map(Source::File), ..Shape::of(form) }
    }
}
