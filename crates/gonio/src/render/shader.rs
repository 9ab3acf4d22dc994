//! Radiance of one material in one light, to a given accuracy.

use glam::{DVec3, Vec3A};

use super::Accuracy;
use super::brdf::Brdf;
use super::integrate::{IntegratorSettings, nodes, nodes_within};
use super::lobe::HalfVectorSampler;
use super::prefiltered::PrefilteredLight;
use super::surface::{PENUMBRA, open_shares};
use super::tree::LightTree;
use crate::reflectance::BivariateTable;
use crate::shape::SurfacePoint;

/// A material in a light.
pub(super) enum Shader<'a> {
    Lobes { lobe: HalfVectorSampler, light: PrefilteredLight },
    Bound { brdf: &'a dyn Brdf, envelope: BivariateTable, light: &'a LightTree, settings: IntegratorSettings },
}

impl<'a> Shader<'a> {
    pub(super) fn new(brdf: &'a dyn Brdf, light: &'a LightTree, accuracy: Accuracy) -> Self {
        match accuracy {
            Accuracy::Lobes(settings) => {
                let light = PrefilteredLight::of(light);
                Self::Lobes { lobe: HalfVectorSampler::new(&[brdf], &light, settings), light }
            }
            Accuracy::Bound(settings) => Self::Bound { brdf, envelope: brdf.envelope(), light, settings },
        }
    }

    /// Returns the radiance that the point reflects of all light above its horizon.
    pub(super) fn radiance(&self, point: &SurfacePoint) -> DVec3 {
        match self {
            Self::Lobes { lobe, light } => {
                let mut sum = Vec3A::ZERO;
                lobe.gather(point, light, |arrival| sum += arrival.reflected(0));
                sum.as_dvec3()
            }
            Self::Bound { brdf, envelope, light, settings } => {
                nodes(point, envelope, light, settings).radiance(point, *brdf)
            }
        }
    }

    /// Returns the radiance that the point reflects of the light that is not blocked.
    ///
    /// See [`Nodes::shadow`](super::Nodes::shadow).
    pub(super) fn shadowed(&self, point: &SurfacePoint, blocked: impl Fn(&[DVec3]) -> Vec<bool>) -> DVec3 {
        match self {
            Self::Lobes { lobe, light } => {
                let (mut directions, mut values, mut strength) = (Vec::new(), Vec::new(), Vec::new());
                lobe.gather(point, light, |arrival| {
                    let value = arrival.reflected(0);
                    directions.push(arrival.direction);
                    values.push(value);
                    strength.push(f64::from(value.abs().max_element()));
                });
                let asked = |asked: &[usize]| {
                    let directions: Vec<DVec3> = asked.iter().map(|&i| directions[i].as_dvec3()).collect();
                    blocked(&directions)
                };
                let shares = open_shares(&strength, asked);
                values.iter().zip(shares).map(|(value, open)| value.as_dvec3() * open).sum()
            }
            Self::Bound { brdf, envelope, light, settings } => {
                let mut found = nodes_within(point, envelope, light, settings, PENUMBRA);
                found.shadow(envelope, blocked);
                found.radiance(point, *brdf)
            }
        }
    }
}
