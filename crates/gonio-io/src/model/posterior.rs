//! The learnt posterior of materials as tensors.

use gonio::inference::learnt::{Candidates, Encoder, EncoderShape, LearntPosterior};
use gonio::model::check_posterior;
use gonio::reflectance::{CELLS, LatentSpace, THETA_D, THETA_H};

use super::container::{Container, Metadata, Tensor};
use crate::Error;

/// Metadata entry that only files with a posterior have: the names of its materials.
pub(super) const NAMES: &str = "posterior";

/// Metadata entry with the sizes of the encoder's layers.
const SHAPE: &str = "encoder";

/// Metadata entry with the model of colours; files without colours do not have it.
const COLOURS: &str = "channels";

/// Prefix of the names of the encoder's tensors.
const ENCODER: &str = "encoder.";

/// Prefix of the names of the tensors of measured materials.
const MEASURED: &str = "measured.";

/// Prefix of the names of the tensors of materials drawn from the prior.
const PRIOR: &str = "prior.";

const PLACES: &str = "places";
const EMBEDDINGS: &str = "embeddings";

/// Tensor of the importance weights of materials drawn from the prior. In files without it, all
/// weights are one.
const LOG_IMPORTANCE: &str = "prior.log_importance";

/// Returns metadata and tensors, those of the widest type first.
pub(super) fn parts(learnt: &LearntPosterior) -> (Metadata, Vec<Tensor>) {
    let LearntPosterior { names, measured, prior, latent_space: coordinates, widths, encoder, ranges, colours } =
        learnt;
    let dimensions = coordinates.axes.len();
    let ranges: Vec<f32> = ranges.iter().flat_map(|(low, high)| [*low, *high]).collect();
    let outputs = encoder.shape().outputs;
    let mut tensors = vec![
        Tensor::f32("place_mean", &[THETA_H, THETA_D], &coordinates.mean),
        Tensor::f32("place_axes", &[dimensions, THETA_H, THETA_D], &coordinates.axes.concat()),
        Tensor::f32("widths", &[THETA_H, THETA_D], widths),
        Tensor::f32("ranges", &[ranges.len() / 2, 2], &ranges),
    ];
    for (name, of) in [(MEASURED, measured), (PRIOR, prior)] {
        let count = of.coordinates.len();
        tensors.push(Tensor::f32(format!("{name}{PLACES}"), &[count, dimensions], &of.coordinates.concat()));
        tensors.push(Tensor::f32(format!("{name}{EMBEDDINGS}"), &[count, outputs], &of.embeddings.concat()));
    }
    tensors.push(Tensor::f32(LOG_IMPORTANCE, &[prior.log_importance.len()], &prior.log_importance));
    for (name, shape, values) in encoder.tensors() {
        tensors.push(Tensor::f32(format!("{ENCODER}{name}"), &shape, values));
    }
    let json = |value: serde_json::Result<String>| value.expect("names and numbers are JSON");
    let mut metadata = Metadata::from([
        (NAMES, json(serde_json::to_string(names))),
        (SHAPE, json(serde_json::to_string(encoder.shape()))),
    ]);
    metadata.extend(colours.as_ref().map(|colours| (COLOURS, json(serde_json::to_string(colours)))));
    (metadata, tensors)
}

/// Reads a posterior that [`parts`] encoded.
pub(super) fn of(file: &Container<'_>) -> Result<LearntPosterior, Error> {
    let wrong = |e: String| file.wrong(format!("contains an invalid model: {e}"));
    let cells = [Some(THETA_H), Some(THETA_D)];
    let names: Vec<String> = file.json(NAMES)?;
    let (_, mean) = file.f32s("place_mean", &cells)?;
    let (_, axes) = file.f32s("place_axes", &[None, Some(THETA_H), Some(THETA_D)])?;
    let coordinates = LatentSpace { mean, axes: rows(&axes, CELLS) };
    let (_, widths) = file.f32s("widths", &cells)?;
    let (_, ranges) = file.f32s("ranges", &[None, Some(2)])?;
    let ranges = ranges.chunks_exact(2).map(|r| (r[0], r[1])).collect();
    let shape: EncoderShape = file.json(SHAPE)?;
    // Checked before memory is allocated in proportion.
    shape.check().map_err(|e| wrong(e.to_string()))?;
    let find = |name: &str| file.any_f32s(&format!("{ENCODER}{name}"));
    let encoder = Encoder::from_tensors(shape, find).map_err(|e| wrong(e.to_string()))?;
    let outputs = encoder.shape().outputs;
    let candidates = |name: &str| -> Result<Candidates, Error> {
        let (_, places) = file.f32s(&format!("{name}{PLACES}"), &[None, Some(coordinates.axes.len())])?;
        let (_, embeddings) = file.f32s(&format!("{name}{EMBEDDINGS}"), &[None, Some(outputs)])?;
        Ok(Candidates::of_prior(rows(&places, coordinates.axes.len()), rows(&embeddings, outputs)))
    };
    let colours = file.says(COLOURS).then(|| file.json(COLOURS)).transpose()?;
    let (measured, mut prior) = (candidates(MEASURED)?, candidates(PRIOR)?);
    if file.has_tensor(LOG_IMPORTANCE) {
        (_, prior.log_importance) = file.f32s(LOG_IMPORTANCE, &[None])?;
    }
    let learnt =
        LearntPosterior { names, measured, prior, latent_space: coordinates, widths, encoder, ranges, colours };
    // Checked before anything is computed from it.
    check_posterior(&learnt).map_err(|e| wrong(e.to_string()))?;
    Ok(learnt)
}

fn rows<T: Copy>(values: &[T], width: usize) -> Vec<Vec<T>> {
    if width == 0 { Vec::new() } else { values.chunks_exact(width).map(<[T]>::to_vec).collect() }
}
