//! Radiance of materials in one light, to a given accuracy.

use glam::{DVec3, Vec3};

use super::Accuracy;
use super::brdf::Brdf;
use super::integrate::{IntegratorSettings, nodes, nodes_within};
use super::lobe::HalfVectorSampler;
use super::prefiltered::PrefilteredLight;
use super::surface::{PENUMBRA, open_shares};
use super::tree::LightTree;
use crate::reflectance::BivariateTable;
use crate::shape::SurfacePoint;

/// Materials in a light.
pub(super) enum Shader<'a> {
    Lobes { sampler: Box<HalfVectorSampler>, light: Box<PrefilteredLight>, count: usize },
    Bound { brdfs: Vec<(&'a dyn Brdf, BivariateTable)>, light: &'a LightTree, settings: IntegratorSettings },
}

impl<'a> Shader<'a> {
    /// # Panics
    /// If there is no material, or if there are several and one of them depends on `phi_d`.
    pub(super) fn new(brdfs: &[&'a dyn Brdf], light: &'a LightTree, accuracy: Accuracy) -> Self {
        match accuracy {
            Accuracy::Lobes => {
                let light = Box::new(PrefilteredLight::of(light));
                let sampler = Box::new(HalfVectorSampler::new(brdfs, &light));
                Self::Lobes { sampler, light, count: brdfs.len() }
            }
            Accuracy::Bound(settings) => {
                Self::Bound { brdfs: brdfs.iter().map(|brdf| (*brdf, brdf.envelope())).collect(), light, settings }
            }
        }
    }

    /// Returns the radiance that the point reflects of all light above its horizon, by material.
    pub(super) fn radiance(&self, point: &SurfacePoint) -> Vec<DVec3> {
        match self {
            Self::Lobes { sampler, light, .. } => {
                sampler.radiance(point, light, |_| 1.0).into_iter().map(|sum| sum.as_dvec3()).collect()
            }
            Self::Bound { brdfs, light, settings } => {
                let each = |(brdf, envelope): &(_, _)| nodes(point, envelope, light, settings).radiance(point, *brdf);
                brdfs.iter().map(each).collect()
            }
        }
    }

    /// Returns the radiance that the point reflects of the light that is not blocked, by material.
    ///
    /// See [`Nodes::shadow`](super::Nodes::shadow).
    pub(super) fn shadowed(&self, point: &SurfacePoint, blocked: impl Fn(&[DVec3]) -> Vec<bool>) -> Vec<DVec3> {
        match self {
            Self::Lobes { sampler, light, count } => {
                // The values of all materials for a direction are contiguous.
                let (mut directions, mut values, mut strength) = (Vec::new(), Vec::new(), Vec::new());
                sampler.gather(point, light, |sample| {
                    directions.push(sample.direction);
                    let mut largest = 0.0_f32;
                    for material in 0..*count {
                        let value = sample.reflected(material);
                        largest = largest.max(value.abs().max_element());
                        values.push(value);
                    }
                    strength.push(f64::from(largest));
                });
                let blocked = |tested: &[usize]| {
                    let directions: Vec<DVec3> = tested.iter().map(|&i| directions[i].as_dvec3()).collect();
                    blocked(&directions)
                };
                let shares = open_shares(&strength, blocked);
                let mut sums = vec![DVec3::ZERO; *count];
                for (values, open) in values.chunks_exact(*count).zip(shares) {
                    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value.as_dvec3() * open);
                }
                sums
            }
            Self::Bound { brdfs, light, settings } => {
                let each = |(brdf, envelope): &(_, _)| {
                    let mut found = nodes_within(point, envelope, light, settings, PENUMBRA);
                    found.shadow(envelope, &blocked);
                    found.radiance(point, *brdf)
                };
                brdfs.iter().map(each).collect()
            }
        }
    }
}

/// Returns the mean colour of each material over samples, times the coverage of the pixel.
pub(super) fn covered(samples: &[Vec<DVec3>], coverage: f32) -> Vec<Vec3> {
    let mean = |material: usize| {
        let sum: DVec3 = samples.iter().map(|sample| sample[material]).sum();
        (sum / samples.len() as f64).as_vec3() * coverage
    };
    (0..samples[0].len()).map(mean).collect()
}
