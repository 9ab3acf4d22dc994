//! Options for the photograph and its object, shared by `gonio infer` and `gonio check`.

mod reference;
mod shape;

use std::path::PathBuf;

use anyhow::{Result, bail};
use gonio::scene::Circle;
use gonio_app::regions::Regions;
use gonio_app::{Scene, Source};

use crate::input::{self, numbers};
use crate::reading::ReadingOptions;
use crate::surface::SurfaceOptions;
use reference::ReferenceOptions;
use shape::{NormalOptions, ShapeName};

/// Options for the photograph and the object in it.
#[derive(clap::Args)]
#[command(next_help_heading = "Input")]
pub(crate) struct SceneOptions {
    /// HDR photograph, or exposures of one scene; use - for standard input
    ///
    /// EXR, Radiance HDR and PFM contain linear radiance. gonio also accepts 8- and 16-bit PNG,
    /// TIFF and JPEG, but warns that highlights are probably clipped. gonio merges several
    /// exposures (8- or 16-bit JPEG, PNG or TIFF) like gonio merge. Standard input holds one image
    /// in any of these formats.
    #[arg(required = true, value_name = "IMAGE", help_heading = None::<&str>)]
    pub(crate) images: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) reading: ReadingOptions,
    /// Radiance at which the camera clips
    ///
    /// By default, gonio detects this level if many pixels share the maximum value.
    #[arg(long, value_name = "VALUE")]
    clip: Option<f32>,
    /// Mask of the object: white on the object and black elsewhere
    ///
    /// Without a mask, gonio detects the object by the alpha channel, by a uniform background, or
    /// by the edges of a ball. gonio scales a mask of another size to the photograph.
    #[arg(long, value_name = "FILE", help_heading = FINDING)]
    mask: Option<PathBuf>,
    /// Outline of the ball in pixels; replaces automatic detection
    ///
    /// X and Y are the centre, measured from the top left corner. To estimate several balls, repeat
    /// the option.
    #[arg(long, value_name = "X,Y,RADIUS", value_parser = parse_circle, help_heading = FINDING,
          conflicts_with_all = ["normals", "mesh", "camera"])]
    circle: Vec<Circle>,
    /// Label image that marks regions of different materials under one light
    ///
    /// Each region has its own index or colour; the rest is black. gonio estimates one BRDF per
    /// region.
    #[arg(long, value_name = "LABELS", help_heading = FINDING)]
    pub(crate) regions: Option<PathBuf>,
    /// Treat the whole object as one material
    ///
    /// By default, gonio ignores other paints, stickers and small spots such as dust, if it can
    /// distinguish them from reflections.
    #[arg(long, help_heading = FINDING)]
    one_material: bool,
    /// Write the estimate even if the photograph contradicts the shape or the light
    ///
    /// By default, gonio stops with an error if the silhouette of the mesh is not that of the
    /// object, or if the misfit (relative RMS residual) exceeds 50 %.
    #[arg(long, help_heading = FINDING)]
    force: bool,
    /// Shape of the object; gonio fits it to the outline
    #[arg(long, value_enum, default_value_t = ShapeName::Sphere, help_heading = SHAPE,
          conflicts_with_all = ["normals", "mesh"])]
    shape: ShapeName,
    #[command(flatten)]
    surface: SurfaceOptions,
    /// Normal map of the object, for any shape: EXR, NPY or PNG
    ///
    /// Normals are in camera coordinates: x points right, y up, and z towards the camera.
    #[arg(long, value_name = "FILE", conflicts_with = "mesh", help_heading = SHAPE)]
    normals: Option<PathBuf>,
    #[command(flatten, next_help_heading = SHAPE)]
    normal_options: NormalOptions,
    /// Semi-axis of an ellipsoid towards the camera, in pixels [default: the geometric mean of the
    /// other two]
    #[arg(long, value_name = "PIXELS", value_parser = parse_positive, allow_negative_numbers = true, help_heading = SHAPE)]
    depth_axis: Option<f64>,
    #[command(flatten, next_help_heading = REFERENCE)]
    reference: ReferenceOptions,
}

const FINDING: &str = "Object detection";
const SHAPE: &str = "Shape";
const REFERENCE: &str = "Neutral reference";

fn parse_positive(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0).ok_or_else(|| "expected a positive number".into())
}

pub(crate) fn parse_circle(text: &str) -> Result<Circle, String> {
    match numbers(text).as_deref() {
        Some(&[x, y, radius]) if radius > 0.0 => Ok(Circle { x, y, radius }),
        _ => Err("expected three numbers, X,Y,RADIUS, in pixels".into()),
    }
}

impl SceneOptions {
    /// Returns the first photograph.
    pub(crate) fn image(&self) -> PathBuf {
        self.images.first().cloned().unwrap_or_default()
    }

    /// Returns the paths of all input pictures and of the files of the shape.
    pub(crate) fn input_files(&self) -> Vec<&PathBuf> {
        let options = [&self.mask, &self.regions, &self.normals, self.reading.flat(), self.reference.grey_card()];
        let shape = self.normal_options.files().into_iter().chain(self.surface.files());
        self.images.iter().chain(options.into_iter().chain(shape).flatten()).collect()
    }

    /// Whether the object can shadow itself.
    pub(crate) fn has_shadows(&self) -> bool {
        self.surface.mesh.is_some() || self.normals.is_some()
    }

    /// Returns the regions of several materials, if the options specify them.
    pub(crate) fn regions(&self) -> Option<Regions> {
        let labels = self.regions.clone().map(|labels| Regions::Labels(Source::File(labels)));
        labels.or_else(|| (self.circle.len() > 1).then(|| Regions::Circles(self.circle.clone())))
    }

    /// Returns the scene that the options describe.
    ///
    /// # Errors
    /// If an option would have no effect, or standard input cannot be read.
    pub(crate) fn scene(&self) -> Result<Scene> {
        self.check()?;
        Ok(Scene {
            name: input::name(&self.images),
            photograph: input::photograph_source(&self.images)?,
            reading: self.reading.reading(),
            clip: self.clip,
            mask: self.mask.clone().map(Source::File),
            one_material: self.one_material,
            force: self.force,
            shape: self.shape(),
            reference: self.reference.reference(),
        })
    }

    /// Rejects options that would have no effect.
    fn check(&self) -> Result<()> {
        self.reference.check()?;
        let is_ellipsoid = matches!(self.shape, ShapeName::Ellipsoid) && !self.has_shadows();
        if self.depth_axis.is_some() && !is_ellipsoid {
            bail!("--depth-axis requires --shape ellipsoid");
        }
        if !self.circle.is_empty() && is_ellipsoid {
            bail!("--circle is the outline of a ball; for an ellipsoid, use --mask or automatic detection");
        }
        if !self.circle.is_empty() && matches!(self.shape, ShapeName::Outline) && !self.has_shadows() {
            bail!("--circle is the outline of a ball; with --shape outline, use --mask or automatic detection");
        }
        if self.circle.len() > 1 {
            if self.regions.is_some() {
                bail!("--regions and several --circle options both define the regions; use only one of them");
            }
            if self.mask.is_some() {
                bail!("--mask and several --circle options both define the balls; use only one of them");
            }
        }
        if self.one_material && self.regions().is_some() {
            bail!("--one-material applies to photographs of one material; with regions, gonio uses all colours");
        }
        Ok(())
    }
}
