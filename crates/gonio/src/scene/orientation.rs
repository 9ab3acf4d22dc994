//! Test of a normal map for the order and signs of its channels: x right, y up, z towards the
//! camera, none flipped and none swapped.
//!
//! Three things hold for the normals of any surface:
//! * what the camera sees faces it: z is positive;
//! * the slopes integrate to a surface: around any closed path they add up to zero. This holds for
//!   one sign of y relative to x and not for the other, but cannot tell a hill from a hollow (x and
//!   y both flipped);
//! * where the outline is the rim of a rounded object the normals are perpendicular to it: they
//!   point out of the object or, in a hollow, into it.
//!
//! Each can show that an order is wrong. The ambiguity between a hill and a hollow remains: the
//! rounder object is offered.

use glam::{DVec2, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::observed::check_size;
use super::{Correction, SceneError};
use crate::picture::Plane;
use crate::remedy::Remedy;

/// Least `z` of a normal whose slope pixels can resolve.
const LEAST_Z: f64 = 0.3;
/// Largest share of normals that may face away under an order of channels that is offered.
const MOST_AWAY: f64 = 0.02;
/// Share of normals facing away above which an order is wrong.
const GROSSLY_AWAY: f64 = 0.2;
/// Number of grid cells along the longer side of the object; closed paths go around squares of the
/// grid.
const CELLS: usize = 24;
/// Least number of squares for a verdict.
const LEAST_SQUARES: usize = 20;
/// Least share of the twist of the slopes (of x along y) in all bending for a verdict.
const LEAST_TWIST: f64 = 0.05;
/// Circulation below which an order fits, and that above which it is wrong.
const FITS: f64 = 0.35;
const CONTRADICTS: f64 = 0.65;
/// Least difference between the two.
const APART: f64 = 0.4;
/// Least sine of the angle between normal and view for a pixel of the outline to belong to a rim.
const RIM_TILT: f64 = 0.8;
/// Least number of pixels of a rim for a verdict.
const LEAST_RIM: usize = 40;
/// Least share of them in the outline within the picture.
const RIM_SHARE: f64 = 0.4;
/// Mean absolute cosine between normals at a rim and the direction out of it: above the first for a
/// right order, below the second for a wrong one.
const ALONG: f64 = 0.9;
const ACROSS: f64 = 0.8;
/// Difference in mean cosine by which orders whose normals point less outwards give way to that of
/// a rounder object.
const RIM_APART: f64 = 0.3;

/// Fit of an order of channels to a surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// Share of normals that face away from the camera, 0 to 1.
    pub away: f64,
    /// Relative sum of the slopes around closed paths, 0 (a surface) to 1; `None` where nothing can
    /// be said: too few pixels, or a shape such as an upright cylinder.
    pub circulation: Option<f64>,
    /// Mean cosine, at the rim, between the normals and the direction out of the object, -1 (a
    /// hollow) to 1 (a round object), and the mean of its absolute value. `None` without a rim.
    pub rim: Option<(f64, f64)>,
}

impl Fit {
    fn outwards(&self) -> Option<f64> {
        self.rim.map(|r| r.0)
    }
}

/// Verdict on the order of the channels of a normal map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Orientation {
    /// Fit of the given order.
    pub given: Fit,
    /// Corrections that fit, the more usual first, where the given order clearly does not;
    /// otherwise empty. There are several where nothing tells them apart, such as x or y flipped on
    /// a relief without a rim.
    pub corrections: Vec<Correction>,
    /// Improvement of the fit by the first correction, 0 to 1; zero without a correction.
    pub confidence: f64,
}

impl Orientation {
    /// Tests the normals that `coverage` gives as at least half covered, or all without it. Normals
    /// of length zero or that are not finite count as missing.
    ///
    /// The verdict is cautious: nothing is corrected without evidence, or where the shape explains
    /// the normals as well as an error would.
    ///
    /// # Errors
    /// [`SceneError::Sizes`]; [`SceneError::NoNormals`].
    pub fn of(normals: &Plane<Vec3>, coverage: Option<&Plane<f32>>) -> Result<Self, SceneError> {
        if let Some(coverage) = coverage {
            check_size("mask", coverage.size(), normals.size())?;
        }
        let surface = Plane::from_fn(normals.width(), normals.height(), |x, y| {
            let covered = coverage.is_none_or(|c| c[(x, y)] >= 0.5);
            normals[(x, y)].as_dvec3().try_normalize().filter(|_| covered)
        });
        let evidence = Evidence::of(&surface).ok_or(SceneError::NoNormals)?;
        let given = evidence.fit(Correction::default());
        let away = given.away > GROSSLY_AWAY;
        let open = given.circulation.is_some_and(|c| c > CONTRADICTS);
        let across = given.rim.is_some_and(|r| r.1 < ACROSS);
        let nothing = Self { given, corrections: Vec::new(), confidence: 0.0 };
        if !(away || open || across) {
            return Ok(nothing);
        }
        // Whatever contradicts must be corrected, and nothing made worse.
        let mends = |fit: &Fit| {
            let closes = fit.circulation.is_some_and(|c| c < FITS);
            let closer = gain(&given, fit);
            fit.away <= MOST_AWAY
                && closes
                && (!open || away || closer.is_some_and(|gain| gain > APART))
                && (open || away || (fit.rim.is_some_and(|r| r.1 > ALONG) && closer.is_none_or(|gain| gain > -0.05)))
        };
        let all = Correction::all().into_iter().map(|c| (c, evidence.fit(c)));
        let mut fitting: Vec<(Correction, Fit)> = all.filter(|(_, fit)| mends(fit)).collect();
        let least = fitting.iter().filter_map(|f| f.1.circulation).fold(f64::INFINITY, f64::min);
        fitting.retain(|f| f.1.circulation.is_some_and(|c| c < least + 0.1));
        // The rim decides among those left, if every one of them has a rim.
        let outwards = fitting.iter().map(|f| f.1.outwards()).collect::<Option<Vec<f64>>>();
        if let Some(best) = outwards.and_then(|r| r.into_iter().reduce(f64::max)) {
            fitting.retain(|f| f.1.outwards().is_some_and(|r| r > best - RIM_APART));
        }
        let Some((_, first)) = fitting.first() else { return Ok(nothing) };
        let straighter = first.rim.zip(given.rim).map_or(0.0, |(a, b)| a.1 - b.1);
        let grounds = [given.away - first.away, gain(&given, first).unwrap_or(0.0), straighter];
        let confidence = grounds.into_iter().fold(0.0, f64::max).min(1.0);
        Ok(Self { given, corrections: fitting.iter().map(|f| f.0).collect(), confidence })
    }

    /// Returns what contradicts the given order; `None` where it is or may be right.
    pub(crate) fn contradiction(&self) -> Option<Contradiction> {
        let first = self.corrections.first()?;
        let why = match self.given {
            Fit { away, .. } if away > GROSSLY_AWAY => {
                format!("{:.0} % of them face away from the camera", 100.0 * away)
            }
            Fit { circulation: Some(off), .. } if off > CONTRADICTS => {
                format!("their slopes do not close ({:.0} % off)", 100.0 * off)
            }
            _ => "at the outline they do not point out of the object".to_owned(),
        };
        let complaint = format!("the normals seem to have {}: {why}", first.words());
        Some(Contradiction { complaint, corrections: self.corrections.iter().take(3).copied().collect() })
    }
}

/// Contradiction within the given normals.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{complaint}")]
pub struct Contradiction {
    complaint: String,
    /// Corrections that mend it, the most probable first.
    corrections: Vec<Correction>,
}

impl Contradiction {
    /// Returns [`Remedy::NormalAxes`].
    pub fn remedy(&self) -> Remedy {
        Remedy::NormalAxes(self.corrections.clone())
    }
}

/// Returns by how much the circulation of one order is smaller than that of another.
fn gain(given: &Fit, other: &Fit) -> Option<f64> {
    Some(given.circulation? - other.circulation?)
}

/// Normals that serve as evidence for the order of channels.
struct Evidence {
    /// Number of normals, and of those whose value in each channel is not positive, and is not
    /// negative.
    count: usize,
    not_positive: [usize; 3],
    not_negative: [usize; 3],
    /// Normals along the bottom, right, top and left side of each square.
    squares: Vec<[Vec<DVec3>; 4]>,
    /// Normals at the outline within the picture, each with the direction out of the object, y up.
    outline: Vec<(DVec3, DVec2)>,
}

impl Evidence {
    fn of(surface: &Plane<Option<DVec3>>) -> Option<Self> {
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
        let side = ((high.0 - low.0).max(high.1 - low.1) / CELLS).max(2);
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

    fn fit(&self, correction: Correction) -> Fit {
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
        let is_rim = cosines.len() >= LEAST_RIM && cosines.len() as f64 >= RIM_SHARE * self.outline.len() as f64;
        let mean = |f: fn(f64) -> f64| cosines.iter().copied().map(f).sum::<f64>() / cosines.len() as f64;
        Fit {
            away: away as f64 / self.count as f64,
            circulation: self.circulation(order),
            rim: is_rim.then(|| (mean(|c| c), mean(f64::abs))),
        }
    }

    /// Computes the sum over all squares of the absolute circulation of the slopes, relative to
    /// that of its two parts, which cancel for a surface.
    fn circulation(&self, order: impl Fn(DVec3) -> DVec3) -> Option<f64> {
        // Mean slope along a path, by the trapezoidal rule; none if it is too steep anywhere.
        let mean = |path: &[DVec3]| -> Option<DVec2> {
            let mut sum = DVec2::ZERO;
            for (i, n) in path.iter().enumerate() {
                let n = order(*n);
                if n.z < LEAST_Z {
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
        let tells = squares >= LEAST_SQUARES && twist > LEAST_TWIST * (twist + bend);
        tells.then(|| off / twist)
    }
}

/// Collects the normals at the outline with the outward direction. Pixels near the border of the
/// picture are left out: the object may continue there.
fn outline(surface: &Plane<Option<DVec3>>) -> Vec<(DVec3, DVec2)> {
    /// Half side of the window whose centre of mass gives the outward direction.
    const REACH: usize = 4;
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

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 240;

    fn map(f: impl Fn(f32, f32) -> Option<Vec3>) -> Plane<Vec3> {
        Plane::from_fn(SIZE, SIZE, |x, y| {
            let at = |i: usize| (i as f32 + 0.5 - 120.0) / 110.0;
            f(at(x), -at(y)).map_or(Vec3::ZERO, Vec3::normalize)
        })
    }

    fn sphere() -> Plane<Vec3> {
        ellipsoid(1.0, 1.0, 0.0)
    }

    /// An ellipsoid of these semi-axes, turned in the picture.
    fn ellipsoid(a: f32, b: f32, turn: f32) -> Plane<Vec3> {
        map(|x, y| {
            let turned = glam::Vec2::from_angle(turn);
            let p = turned.rotate(glam::Vec2::new(x, y));
            let left = 1.0 - (p.x / a).powi(2) - (p.y / b).powi(2);
            let n = glam::Vec2::from_angle(-turn).rotate(glam::Vec2::new(p.x / (a * a), p.y / (b * b)));
            (left > 0.0).then(|| n.extend(left.sqrt()))
        })
    }

    /// Bumps on a plane that fills the picture.
    fn relief() -> Plane<Vec3> {
        map(|x, y| {
            let (p, q) =
                ((5.0 * x + 2.0 * y).cos() * 0.5 + 0.3 * x, (5.0 * x + 2.0 * y).cos() * 0.2 - (4.0 * y).sin() * 0.4);
            Some(Vec3::new(-p, -q, 1.0))
        })
    }

    /// The upper right part of the sphere.
    fn cropped() -> Plane<Vec3> {
        let sphere = sphere();
        Plane::from_fn(SIZE, SIZE, |x, y| if x > 135 && y < 110 { sphere[(x, y)] } else { Vec3::ZERO })
    }

    fn of(normals: &Plane<Vec3>) -> Orientation {
        Orientation::of(normals, None).unwrap()
    }

    const FLIP_Y: Correction = Correction { order: [0, 1, 2], flip_x: false, flip_y: true, flip_z: false };
    const FLIP_X: Correction = Correction { flip_x: true, flip_y: false, ..FLIP_Y };

    #[test]
    fn sound_maps_are_left_alone() {
        for (name, normals) in [
            ("sphere", sphere()),
            ("ellipsoid", ellipsoid(1.0, 0.6, 0.5)),
            ("upright", ellipsoid(0.5, 0.9, 0.0)),
            ("relief", relief()),
            ("cropped", cropped()),
            ("bowl", sphere().map(|n| Vec3::new(-n.x, -n.y, n.z))),
            ("plane", map(|_, _| Some(Vec3::new(0.1, 0.2, 1.0)))),
            ("cylinder", map(|x, _| (x.abs() < 0.8).then(|| Vec3::new(x, 0.0, (0.64 - x * x).sqrt())))),
            ("lying", map(|_, y| (y.abs() < 0.8).then(|| Vec3::new(0.0, y, (0.64 - y * y).sqrt())))),
            ("tiny", map(|x, y| (x.abs().max(y.abs()) < 0.02).then(|| Vec3::new(x, y, 1.0)))),
        ] {
            let got = of(&normals);
            assert!(got.corrections.is_empty() && got.contradiction().is_none(), "{name}: {got:?}");
        }
    }

    #[test]
    fn whatever_is_wrong_on_a_round_object_is_named() {
        for (name, right) in [("sphere", sphere()), ("ellipsoid", ellipsoid(1.0, 0.6, 0.5))] {
            for wrong in Correction::all() {
                // Nothing wrong, or a hill that became a hollow, which is also a valid shape.
                let Correction { order, flip_x, flip_y, flip_z } = wrong;
                if order == [0, 1, 2] && !flip_z && flip_x == flip_y {
                    continue;
                }
                let given = wrong.apply_to(&right);
                let got = of(&given);
                assert_eq!(got.corrections.len(), 1, "{name} {wrong:?}: {got:?}");
                assert_eq!(got.corrections[0].apply_to(&given), right, "{name} {wrong:?}: {got:?}");
                assert!(got.confidence > 0.2, "{name} {wrong:?}: {got:?}");
            }
        }
    }

    #[test]
    fn corrections_have_names() {
        let swapped = Correction { order: [1, 0, 2], ..FLIP_Y };
        assert_eq!((swapped.reordered().as_deref(), swapped.flips()), (Some("yxz"), vec!['y']));
        assert_eq!(swapped.apply(Vec3::new(1.0, 2.0, 3.0)), Vec3::new(2.0, -1.0, 3.0));
        // Channels that hold y, z and x.
        let order = Correction::order_named("yzx").unwrap();
        assert_eq!(
            Correction { order, ..Correction::default() }.apply(Vec3::new(2.0, 3.0, 1.0)),
            Vec3::new(1.0, 2.0, 3.0)
        );
        assert_eq!((Correction::order_named("xyx"), Correction::order_named("bgr")), (None, None));
        assert!(Correction::default().is_none() && !swapped.is_none() && Correction::all().len() == 48);
    }

    #[test]
    fn without_a_rim_either_flip_is_named() {
        for wrong in [FLIP_Y, FLIP_X] {
            assert_eq!(of(&wrong.apply_to(&relief())).corrections[..2], [FLIP_Y, FLIP_X]);
            // A part of a rim is enough.
            assert_eq!(of(&wrong.apply_to(&cropped())).corrections, [wrong]);
        }
        let found = of(&FLIP_Y.apply_to(&relief())).contradiction().unwrap();
        let complaint = found.to_string();
        assert!(
            complaint.starts_with("the normals seem to have y flipped: their slopes do not close ("),
            "{complaint}"
        );
        assert_eq!(found.remedy(), Remedy::NormalAxes(vec![FLIP_Y, FLIP_X]));
    }

    #[test]
    fn eight_bits_are_enough() {
        let coded = |normals: &Plane<Vec3>| {
            normals.map(|n| {
                let code = ((*n + Vec3::ONE) * 127.5).round();
                if *n == Vec3::ZERO { Vec3::ZERO } else { (code / 127.5 - Vec3::ONE).normalize() }
            })
        };
        for right in [sphere(), ellipsoid(1.0, 0.6, 0.5), relief()] {
            assert!(of(&coded(&right)).corrections.is_empty());
            assert_eq!(of(&FLIP_Y.apply_to(&coded(&right))).corrections[0], FLIP_Y);
        }
    }

    #[test]
    fn noise_is_no_evidence() {
        let mut state = 1_u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        let normals = Plane::from_fn(SIZE, SIZE, |_, _| Vec3::new(noise(), noise(), 0.6 + noise().abs()).normalize());
        assert!(of(&normals).corrections.is_empty());
        let none = sphere().map(|_| Vec3::ZERO);
        assert_eq!(Orientation::of(&none, None).unwrap_err(), SceneError::NoNormals);
        let small = Plane::from_fn(2, 2, |_, _| 1.0_f32);
        assert!(matches!(Orientation::of(&sphere(), Some(&small)), Err(SceneError::Sizes { .. })));
    }

    #[test]
    fn a_mask_hides_normals() {
        let mut normals = sphere();
        let mask = Plane::from_fn(SIZE, SIZE, |x, _| f32::from(x < 150));
        for y in 0..SIZE {
            for x in 150..SIZE {
                normals[(x, y)] = Vec3::NEG_Z;
            }
        }
        assert!(Orientation::of(&normals, Some(&mask)).unwrap().corrections.is_empty());
        assert_eq!(Orientation::of(&FLIP_Y.apply_to(&normals), Some(&mask)).unwrap().corrections, [FLIP_Y]);
    }
}
