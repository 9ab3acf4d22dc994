//! Draws from the posterior of a folder of results.

use std::path::Path;

use gonio::estimate::{ALBEDO, predictive_draws};
use gonio::inference::learnt::peak_height;
use gonio::model::Model;
use gonio::reflectance::BivariateTable;
use gonio_io::posterior::{FILE, SavedPosterior};

use crate::results::brdf_in;
use crate::{AppError, read_brdf};

/// The reason why a folder of results has no draws.
pub enum DrawsError {
    /// The posterior belongs to another model.
    OtherModel(AppError),
    /// The folder has no BRDF or no posterior, or a file is damaged.
    Unreadable(AppError),
}

impl DrawsError {
    /// Returns the message.
    pub fn into_inner(self) -> AppError {
        match self {
            Self::OtherModel(error) | Self::Unreadable(error) => error,
        }
    }
}

impl<E: Into<AppError>> From<E> for DrawsError {
    fn from(error: E) -> Self {
        Self::Unreadable(error.into())
    }
}

/// Returns posterior predictive draws of the BRDF in a folder of results, in 1/sr and linear Rec.
/// 709, from dull to glossy.
///
/// The draws have the albedo of the estimate and its chroma in every cell; their luminance varies.
/// `model` is the model of the inference, with its name in messages. The same `seed` gives the same
/// draws.
///
/// # Errors
/// If the folder has no BRDF or no posterior, a file is damaged, or the posterior belongs to
/// another model ([`DrawsError::OtherModel`]).
pub fn of_result(
    folder: &Path,
    (model, model_name): (&Model, &str),
    count: usize,
    seed: u64,
) -> Result<Vec<[BivariateTable; 3]>, DrawsError> {
    let name = folder.display();
    let Some(file) = brdf_in(folder).filter(|_| folder.join(FILE).is_file()) else {
        let problem =
            format!("does not contain a BRDF and {FILE}; specify a result folder of the learnt or known-light method");
        return Err(AppError::of(name, problem).into());
    };
    let saved = SavedPosterior::read(&folder.join(FILE))?;
    let drawn = predictive_draws(model, &saved.likelihood, count, seed).map_err(|_| {
        let problem = format!("was inferred with another model than {model_name}; specify the model of the inference");
        DrawsError::OtherModel(AppError::of(name, problem))
    })?;
    let table = read_brdf(&file)?;
    let estimate = table.to_bivariate();
    let luminance = BivariateTable::luminance(&estimate);
    let scale = luminance.normal_albedo() / ALBEDO;
    // A cell without reflectance has no chroma.
    let ratios = estimate.each_ref().map(|channel| -> Vec<f32> {
        let cells = channel.as_slice().iter().zip(luminance.as_slice());
        cells.map(|(value, y)| if *y > 0.0 { scale as f32 * value / y } else { scale as f32 }).collect()
    });
    let coloured = |(_, draw): (f64, BivariateTable)| {
        ratios.each_ref().map(|ratios| {
            BivariateTable::from_vec(draw.as_slice().iter().zip(ratios).map(|(value, ratio)| value * ratio).collect())
        })
    };
    let mut ranked: Vec<(f64, BivariateTable)> = drawn.into_iter().map(|draw| (peak_height(&draw), draw)).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(ranked.into_iter().map(coloured).collect())
}
