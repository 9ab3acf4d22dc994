//! Estimates with and without small spots.

use super::material::MaterialDraft;
use super::{EstimateError, Highlight};
use crate::model::Model;
use crate::picture::Picture;
use crate::scene::{Detection, Observations};

/// Returns the detection without small spots ([`Detection::without_spots`]), if the spots make the
/// estimate too glossy. `side` is the number of texels per side of the light.
///
/// Dust on a satin ball looks like reflections of small lamps in a polished ball. A polished ball
/// also has sharp reflections of its other surroundings, so its estimate remains glossy without the
/// spots. If the estimate becomes duller, and one of both medians of the roughness is outside the
/// 90 % interval of the other, the spots contradict the rest of the photograph.
///
/// # Errors
/// If the model has no posterior of materials, or nothing is observed.
pub fn without_misleading_spots(
    model: &Model,
    detection: &Detection,
    picture: &Picture,
    side: usize,
) -> Result<Option<Detection>, EstimateError> {
    let Some(cleaned) = detection.without_spots(picture) else { return Ok(None) };
    let roughness = |observations: &Observations| {
        MaterialDraft::of(model, observations, side).map(|draft| Highlight::of(draft.posterior()).roughness())
    };
    let (with, without) = (roughness(&detection.observations)?, roughness(&cleaned.observations)?);
    Ok(are_misleading(with, without).then_some(cleaned))
}

/// Whether spots with which the roughness has the quantiles `with` contradict the rest, with which
/// it has the quantiles `without`.
fn are_misleading(with: [f64; 3], without: [f64; 3]) -> bool {
    let ([_, median, high], [low, duller, _]) = (with, without);
    duller > high || median < low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_duller_answers_outside_an_interval_contradict_the_spots() {
        assert!(are_misleading([0.05, 0.07, 0.13], [0.06, 0.22, 0.5]));
        assert!(are_misleading([0.06, 0.16, 0.52], [0.32, 0.43, 0.62]));
        assert!(!are_misleading([0.05, 0.08, 0.19], [0.06, 0.15, 0.26]));
        // A sharper answer.
        assert!(!are_misleading([0.32, 0.43, 0.62], [0.06, 0.16, 0.3]));
    }
}
