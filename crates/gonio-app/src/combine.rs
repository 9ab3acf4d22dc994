//! Combines the results of several photographs of one material.

use std::path::{Path, PathBuf};

use glam::Vec3;
use gonio::colour::{Chroma, ChromaField, SavedChroma};
use gonio::estimate::{ALBEDO, Colouring, Combined, EstimateError, Highlight, MaterialEstimate, combine as multiply};
use gonio::inference::ProductError;
use gonio::inference::learnt::MaterialPosterior;
use gonio::model::Model;
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::encode_png;
use gonio_io::posterior::{self, SavedPosterior};
use gonio_io::result::{self, Colour, ColourSpaces, CombinedPhotograph, ModelSection, ResultDocument, UncertainColour};
use gonio_io::result_brdf::BrdfQuantiles;
use gonio_report::combined::{Shown, compose};
use gonio_report::report::{self, CombinedReport, Fits};
use gonio_report::uncertainty;

use crate::document::{combined, new, reflectance};
use crate::results::{Files, levels};
use crate::{AppError, ProgressLog};

/// Name of the picture of all materials.
const SHEET: &str = "combined";

/// Largest number of photographs in the picture.
const SHOWN: usize = 12;

/// Half of the width of the 90 % interval of a Gaussian, in standard deviations.
const HALF_WIDTH: f64 = 1.645;

/// Combined result of several photographs.
pub struct CombinedResult {
    /// The material, scaled to an albedo of 0.5 at normal incidence.
    pub material: MaterialEstimate,
    /// Chroma of each cell: the mean over the photographs, weighted by inverse variance.
    pub field: ChromaField,
    /// For each photograph, the log odds that it shows the same material as the others.
    pub agreement: Vec<f64>,
    /// Pictures by name, as linear display values.
    pub pictures: Vec<(&'static str, Plane<Vec3>)>,
    /// The photographs.
    pub photographs: Vec<report::CombinedPhotograph>,
    /// Contents of `result.json`.
    pub document: ResultDocument,
    /// Posterior to combine with further photographs.
    pub saved: SavedPosterior,
}

/// Returns the posterior to save for [`combine`]. `image` is the name of the photograph.
pub(crate) fn saved(
    model: &Model,
    image: &str,
    material: &MaterialEstimate,
    colouring: &Colouring,
) -> Option<SavedPosterior> {
    let learnt = model.learnt.as_ref()?;
    let likelihood = material.posterior.likelihood.clone();
    Some(SavedPosterior::new(learnt.id(), vec![image.to_owned()], likelihood, saved_chroma(colouring)))
}

fn saved_chroma(colouring: &Colouring) -> Option<SavedChroma> {
    let Colouring::Estimate(found) = colouring else { return None };
    Some(found.saved())
}

/// Reads the posteriors in folders of results.
///
/// # Errors
/// If a folder has no posterior, or it cannot be read.
pub fn read_posteriors(folders: &[PathBuf]) -> Result<Vec<(String, SavedPosterior)>, AppError> {
    let read = |folder: &PathBuf| {
        let name = folder.display().to_string();
        if folder.is_dir() && !folder.join(posterior::FILE).is_file() {
            let problem = format!(
                "does not contain {}; specify result folders of the learnt or known-light method",
                posterior::FILE
            );
            return Err(AppError::of(name, problem));
        }
        Ok((name, SavedPosterior::read(folder)?))
    };
    folders.iter().map(read).collect()
}

/// Combines the posteriors of several photographs of one material. `model` is the model that
/// inferred them, with its name in messages.
///
/// # Errors
/// If there are fewer than two posteriors, two have the same photograph, one is from another model,
/// only some are under a known light, or they contradict each other. The error names the faulty
/// one.
pub fn combine(
    (model, model_name): (&Model, &str),
    given: &[(String, SavedPosterior)],
    progress_log: &ProgressLog<'_>,
) -> Result<CombinedResult, AppError> {
    let learnt = model.learnt.as_ref().ok_or_else(|| AppError::of(model_name, "has no posterior of materials"))?;
    let other = "was inferred with another model; combine only results of one model, and specify this model";
    if let Some((name, _)) = given.iter().find(|(_, saved)| saved.model != learnt.id()) {
        return Err(AppError::of(name, other));
    }
    for (at, (name, saved)) in given.iter().enumerate() {
        if let Some((first, _)) = given[..at].iter().find(|(_, other)| other.likelihood == saved.likelihood) {
            return Err(AppError::of(
                name,
                format!("has the same photograph as {first}; specify each photograph once"),
            ));
        }
    }
    progress_log.report("posterior", 0.0);
    let likelihoods: Vec<_> = given.iter().map(|(_, saved)| saved.likelihood.clone()).collect();
    let Combined { material, agreement } = multiply(model, &likelihoods).map_err(|error| to_error(given, &error))?;
    let saved: Vec<SavedChroma> = given.iter().filter_map(|(_, saved)| saved.chroma.clone()).collect();
    let chroma = SavedChroma::mean(&saved);
    let field = chroma.as_ref().map_or(ChromaField::GREY, SavedChroma::field);
    let alone: Vec<MaterialPosterior> =
        likelihoods.into_iter().filter_map(|likelihood| MaterialPosterior::of(learnt, likelihood)).collect();
    progress_log.report("drawing", 0.0);
    let pictures = draw(given, &material, &alone, &field);
    let photograph = |(((name, _), posterior), agreement): ((&(String, SavedPosterior), &MaterialPosterior), &f64)| {
        let roughness = Highlight::of(posterior).roughness();
        report::CombinedPhotograph { name: name.clone(), roughness, agreement: *agreement }
    };
    let photographs = given.iter().zip(&alone).zip(&agreement).map(photograph).collect();
    let images: Vec<String> = given.iter().flat_map(|(_, saved)| saved.images.clone()).collect();
    let both = SavedPosterior::new(learnt.id(), images, material.posterior.likelihood.clone(), chroma.clone());
    let document = document(model, given, &material, &agreement, (&field, chroma.as_ref()), progress_log);
    Ok(CombinedResult { material, field, agreement, pictures, photographs, document, saved: both })
}

/// Converts the error and adds the name of the faulty photograph, if there is one.
fn to_error(given: &[(String, SavedPosterior)], error: &EstimateError) -> AppError {
    match error {
        EstimateError::Product(ProductError::Contradiction { at, .. } | ProductError::Model(at)) => {
            AppError::of(&given[*at].0, error)
        }
        error => AppError::new(error.to_string()),
    }
}

fn draw(
    given: &[(String, SavedPosterior)],
    material: &MaterialEstimate,
    alone: &[MaterialPosterior],
    field: &ChromaField,
) -> Vec<(&'static str, Plane<Vec3>)> {
    let coloured = |table: &BivariateTable| field.tables(table);
    let spheres = [
        ("combined", &material.table),
        ("dull end of the interval (5 %)", &material.ends.tables[0]),
        ("glossy end of the interval (95 %)", &material.ends.tables[1]),
    ]
    .map(|(label, table)| Shown { label: label.to_owned(), tables: coloured(table) });
    let singles: Vec<Shown> = given
        .iter()
        .zip(alone)
        .take(SHOWN)
        .map(|((name, _), posterior)| {
            let name = Path::new(name).file_name().unwrap_or_default().to_string_lossy();
            let label = name.chars().take(20).collect();
            Shown { label, tables: coloured(&posterior.mean.with_normal_albedo(ALBEDO).0) }
        })
        .collect();
    let caption = format!("combined from {} photographs | {}", given.len(), material.verdict());
    let (sheet, sphere) = compose(&spheres, &singles, &caption);
    vec![("relit", sphere), (SHEET, sheet), ("uncertainty", uncertainty::draw(material))]
}

/// Returns the contents of `result.json`.
fn document(
    model: &Model,
    given: &[(String, SavedPosterior)],
    material: &MaterialEstimate,
    agreement: &[f64],
    (field, chroma): (&ChromaField, Option<&SavedChroma>),
    progress_log: &ProgressLog<'_>,
) -> ResultDocument {
    let part = |chroma: Chroma, sd: Option<[f64; 2]>| {
        let rgb = chroma.rgb().to_array();
        let interval_90 = sd.map(|sd| [0, 1].map(|k| [-1.0, 1.0].map(|sign| chroma.0[k] + sign * HALF_WIDTH * sd[k])));
        Some(UncertainColour {
            rgb,
            log_chroma: chroma.0,
            interval_90,
            log_chroma_sd: sd,
            ..UncertainColour::default()
        })
    };
    let photograph = |((name, saved), agreement): (&(String, SavedPosterior), &f64)| CombinedPhotograph {
        folder: name.clone(),
        images: saved.images.clone(),
        agreement: *agreement,
    };
    ResultDocument {
        model: ModelSection { provenance: model.provenance.clone(), ..ModelSection::default() },
        photographs: given.iter().zip(agreement).map(photograph).collect(),
        posterior: Some(combined(material)),
        reflectance: reflectance(None),
        colour: Colour {
            source: "estimate".to_owned(),
            body: part(field.body(&material.table), chroma.map(|c| c.body_sd)),
            highlight: part(field.highlight(&material.table), None),
            ..Colour::default()
        },
        colorspace: ColourSpaces { output: ColourSpace::Rec709.name().to_owned(), ..ColourSpaces::default() },
        seconds: progress_log.seconds().into_iter().map(|(stage, seconds)| (stage.to_owned(), seconds)).collect(),
        ..new("combine")
    }
}

impl CombinedResult {
    /// Returns the page `report.html`; fits models of renderers for it.
    fn page(&self) -> Option<String> {
        let sheet = self.pictures.iter().find(|(name, _)| *name == SHEET).map(|(_, sheet)| sheet)?;
        let tables = self.field.tables(&self.material.table);
        let fits = Fits::of(&tables, Some(self.material.highlight.roughness()), false);
        let Self { material, photographs, document: result, .. } = self;
        let report = CombinedReport { name: "material", material, sheet, photographs, fits: &fits, result };
        Some(report.render())
    }

    /// Returns the contents of the folder of results.
    pub fn files(&self) -> Files {
        let luminance = self.material.quantiles.clone();
        Files {
            tables: self.field.tables(&self.material.table),
            quantiles: Some(BrdfQuantiles { levels: levels(), luminance, channels: None }),
            posterior: Some(self.saved.encode()),
            light: None,
            albedo_map: None,
            pictures: self.pictures.iter().map(|(name, picture)| (*name, encode_png(picture))).collect(),
            document: result::encode(&self.document),
            page: self.page(),
            space: ColourSpace::Rec709,
        }
    }
}
