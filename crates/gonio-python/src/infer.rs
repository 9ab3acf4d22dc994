//! Inference from a photograph to the values of a `gonio.Posterior`.

use glam::Vec3;
use gonio::colour::ChromaField;
use gonio::estimate::MaterialEstimate;
use gonio::lighting::EnvironmentMap;
use gonio::model::Model as Known;
use gonio::picture::Plane;
use gonio::reflectance::{BivariateTable, THETA_D, THETA_H};
use gonio::scene::Circle;
use gonio_app::names::{ALIGNMENTS, COLOURS, SOLVERS, named};
use gonio_app::regions::{self, Regions};
use gonio_app::{
    Alignment, AppError, ColourMode, EnvironmentSource, InferenceResult, KnownLight, Method, MirrorBall, ProgressLog,
    Source, Spaces,
};
use gonio_io::colour_space::ColourSpace;
use gonio_io::result;
use gonio_paper::{PaperMethod, PaperSettings};
use gonio_report::panels::Panels;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays;
use crate::error::raise;
use crate::error::words;
use crate::likelihood::Likelihood;
use crate::model::Model;
use crate::scene::{PictureArg, SceneArg};
use crate::work::{self, Listeners};

/// Settings of the inference.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct InferSettings<'py> {
    method: String,
    starts: usize,
    seed: u64,
    solver: String,
    all_observations: bool,
    grid: usize,
    light: Option<PictureArg<'py>>,
    mirror_ball: Option<(f64, f64, f64)>,
    mirror_reflectance: Option<[f64; 3]>,
    align_light: String,
    absolute: bool,
    shadows: bool,
    color: String,
    light_color: Option<[f64; 3]>,
    pictures: bool,
    report: bool,
    colorspace: Option<String>,
    output_colorspace: String,
}

impl InferSettings<'_> {
    /// Returns the method from names that the package has checked.
    fn method(&self, py: Python<'_>) -> PyResult<Method> {
        let to_error = |error: AppError| raise(&error, py);
        let search = PaperSettings {
            method: if self.method == "joint-map" { PaperMethod::JointMap } else { PaperMethod::Variational },
            solver: named("solver", &self.solver, SOLVERS).map_err(to_error)?,
            starts: self.starts,
            seed: self.seed,
            as_printed: self.method == "paper",
            all_observations: self.all_observations,
            ..PaperSettings::default()
        };
        let map = match &self.light {
            None => None,
            Some(PictureArg::File(path)) => Some(Source::File(path.clone())),
            Some(PictureArg::Array(rgb) | PictureArg::WithAlpha((rgb, _))) => {
                let map = EnvironmentMap::new(self.in_working_space(arrays::colours(rgb)?));
                Some(Source::Memory(map.map_err(|error| to_error(AppError::of("the light", error)))?))
            }
        };
        let alignment = named("align_light", &self.align_light, ALIGNMENTS).map_err(to_error)?;
        if let Some((x, y, radius)) = self.mirror_ball {
            let ball = MirrorBall {
                circle: Circle { x, y, radius },
                reflectance: self.mirror_reflectance.unwrap_or([1.0; 3]),
            };
            return Ok(Method::KnownLight(KnownLight {
                map: EnvironmentSource::MirrorBall(ball),
                alignment: Alignment::Fixed,
                absolute: self.mirror_reflectance.is_some(),
            }));
        }
        match (self.method.as_str(), map) {
            ("known-light", Some(map)) => Ok(Method::KnownLight(KnownLight {
                map: EnvironmentSource::Map(map),
                alignment,
                absolute: self.absolute,
            })),
            ("known-light-basis", Some(map)) => Ok(Method::KnownLightBasis(search, map)),
            ("learnt", _) => Ok(Method::Learnt),
            ("variational" | "paper" | "joint-map", _) => Ok(Method::Paper(search)),
            (other, _) => {
                let problem = format!("method {other:?}: unknown method, or its light is missing");
                Err(to_error(AppError::new(problem)))
            }
        }
    }

    /// Returns the colour spaces from names that the package has checked.
    fn spaces(&self) -> Spaces {
        let named = |name: &str| ColourSpace::named(name);
        Spaces {
            input: self.colorspace.as_deref().and_then(named),
            output: named(&self.output_colorspace).unwrap_or_default(),
        }
    }

    /// Converts an environment map in memory to linear Rec. 709.
    fn in_working_space(&self, map: Plane<Vec3>) -> Plane<Vec3> {
        match self.spaces().input {
            None | Some(ColourSpace::Rec709) => map,
            Some(space) => {
                let matrix = space.to_rec709().as_mat3();
                map.map(|v| (matrix * *v).max(Vec3::ZERO))
            }
        }
    }

    fn colours(&self) -> Result<ColourMode, AppError> {
        match (named("color", &self.color, COLOURS)?, self.light_color) {
            (color, None) => Ok(color),
            (ColourMode::Estimate, Some(rgb)) => ColourMode::under(rgb)
                .ok_or_else(|| AppError::new("light_color: must be three positive linear numbers")),
            (_, Some(_)) => Err(AppError::new("light_color requires color=\"estimate\"")),
        }
    }
}

/// Runs the inference; returns the values of a `Posterior` or of a `BasisPosterior` by name.
#[pyfunction]
pub(crate) fn infer<'py>(
    py: Python<'py>,
    scene: SceneArg<'py>,
    settings: InferSettings<'py>,
    model: &Bound<'py, Model>,
    listeners: Listeners,
) -> PyResult<Bound<'py, PyDict>> {
    let scene = scene.take()?;
    let inferred = work_on(py, settings, model, listeners, move |model, settings, progress_log| {
        gonio_app::infer(model, scene, settings, progress_log)
    })?;
    result_dict(py, inferred, model)
}

/// Runs an inference on a separate thread.
fn work_on<T: Send + 'static>(
    py: Python<'_>,
    settings: InferSettings<'_>,
    model: &Bound<'_, Model>,
    listeners: Listeners,
    infer: impl FnOnce((&Known, &str), &gonio_app::Settings<'_>, &ProgressLog<'_>) -> Result<T, AppError> + Send + 'static,
) -> PyResult<T> {
    let (known, name) = (model.get().model.clone(), model.get().name.clone());
    let method = settings.method(py)?;
    let colours = settings.colours().map_err(|error| raise(&error, py))?;
    let spaces = settings.spaces();
    let InferSettings { grid: side, shadows, pictures, report, .. } = settings;
    work::run(py, listeners, move |reporter| {
        let listener = |stage, fraction| reporter.at(stage, fraction);
        let settings = gonio_app::Settings { method, side, shadows, colours, spaces, pictures, report, words: &words };
        infer((&known, &name), &settings, &ProgressLog::new("reading", &listener))
    })
}

/// Regions: a label image, outlines, or balls to detect.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct GivenRegions<'py> {
    labels: Option<PictureArg<'py>>,
    circles: Option<Vec<(f64, f64, f64)>>,
}

impl GivenRegions<'_> {
    pub(crate) fn take(self) -> PyResult<Regions> {
        Ok(match (self.labels, self.circles) {
            (Some(PictureArg::File(path)), _) => Regions::Labels(Source::File(path)),
            (Some(PictureArg::Array(rgb) | PictureArg::WithAlpha((rgb, _))), _) => {
                Regions::Labels(Source::Memory(arrays::colours(&rgb)?))
            }
            (None, Some(circles)) => {
                Regions::Circles(circles.into_iter().map(|(x, y, radius)| Circle { x, y, radius }).collect())
            }
            (None, None) => Regions::Balls,
        })
    }
}

/// Name and values of the posterior of each region.
type NamedPosteriors<'py> = Vec<(String, Bound<'py, PyDict>)>;

/// Infers several materials under one light. Returns the name of each region with the values of a
/// `Posterior` by name, and the warnings about the whole photograph.
#[pyfunction]
pub(crate) fn infer_regions<'py>(
    py: Python<'py>,
    scene: SceneArg<'py>,
    regions: GivenRegions<'py>,
    settings: InferSettings<'py>,
    model: &Bound<'py, Model>,
    listeners: Listeners,
) -> PyResult<(NamedPosteriors<'py>, Vec<String>)> {
    let (scene, regions) = (scene.take()?, regions.take()?);
    let several = work_on(py, settings, model, listeners, move |model, settings, progress_log| {
        regions::infer_regions(model, scene, &regions, settings, progress_log)
    })?;
    let named = several.regions.into_iter().map(|region| Ok((region.name, result_dict(py, region.result, model)?)));
    Ok((named.collect::<PyResult<_>>()?, several.document.warnings))
}

/// Returns all pictures by name: those of a result folder and the panels that they consist of.
fn pictures(inferred: &InferenceResult) -> Vec<(&'static str, Plane<Vec3>)> {
    let mut pictures = inferred.pictures();
    if let Some(panels) = &inferred.panels {
        let Panels { photograph, observed, reproduction, residual, light, spheres, .. } = panels;
        let named = [photograph, observed, reproduction, residual, light].map(Clone::clone);
        pictures.extend(["photograph", "observed", "reproduction", "residual", "light"].into_iter().zip(named));
        // The pictures of a result folder already contain the first sphere.
        pictures.extend(spheres.iter().skip(1).cloned());
    }
    pictures
}

/// Returns a dictionary of a BRDF with the keys of `gonio._types.BrdfData`.
fn of_table<'py>(py: Python<'py>, table: BivariateTable, field: &ChromaField) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("table", arrays::of_tables(py, &field.tables(&table)))?;
    let two = [field.body(&table), field.highlight(&table)].map(|colour| colour.rgb().to_array());
    out.set_item("colors", arrays::array(py, (2, 3), two.concat()))?;
    out.set_item("luminance", arrays::array(py, (THETA_H, THETA_D), table.into()))?;
    Ok(out)
}

/// Returns a dictionary of a material with the keys of `gonio._types.MaterialData`.
pub(crate) fn of_material<'py>(
    py: Python<'py>,
    material: &MaterialEstimate,
    (field, channels): (&ChromaField, Option<[Vec<Vec<f32>>; 3]>),
    scale: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let shape = (THETA_H, THETA_D);
    let out = of_table(py, material.table.scaled(scale), field)?;
    let ends = material.ends.tables.each_ref().map(|end| arrays::of_tables(py, &field.tables(&end.scaled(scale))));
    out.set_item("ends", ends)?;
    let quantiles: Vec<f32> = material.quantiles.iter().flatten().map(|v| v * scale as f32).collect();
    out.set_item("luminance_quantiles", arrays::array(py, (material.quantiles.len(), THETA_H, THETA_D), quantiles))?;
    let channels = channels.map(|channels| {
        let count = material.quantiles.len();
        let cells = (0..count).flat_map(|q| (0..THETA_H * THETA_D).map(move |cell| (q, cell)));
        let values = cells.flat_map(|(q, cell)| channels.each_ref().map(|channel| channel[q][cell] * scale as f32));
        arrays::array(py, (count, THETA_H, THETA_D, 3), values.collect::<Vec<f32>>())
    });
    out.set_item("rgb_quantiles", channels)?;
    out.set_item("undetermined", arrays::array(py, shape, material.undetermined.clone()))?;
    out.set_item("undetermined_share", material.undetermined_share)?;
    let materials: Vec<(String, f64)> =
        material.posterior.neighbours.iter().map(|n| (n.name.clone(), n.weight)).collect();
    out.set_item("materials", materials)?;
    let three = |values: [f64; 3]| arrays::array(py, 3, values.to_vec());
    out.set_item("peak_height", three(material.peak_height))?;
    out.set_item("ggx_alpha", three(material.highlight.alpha))?;
    // Gloss units are proportional to the scale of the table.
    out.set_item("gloss_units", material.highlight.units.map(|units| three(units.map(|u| u * scale))))?;
    out.set_item("verdict", material.verdict())?;
    Ok(out)
}

/// Converts pictures to a dictionary of sRGB samples of shape (height, width, 3) by name.
pub(crate) fn shown<'py>(py: Python<'py>, pictures: Vec<(&'static str, Plane<Vec3>)>) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    for (name, picture) in pictures {
        out.set_item(name, arrays::coded(py, &picture))?;
    }
    Ok(out)
}

/// Returns a dictionary of the results with the keys of `gonio._types.PosteriorData`. For methods
/// that estimate coefficients only, the keys are those of `BasisData`.
fn result_dict<'py>(
    py: Python<'py>,
    inferred: InferenceResult,
    model: &Bound<'py, Model>,
) -> PyResult<Bound<'py, PyDict>> {
    let (field, light_colour) = (inferred.colouring.field(), inferred.colouring.light());
    let channels = inferred.material.as_ref().map(|material| inferred.colouring.quantiles(material));
    let pictures = pictures(&inferred);
    let estimated = inferred.light.as_ref().map(|light| inferred.lat_long(light));
    let light = estimated.or_else(|| inferred.known_light.as_ref().map(|light| light.radiance().clone()));
    let albedo_map = inferred.albedo_map();
    let InferenceResult { table, material, saved, scale, residual, document, warnings, page, .. } = inferred;
    let out = match material.zip(saved) {
        Some((material, saved)) => {
            let out = of_material(py, &material, (&field, channels), scale)?;
            out.set_item("likelihood", Likelihood(saved))?;
            out.set_item("scale", scale)?;
            out.set_item("scatter", material.scatter)?;
            out
        }
        None => of_table(py, table.scaled(scale), &field)?,
    };
    out.set_item("light", light.map(|light| arrays::of_colours(py, light)))?;
    out.set_item("albedo_map", albedo_map.map(|map| arrays::of_colours(py, map)))?;
    out.set_item("light_color", arrays::array(py, 3, light_colour.to_array().to_vec()))?;
    out.set_item("misfit", residual.1)?;
    out.set_item("pictures", shown(py, pictures)?)?;
    out.set_item("warnings", warnings)?;
    out.set_item("document", result::encode(&document))?;
    out.set_item("page", page)?;
    out.set_item("model", model)?;
    Ok(out)
}
