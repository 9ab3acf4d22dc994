//! What a photograph shows, and where.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gonio::picture::Picture;
use gonio::scene::{Correction, NormalPicture, Object, ObservationSettings, Oddity, Relief, SceneError, Sighting};
use gonio::shape::{Camera, DepthKind, Projection, Visibility, positions_of_depth};
use gonio::sphere::OctahedralMap;
use gonio_io::geometry::{DepthOptions, read_depth, read_positions};
use serde_json::{Value, json};

use super::{Options, Shape};
use crate::progress::Stage;

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
    /// Picture of the object's depth (EXR, NPY, 16-bit PNG), to know which light it keeps from
    /// itself
    #[arg(long, value_name = "FILE", requires = "normals", conflicts_with = "positions")]
    depth: Option<PathBuf>,
    /// Depths that the codes 0 and 1 of an integer picture stand for
    #[arg(long, value_name = "NEAR,FAR", requires = "depth", value_parser = parse_range, allow_hyphen_values = true)]
    depth_range: Option<(f64, f64)>,
    /// Depths are distances along the rays, not along the camera's axis
    #[arg(long, requires = "depth")]
    depth_along_rays: bool,
    /// Picture of the object's positions (EXR, NPY) in coordinates of the camera, for the same
    #[arg(long, value_name = "FILE", requires = "normals")]
    positions: Option<PathBuf>,
}

/// Which channels hold x, y and z.
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

/// Finds the object and samples the picture on it; with what result.json says of it.
pub(super) fn observe(
    options: &Options,
    picture: &Picture,
    clip: Option<f32>,
    map: OctahedralMap,
    warnings: &mut Vec<String>,
) -> Result<(Sighting, Value)> {
    let size = picture.rgb.size();
    let mask = options.mask.as_deref().map(gonio_io::picture::read_mask).transpose()?;
    if let (Some(mask), Some(path)) = (&mask, &options.mask)
        && mask.size() != size
    {
        let ((w, h), (pw, ph)) = (mask.size(), size);
        bail!("{}: the mask is {w}x{h}, the photograph {pw}x{ph}; give one of the same size", path.display());
    }
    let (object, own_notes) = object(options, size, warnings)?;
    let known = if options.paper { ObservationSettings::of_paper() } else { ObservationSettings::default() };
    let settings = ObservationSettings { clip, keep_colours: options.keep_colors, ..known };
    let mut sighting = Sighting::of(picture, mask, object, &settings).map_err(|error| {
        let origin = to_blame(options, &error);
        anyhow::Error::new(error).context(origin)
    })?;
    warnings.extend(sighting.oddities.iter().map(|odd| match odd {
        Oddity::Depth(_) => odd.to_string(),
        Oddity::Clipped { .. } | Oddity::Faulty { .. } => format!("{}: {odd}", options.image.display()),
        Oddity::OtherColour { .. } => format!("{}: {odd}; --keep-colors uses them", options.image.display()),
        Oddity::Contradiction(_) => format!("{}: {odd}", shape_file(options).unwrap_or(&options.image).display()),
        Oddity::Misplaced { .. } | Oddity::Inside { .. } => format!("{}: {odd}", whole(options)),
    }));
    let mut hidden = Value::Null;
    if sighting.placed.is_some() && !options.no_shadows {
        let stage = Stage::new("asking which light is hidden");
        sighting.shadow((map, options.grid), &|x| stage.at(x))?;
        let visibility = sighting.observations.visibility.as_ref();
        hidden = json!({
            "hidden": visibility.is_some(), "bytes": visibility.map(Visibility::bytes), "seconds": stage.finish(),
        });
    }
    let mut notes = gonio_report::notes::sighting(&sighting);
    if !hidden.is_null() {
        notes["visibility"] = hidden;
    }
    if let Some(shape) = notes.get_mut("shape") {
        gonio_report::notes::extend(shape, own_notes);
    }
    Ok((sighting, notes))
}

/// The file that says what shape the object has.
fn shape_file(options: &Options) -> Option<&PathBuf> {
    options.normals.as_ref().or(options.shape_options.mesh.as_ref())
}

/// Photograph and shape together.
fn whole(options: &Options) -> String {
    let image = options.image.display();
    match (shape_file(options), &options.mask) {
        (Some(shape), Some(mask)) if options.normals.is_some() => {
            format!("{image} with {} and {}", shape.display(), mask.display())
        }
        (Some(shape), _) => format!("{image} with {}", shape.display()),
        (None, _) => image.to_string(),
    }
}

/// The file, or files, in which a fault lies.
fn to_blame(options: &Options, error: &SceneError) -> String {
    let relief = options.normal_options.depth.as_ref().or(options.normal_options.positions.as_ref());
    match error {
        // What is wrong with an outline is wrong with the file it comes from.
        error if error.is_of_outline() => options.mask.as_ref().unwrap_or(&options.image).display().to_string(),
        SceneError::Contradiction(_) => shape_file(options).unwrap_or(&options.image).display().to_string(),
        SceneError::Relief(_) => relief.unwrap_or(&options.image).display().to_string(),
        _ => whole(options),
    }
}

/// What the options say of the shape; with what result.json says of it.
fn object(options: &Options, size: (usize, usize), warnings: &mut Vec<String>) -> Result<(Object, Value)> {
    if let Some(path) = &options.normals {
        return normals(options, path, size);
    }
    if let Some((placed, notes)) = options.shape_options.place(size, warnings)? {
        return Ok((Object::Surface(placed), notes));
    }
    let object = match (options.shape, options.shape_options.camera(size)?) {
        (Shape::Sphere, None) => Object::Sphere(options.circle),
        (Shape::Sphere, Some(camera)) => Object::Ball(camera),
        (Shape::Ellipsoid, None) => Object::Ellipsoid(options.depth_axis),
        (Shape::Ellipsoid, Some(_)) => bail!(
            "--shape ellipsoid and --camera do not go together: an ellipsoid is fitted under an orthographic camera; give a --mesh"
        ),
    };
    Ok((object, Value::Null))
}

/// Any shape, by a picture of its normals.
fn normals(options: &Options, path: &Path, size: (usize, usize)) -> Result<(Object, Value)> {
    let more = &options.normal_options;
    let correction = Correction {
        order: more.normals_order.0,
        flip_x: more.normals_flip_x,
        flip_y: more.normals_flip_y,
        flip_z: more.normals_flip_z,
    };
    let normals = correction.apply_to(&gonio_io::normals::read_normals(path)?);
    let camera = options.shape_options.camera(size)?;
    let (relief, file) = relief(options, camera, size)?.unzip();
    let notes = file.map_or(Value::Null, |file| json!({ "geometry": file.display().to_string() }));
    Ok((Object::Normals(Box::new(NormalPicture { normals, camera, relief, trusted: more.trust_normals })), notes))
}

/// The places of a picture of depths or positions, and its file.
fn relief(options: &Options, camera: Option<Camera>, size: (usize, usize)) -> Result<Option<(Relief, &PathBuf)>> {
    let more = &options.normal_options;
    let unit = || Camera::new(Projection::Orthographic { pixels_per_unit: 1.0 }, (0.0, 0.0), size);
    let (places, path, camera) = if let Some(path) = &more.depth {
        let depth = read_depth(path, &DepthOptions { range: more.depth_range, ..DepthOptions::default() })?;
        // Without a camera depths are in pixels.
        let camera = camera.map_or_else(unit, Ok)?;
        let kind = if more.depth_along_rays { DepthKind::AlongRay } else { DepthKind::AlongAxis };
        (positions_of_depth(&depth, &camera, kind).with_context(|| path.display().to_string())?, path, camera)
    } else if let Some(path) = &more.positions {
        let Some(camera) = camera else {
            bail!("{}: positions need the camera that saw them; give --camera FILE.json", path.display());
        };
        (read_positions(path)?, path, camera)
    } else {
        return Ok(None);
    };
    if places.size() != size {
        let ((w, h), (pw, ph)) = (places.size(), size);
        bail!("{} is {w}x{h} and {} {pw}x{ph}: make both of one size", path.display(), options.image.display());
    }
    Ok(Some((Relief { places, camera }, path)))
}
