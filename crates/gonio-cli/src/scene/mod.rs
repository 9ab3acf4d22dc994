//! A photograph and the object in it, as the options say them: for `gonio infer` and `gonio check`.

mod reference;
mod shape;

use std::path::PathBuf;

use anyhow::{Result, bail};
use gonio::scene::Circle;
use gonio_app::regions::Regions;
use gonio_app::{Scene, Source};

use crate::input;
use crate::reading::ReadingOptions;
use crate::surface::SurfaceOptions;
use reference::ReferenceOptions;
use shape::{NormalOptions, ShapeName};

/// Options that say what is to be looked at.
#[derive(clap::Args)]
#[command(next_help_heading = "Input")]
pub(crate) struct SceneOptions {
    /// HDR photograph, or exposures of one scene; - is standard input
    ///
    /// EXR, Radiance HDR and PFM are read as they are; PNG, TIFF and JPEG with a warning. Several
    /// exposures (8 or 16-bit JPEG, PNG, TIFF) are merged as by gonio merge. From standard input
    /// comes one whole picture, whose format its bytes tell.
    #[arg(required = true, value_name = "IMAGE", help_heading = None::<&str>)]
    pub(crate) images: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) reading: ReadingOptions,
    /// Radiance at which the camera clips
    ///
    /// It is found by itself where many pixels share the maximum.
    #[arg(long, value_name = "VALUE")]
    clip: Option<f32>,
    /// Where the object is: a picture that is bright on it
    ///
    /// Without one the alpha channel tells, a plain background, or the edges of a ball. One of
    /// another size is scaled.
    #[arg(long, value_name = "FILE", help_heading = FINDING)]
    mask: Option<PathBuf>,
    /// Outline of the ball in pixels, if it is not to be found
    ///
    /// The centre is counted from the top left corner. Several times for several balls.
    #[arg(long, value_name = "X,Y,RADIUS", value_parser = parse_circle, help_heading = FINDING,
          conflicts_with_all = ["normals", "mesh", "camera"])]
    circle: Vec<Circle>,
    /// Picture of regions of different materials, all under one light
    ///
    /// One index or colour for each region, black where there is none. Each gets a BRDF.
    #[arg(long, value_name = "LABELS", help_heading = FINDING)]
    pub(crate) materials: Option<PathBuf>,
    /// Observe regions of another colour as well
    ///
    /// Paint and stickers are left out otherwise, where they are told safely from reflections.
    #[arg(long, help_heading = FINDING)]
    keep_colors: bool,
    /// Shape of the object, fitted to its outline
    #[arg(long, value_enum, default_value_t = ShapeName::Sphere, help_heading = SHAPE,
          conflicts_with_all = ["normals", "mesh"])]
    shape: ShapeName,
    #[command(flatten)]
    surface: SurfaceOptions,
    /// Picture of the object's normals, for any shape
    ///
    /// EXR, NPY or PNG, in camera space: x right, y up, z towards the camera.
    #[arg(long, value_name = "FILE", conflicts_with = "mesh", help_heading = SHAPE)]
    normals: Option<PathBuf>,
    #[command(flatten, next_help_heading = SHAPE)]
    normal_options: NormalOptions,
    /// Semi-axis of an ellipsoid towards the camera, in pixels
    #[arg(long, value_name = "PIXELS", value_parser = parse_positive, allow_negative_numbers = true, help_heading = SHAPE)]
    depth_axis: Option<f64>,
    #[command(flatten, next_help_heading = REFERENCE)]
    reference: ReferenceOptions,
}

const FINDING: &str = "Finding the object";
const SHAPE: &str = "Shape";
const REFERENCE: &str = "Reference in the picture";

fn parse_positive(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0).ok_or_else(|| "give a positive number".into())
}

pub(crate) fn parse_circle(text: &str) -> Result<Circle, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|s| s.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, radius]) if radius > 0.0 => Ok(Circle { x, y, radius }),
        _ => Err("give three numbers, X,Y,RADIUS, in pixels".into()),
    }
}

impl SceneOptions {
    /// The first photograph.
    pub(crate) fn image(&self) -> PathBuf {
        self.images.first().cloned().unwrap_or_default()
    }

    /// Whether the object can throw shadows on itself.
    pub(crate) fn has_shadows(&self) -> bool {
        self.surface.mesh.is_some() || self.normals.is_some()
    }

    /// The regions that are given, if any are.
    pub(crate) fn regions(&self) -> Option<Regions> {
        let labels = self.materials.clone().map(|labels| Regions::Labels(Source::File(labels)));
        labels.or_else(|| (self.circle.len() > 1).then(|| Regions::Circles(self.circle.clone())))
    }

    /// The scene.
    ///
    /// # Errors
    /// If an option would have no effect, or standard input cannot be read.
    pub(crate) fn scene(&self) -> Result<Scene> {
        self.check()?;
        Ok(Scene {
            name: input::name(&self.images),
            shots: input::shots(&self.images)?,
            reading: self.reading.reading(),
            clip: self.clip,
            mask: self.mask.clone().map(Source::File),
            keep_colours: self.keep_colors,
            shape: self.shape(),
            reference: self.reference.reference(),
        })
    }

    /// Refuses options that would have no effect.
    fn check(&self) -> Result<()> {
        self.reference.check()?;
        let is_ellipsoid = matches!(self.shape, ShapeName::Ellipsoid) && !self.has_shadows();
        if self.depth_axis.is_some() && !is_ellipsoid {
            bail!("--depth-axis is for --shape ellipsoid");
        }
        if !self.circle.is_empty() && is_ellipsoid {
            bail!("--circle is the outline of a ball: an ellipsoid is found by --mask, or by itself");
        }
        if self.circle.len() > 1 {
            if self.materials.is_some() {
                bail!("--materials says where the regions are: give it, or several --circle");
            }
            if self.mask.is_some() {
                bail!("several --circle say where the balls are: give them, or --mask");
            }
        }
        if self.keep_colors && self.regions().is_some() {
            bail!("--keep-colors is for a photograph of one material: in regions all colours are observed");
        }
        Ok(())
    }
}
