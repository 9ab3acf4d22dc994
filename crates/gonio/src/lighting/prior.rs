//! Prior of light: mixtures per group of Haar coefficients, learnt from captured environments
//! (paper 3.1, eq. 5).

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{LightGrid, MixtureSettings, RectifiedGaussian, ScaleMixture};
use crate::sphere::{OctahedralMap, Orientation, Wavelet};

/// Prior density of one wavelet coefficient of normalised light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CoefficientPrior {
    /// Zero-mean scale mixture: all groups but one.
    Mixture(ScaleMixture),
    /// The coarsest vertical wavelet: light comes from above.
    Rectified(RectifiedGaussian),
}

impl CoefficientPrior {
    /// Mean and variance.
    pub fn mean_and_variance(&self) -> (f64, f64) {
        match self {
            Self::Mixture(m) => (0.0, m.variance()),
            Self::Rectified(r) => {
                let m = r.moments();
                (m.mean, m.variance)
            }
        }
    }

    /// Logarithm of the density at `x`.
    pub fn log_density(&self, x: f64) -> f64 {
        match self {
            Self::Mixture(m) => m.log_density(x),
            Self::Rectified(r) => r.log_density(x),
        }
    }
}

/// Group of coefficients that share one prior (paper 3.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PriorGroup {
    /// Scale 1: one group per orientation.
    Coarsest(Orientation),
    /// Scales 2 and 3: per orientation, above or below the horizon.
    Middle {
        /// 2 or 3.
        scale: u32,
        /// Orientation.
        orientation: Orientation,
        /// Whether the support is in the upper half.
        above: bool,
    },
    /// Scales 4 and finer: all coefficients of a scale.
    Fine {
        /// 4 or more.
        scale: u32,
    },
}

impl PriorGroup {
    /// Group of coefficient `index`; `None` for DC, which is the same for every light.
    pub fn of_index(index: usize) -> Option<Self> {
        let w = Wavelet::of_index(index)?;
        Some(match (w.scale, w.above_horizon()) {
            (1, _) | (_, None) => Self::Coarsest(w.orientation),
            (scale @ (2 | 3), Some(above)) => Self::Middle { scale, orientation: w.orientation, above },
            (scale, _) => Self::Fine { scale },
        })
    }

    /// Returns the groups of a prior of `scales` scales, in the order of [`LightPrior::groups`].
    pub fn all(scales: u32) -> Vec<Self> {
        let mut groups = Orientation::ALL.map(Self::Coarsest).to_vec();
        for scale in 2..=scales.min(3) {
            for orientation in Orientation::ALL {
                groups.extend([true, false].map(|above| Self::Middle { scale, orientation, above }));
            }
        }
        groups.extend((4..=scales).map(|scale| Self::Fine { scale }));
        groups
    }

    /// Mixture components of the paper: 2, 2, 3, 4, 5 for scales 1 to 5; finer scales use 5.
    fn components(self) -> usize {
        match self {
            Self::Coarsest(_) => 2,
            Self::Middle { scale, .. } | Self::Fine { scale } => (scale as usize).min(5),
        }
    }

    /// Short name for reports: `1 vertical`, `3 diagonal above`, `5`.
    pub fn label(self) -> String {
        let name = |o: Orientation| format!("{o:?}").to_lowercase();
        match self {
            Self::Coarsest(o) => format!("1 {}", name(o)),
            Self::Middle { scale, orientation, above } => {
                format!("{scale} {} {}", name(orientation), if above { "above" } else { "below" })
            }
            Self::Fine { scale } => format!("{scale}"),
        }
    }
}

/// `p(l)` of eq. 5 for lights normalised to integral one: all coefficients but DC are independent,
/// each with the prior of its group.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightPrior {
    /// Layout of the sphere on the square.
    pub map: OctahedralMap,
    /// Number of scales; the prior covers grids of up to `2^scales` texels per side.
    pub scales: u32,
    /// One density per group, in the order of [`PriorGroup::all`].
    pub groups: Vec<CoefficientPrior>,
    /// Number of captured lights in the training data.
    pub lights: usize,
}

/// Error in training a prior.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PriorError {
    /// There are no lights.
    #[error("no lights to train on")]
    Empty,
    /// A light is on another grid than the first.
    #[error("light {0} has another grid than the first")]
    Grids(usize),
    /// A light is black and has no normalised coefficients.
    #[error("light {0} is black")]
    Black(usize),
    /// Every coefficient of a group is zero.
    #[error("the lights have no variation in group \"{0}\"")]
    Flat(String),
}

/// Settings for learning a light prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PriorSettings {
    /// Number of starts of each mixture fit.
    pub starts: usize,
    /// Seed of the starts.
    pub seed: u64,
}

impl Default for PriorSettings {
    fn default() -> Self {
        Self { starts: 8, seed: 1 }
    }
}

impl LightPrior {
    /// Learns the densities of all groups from lights on a common grid; deterministic for a seed.
    ///
    /// `lights` may contain each capture several times, rotated about the vertical; `captures` is
    /// the number of different captures.
    ///
    /// # Errors
    /// If there are no lights, they are on different grids, one is black, or every coefficient of a
    /// group is zero.
    pub fn learn(lights: &[LightGrid], captures: usize, settings: &PriorSettings) -> Result<Self, PriorError> {
        let first = lights.first().ok_or(PriorError::Empty)?;
        let coefficients: Vec<Vec<f64>> = lights
            .iter()
            .enumerate()
            .map(|(i, light)| {
                if (light.map(), light.side()) != (first.map(), first.side()) {
                    return Err(PriorError::Grids(i));
                }
                light.normalised_coefficients().ok_or(PriorError::Black(i))
            })
            .collect::<Result<_, _>>()?;
        let scales = first.side().ilog2();
        let all = PriorGroup::all(scales);
        let mut samples = vec![Vec::new(); all.len()];
        for index in 1..first.side() * first.side() {
            let group = PriorGroup::of_index(index).expect("only DC has no group");
            let at = all.iter().position(|g| *g == group).expect("every group is listed");
            samples[at].extend(coefficients.iter().map(|l| l[index]));
        }
        let groups = all
            .par_iter()
            .zip(samples)
            .map(|(group, samples)| Self::fit_group(*group, &samples, settings))
            .collect::<Result<_, _>>()?;
        Ok(Self { map: first.map(), scales, groups, lights: captures })
    }

    fn fit_group(group: PriorGroup, samples: &[f64], settings: &PriorSettings) -> Result<CoefficientPrior, PriorError> {
        let flat = || PriorError::Flat(group.label());
        if group == PriorGroup::Coarsest(Orientation::Vertical) {
            let (low, high) = samples.iter().fold((f64::MAX, f64::MIN), |(a, b), &x| (a.min(x), b.max(x)));
            // The likelihood is always largest with the threshold at the smallest sample. The
            // expected gap between the smallest sample and the true end of a range is the range
            // over the number of samples. The threshold is never above zero (paper: "rectified at a
            // negative value"), nor below the bound of non-negative light.
            let gap = (high - low) / samples.len() as f64;
            let dc = LightGrid::normalised_dc();
            let threshold = (low - gap).clamp(-dc, -1e-3 * dc);
            return RectifiedGaussian::fit(samples, threshold).map(CoefficientPrior::Rectified).ok_or_else(flat);
        }
        let settings = MixtureSettings { components: group.components(), starts: settings.starts, seed: settings.seed };
        ScaleMixture::fit(samples, &settings).map(CoefficientPrior::Mixture).ok_or_else(flat)
    }

    /// Prior of coefficient `index`; `None` for DC and for scales that the prior does not cover.
    pub fn of_index(&self, index: usize) -> Option<&CoefficientPrior> {
        let group = PriorGroup::of_index(index)?;
        let at = match group {
            PriorGroup::Coarsest(o) => o as usize,
            PriorGroup::Middle { scale, orientation, above } => {
                3 + 6 * (scale as usize - 2) + 2 * orientation as usize + usize::from(!above)
            }
            PriorGroup::Fine { scale } => 15 + (scale as usize - 4),
        };
        self.groups.get(at)
    }

    /// Texels along a side of the finest grid that the prior covers.
    pub fn finest_side(&self) -> usize {
        1 << self.scales
    }

    /// Returns prior mean and variance of all coefficients of a grid of `side`.
    ///
    /// DC is the constant of normalised light.
    ///
    /// # Panics
    /// If the prior does not cover the grid.
    pub fn mean_and_variance(&self, side: usize) -> Vec<(f64, f64)> {
        assert!(side.ilog2() <= self.scales, "this prior covers grids of up to {} texels per side", self.finest_side());
        let dc = (LightGrid::normalised_dc(), 0.0);
        let rest = (1..side * side).map(|m| self.of_index(m).expect("the prior covers the grid").mean_and_variance());
        std::iter::once(dc).chain(rest).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use glam::Vec3;
    use rand::{RngExt, SeedableRng};

    use super::*;

    fn lights(count: usize, side: usize) -> Vec<LightGrid> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(11);
        (0..count)
            .map(|_| {
                let texels = (0..side * side)
                    .map(|t| {
                        let sky = if t < side * side / 2 { 2.0 } else { 1.0 };
                        let lamp = if rng.random_range(0..50) == 0 { 20.0 } else { 0.0 };
                        Vec3::splat(sky + lamp + rng.random_range(0.0..1.0))
                    })
                    .collect();
                LightGrid::from_texels(OctahedralMap::EqualArea, side, texels)
            })
            .collect()
    }

    static LIGHTS: LazyLock<Vec<LightGrid>> = LazyLock::new(|| lights(40, 32));
    static PRIOR: LazyLock<LightPrior> = LazyLock::new(|| learn(&LIGHTS));

    fn learn(lights: &[LightGrid]) -> LightPrior {
        LightPrior::learn(lights, lights.len(), &PriorSettings::default()).unwrap()
    }

    #[test]
    fn groups_match_the_paper() {
        // Scale 1: 3; scales 2 and 3: 3 orientations x 2; scales 4 and 5: one each.
        let all = PriorGroup::all(5);
        assert_eq!(all.len(), 3 + 6 + 6 + 2);
        let sizes: Vec<usize> =
            all.iter().map(|g| (1..1024).filter(|&m| PriorGroup::of_index(m) == Some(*g)).count()).collect();
        assert_eq!(sizes, [1, 1, 1, 2, 2, 2, 2, 2, 2, 8, 8, 8, 8, 8, 8, 192, 768]);
        let components: Vec<usize> = all.iter().map(|g| g.components()).collect();
        assert_eq!(components[3..], [2, 2, 2, 2, 2, 2, 3, 3, 3, 3, 3, 3, 4, 5]);
    }

    #[test]
    fn every_coefficient_has_the_prior_of_its_group() {
        let prior = &*PRIOR;
        let all = PriorGroup::all(5);
        for m in 1..1024 {
            let group = PriorGroup::of_index(m).unwrap();
            let at = all.iter().position(|g| *g == group).unwrap();
            assert!(std::ptr::eq(prior.of_index(m).unwrap(), &prior.groups[at]), "{m} {group:?}");
        }
        assert!(prior.of_index(0).is_none() && prior.of_index(1024).is_none());
        assert_eq!(*prior, learn(&LIGHTS));
    }

    #[test]
    fn light_from_above_is_learnt() {
        let CoefficientPrior::Rectified(vertical) = PRIOR.of_index(2).unwrap() else { panic!("not rectified") };
        assert!(vertical.threshold < 0.0 && vertical.moments().mean > 0.02, "{vertical:?}");
    }

    #[test]
    fn variances_match_the_samples() {
        let moments = PRIOR.mean_and_variance(32);
        let fine: Vec<f64> =
            LIGHTS.iter().flat_map(|l| l.normalised_coefficients().unwrap()[256..].to_vec()).map(|x| x * x).collect();
        let sample = fine.iter().sum::<f64>() / fine.len() as f64;
        assert!((moments[300].1 / sample - 1.0).abs() < 1e-3, "{} {sample}", moments[300].1);
        assert_eq!(moments[0], (LightGrid::normalised_dc(), 0.0));
    }

    #[test]
    fn rejects_unusable_lights() {
        let settings = PriorSettings::default();
        assert_eq!(LightPrior::learn(&[], 0, &settings), Err(PriorError::Empty));
        let black = LightGrid::from_texels(OctahedralMap::EqualArea, 8, vec![Vec3::ZERO; 64]);
        assert_eq!(LightPrior::learn(&[black], 1, &settings), Err(PriorError::Black(0)));
        let mixed = [lights(1, 8), lights(1, 16)].concat();
        assert_eq!(LightPrior::learn(&mixed, 2, &settings), Err(PriorError::Grids(1)));
    }
}
