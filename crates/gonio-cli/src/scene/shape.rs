//! The shape of the object, as the options say it.

use std::path::PathBuf;

use gonio::scene::Correction;
use gonio::shape::DepthKind;
use gonio_app::{Form, Normals, Places, Shape, Source};

use super::SceneOptions;

/// Shapes known by name.
#[derive(Clone, Copy, clap::ValueEnum)]
pub(super) enum ShapeName {
    /// A ball: orthographic, or in perspective with --camera
    Sphere,
    /// An ellipsoid seen orthographically, one of its axes towards the camera
    Ellipsoid,
}

/// Options that go with `--normals`.
#[derive(clap::Args)]
pub(super) struct NormalOptions {
    /// The normals' y points down, as in normal maps for DirectX
    #[arg(long, requires = "normals")]
    normals_flip_y: bool,
    /// The normals' x points left
    #[arg(long, requires = "normals")]
    normals_flip_x: bool,
    /// The normals' z points away from the camera
    #[arg(long, requires = "normals")]
    normals_flip_z: bool,
    /// Which axis each channel of the normals holds
    #[arg(long, value_name = "xyz|yxz|zyx|…", default_value = "xyz", requires = "normals", value_parser = parse_order)]
    normals_order: ChannelOrder,
    /// Take the normals as they are even if they contradict themselves
    #[arg(long, requires = "normals")]
    trust_normals: bool,
    /// Picture of the object's depth, to know which light it keeps from itself
    ///
    /// EXR, NPY or 16-bit PNG.
    #[arg(long, value_name = "FILE", requires = "normals", conflicts_with = "positions")]
    depth: Option<PathBuf>,
    /// Depths that the codes 0 and 1 of an integer picture stand for
    #[arg(long, value_name = "NEAR,FAR", requires = "depth", value_parser = parse_range, allow_hyphen_values = true)]
    depth_range: Option<(f64, f64)>,
    /// Depths are distances along the rays, not along the camera's axis
    #[arg(long, requires = "depth")]
    depth_along_rays: bool,
    /// Picture of the object's positions, for the same
    ///
    /// EXR or NPY, in coordinates of the camera.
    #[arg(long, value_name = "FILE", requires = "normals")]
    positions: Option<PathBuf>,
}

/// Channels that hold x, y and z.
#[derive(Clone, Copy)]
struct ChannelOrder([usize; 3]);

fn parse_order(text: &str) -> Result<ChannelOrder, String> {
    Correction::order_named(text)
        .map(ChannelOrder)
        .ok_or_else(|| "give x, y and z in some order, such as yxz or zyx".into())
}

fn parse_range(text: &str) -> Result<(f64, f64), String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|s| s.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[near, far]) if near != far && near.is_finite() && far.is_finite() => Ok((near, far)),
        _ => Err("give two different numbers, NEAR,FAR".into()),
    }
}

impl NormalOptions {
    fn normals(&self, picture: PathBuf) -> Normals {
        let kind = if self.depth_along_rays { DepthKind::AlongRay } else { DepthKind::AlongAxis };
        let depth = self.depth.clone().map(|path| Places::Depth(Source::File(path), self.depth_range, kind));
        Normals {
            picture: Source::File(picture),
            correction: Correction {
                order: self.normals_order.0,
                flip_x: self.normals_flip_x,
                flip_y: self.normals_flip_y,
                flip_z: self.normals_flip_z,
            },
            trusted: self.trust_normals,
            places: depth.or_else(|| self.positions.clone().map(|path| Places::Positions(Source::File(path)))),
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
            (Some(picture), _) => Form::Normals(Box::new(self.normal_options.normals(picture.clone()))),
            (None, ShapeName::Sphere) => Form::Sphere(self.circle.first().copied()),
            (None, ShapeName::Ellipsoid) => Form::Ellipsoid(self.depth_axis),
        };
        Shape { camera: self.surface.camera.clone().map(Source::File), ..Shape::of(form) }
    }
}
