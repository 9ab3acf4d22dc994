//! Materials outside all dictionaries and training sets: measurements of another laboratory (the
//! RGL database), and formulas. The families of the formulas differ from those of
//! [`gonio::reflectance::Dictionary`], which are GGX lobes over a Lambertian base.

use std::f64::consts::{FRAC_1_PI, PI};
use std::fmt::Debug;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use glam::DVec3;
use gonio::reflectance::BivariateTable;
use gonio::reflectance::parametric::{CookTorrance, Lafortune, Parametric, Ward};

/// Version of these materials, part of their fingerprints. Raise it when a formula or the reading
/// of a file gives a different table.
pub(crate) const VERSION: u32 = 1;

/// Lists the files `NAME_rgb.bsdf` of a folder, which may be absent, in order of name.
pub(crate) fn rgl_files(folder: &Path) -> Result<Vec<(String, PathBuf)>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(|| format!("{}: cannot list", folder.display()))? {
        let path = entry.with_context(|| format!("{}: cannot list", folder.display()))?.path();
        let name = path.file_name().and_then(|n| n.to_str()).and_then(|n| n.strip_suffix("_rgb.bsdf"));
        if let Some(name) = name {
            files.push((format!("rgl_{name}"), path.clone()));
        }
    }
    files.sort();
    Ok(files)
}

/// Reads red, green and blue of the files of a folder ([`rgl_files`]).
pub(crate) fn rgl_tables(folder: &Path) -> Result<Vec<(String, [BivariateTable; 3])>> {
    let read = |(name, path): (String, PathBuf)| {
        let table = gonio_io::rgl::read(path)?.to_merl();
        Ok((name, table.to_bivariate()))
    };
    rgl_files(folder)?.into_iter().map(read).collect()
}

/// Reads red, green and blue of the files of `DATA/rgl`, and of the formulas, which are grey.
pub(crate) fn tables(data: &Path) -> Result<Vec<(String, [BivariateTable; 3])>> {
    let mut tables = rgl_tables(&data.join("rgl"))?;
    let grey = |table: BivariateTable| [table.clone(), table.clone(), table];
    tables.extend(formulas().into_iter().map(|(name, formula)| (name.to_owned(), grey(formula.to_bivariate()))));
    Ok(tables)
}

/// A grey material given by a formula. Its `Debug` output contains all its parameters.
pub(crate) trait Formula: Parametric + Debug + Send {}

impl<T: Parametric + Debug + Send> Formula for T {}

/// All formulas with names, from matte to mirror.
pub(crate) fn formulas() -> Vec<(&'static str, Box<dyn Formula>)> {
    let plaster = OrenNayar { albedo: 0.7, slope: 0.6 };
    let clay = OrenNayar { albedo: 0.12, slope: 0.4 };
    vec![
        ("plaster", Box::new(plaster)),
        ("velvet", Box::new(Velvet { diffuse: 0.04, sheen: 0.3, roughness: 0.4 })),
        ("rubbed-wood", Box::new(Lafortune { diffuse: 0.2, specular: 0.2, cxy: -0.58, cz: 0.55, exponent: 30.0 })),
        ("eggshell-paint", Box::new(CookTorrance { diffuse: 0.45, specular: 0.25, f0: 0.06, roughness: 0.15 })),
        ("cast-copper", Box::new(Metal { diffuse: 0.03, lobes: &[(1.0, 0.25)], eta: 0.6, k: 2.7 })),
        ("varnish", Box::new(Ward { diffuse: 0.15, specular: 0.05, roughness: 0.03 })),
        ("glazed-clay", Box::new(Coated { base: clay, lobes: &[(0.7, 0.025), (0.3, 0.2)], eta: 1.5 })),
        ("rolled-aluminium", Box::new(Metal { diffuse: 0.02, lobes: &[(1.0, 0.06)], eta: 1.1, k: 6.7 })),
        ("flake-paint", Box::new(Metal { diffuse: 0.04, lobes: &[(0.45, 0.04), (0.55, 0.35)], eta: 1.8, k: 2.6 })),
        ("silver", Box::new(Metal { diffuse: 0.01, lobes: &[(1.0, 0.006)], eta: 0.15, k: 3.5 })),
    ]
}

/// Functions of the angles, for the formulas.
struct Angles {
    cos_i: f64,
    cos_o: f64,
    cos_h: f64,
    /// Cosine of the angle between half vector and light.
    cos_d: f64,
    sin2_h: f64,
}

impl Angles {
    /// Computes the angles; `None` unless light and view are above the surface.
    fn new(wi: DVec3, wo: DVec3) -> Option<Self> {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return None;
        }
        let half = (wi + wo).normalize();
        // Computed from x and y, since 1 - cos^2 would lose the narrow peaks.
        let sin2_h = half.x * half.x + half.y * half.y;
        Some(Self { cos_i: wi.z, cos_o: wo.z, cos_h: half.z, cos_d: half.dot(wi).min(1.0), sin2_h })
    }

    /// Microfacet reflection without its Fresnel factor, `D G / (4 cos_i cos_o)`, with Beckmann's
    /// distribution of mean square slope `roughness^2`, and Smith's masking in the approximation of
    /// Walter et al. 2007.
    fn beckmann(&self, roughness: f64) -> f64 {
        let m2 = roughness * roughness;
        let c2 = self.cos_h * self.cos_h;
        let distribution = (-self.sin2_h / (c2 * m2)).exp() / (PI * m2 * c2 * c2);
        let visible = |cos: f64| {
            let a = cos / (roughness * (1.0 - cos * cos).sqrt().max(1e-12));
            if a < 1.6 { (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a) } else { 1.0 }
        };
        distribution * visible(self.cos_i) * visible(self.cos_o) / (4.0 * self.cos_i * self.cos_o)
    }
}

/// Lobes of several roughnesses, each `(share, roughness)`.
pub(crate) type Lobes = &'static [(f64, f64)];

fn beckmann(lobes: Lobes, angles: &Angles) -> f64 {
    lobes.iter().map(|&(share, roughness)| share * angles.beckmann(roughness)).sum()
}

/// Rough diffuse reflection (Oren and Nayar 1994, the qualitative model).
#[derive(Debug)]
pub(crate) struct OrenNayar {
    /// Albedo of the facets, 0 to 1.
    pub(crate) albedo: f64,
    /// Standard deviation of the facets' angle, radians.
    pub(crate) slope: f64,
}

impl Parametric for OrenNayar {
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
        if wi.z <= 0.0 || wo.z <= 0.0 {
            return 0.0;
        }
        let s2 = self.slope * self.slope;
        let (a, b) = (1.0 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09));
        // cos(phi_i - phi_o) sin alpha tan beta, alpha the larger and beta the smaller angle to the
        // normal.
        let lateral = (wi.x * wo.x + wi.y * wo.y).max(0.0) / wi.z.max(wo.z);
        self.albedo * FRAC_1_PI * (a + b * lateral)
    }
}

/// Cloth: a sheen that is bright where facets stand upright (Estevez and Kulla 2017, with the
/// denominator of Neubelt and Pettineo 2013) over a Lambertian part.
#[derive(Debug)]
struct Velvet {
    diffuse: f64,
    /// Factor of the sheen.
    sheen: f64,
    /// Lean of the fibres from upright, 0 to 1.
    roughness: f64,
}

impl Parametric for Velvet {
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
        let Some(angles) = Angles::new(wi, wo) else { return 0.0 };
        let power = 1.0 / self.roughness;
        let distribution = (2.0 + power) * angles.sin2_h.powf(0.5 * power) * 0.5 * FRAC_1_PI;
        let spread = 4.0 * (angles.cos_i + angles.cos_o - angles.cos_i * angles.cos_o);
        self.diffuse * FRAC_1_PI + self.sheen * distribution / spread
    }
}

/// Microfacets of a conductor with the exact Fresnel reflectance, over a Lambertian part. The
/// Lambertian part models scattering by dust and multiple reflections, as in every measured metal.
/// The tails of Beckmann's distribution vanish quickly; the Lambertian part keeps the logarithm of
/// the reflectance meaningful there.
#[derive(Debug)]
pub(crate) struct Metal {
    /// Albedo of the Lambertian part.
    pub(crate) diffuse: f64,
    pub(crate) lobes: Lobes,
    /// Real part of the refractive index.
    pub(crate) eta: f64,
    /// Imaginary part.
    pub(crate) k: f64,
}

impl Parametric for Metal {
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
        let Some(angles) = Angles::new(wi, wo) else { return 0.0 };
        let lobes = beckmann(self.lobes, &angles) * conductor(angles.cos_d, self.eta, self.k);
        self.diffuse * FRAC_1_PI + lobes
    }
}

/// A smooth to rough dielectric coat over a rough diffuse base, which the light reaches and leaves
/// through the coat.
#[derive(Debug)]
pub(crate) struct Coated {
    pub(crate) base: OrenNayar,
    pub(crate) lobes: Lobes,
    /// Refractive index of the coat.
    pub(crate) eta: f64,
}

impl Parametric for Coated {
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
        let Some(angles) = Angles::new(wi, wo) else { return 0.0 };
        let enters = |cos: f64| 1.0 - dielectric(cos, self.eta);
        beckmann(self.lobes, &angles) * dielectric(angles.cos_d, self.eta)
            + enters(angles.cos_i) * enters(angles.cos_o) * self.base.eval(wi, wo)
    }
}

/// Microfacets of a dielectric over a Lambertian body.
#[derive(Debug)]
pub(crate) struct Plastic {
    /// Albedo of the body.
    pub(crate) diffuse: f64,
    pub(crate) roughness: f64,
    /// Refractive index.
    pub(crate) eta: f64,
}

impl Parametric for Plastic {
    fn eval(&self, wi: DVec3, wo: DVec3) -> f64 {
        let Some(angles) = Angles::new(wi, wo) else { return 0.0 };
        let enters = |cos: f64| 1.0 - dielectric(cos, self.eta);
        let body = enters(angles.cos_i) * enters(angles.cos_o) * self.diffuse * FRAC_1_PI;
        body + angles.beckmann(self.roughness) * dielectric(angles.cos_d, self.eta)
    }
}

/// Reflectance of unpolarised light by a dielectric of refractive index `eta`, at the cosine of
/// incidence.
fn dielectric(cos: f64, eta: f64) -> f64 {
    let g = (eta * eta - 1.0 + cos * cos).sqrt();
    let (minus, plus) = (g - cos, g + cos);
    0.5 * (minus / plus).powi(2) * (1.0 + ((cos * plus - 1.0) / (cos * minus + 1.0)).powi(2))
}

/// Reflectance of unpolarised light by a conductor of refractive index `eta - i k`, at the cosine
/// of incidence.
fn conductor(cos: f64, eta: f64, k: f64) -> f64 {
    let (c2, s2) = (cos * cos, 1.0 - cos * cos);
    let difference = eta * eta - k * k - s2;
    let modulus = difference.hypot(2.0 * eta * k);
    let real = (0.5 * (modulus + difference)).max(0.0).sqrt();
    let ratio = |sum: f64, cross: f64| (sum - cross) / (sum + cross);
    let perpendicular = ratio(modulus + c2, 2.0 * cos * real);
    let parallel = perpendicular * ratio(c2 * modulus + s2 * s2, 2.0 * cos * real * s2);
    0.5 * (perpendicular + parallel)
}

#[cfg(test)]
mod tests {
    use gonio::reflectance::parametric::directions;

    use super::*;
    use crate::metrics::{Class, Gloss};

    #[test]
    fn formulas_are_reciprocal_and_have_an_albedo_below_one() {
        for (name, formula) in formulas() {
            for h in [0.0, 0.2, 0.7, 1.2] {
                for d in [0.0, 0.4, 1.0, 1.4] {
                    for phi in [0.0, 0.9, 2.0, 3.0] {
                        let (wi, wo) = directions(h, d, phi);
                        let (there, back) = (formula.eval(wi, wo), formula.eval(wo, wi));
                        assert!((there - back).abs() <= 1e-9 * there && there >= 0.0, "{name}: {there} {back}");
                    }
                }
            }
            let albedo = formula.to_bivariate().normal_albedo();
            assert!((0.02..1.0).contains(&albedo), "{name}: {albedo}");
        }
    }

    #[test]
    fn formulas_span_the_gloss_classes() {
        let classes: Vec<(&str, Class)> =
            formulas().iter().map(|(name, f)| (*name, Class::of(&Gloss::of(&f.to_bivariate())))).collect();
        use Class::{DielectricGloss, Matte, Metal, Mirror, Satin};
        let want = [Matte, Matte, Satin, Satin, Satin, DielectricGloss, DielectricGloss, Metal, Metal, Mirror];
        assert_eq!(classes.iter().map(|c| c.1).collect::<Vec<_>>(), want, "{classes:?}");
    }

    #[test]
    fn fresnel_reflectances_match_manual_calculations() {
        // Glass and silver along the normal: ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2). At the horizon,
        // all light is reflected.
        assert!((dielectric(1.0, 1.5) - 0.04).abs() < 1e-12);
        let silver = (0.85_f64.powi(2) + 3.5 * 3.5) / (1.15_f64.powi(2) + 3.5 * 3.5);
        assert!((conductor(1.0, 0.15, 3.5) - silver).abs() < 1e-12);
        assert!((dielectric(1e-9, 1.5) - 1.0).abs() < 1e-6 && (conductor(1e-9, 0.15, 3.5) - 1.0).abs() < 1e-6);
        // Without absorption a conductor is a dielectric; at Brewster's angle only light of
        // perpendicular polarisation, half of the whole, is reflected.
        for cos in [0.1, 0.4, 0.9] {
            assert!((conductor(cos, 1.5, 0.0) - dielectric(cos, 1.5)).abs() < 1e-9);
        }
        let brewster = 1.5_f64.atan().cos();
        let perpendicular = ((1.0 - 2.25) / (1.0 + 2.25_f64)).powi(2);
        assert!((dielectric(brewster, 1.5) - 0.5 * perpendicular).abs() < 1e-12);
    }

    #[test]
    fn lobes_have_the_expected_albedo() {
        // A perfect conductor reflects all light that is not shadowed. Along the normal, almost no
        // light is shadowed.
        let mirror = Metal { diffuse: 0.0, lobes: &[(0.5, 0.05), (0.5, 0.1)], eta: 1e-3, k: 1e3 };
        let albedo = mirror.to_bivariate().normal_albedo();
        assert!((albedo - 1.0).abs() < 0.01, "{albedo}");
        // Facets without slope are Lambertian.
        let flat = OrenNayar { albedo: 0.5, slope: 0.0 };
        assert!((flat.to_bivariate().normal_albedo() - 0.5).abs() < 1e-6);
    }
}
