//! The learnt posterior of materials as tensors.

use gonio::appearance::STATISTICS;
use gonio::inference::amortised::{Amortised, Dense, Network, Scaling};
use gonio::model::check_posterior;
use gonio::reflectance::{CELLS, Coordinates, Dictionary, LogBasis, Mixture, THETA_D, THETA_H};

use super::container::{Container, Metadata, Tensor};
use crate::Error;

/// Metadata that only files with a posterior have.
pub(super) const NAMES: &str = "posterior";

/// Metadata and tensors, those of the widest type first.
pub(super) fn parts(amortised: &Amortised) -> (Metadata, Vec<Tensor>) {
    let Amortised { dictionary, scaling, network } = amortised;
    let basis = &dictionary.measured;
    let names = serde_json::to_string(&basis.names).expect("names are JSON");
    let entries: Vec<f64> = dictionary
        .entries
        .iter()
        .enumerate()
        .flat_map(|(at, entry)| entry.iter().flat_map(move |&(c, weight)| [at as f64, c as f64, weight]))
        .collect();
    let scales: Vec<f32> = scaling.iter().flat_map(|s| [s.low, s.high, s.centre, s.deviation]).collect();
    let rank = basis.axes.len();
    let dimensions = dictionary.coordinates.axes.len();
    let mut tensors = vec![
        Tensor::f64("entries", &[entries.len() / 3, 3], &entries),
        Tensor::f64("places", &[dictionary.places.len(), dimensions], &dictionary.places.concat()),
        Tensor::f32("material_mean", &[THETA_H, THETA_D], &basis.mean),
        Tensor::f32("material_axes", &[rank, THETA_H, THETA_D], &basis.axes.concat()),
        Tensor::f32("material_coefficients", &[basis.len(), rank], &basis.coefficients.concat()),
        Tensor::f32("place_mean", &[THETA_H, THETA_D], &dictionary.coordinates.mean),
        Tensor::f32("place_axes", &[dimensions, THETA_H, THETA_D], &dictionary.coordinates.axes.concat()),
        Tensor::f32("scaling", &[STATISTICS, 4], &scales),
    ];
    for (at, layer) in network.layers.iter().enumerate() {
        let outputs = layer.bias.len();
        tensors.push(Tensor::f32(format!("layer_{at}_weights"), &[outputs, layer.inputs], &layer.weights));
        tensors.push(Tensor::f32(format!("layer_{at}_bias"), &[outputs], &layer.bias));
    }
    (Metadata::from([(NAMES, names)]), tensors)
}

/// What [`parts`] made.
pub(super) fn of(file: &Container<'_>) -> Result<Amortised, Error> {
    let wrong = |e: String| file.wrong(format!("holds a model that cannot be: {e}"));
    let cells = [Some(THETA_H), Some(THETA_D)];
    let tables = [None, Some(THETA_H), Some(THETA_D)];
    let names: Vec<String> = file.json(NAMES)?;
    let (_, mean) = file.f32s("material_mean", &cells)?;
    let (shape, axes) = file.f32s("material_axes", &tables)?;
    let (_, coefficients) = file.f32s("material_coefficients", &[Some(names.len()), Some(shape[0])])?;
    let measured = LogBasis { axes: rows(&axes, CELLS), coefficients: rows(&coefficients, shape[0]), names, mean };
    let (_, mean) = file.f32s("place_mean", &cells)?;
    let (_, axes) = file.f32s("place_axes", &tables)?;
    let coordinates = Coordinates { mean, axes: rows(&axes, CELLS) };
    let (_, entries) = file.f64s("entries", &[None, Some(3)])?;
    let entries = mixtures(&entries).ok_or_else(|| wrong("the entries of its posterior are not in order".into()))?;
    let (_, places) = file.f64s("places", &[Some(entries.len()), Some(coordinates.axes.len())])?;
    let places = rows(&places, coordinates.axes.len());
    let (_, scales) = file.f32s("scaling", &[Some(STATISTICS), Some(4)])?;
    let scale = |s: &[f32]| Scaling { low: s[0], high: s[1], centre: s[2], deviation: s[3] };
    let scaling: Vec<Scaling> = scales.chunks_exact(4).map(scale).collect();
    let mut layers = Vec::new();
    while file.has(&format!("layer_{}_bias", layers.len())) {
        let at = layers.len();
        let (_, bias) = file.f32s(&format!("layer_{at}_bias"), &[None])?;
        let (shape, weights) = file.f32s(&format!("layer_{at}_weights"), &[Some(bias.len()), None])?;
        layers.push(Dense { inputs: shape[1], weights, bias });
    }
    let network = Network { layers };
    // Before anything is computed from it.
    check_posterior(&measured, &entries, &coordinates, &places, &scaling, &network)
        .map_err(|e| wrong(e.to_string()))?;
    Ok(Amortised { dictionary: Dictionary::restore(measured, entries, coordinates, places), scaling, network })
}

fn rows<T: Copy>(values: &[T], width: usize) -> Vec<Vec<T>> {
    if width == 0 { Vec::new() } else { values.chunks_exact(width).map(<[T]>::to_vec).collect() }
}

/// Entries from rows of entry, component and weight; `None` if the entries do not count up from zero.
fn mixtures(rows: &[f64]) -> Option<Vec<Mixture>> {
    let mut entries: Vec<Mixture> = Vec::new();
    for row in rows.chunks_exact(3) {
        if row[0] == entries.len() as f64 {
            entries.push(Vec::new());
        } else if row[0] + 1.0 != entries.len() as f64 {
            return None;
        }
        // Indices are whole and small; what is not becomes one out of range.
        let component =
            if row[1].fract() == 0.0 && (0.0..1e6).contains(&row[1]) { row[1] as usize } else { usize::MAX };
        entries.last_mut()?.push((component, row[2]));
    }
    Some(entries)
}
