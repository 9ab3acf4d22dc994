//! Fit under a light that may be rotated.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use super::error_model::{CUT, median};
use super::fit::{Fit, FitPrior, Image, State};
use super::light::{GivenLight, Operator};
use super::space::Space;
use super::turn::propose;
use super::{Alignment, COMPARED, KnownLightError, KnownLightPosterior, Materials, Rows, start};

/// Turns that are tried one after the other, at most.
const TURNS: usize = 4;

/// Decrease of the cost in nats, and angle in radians (0.2 degrees), from which a turn is tried:
/// less is within what the error of a right light asks for.
const WORTH: (f64, f64) = (10.0, 0.0035);

/// A turn stays if the error of the image falls to this share, or below.
const BETTER: f64 = 0.97;

/// Angles about the vertical that are compared, and how many of them are followed up.
const AROUND: (usize, usize) = (24, 2);

/// A fit under a light with the turn it was found for.
struct Candidate {
    turn: DQuat,
    operator: Operator,
    fit: Fit,
}

impl Candidate {
    /// Root mean square of the error of the logarithm of the image, outliers cut off.
    fn error(&self) -> f64 {
        let residuals = &self.fit.state.residuals;
        let cut = CUT * median(residuals.iter().map(|r| r.abs()).collect());
        (residuals.iter().map(|r| r.abs().min(cut).powi(2)).sum::<f64>() / residuals.len() as f64).sqrt()
    }
}

/// Finds the posterior and the turn of the light.
pub(super) fn aligned(
    rows: &Rows<'_>,
    mut light: GivenLight,
    alignment: Alignment,
    space: &Space,
    materials: &Materials<'_>,
) -> Result<KnownLightPosterior, KnownLightError> {
    let turns = match alignment {
        Alignment::Fixed | Alignment::Near => vec![DQuat::IDENTITY],
        Alignment::Around => around(rows, &mut light, materials),
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
    let image = Image::of(&operator, rows, space, FitPrior::MATERIAL)?;
    Ok(KnownLightPosterior::found(&image, fit, rows, space, turn))
}

/// The angles about the vertical under which some material of the prior comes nearest to the image.
fn around(rows: &Rows<'_>, light: &mut GivenLight, materials: &Materials<'_>) -> Vec<DQuat> {
    let total = rows.values.len();
    let some: Vec<usize> = (0..total).step_by(total.div_ceil(COMPARED)).collect();
    let points: Vec<_> = some.iter().map(|&at| rows.points[at]).collect();
    let values: Vec<f64> = some.iter().map(|&at| rows.values[at]).collect();
    let visibility = rows.visibility.map(|v| v.select(&some));
    let mut scored = Vec::new();
    for step in 0..AROUND.0 {
        let turn = DQuat::from_rotation_y(TAU * step as f64 / AROUND.0 as f64);
        light.turn_to(turn);
        let operator = Operator::of(&points, visibility.as_ref(), light, materials);
        scored.push((start(&operator, &values, materials).deviation, turn));
    }
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    scored.into_iter().take(AROUND.1).map(|(_, turn)| turn).collect()
}

impl Candidate {
    /// Turns the light and fits the material under it, from a state or from the best material of
    /// the prior.
    fn at(
        turn: DQuat,
        light: &mut GivenLight,
        rows: &Rows<'_>,
        space: &Space,
        materials: &Materials<'_>,
        from: Option<&State>,
    ) -> Result<Self, KnownLightError> {
        light.turn_to(turn);
        let operator = Operator::of(rows.points, rows.visibility, light, materials);
        let mut image = Image::of(&operator, rows, space, FitPrior::MATERIAL)?;
        let state = match from {
            Some(state) => image.state(state.coefficients.clone()),
            None => start(&operator, rows.values, materials).state(&image),
        };
        let fit = image.fit_to(rows, state)?;
        Ok(Self { turn, operator, fit })
    }

    /// Turns the light for as long as the image is explained better. Small turns from where it is
    /// now are probable.
    fn refined(
        mut self,
        light: &mut GivenLight,
        rows: &Rows<'_>,
        space: &Space,
        materials: &Materials<'_>,
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

    /// The next turn, if there is one worth trying.
    fn proposal(
        &self,
        light: &GivenLight,
        rows: &Rows<'_>,
        space: &Space,
        made: DVec3,
    ) -> Result<Option<DVec3>, KnownLightError> {
        let image = Image::of(&self.operator, rows, space, FitPrior::MATERIAL)?;
        let table = space.table(&self.fit.state.coefficients);
        let proposal = propose((&image, &self.fit), rows, light, &table, made);
        Ok(proposal.filter(|p| p.worth > WORTH.0 && p.turn.length() > WORTH.1).map(|p| p.turn))
    }
}
