//! Detection of circles by their edges, for images without a uniform background. All circles on a
//! grid are scored, and the best ones are fitted to nearby edges.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::SceneError;
use super::circle_fit::Circle;
use super::edges::{Edges, Ring, distinct, sort};
use super::rim::{polished, standard_error, straying};
use super::small::Small;
use crate::parallel;
use crate::picture::Plane;

/// Largest number of circles that are refined on edges.
const REFINED: usize = 12;
/// Largest number of circles that are reported.
const MAX_CANDIDATES: usize = 5;
/// Smallest share of its weight that a separate circle must keep without the edges of the first.
const OWN: f32 = 0.5;
/// Smallest support of the outline of a ball. In simulated photographs, circles elsewhere, or about
/// objects that are not balls, fail this test or one of the next two.
pub(super) const SURE: f64 = 0.5;
/// Largest weight of the next circle, relative to that of the ball.
const MAX_RIVAL: f64 = 0.55;
/// Largest spread of edges about the outline of a ball, as a share of the radius.
const MAX_STRAYING: f64 = 0.015;
/// Share of the circle with an edge along it, at the fine scale, above which it is round even if a
/// texture has stronger edges around it.
const TIGHT: f64 = 0.85;

/// A circle that may be the outline of a ball.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CircleCandidate {
    /// The circle.
    pub circle: Circle,
    /// Share of its circumference that has an edge along it, 0..=1.
    pub support: f64,
}

/// Reason why a circle is not a reliable outline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CircleDoubt {
    /// Too little of the outline has an edge along it.
    Support,
    /// The strongest edges deviate from the circle.
    NotRound,
    /// Another circle is nearly as distinct.
    Rival,
}

impl CircleDoubt {
    /// Returns the end of the message.
    pub(super) fn reason(self) -> &'static str {
        match self {
            Self::Support => "",
            Self::NotRound => {
                ", but the strongest edges deviate from it; possible causes are an object that is not round, pixels that \
                 are not square, and sharpening"
            }
            Self::Rival => ", but another circle is nearly as distinct",
        }
    }
}

/// Reliability of a ball that was detected by its edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlineReliability {
    /// Share of its circumference that has an edge along it, 0..=1.
    pub support: f64,
    /// Weight of the next circle without the edges of the ball, relative to that of the ball; at
    /// least 0.
    pub runner_up: f64,
    /// Standard error of its centre and radius, in pixels; infinite if its edges are too few.
    pub standard_error: f64,
}

impl std::fmt::Display for OutlineReliability {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { support, runner_up: rival, standard_error: error } = self;
        write!(f, "detected by its edges, along {:.0} % of its outline", 100.0 * support)?;
        match error {
            error if error.is_finite() => write!(f, ", standard error {error:.1} pixels")?,
            _ => write!(f, ", unknown standard error")?,
        }
        if *rival > 0.0 {
            write!(f, ", score of the second-best circle {:.0} % of the best", 100.0 * rival)?;
        }
        Ok(())
    }
}

/// Circles that may be the outline of a ball.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct CircleDetection {
    /// Up to five candidates, by decreasing weight.
    pub(super) candidates: Vec<CircleCandidate>,
    /// Weight of the next circle without the edges of the first, relative to that of the first.
    rival: f64,
    /// Whether the edges around the first are as round as those of a ball.
    round: bool,
    /// Standard error of the first, in pixels.
    error: f64,
}

impl CircleDetection {
    /// Returns the first candidate and its reliability; `None` if it is unreliable.
    ///
    /// If the object is `alone`, other circles do not count.
    pub(super) fn winner(&self, alone: bool) -> Option<(Circle, OutlineReliability)> {
        let CircleCandidate { circle, support } = *self.candidates.first()?;
        let is_sure = self.round && support >= SURE && (alone || self.rival <= MAX_RIVAL);
        is_sure.then_some((circle, OutlineReliability { support, runner_up: self.rival, standard_error: self.error }))
    }

    /// Returns the error for a first candidate that is unreliable.
    pub(super) fn unsure(self) -> SceneError {
        let supported = self.candidates.first().is_some_and(|first| first.support >= SURE);
        let doubt = match (supported, self.round) {
            (false, _) => CircleDoubt::Support,
            (true, false) => CircleDoubt::NotRound,
            (true, true) => CircleDoubt::Rival,
        };
        SceneError::Unsure { doubt, candidates: self.candidates }
    }

    /// Detects the distinct circles of a photograph, including those near a `hint`.
    pub(super) fn of(rgb: &Plane<Vec3>, small: &Small, edges: &Edges, hint: Option<&Circle>) -> Self {
        let hint = hint.map(|circle| edges.ring(circle));
        let rough: Vec<Ring> = hint.into_iter().chain(distinct(edges.best(), REFINED, |ring| ring)).collect();
        let mut closer: Vec<_> = parallel::flat_map_range(rough.len(), |at| edges.refined(rgb, small, &rough[at]));
        sort(&mut closer, |(ring, _)| ring);
        let mut distinct_circles = distinct(closer, REFINED, |(ring, _)| ring);
        let mut rival = 0.0;
        if let Some(first) = distinct_circles.first().map(|(ring, _)| *ring) {
            let rest = edges.without(&first);
            let mut at = 0..;
            distinct_circles
                .retain(|(ring, _)| at.next() == Some(0) || rest.scored(*ring).weight() >= OWN * ring.weight());
            // Circles that cannot be refined on edges are rivals as well.
            let others = rough.iter().chain(distinct_circles[1..].iter().map(|(ring, _)| ring));
            rival = others.map(|ring| rest.scored(*ring).weight()).fold(0.0, f32::max) / first.weight();
        }
        let candidate = |(ring, circle): (Ring, Circle)| {
            let circle = polished(rgb, small, &circle);
            CircleCandidate { circle, support: edges.support(&ring) }
        };
        let candidates: Vec<CircleCandidate> =
            distinct_circles.into_iter().take(MAX_CANDIDATES).map(candidate).collect();
        let is_round = |first: &CircleCandidate| {
            edges.tight_support(&edges.ring(&first.circle)) >= TIGHT
                || straying(small, &first.circle).is_some_and(|share| share <= MAX_STRAYING)
        };
        let round = candidates.first().is_some_and(is_round);
        let error = candidates.first().map_or(f64::INFINITY, |first| standard_error(rgb, small, &first.circle));
        Self { candidates, rival: rival.into(), round, error }
    }
}
