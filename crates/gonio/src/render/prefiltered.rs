//! RGB light, prefiltered at every scale.

use glam::{DQuat, DVec3, Quat, Vec3, Vec3A};

use super::pyramid::{LampRule, Pyramid};
use super::tree::LightTree;
use crate::parallel;
use crate::sphere::OctahedralMap;

/// Rule that classifies texels as lamps.
const LAMPS: LampRule = LampRule { bright: 12.0, most: 600 };

/// Smallest and largest number of texels along a side: 1.6 and 0.2 degrees each.
const SIDES: (usize, usize) = (128, 1024);

/// Number of parts in which a light is sampled in parallel, independent of the number of threads.
const PARTS: usize = 4;

/// A light in the form that [`HalfVectorSampler`](super::HalfVectorSampler) samples.
pub struct PrefilteredLight {
    pyramid: Pyramid<Vec3A>,
    /// Direction and irradiance of the lamps, after rotation of the light.
    lamps: Vec<(Vec3A, Vec3A)>,
    /// Rotation from directions of the light to those of the pyramid; `None` for the identity.
    back: Option<Quat>,
}

impl PrefilteredLight {
    /// Filters a light.
    ///
    /// Fluxes are preserved exactly; texels are about as wide as those of the light.
    pub fn of(tree: &LightTree) -> Self {
        let side = (tree.rows() * 3 / 2).next_power_of_two().clamp(SIDES.0, SIDES.1);
        let parts: Vec<Vec<(DVec3, f64)>> = parallel::map_range(PARTS, |part| splat(tree, side, part));
        let mut texels = vec![(DVec3::ZERO, 0.0); side * side];
        for part in &parts {
            texels.iter_mut().zip(part).for_each(|(sum, add)| *sum = (sum.0 + add.0, sum.1 + add.1));
        }
        let mean = tree.mean().as_dvec3();
        // The samples are dense enough to reach every texel; the mean is only a fallback.
        let texels = texels.into_iter().map(|(e, w)| if w > 0.0 { (e / w, w) } else { (mean, 1e-12) }).collect();
        let pyramid = Pyramid::of_texels(side, texels, LAMPS);
        let turn = tree.turn();
        let place = |d: Vec3| Vec3A::from((turn * d.as_dvec3()).as_vec3());
        let lamps = pyramid.lamps().iter().map(|(d, e)| (place(*d), *e)).collect();
        let back = (turn != DQuat::IDENTITY).then(|| turn.inverse().as_quat());
        Self { pyramid, lamps, back }
    }

    /// Returns the number of texels along a side of the finest level.
    pub(super) fn side(&self) -> usize {
        self.pyramid.side()
    }

    pub(super) fn pyramid(&self) -> &Pyramid<Vec3A> {
        &self.pyramid
    }

    /// Returns direction and irradiance (on a surface that faces it) of each lamp.
    pub(super) fn lamps(&self) -> &[(Vec3A, Vec3A)] {
        &self.lamps
    }

    /// Converts a direction of the light to one of the pyramid.
    #[inline(always)]
    pub(super) fn turned(&self, direction: Vec3A) -> Vec3A {
        match self.back {
            Some(back) => back * direction,
            None => direction,
        }
    }
}

/// Sums flux and solid angle in each texel over one of the [`PARTS`] of a light.
fn splat(tree: &LightTree, side: usize, part: usize) -> Vec<(DVec3, f64)> {
    let mut texels = vec![(DVec3::ZERO, 0.0); side * side];
    // A third of a texel of mean size is slightly more than half of the smallest texel.
    let step = (4.0 * std::f64::consts::PI).sqrt() / side as f64 / 3.0;
    tree.samples(step, part, PARTS, |direction, radiance, solid_angle| {
        let (u, v) = OctahedralMap::PraunHoppe.square(direction);
        let at = |x: f64| (((0.5 + 0.5 * x) * side as f64) as usize).min(side - 1);
        let texel = &mut texels[at(-v) * side + at(u)];
        *texel = (texel.0 + radiance.as_dvec3() * solid_angle, texel.1 + solid_angle);
    });
    texels
}
