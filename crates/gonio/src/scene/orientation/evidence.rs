//! Normals collected once, from which the fit of any order of channels is computed.

use glam::{DVec2, DVec3};

use super::AxisFit;
use super::thresholds::{GRID_CELLS, MIN_RIM_PIXELS, MIN_SQUARES, MIN_TWIST, MIN_Z, REACH, RIM_SHARE, RIM_TILT};
use crate::picture::Plane;
use crate::scene::Correction;

/// Normals that serve as evidence for the order of channels.
pub(super) struct Evidence {
    /// Number of normals.
    count: usize,
    /// Number of normals whose value in each channel is not positive.
    not_positive: [usize; 3],
    /// Number of normals whose value in each channel is not negative.
    not_negative: [usize; 3],
    /// Normals along the bottom, right, top and left side of each square.
    squares: Vec<[Vec<DVec3>; 4]>,
    /// Normals at the outline within the picture, each with the outward direction, y up.
    outline: Vec<(DVec3, DVec2)>,
}

impl Evidence {
    /// Collects the normals; `None` for a map without normals.
    pub(super) fn of(surface: &Plane<Option<DVec3>>) -> Option<Self> {
        let (width, height) = surface.size();
        let all = || surface.as_slice().iter().flatten();
        let count = all().count();
        if count == 0 {
            return None;
        }
        let not_positive = [0, 1, 2].map(|c| all().filter(|n| n[c] <= 0.0).count());
        let not_negative = [0, 1, 2].map(|c| all().filter(|n| n[c] >= 0.0).count());
        let places = || {
            let here = surface.as_slice().iter().enumerate().filter(|(_, n)| n.is_some());
            here.map(move |(i, _)| (i % width, i / width))
        };
        let low = places().fold((width, height), |l, p| (l.0.min(p.0), l.1.min(p.1)));
        let high = places().fold((0, 0), |h, p| (h.0.max(p.0), h.1.max(p.1)));
        let side = ((high.0 - low.0).max(high.1 - low.1) / GRID_CELLS).max(2);
        let along = |from: (usize, usize), step: (usize, usize)| -> Option<Vec<DVec3>> {
            (0..=side).map(|i| surface[(from.0 + i * step.0, from.1 + i * step.1)]).collect()
        };
        let mut squares = Vec::new();
        for y in (low.1..(high.1 + 1).saturating_sub(side)).step_by(side) {
            for x in (low.0..(high.0 + 1).saturating_sub(side)).step_by(side) {
                let sides = [
                    along((x, y + side), (1, 0)),
                    along((x + side, y), (0, 1)),
                    along((x, y), (1, 0)),
                    along((x, y), (0, 1)),
                ];
                if let [Some(bottom), Some(right), Some(top), Some(left)] = sides {
                    squares.push([bottom, right, top, left]);
                }
            }
        }
        Some(Self { count, not_positive, not_negative, squares, outline: outline(surface) })
    }

    /// Computes how well the order that results from a correction fits a surface.
    pub(super) fn fit(&self, correction: Correction) -> AxisFit {
        let order = |n: DVec3| correction.apply(n.as_vec3()).as_dvec3();
        let z = correction.order[2];
        let away = if correction.flip_z { self.not_negative[z] } else { self.not_positive[z] };
        let cosines: Vec<f64> = self
            .outline
            .iter()
            .map(|(n, out)| (order(*n).truncate(), out))
            .filter(|(n, _)| n.length() > RIM_TILT)
            .map(|(n, out)| n.normalize().dot(*out))
            .collect();
        let is_rim = cosines.len() >= MIN_RIM_PIXELS && cosines.len() as f64 >= RIM_SHARE * self.outline.len() as f64;
        let mean = |f: fn(f64) -> f64| cosines.iter().copied().map(f).sum::<f64>() / cosines.len() as f64;
        AxisFit {
            back_facing: away as f64 / self.count as f64,
            circulation: self.circulation(order),
            rim: is_rim.then(|| (mean(|c| c), mean(f64::abs))),
        }
    }

    /// Computes the absolute circulation of the slopes, summed over all squares.
    ///
    /// The sum is relative to that of its two parts, which cancel for a surface. Returns `None` if
    /// there are too few squares or the surface has too little twist.
    fn circulation(&self, order: impl Fn(DVec3) -> DVec3) -> Option<f64> {
        // Returns the mean slope along a path, by the trapezoidal rule; `None` if it is too steep
        // anywhere.
        let mean = |path: &[DVec3]| -> Option<DVec2> {
            let mut sum = DVec2::ZERO;
            for (i, n) in path.iter().enumerate() {
                let n = order(*n);
                if n.z < MIN_Z {
                    return None;
                }
                let weight = if i == 0 || i + 1 == path.len() { 0.5 } else { 1.0 };
                sum -= weight * n.truncate() / n.z;
            }
            Some(sum / (path.len() - 1) as f64)
        };
        let (mut squares, mut off, mut twist, mut bend) = (0, 0.0, 0.0, 0.0);
        for [bottom, right, top, left] in &self.squares {
            let (Some(bottom), Some(right), Some(top), Some(left)) = (mean(bottom), mean(right), mean(top), mean(left))
            else {
                continue;
            };
            squares += 1;
            let (across, along) = (bottom.x - top.x, right.y - left.y);
            off += (across + along).abs();
            twist += across.abs() + along.abs();
            bend += (right.x - left.x).abs() + (top.y - bottom.y).abs();
        }
        let tells = squares >= MIN_SQUARES && twist > MIN_TWIST * (twist + bend);
        tells.then(|| off / twist)
    }
}

/// Collects the normals at the outline with their outward directions.
///
/// The outward direction points away from the centre of mass of the pixels within [`REACH`]. Pixels
/// near the border of the picture are omitted, because the object may continue there.
fn outline(surface: &Plane<Option<DVec3>>) -> Vec<(DVec3, DVec2)> {
    let (width, height) = surface.size();
    let mut outline = Vec::new();
    for y in REACH..height.saturating_sub(REACH) {
        for x in REACH..width.saturating_sub(REACH) {
            let Some(normal) = surface[(x, y)] else { continue };
            let edge = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)].iter().any(|p| surface[*p].is_none());
            if !edge {
                continue;
            }
            let mut inwards = DVec2::ZERO;
            for v in y - REACH..=y + REACH {
                for u in x - REACH..=x + REACH {
                    if surface[(u, v)].is_some() {
                        inwards += DVec2::new(u as f64 - x as f64, y as f64 - v as f64);
                    }
                }
            }
            if let Some(inwards) = inwards.try_normalize() {
                outline.push((normal, -inwards));
            }
        }
    }
    outline
}
