use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{Parameter, Shading, UNIT};
use crate::reflectance::parametric::{CookTorrance, Parametric, Ward};

/// [`CookTorrance`] in RGB, with one factor per channel and a common shape of the lobe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColourCookTorrance {
    /// Albedo of the Lambertian part.
    pub diffuse: DVec3,
    /// Factor of the specular part.
    pub specular: DVec3,
    /// Fresnel reflectance at normal incidence.
    pub f0: f64,
    /// Root mean square slope `m` of the facets.
    pub roughness: f64,
}

/// [`Ward`] in RGB, with one factor per channel and a common width of the lobe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColourWard {
    /// Albedo of the Lambertian part.
    pub diffuse: DVec3,
    /// Approximate albedo of the specular part.
    pub specular: DVec3,
    /// Standard deviation `alpha` of the surface slope.
    pub roughness: f64,
}

const WIDTH: Parameter = Parameter { low: 0.002, high: 1.0 };
const FACTOR: Parameter = Parameter { low: 0.0, high: 4.0 };

/// Returns starting parameters: diffuse and specular colours, then those of `more`.
fn starts(body: DVec3, highlight: DVec3, more: impl Fn(f64) -> Vec<f64>) -> Vec<Vec<f64>> {
    let [body, highlight] = [body, highlight].map(|c| c.clamp(DVec3::splat(0.01), DVec3::splat(0.98)).to_array());
    [0.02, 0.1, 0.3].map(|width| [&body[..], &highlight[..], &more(width)].concat()).to_vec()
}

impl Shading for ColourCookTorrance {
    const PARAMETERS: &'static [Parameter] =
        &[UNIT, UNIT, UNIT, FACTOR, FACTOR, FACTOR, Parameter { low: 0.001, high: 1.0 }, WIDTH];

    fn of(p: &[f64]) -> Self {
        Self {
            diffuse: DVec3::new(p[0], p[1], p[2]),
            specular: DVec3::new(p[3], p[4], p[5]),
            f0: p[6],
            roughness: p[7],
        }
    }

    fn starts(body: DVec3, highlight: DVec3) -> Vec<Vec<f64>> {
        [starts(body, highlight, |width| vec![0.05, width]), starts(body, highlight, |width| vec![0.7, width])].concat()
    }

    fn eval(&self, wi: DVec3, wo: DVec3) -> DVec3 {
        let lobe = CookTorrance { diffuse: 0.0, specular: 1.0, f0: self.f0, roughness: self.roughness }.eval(wi, wo);
        let lambert = CookTorrance { diffuse: 1.0, specular: 0.0, f0: 0.0, roughness: 1.0 }.eval(wi, wo);
        self.diffuse * lambert + self.specular * lobe
    }
}

impl Shading for ColourWard {
    const PARAMETERS: &'static [Parameter] = &[UNIT, UNIT, UNIT, FACTOR, FACTOR, FACTOR, WIDTH];

    fn of(p: &[f64]) -> Self {
        Self { diffuse: DVec3::new(p[0], p[1], p[2]), specular: DVec3::new(p[3], p[4], p[5]), roughness: p[6] }
    }

    fn starts(body: DVec3, highlight: DVec3) -> Vec<Vec<f64>> {
        starts(body, highlight, |width| vec![width])
    }

    fn eval(&self, wi: DVec3, wo: DVec3) -> DVec3 {
        let lobe = Ward { diffuse: 0.0, specular: 1.0, roughness: self.roughness }.eval(wi, wo);
        let lambert = Ward { diffuse: 1.0, specular: 0.0, roughness: 1.0 }.eval(wi, wo);
        self.diffuse * lambert + self.specular * lobe
    }
}
