//! What a photograph shows, and where.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::scene::{
    Circle, Correction, ObservationSettings, Observations, Orientation, SurfaceView, background_coverage, find_ball,
    find_ellipse, find_sphere,
};
use gonio::shape::{Camera, DepthKind, GeometryBuffer, Mesh, Projection, Tracer, positions_of_depth};
use gonio::sphere::OctahedralMap;
use gonio_io::geometry::{DepthOptions, read_depth, read_positions};
use serde_json::{Value, json};

use super::{Options, Shape};
use crate::progress::Stage;
use crate::shape::Placed;

/// Edges of a surface of places more than so many times as long as the median one are steps.
const STEP: f64 = 8.0;

/// A mesh that shares less than this with the mask is somewhere else.
const LEAST_OVERLAP: f64 = 0.5;
/// And with less than this it does not quite fit.
const GOOD_OVERLAP: f64 = 0.93;

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
    /// Picture of the object's depth (EXR, NPY, 16-bit PNG), to know which light it keeps from itself
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

/// What the picture shows, and where.
pub(super) struct Scene {
    pub(super) observations: Observations,
    pub(super) coverage: Option<Plane<f32>>,
    pub(super) circle: Option<Circle>,
    pub(super) normals: Option<Plane<Vec3>>,
    /// The surface that shadows itself, and its camera.
    pub(super) placed: Option<Placed>,
    pub(super) notes: Value,
}

/// Finds the object and samples the picture on it.
pub(super) fn observe(
    options: &Options,
    picture: &Picture,
    clip: Option<f32>,
    map: OctahedralMap,
    warnings: &mut Vec<String>,
) -> Result<Scene> {
    let name = || options.image.display().to_string();
    let mask = options.mask.as_deref().map(gonio_io::picture::read_mask).transpose()?;
    if let (Some(mask), Some(path)) = (&mask, &options.mask)
        && mask.size() != picture.rgb.size()
    {
        let ((w, h), (pw, ph)) = (mask.size(), picture.rgb.size());
        bail!("{}: the mask is {w}x{h}, the photograph {pw}x{ph}; give one of the same size", path.display());
    }
    let coverage = mask.or_else(|| picture.alpha.clone()).or_else(|| background_coverage(&picture.rgb));
    let looker = Looker { options, picture, coverage, settings: ObservationSettings { clip, ..Default::default() } };
    let size = picture.rgb.size();
    let mut scene = if options.normals.is_some() {
        looker.normals(warnings)?
    } else if let Some(placed) = options.shape_options.place(size, warnings)? {
        looker.surface(placed, warnings)?
    } else {
        looker.outline(warnings)?
    };
    if let (Some(placed), false) = (&scene.placed, options.no_shadows) {
        let stage = Stage::new("asking which light is hidden");
        scene
            .observations
            .shadowed_by(placed.surface.as_ref(), &placed.camera, (map, options.grid), &|x| stage.at(x))?;
        let seconds = stage.finish();
        scene.notes["visibility"] = json!({
            "hidden": scene.observations.visibility.is_some(),
            "bytes": scene.observations.visibility.as_ref().map(gonio::shape::Visibility::bytes),
            "seconds": seconds,
        });
    }
    let report = &scene.observations.report;
    if report.clipped_pixels > 0 {
        warnings.push(format!(
            "{}: {} of {} pixels on the object are clipped and left out",
            name(),
            report.clipped_pixels,
            report.observed_pixels
        ));
    }
    scene.notes["report"] = json!(report);
    Ok(scene)
}

/// What is known before the shape is.
struct Looker<'a> {
    options: &'a Options,
    picture: &'a Picture,
    coverage: Option<Plane<f32>>,
    settings: ObservationSettings,
}

impl Looker<'_> {
    fn name(&self) -> String {
        self.options.image.display().to_string()
    }

    /// A ball or an ellipsoid, from its outline.
    fn outline(self, warnings: &mut Vec<String>) -> Result<Scene> {
        let Some(coverage) = &self.coverage else {
            if let (Some(circle), Shape::Sphere) = (self.options.circle, self.options.shape) {
                return self.circle(circle);
            }
            bail!(
                "{}: no alpha channel and no constant background to tell the object from; give --mask FILE or --circle X,Y,RADIUS",
                self.name()
            );
        };
        // What is wrong with an outline is wrong with the file it comes from.
        let origin = || self.options.mask.as_ref().map_or_else(|| self.name(), |mask| mask.display().to_string());
        let size = self.picture.rgb.size();
        let camera = self.options.shape_options.camera(size)?;
        match (self.options.shape, camera) {
            (Shape::Sphere, None) => {
                let circle = match self.options.circle {
                    Some(circle) => circle,
                    None => find_sphere(coverage).with_context(origin)?.circle,
                };
                self.circle(circle)
            }
            (Shape::Sphere, Some(camera)) => {
                let ball = find_ball(coverage, &camera).with_context(origin)?;
                let notes = json!({ "ball": { "centre": ball.centre().to_array() }, "projection": camera.projection });
                self.surface(Placed { surface: Box::new(ball), camera, notes }, warnings)
            }
            (Shape::Ellipsoid, None) => {
                let ellipse = find_ellipse(coverage).with_context(origin)?;
                let depth = self.options.depth_axis.unwrap_or((ellipse.axes.0 * ellipse.axes.1).sqrt());
                let surface = Box::new(ellipse.with_depth(depth).with_context(origin)?);
                let camera = Camera::new(Projection::Orthographic { pixels_per_unit: 1.0 }, (0.0, 0.0), size)?;
                if self.options.depth_axis.is_none() {
                    warnings.push(format!(
                        "the outline does not tell how deep the ellipsoid is: {depth:.1} pixels were taken, the geometric mean of the other two \
                         semi-axes; give --depth-axis PIXELS if you know it"
                    ));
                }
                self.surface(
                    Placed { surface, camera, notes: json!({ "ellipse": ellipse, "depth_axis": depth }) },
                    warnings,
                )
            }
            (Shape::Ellipsoid, Some(_)) => bail!(
                "--shape ellipsoid and --camera do not go together: an ellipsoid is fitted under an orthographic camera; give a --mesh"
            ),
        }
    }

    /// A ball seen orthographically.
    fn circle(self, circle: Circle) -> Result<Scene> {
        let observations = Observations::of_sphere(self.picture, &circle, self.coverage.as_ref(), &self.settings)
            .with_context(|| self.name())?;
        let notes = json!({ "circle": circle });
        Ok(Scene { observations, coverage: self.coverage, circle: Some(circle), normals: None, placed: None, notes })
    }

    /// A surface before a camera.
    fn surface(self, placed: Placed, warnings: &mut Vec<String>) -> Result<Scene> {
        let buffer = GeometryBuffer::of(placed.surface.as_ref(), &placed.camera);
        let what = || match &self.options.shape_options.mesh {
            Some(mesh) => format!("{} with {}", self.name(), mesh.display()),
            None => self.name(),
        };
        if let Some(coverage) = &self.coverage {
            let both = coverage.as_slice().iter().zip(buffer.distances.as_slice());
            let (mut either, mut shared) = (0_usize, 0_usize);
            for (covered, distance) in both.map(|(c, d)| (*c >= 0.5, d.is_finite())) {
                either += usize::from(covered || distance);
                shared += usize::from(covered && distance);
            }
            let overlap = shared as f64 / either.max(1) as f64;
            if overlap < LEAST_OVERLAP {
                bail!(
                    "{}: the shape does not lie on the object: only {:.0} % of the pixels of either belong to both; check --pose and --camera",
                    what(),
                    100.0 * overlap
                );
            }
            if overlap < GOOD_OVERLAP {
                warnings.push(format!(
                    "{}: the shape does not quite fit the object: {:.0} % of the pixels of either belong to both",
                    what(),
                    100.0 * overlap
                ));
            }
        }
        if 20 * buffer.inside > buffer.seen {
            warnings.push(format!(
                "{}: {} of {} pixels see the back of the surface; its normals were turned to the camera there",
                what(),
                buffer.inside,
                buffer.seen
            ));
        }
        let view =
            SurfaceView { normals: &buffer.normals, camera: Some(&placed.camera), distances: Some(&buffer.distances) };
        let observations =
            Observations::of_view(self.picture, &view, self.coverage.as_ref(), &self.settings).with_context(what)?;
        let notes = json!({ "shape": placed.notes, "pixels": { "seen": buffer.seen, "inside": buffer.inside } });
        let normals = Some(buffer.normals);
        Ok(Scene { observations, coverage: self.coverage, circle: None, normals, placed: Some(placed), notes })
    }

    /// Any shape, by a picture of its normals.
    fn normals(self, warnings: &mut Vec<String>) -> Result<Scene> {
        let options = &self.options.normal_options;
        let path = self.options.normals.as_ref().context("without --normals")?;
        let correction = Correction {
            order: options.normals_order.0,
            flip_x: options.normals_flip_x,
            flip_y: options.normals_flip_y,
            flip_z: options.normals_flip_z,
        };
        let normals = correction.apply_to(&gonio_io::normals::read_normals(path)?);
        let what = || {
            let mask = self.options.mask.as_ref().map(|mask| format!(" and {}", mask.display())).unwrap_or_default();
            format!("{} with {}{mask}", self.name(), path.display())
        };
        if normals.size() == self.picture.rgb.size() {
            let orientation = Orientation::of(&normals, self.coverage.as_ref()).with_context(what)?;
            match orientation.complaint() {
                Some(complaint) if options.trust_normals => warnings.push(format!("{}: {complaint}", path.display())),
                Some(complaint) => {
                    bail!("{}: {complaint}, or --trust-normals to take them as they are", path.display())
                }
                None => (),
            }
        }
        let size = self.picture.rgb.size();
        let camera = self.options.shape_options.camera(size)?;
        let view = SurfaceView { normals: &normals, camera: camera.as_ref(), distances: None };
        let observations =
            Observations::of_view(self.picture, &view, self.coverage.as_ref(), &self.settings).with_context(what)?;
        let placed = self.relief(camera)?;
        let notes = json!({ "shape": placed.as_ref().map(|p| &p.notes) });
        Ok(Scene { observations, coverage: self.coverage, circle: None, normals: Some(normals), placed, notes })
    }

    /// The surface of a picture of depths or positions.
    fn relief(&self, camera: Option<Camera>) -> Result<Option<Placed>> {
        let options = &self.options.normal_options;
        let size = self.picture.rgb.size();
        let unit = || Camera::new(Projection::Orthographic { pixels_per_unit: 1.0 }, (0.0, 0.0), size);
        let (mut places, path, camera) = if let Some(path) = &options.depth {
            let depth = read_depth(path, &DepthOptions { range: options.depth_range, ..DepthOptions::default() })?;
            // Without a camera depths are in pixels.
            let camera = camera.map_or_else(unit, Ok)?;
            let kind = if options.depth_along_rays { DepthKind::AlongRay } else { DepthKind::AlongAxis };
            (positions_of_depth(&depth, &camera, kind).with_context(|| path.display().to_string())?, path, camera)
        } else if let Some(path) = &options.positions {
            let Some(camera) = camera else {
                bail!("{}: positions need the camera that saw them; give --camera FILE.json", path.display());
            };
            (read_positions(path)?, path, camera)
        } else {
            return Ok(None);
        };
        if places.size() != size {
            let ((w, h), (pw, ph)) = (places.size(), size);
            bail!("{} is {w}x{h} and {} {pw}x{ph}: make both of one size", path.display(), self.name());
        }
        if let Some(coverage) = &self.coverage {
            let cut = places.as_slice().iter().zip(coverage.as_slice()).map(|(p, c)| p.filter(|_| *c >= 0.5));
            places = Plane::from_vec(size.0, size.1, cut.collect());
        }
        let (mesh, soundness) = Mesh::of_positions(&places, STEP).with_context(|| path.display().to_string())?;
        let notes =
            json!({ "geometry": path.display().to_string(), "soundness": soundness, "projection": camera.projection });
        Ok(Some(Placed { surface: Box::new(Tracer::new(mesh)), camera, notes }))
    }
}
