//! Fit under a light that may be rotated.

use crate::statistics::median;
use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use super::error_model::CUT;
use super::fit::{FitPrior, ImageModel, LaplaceFit, State};
use super::light::{KnownLight, Operator};
use super::rotation::propose;
use super::space::ParameterSpace;
use super::start::{COMPARED, start};
use super::{Alignment, KnownLightError, KnownLightPosterior, ObservedPoints, PriorMaterials, thinned};

/// Largest number of successive rotations.
const TURNS: usize = 4;

/// Decrease of the cost (nats) and angle (radians; 0.2 degrees) above which a rotation is tried.
/// The error of a correct light may suggest smaller ones.
const MIN_GAIN: (f64, f64) = (10.0, 0.0035);

/// Largest ratio of the errors of the image after and before a rotation for which it is kept.
const BETTER: f64 = 0.97;

/// Number of angles about the vertical that are compared, and number of those that are refined.
const AROUND: (usize, usize) = (24, 2);

/// Fit under a light with a given rotation.
struct Candidate {
    turn: DQuat,
    operator: Operator,
    fit: LaplaceFit,
}

impl Candidate {
    /// Returns the root mean square error of the logarithm of the image, with outliers clipped.
    fn error(&self) -> f64 {
        let residuals = &self.fit.state.residuals;
        let cut = CUT * median(residuals.iter().map(|r| r.abs())).unwrap_or(0.0);
        (residuals.iter().map(|r| r.abs().min(cut).powi(2)).sum::<f64>() / residuals.len() as f64).sqrt()
    }
}

/// Computes the posterior and the rotation of the light.
pub(super) fn aligned(
    rows: &ObservedPoints<'_>,
    mut light: KnownLight,
    alignment: Alignment,
    space: &ParameterSpace,
    materials: &PriorMaterials<'_>,
) -> Result<KnownLightPosterior, KnownLightError> {
    let turns = match alignment {
        Alignment::Fixed | Alignment::Small => vec![DQuat::IDENTITY],
        Alignment::Vertical => around(rows, &mut light, materials),
    };
    let mut best: Option<Candidate> = None;
    for from in turns {
        let mut found = Candidate::at(from, &mut light, rows, space, materials, None)?;
        if alignment != Alignment::Fixed {
            found = found.refined(&mut light, rows, space, materials)?;
        }
        if best.as_ref().is_none_or(|best| found.error() < best.error()) {
            best = Some(found);
        }
    }
    let Some(Candidate { turn, operator, fit }) = best else { return Err(KnownLightError::Unsolvable) };
    let image = ImageModel::of(&operator, rows, space, FitPrior::MATERIAL)?;
    Ok(KnownLightPosterior::found(&image, fit, rows, space, turn))
}

/// Returns the rotations about the vertical under which a material of the prior fits best.
fn around(rows: &ObservedPoints<'_>, light: &mut KnownLight, materials: &PriorMaterials<'_>) -> Vec<DQuat> {
    let some = thinned(rows.values.len(), COMPARED);
    let points: Vec<_> = some.iter().map(|&at| rows.points[at]).collect();
    let values: Vec<f64> = some.iter().map(|&at| rows.values[at]).collect();
    let visibility = rows.visibility.map(|v| v.select(&some));
    let mut scored = Vec::new();
    for step in 0..AROUND.0 {
        let turn = DQuat::from_rotation_y(TAU * step as f64 / AROUND.0 as f64);
        light.set_rotation(turn);
        let operator = Operator::of(&points, visibility.as_ref(), light, materials);
        scored.push((start(&operator, &values, materials).deviation, turn));
    }
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    scored.into_iter().take(AROUND.1).map(|(_, turn)| turn).collect()
}

impl Candidate {
    /// Rotates the light and fits the material.
    ///
    /// The fit starts from a state or from the best material of the prior.
    fn at(
        turn: DQuat,
        light: &mut KnownLight,
        rows: &ObservedPoints<'_>,
        space: &ParameterSpace,
        materials: &PriorMaterials<'_>,
        from: Option<&State>,
    ) -> Result<Self, KnownLightError> {
        light.set_rotation(turn);
        let operator = Operator::of(rows.points, rows.visibility, light, materials);
        let mut image = ImageModel::of(&operator, rows, space, FitPrior::MATERIAL)?;
        let state = match from {
            Some(state) => image.state(state.coefficients.clone()),
            None => start(&operator, rows.values, materials).state(&image),
        };
        let fit = image.fit_to(rows, state)?;
        Ok(Self { turn, operator, fit })
    }

    /// Rotates the light as long as the error of the image decreases.
    ///
    /// The prior favours small rotations relative to the initial one.
    fn refined(
        mut self,
        light: &mut KnownLight,
        rows: &ObservedPoints<'_>,
        space: &ParameterSpace,
        materials: &PriorMaterials<'_>,
    ) -> Result<Self, KnownLightError> {
        let origin = self.turn;
        for _ in 0..TURNS {
            let made = (self.turn * origin.inverse()).to_scaled_axis();
            let Some(turn) = self.proposal(light, rows, space, made)? else { break };
            let turn = DQuat::from_scaled_axis(turn) * self.turn;
            let next = Self::at(turn, light, rows, space, materials, Some(&self.fit.state))?;
            if next.error() > BETTER * self.error() {
                break;
            }
            self = next;
        }
        Ok(self)
    }

    /// Returns the next rotation, if its expected gain is large enough.
    fn proposal(
        &self,
        light: &KnownLight,
        rows: &ObservedPoints<'_>,
        space: &ParameterSpace,
        made: DVec3,
    ) -> Result<Option<DVec3>, KnownLightError> {
        // The prior of the fit, so that the state is at the minimum of the same cost.
        let prior = FitPrior { deviation: self.fit.deviation, ..FitPrior::MATERIAL };
        let image = ImageModel::of(&self.operator, rows, space, prior)?;
        let table = space.table(&self.fit.state.coefficients);
        let proposal = propose((&image, &self.fit), rows, light, &table, made);
        Ok(proposal.filter(|p| p.gain > MIN_GAIN.0 && p.rotation.length() > MIN_GAIN.1).map(|p| p.rotation))
    }
}
