//! Light in three colours, prefiltered at every scale.

use glam::{DQuat, DVec3, Quat, Vec3, Vec3A};
use rayon::prelude::*;

use super::pyramid::{LampRule, Pyramid};
use super::tree::LightTree;
use crate::sphere::OctahedralMap;

/// Texels that are lamps.
const LAMPS: LampRule = LampRule { bright: 12.0, most: 600 };

/// Least and largest number of texels along a side: 1.6 and 0.2 degrees each.
const SIDES: (usize, usize) = (128, 1024);

/// Number of parts in which a light is read, whatever the number of threads.
const PARTS: usize = 4;

/// A light as [`Lobe`](super::Lobe) looks it up.
pub struct PrefilteredLight {
    pyramid: Pyramid<Vec3A>,
    /// Direction and irradiance of lamps, where the light has been turned to.
    lamps: Vec<(Vec3A, Vec3A)>,
    /// From directions to those in which the pyramid was built.
    back: Option<Quat>,
}

impl PrefilteredLight {
    /// Filters a light. Fluxes are kept exactly; texels are about as wide as those of the light.
    pub fn of(tree: &LightTree) -> Self {
        let side = (tree.rows() * 3 / 2).next_power_of_two().clamp(SIDES.0, SIDES.1);
        let parts: Vec<Vec<(DVec3, f64)>> = (0..PARTS).into_par_iter().map(|part| splat(tree, side, part)).collect();
        let mut texels = vec![(DVec3::ZERO, 0.0); side * side];
        for part in &parts {
            texels.iter_mut().zip(part).for_each(|(sum, add)| *sum = (sum.0 + add.0, sum.1 + add.1));
        }
        let mean = tree.mean().as_dvec3();
        // The samples are dense enough that none is missed.
        let texels = texels.into_iter().map(|(e, w)| if w > 0.0 { (e / w, w) } else { (mean, 1e-12) }).collect();
        let pyramid = Pyramid::of_texels(side, texels, LAMPS);
        let turn = tree.turn();
        let place = |d: Vec3| Vec3A::from((turn * d.as_dvec3()).as_vec3());
        let lamps = pyramid.lamps().iter().map(|(d, e)| (place(*d), *e)).collect();
        let back = (turn != DQuat::IDENTITY).then(|| turn.inverse().as_quat());
        Self { pyramid, lamps, back }
    }

    /// Texels along a side of the finest level.
    pub(super) fn side(&self) -> usize {
        self.pyramid.side()
    }

    pub(super) fn pyramid(&self) -> &Pyramid<Vec3A> {
        &self.pyramid
    }

    /// Direction and irradiance of each lamp, on a surface that faces it.
    pub(super) fn lamps(&self) -> &[(Vec3A, Vec3A)] {
        &self.lamps
    }

    /// Direction of the pyramid for a direction of the light.
    #[inline(always)]
    pub(super) fn turned(&self, direction: Vec3A) -> Vec3A {
        match self.back {
            Some(back) => back * direction,
            None => direction,
        }
    }
}

/// Sums, by texels, flux and solid angle of one of [`PARTS`] of a light.
fn splat(tree: &LightTree, side: usize, part: usize) -> Vec<(DVec3, f64)> {
    let mut texels = vec![(DVec3::ZERO, 0.0); side * side];
    // A third of a texel of mean size is a little more than half of the smallest.
    let step = (4.0 * std::f64::consts::PI).sqrt() / side as f64 / 3.0;
    tree.samples(step, part, PARTS, |direction, radiance, solid_angle| {
        let (u, v) = OctahedralMap::PraunHoppe.square(direction);
        let at = |x: f64| (((0.5 + 0.5 * x) * side as f64) as usize).min(side - 1);
        let texel = &mut texels[at(-v) * side + at(u)];
        *texel = (texel.0 + radiance.as_dvec3() * solid_angle, texel.1 + solid_angle);
    });
    texels
}
