//! Trained models and their parts: light prior, reflectance basis and posterior of materials.
//!
//! The format is described in `docs/model-format.md`: a safetensors file, versioned, with a
//! checksum. Equal models give identical files. Decoding applies the checks of [`gonio::model`];
//! encoding does not.

mod container;
mod posterior;
#[cfg(test)]
mod tests;

use std::path::Path;

use gonio::inference::learnt::LearntPosterior;
use gonio::lighting::LightPrior;
use gonio::model::{Model, check_light, check_reflectance};
use gonio::reflectance::{BivariateTable, CELLS, ReflectanceBasis, THETA_D, THETA_H, TrainingMaterial};
use serde::{Deserialize, Serialize};

use crate::{Error, guard};
use container::{Container, Metadata, Tensor};

/// Longest file read, 64 MiB: nine times the embedded model.
const MAX_BYTES: u64 = 64 << 20;

/// Kind of content of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    Model,
    Lighting,
    Reflectance,
    Posterior,
    Checkpoint,
}

impl Content {
    const ALL: [Self; 5] = [Self::Model, Self::Lighting, Self::Reflectance, Self::Posterior, Self::Checkpoint];

    /// Returns the `kind` in the metadata, and the description in messages.
    fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::Model => ("model", "a whole model"),
            Self::Lighting => ("lighting", "a light prior alone"),
            Self::Reflectance => ("reflectance", "a reflectance basis alone"),
            Self::Posterior => ("posterior", "a posterior of materials alone"),
            Self::Checkpoint => ("checkpoint", "a checkpoint of an unfinished training"),
        }
    }

    fn name(self) -> &'static str {
        self.names().0
    }

    fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|content| content.name() == name)
    }

    fn label(self) -> &'static str {
        self.names().1
    }

    fn command(self) -> String {
        match self {
            Self::Checkpoint => "gonio train posterior".to_owned(),
            _ => format!("gonio train {}", self.name()),
        }
    }

    /// Describes the expected file, for the suggestion in an error message.
    fn wanted(self) -> String {
        format!("a file written by `{}`", self.command())
    }
}

/// Encodes a whole model.
pub fn encode_model(model: &Model) -> Vec<u8> {
    let mut metadata = lighting_metadata(&model.light);
    let (more, tensors) = reflectance_parts(&model.reflectance);
    metadata.extend(more);
    let mut tensors = Vec::from(tensors);
    if let Some(learnt) = &model.learnt {
        let (more, parts) = posterior::parts(learnt);
        metadata.extend(more);
        tensors.extend(parts);
    }
    encode(Content::Model, metadata, &model.provenance, &tensors)
}

/// Encodes a light prior, with a note of its origin.
pub fn encode_lighting(prior: &LightPrior, provenance: &str) -> Vec<u8> {
    encode(Content::Lighting, lighting_metadata(prior), provenance, &[])
}

/// Encodes a reflectance basis, with a note of its origin.
pub fn encode_reflectance(basis: &ReflectanceBasis, provenance: &str) -> Vec<u8> {
    let (metadata, tensors) = reflectance_parts(basis);
    encode(Content::Reflectance, metadata, provenance, &tensors)
}

/// Encodes a posterior of materials, with a note of its origin.
pub fn encode_posterior(learnt: &LearntPosterior, provenance: &str) -> Vec<u8> {
    let (metadata, tensors) = posterior::parts(learnt);
    encode(Content::Posterior, metadata, provenance, &tensors)
}

/// Encodes the arrays of a training checkpoint, with a note.
pub fn encode_arrays(note: &str, arrays: &[&[f32]]) -> Vec<u8> {
    let tensor = |(at, values): (usize, &&[f32])| Tensor::f32(at.to_string(), &[values.len()], values);
    let tensors: Vec<Tensor> = arrays.iter().enumerate().map(tensor).collect();
    encode(Content::Checkpoint, Metadata::from([("arrays", arrays.len().to_string())]), note, &tensors)
}

/// Decodes what [`encode_arrays`] encoded: the note and the arrays. `path` is only used in error
/// messages.
///
/// # Errors
/// If the bytes are not such a file, or are damaged.
pub fn decode_arrays(path: &Path, bytes: &[u8]) -> Result<(String, Vec<Vec<f32>>), Error> {
    let file = Container::decode(path, bytes, Content::Checkpoint)?;
    let count: usize = file.json("arrays")?;
    let arrays = (0..count.min(bytes.len()))
        .map(|at| Ok(file.f32s(&at.to_string(), &[None])?.1))
        .collect::<Result<_, Error>>()?;
    Ok((provenance(&file)?, arrays))
}

fn encode(content: Content, mut metadata: Metadata, provenance: &str, tensors: &[Tensor]) -> Vec<u8> {
    metadata.insert("provenance", provenance.to_owned());
    container::encode(content, metadata, tensors)
}

/// Decodes a model held in memory; `path` is only used in error messages.
///
/// # Errors
/// If the bytes are not a model of this version, are damaged or incomplete, or fail
/// [`Model::check`].
pub fn decode_model(path: &Path, bytes: &[u8]) -> Result<Model, Error> {
    let file = Container::decode(path, bytes, Content::Model)?;
    let posterior = file.says(posterior::NAMES).then(|| posterior::of(&file)).transpose()?;
    let (light, reflectance) = (lighting(&file)?, reflectance(&file)?);
    Ok(Model { light, reflectance, learnt: posterior, provenance: provenance(&file)? })
}

/// Decodes a light prior held in memory, and the note of its origin. `path` is only used in error
/// messages.
///
/// # Errors
/// See [`decode_model`].
pub fn decode_lighting(path: &Path, bytes: &[u8]) -> Result<(LightPrior, String), Error> {
    let file = Container::decode(path, bytes, Content::Lighting)?;
    Ok((lighting(&file)?, provenance(&file)?))
}

/// Decodes a reflectance basis held in memory, and the note of its origin. `path` is only used in
/// error messages.
///
/// # Errors
/// See [`decode_model`].
pub fn decode_reflectance(path: &Path, bytes: &[u8]) -> Result<(ReflectanceBasis, String), Error> {
    let file = Container::decode(path, bytes, Content::Reflectance)?;
    Ok((reflectance(&file)?, provenance(&file)?))
}

/// Decodes a posterior of materials held in memory, and the note of its origin. `path` is only used
/// in error messages.
///
/// # Errors
/// See [`decode_model`].
pub fn decode_posterior(path: &Path, bytes: &[u8]) -> Result<(LearntPosterior, String), Error> {
    let file = Container::decode(path, bytes, Content::Posterior)?;
    Ok((posterior::of(&file)?, provenance(&file)?))
}

/// Decodes the model built into the program; `model/PROVENANCE.md` lists its training data.
///
/// # Errors
/// Never in a build that passed its tests.
pub fn embedded() -> Result<Model, Error> {
    decode_model(Path::new(EMBEDDED), include_bytes!("../../model/gonio-1.model"))
}

const EMBEDDED: &str = "the embedded model";

/// Returns the file of the embedded model with rounded 32-bit numbers.
///
/// Numbers are rounded to `digits` binary digits (1 to 24), which improves compression.
///
/// # Errors
/// Never in a build that passed its tests.
pub fn embedded_rounded(digits: u32) -> Result<Vec<u8>, Error> {
    let bytes = include_bytes!("../../model/gonio-1.model");
    container::rounded(Path::new(EMBEDDED), bytes, Content::Model, digits)
}

/// Training data of the embedded models and their terms, for display; `model/PROVENANCE.md` has the
/// details.
pub const EMBEDDED_SOURCES: &str = "\
59 captured lights of Poly Haven: CC0 (we inferred the authorship of 8 of them)
7 captured lights of the sIBL Archive: CC BY-NC-SA 3.0 US (not verified), no commercial use
6 captured lights of others: various or unknown terms
100 materials of the MERL database, reconstructed: CC BY-SA 4.0 according to its readme of
  2023, research use only according to that of 2006
41 measurements for the model of colours (33 of EPFL/RGL, 8 of Nielsen et al.), reconstructed: the
  authors request citation";

/// Decodes the light prior for the paper's version of the inference.
///
/// It uses the map of Praun and Hoppe and contains each light at one azimuth.
///
/// # Errors
/// Never in a build that passed its tests.
pub fn lighting_of_paper() -> Result<LightPrior, Error> {
    let bytes = include_bytes!("../../model/paper.prior");
    Ok(decode_lighting(Path::new("the embedded prior of the paper's version"), bytes)?.0)
}

/// Reads a whole model.
///
/// # Errors
/// If the file cannot be read, and the errors of [`decode_model`].
pub fn read_model(path: impl AsRef<Path>) -> Result<Model, Error> {
    decode_model(path.as_ref(), &guard::read_whole(path.as_ref(), MAX_BYTES)?)
}

/// Reads the bytes of any of these files without decoding them.
///
/// # Errors
/// If the file cannot be read.
pub fn read_part(path: impl AsRef<Path>) -> Result<Vec<u8>, Error> {
    guard::read_whole(path.as_ref(), MAX_BYTES)
}

/// Reads a light prior and the note of its origin.
///
/// # Errors
/// If the file cannot be read, and the errors of [`decode_model`].
pub fn read_lighting(path: impl AsRef<Path>) -> Result<(LightPrior, String), Error> {
    decode_lighting(path.as_ref(), &guard::read_whole(path.as_ref(), MAX_BYTES)?)
}

/// Reads a reflectance basis and the note of its origin.
///
/// # Errors
/// If the file cannot be read, and the errors of [`decode_model`].
pub fn read_reflectance(path: impl AsRef<Path>) -> Result<(ReflectanceBasis, String), Error> {
    decode_reflectance(path.as_ref(), &guard::read_whole(path.as_ref(), MAX_BYTES)?)
}

/// Reads a posterior of materials and the note of its origin.
///
/// # Errors
/// If the file cannot be read, and the errors of [`decode_model`].
pub fn read_posterior(path: impl AsRef<Path>) -> Result<(LearntPosterior, String), Error> {
    decode_posterior(path.as_ref(), &guard::read_whole(path.as_ref(), MAX_BYTES)?)
}

/// Metadata of a training material; its coefficients are a row of a tensor.
#[derive(Serialize, Deserialize)]
struct MaterialEntry {
    name: String,
    scale: f64,
}

fn provenance(file: &Container<'_>) -> Result<String, Error> {
    file.text("provenance").map(str::to_owned)
}

fn lighting_metadata(prior: &LightPrior) -> Metadata {
    Metadata::from([("light", serde_json::to_string(prior).expect("a prior is JSON"))])
}

fn lighting(file: &Container<'_>) -> Result<LightPrior, Error> {
    let prior = file.json("light")?;
    check_light(&prior).map_err(|e| file.wrong(format!("contains an invalid model: {e}")))?;
    Ok(prior)
}

fn reflectance_parts(basis: &ReflectanceBasis) -> (Metadata, [Tensor; 3]) {
    let k = basis.len();
    let entry = |m: &TrainingMaterial| MaterialEntry { name: m.name.clone(), scale: m.scale };
    let entries: Vec<MaterialEntry> = basis.materials.iter().map(entry).collect();
    let materials = serde_json::to_string(&entries).expect("names and numbers are JSON");
    let coefficients: Vec<f64> = basis.materials.iter().flat_map(|m| &m.coefficients).copied().collect();
    let values: Vec<f32> = basis.functions.iter().flat_map(BivariateTable::as_slice).copied().collect();
    let tensors = [
        Tensor::f64("coefficients", &[basis.materials.len(), k], &coefficients),
        Tensor::f64("rates", &[basis.rates.len()], &basis.rates),
        Tensor::f32("functions", &[k, THETA_H, THETA_D], &values),
    ];
    (Metadata::from([("materials", materials)]), tensors)
}

fn reflectance(file: &Container<'_>) -> Result<ReflectanceBasis, Error> {
    let (shape, values) = file.f32s("functions", &[None, Some(THETA_H), Some(THETA_D)])?;
    let functions: Vec<_> = values.chunks_exact(CELLS).map(|v| BivariateTable::from_vec(v.to_vec())).collect();
    let k = shape[0];
    let (_, rates) = file.f64s("rates", &[Some(k)])?;
    let entries: Vec<MaterialEntry> = file.json("materials")?;
    let (_, coefficients) = file.f64s("coefficients", &[Some(entries.len()), Some(k)])?;
    let material = |(i, MaterialEntry { name, scale }): (usize, MaterialEntry)| TrainingMaterial {
        name,
        scale,
        coefficients: coefficients[i * k..][..k].to_vec(),
    };
    let materials = entries.into_iter().enumerate().map(material).collect();
    let basis = ReflectanceBasis { functions, rates, materials };
    check_reflectance(&basis).map_err(|e| file.wrong(format!("contains an invalid model: {e}")))?;
    Ok(basis)
}
