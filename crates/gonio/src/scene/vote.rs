//! Detection of circles by their edges, for images without a uniform background. All circles on a
//! grid are scored, and the best ones are fitted to nearby edges.

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::circle_fit::Circle;
use super::edges::{Edges, Ring, distinct, sort};
use super::rim::straying;
use super::small::Small;
use crate::picture::Plane;

/// Circles that are moved to edges, and those that are told.
const REFINED: usize = 12;
const TOLD: usize = 5;
/// Share of its weight that a circle must keep without the edges of the first to be another one.
const OWN: f32 = 0.5;
/// Least support of the outline of a ball, most weight of its rival, and how far edges may stray
/// from it as a share of the radius. In simulated photographs circles that are found elsewhere, or
/// about objects that are no balls, miss one of the three.
pub(super) const SURE: f64 = 0.5;
const MOST_RIVAL: f64 = 0.55;
const MOST_STRAYING: f64 = 0.015;
/// Share of the circle with an edge along it, to a pixel, that shows that it is round even where a
/// texture has stronger edges around it.
const TIGHT: f64 = 0.85;

/// A circle that may be the outline of a ball.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// The circle.
    pub circle: Circle,
    /// Share of its circumference on which there is an edge along it, 0..=1.
    pub support: f64,
}

/// Reliability of a ball that was detected by its edges.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sureness {
    /// Share of its circumference on which there is an edge along it, 0..=1.
    pub support: f64,
    /// Weight of the next circle, without the edges of the ball, relative to that of the ball, from
    /// 0 on.
    pub rival: f64,
}

impl std::fmt::Display for Sureness {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { support, rival } = self;
        write!(f, "detected by its edges: {:.0} % of its outline is visible", 100.0 * support)?;
        if *rival > 0.0 {
            write!(f, ", weight of the next circle {:.0} %", 100.0 * rival)?;
        }
        Ok(())
    }
}

/// Circles that may be the outline of a ball.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Vote {
    /// Up to five, the one of most weight first.
    pub(super) candidates: Vec<Candidate>,
    /// Weight of the next circle without the edges of the first, relative to that of the first.
    rival: f64,
    /// Whether the edges about the first are as round as a ball.
    round: bool,
}

impl Vote {
    /// The first of the candidates and how sure it is; `None` if it is not sure. What else stands
    /// out does not count if it is `alone`.
    pub(super) fn winner(&self, alone: bool) -> Option<(Circle, Sureness)> {
        let Candidate { circle, support } = *self.candidates.first()?;
        let is_sure = self.round && support >= SURE && (alone || self.rival <= MOST_RIVAL);
        is_sure.then_some((circle, Sureness { support, rival: self.rival }))
    }

    /// Finds the circles that stand out in a photograph, and what is near a `hint`.
    pub(super) fn of(rgb: &Plane<Vec3>, small: &Small, edges: &Edges, hint: Option<&Circle>) -> Self {
        let hint = hint.map(|circle| edges.ring(circle));
        let rough: Vec<Ring> = hint.into_iter().chain(distinct(edges.best(), REFINED, |ring| ring)).collect();
        let mut closer: Vec<_> = rough.par_iter().filter_map(|ring| edges.settled(rgb, small, ring)).collect();
        sort(&mut closer, |(ring, _)| ring);
        let mut told = distinct(closer, REFINED, |(ring, _)| ring);
        let mut rival = 0.0;
        if let Some(first) = told.first().map(|(ring, _)| *ring) {
            let rest = edges.without(&first);
            let mut at = 0..;
            told.retain(|(ring, _)| at.next() == Some(0) || rest.scored(*ring).weight() >= OWN * ring.weight());
            // Also circles that no edges refine speak against the first one.
            let others = rough.iter().chain(told[1..].iter().map(|(ring, _)| ring));
            rival = others.map(|ring| rest.scored(*ring).weight()).fold(0.0, f32::max) / first.weight();
        }
        let candidate = |(ring, circle): (Ring, Circle)| Candidate { circle, support: edges.support(&ring) };
        let candidates: Vec<Candidate> = told.into_iter().take(TOLD).map(candidate).collect();
        let is_round = |first: &Candidate| {
            edges.tight_support(&edges.ring(&first.circle)) >= TIGHT
                || straying(small, &first.circle).is_some_and(|share| share <= MOST_STRAYING)
        };
        let round = candidates.first().is_some_and(is_round);
        Self { candidates, rival: rival.into(), round }
    }
}
