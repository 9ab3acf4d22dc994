//! Ground truth: materials rendered in captured light and stored in the cache.

use anyhow::Result;
use glam::Vec3;
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio::render::{Brdf, IntegratorSettings, LightTree, images_of_basis, radiance};
use gonio::shape::SurfacePoint;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::cache::Cache;

/// A rendered list of points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Render {
    /// Linear RGB of each point.
    pub(crate) rgb: Vec<[f32; 3]>,
}

impl Render {
    /// Returns the linear RGB of each point.
    pub(crate) fn colours(&self) -> Vec<Vec3> {
        self.rgb.iter().copied().map(Vec3::from_array).collect()
    }
}

/// Version of the renders. Raise it when the renderer gives different pictures for the same input.
const VERSION: u32 = 2;

/// Settings of reference renders. Pictures differ by 0.05 to 0.4 % from pictures with a twentieth
/// of this tolerance, after the best common scale (`gonio-eval quadrature`).
pub(crate) const ACCURACY: IntegratorSettings = IntegratorSettings { tolerance: 0.2, max_cells: 40_000 };

/// Settings of draft renders: accurate enough for training photographs and for comparing settings.
pub(crate) const DRAFT: IntegratorSettings = IntegratorSettings { tolerance: 0.3, max_cells: 8_000 };

/// Returns the cache key of the render of a material in a light at points. `material` and `light`
/// are fingerprints.
pub(crate) fn render_key(material: &str, light: &str, points: &[SurfacePoint]) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(
        format!("render {VERSION} {} {} {material} {light}", ACCURACY.tolerance, ACCURACY.max_cells).as_bytes(),
    );
    hash_points(&mut hasher, points);
    format!("render-{}", hasher.finalize().to_hex())
}

/// Returns the cache key of the images of basis functions in a light. `light` is a fingerprint.
pub(crate) fn basis_key(functions: &[BivariateTable], light: &str, points: &[SurfacePoint]) -> String {
    let mut hasher = blake3::Hasher::new();
    let IntegratorSettings { tolerance, max_cells } = IntegratorSettings::default();
    hasher.update(format!("basis images {VERSION} {tolerance} {max_cells} {light}").as_bytes());
    for value in functions.iter().flat_map(BivariateTable::as_slice) {
        hasher.update(&value.to_le_bytes());
    }
    hash_points(&mut hasher, points);
    format!("images-{}", hasher.finalize().to_hex())
}

fn hash_points(hasher: &mut blake3::Hasher, points: &[SurfacePoint]) {
    for value in points.iter().flat_map(|p| [p.normal, p.view]).flat_map(|v| v.to_array()) {
        hasher.update(&value.to_le_bytes());
    }
}

/// Renders the full table at every point.
pub(crate) fn render(material: &MerlTable, light: &LightTree, points: &[SurfacePoint]) -> Render {
    let envelope = material.envelope();
    let rgb = |p: &SurfacePoint| radiance(p, material, &envelope, light, &ACCURACY).as_vec3().to_array();
    Render { rgb: points.par_iter().map(rgb).collect() }
}

/// Returns the images of basis functions in a light, `[point][function]`. Loads them from the cache
/// if it contains them.
pub(crate) fn images(
    cache: &Cache,
    functions: &[BivariateTable],
    light: &str,
    tree: &dyn Fn() -> Result<LightTree>,
    points: &[SurfacePoint],
) -> Result<Vec<f32>> {
    let key = basis_key(functions, light, points);
    if let Some(bytes) = cache.load(&key).filter(|b| b.len() == 4 * functions.len() * points.len()) {
        return Ok(bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect());
    }
    let images = images_of_basis(points, functions, &tree()?, &IntegratorSettings::default(), &|_| ());
    cache.store(&key, &images.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())?;
    Ok(images)
}

/// Adds white noise to an image. The standard deviation is `relative` times the mean of the image,
/// and `key` determines the seed. Negative values become zero.
pub(crate) fn add_noise(values: &mut [f64], relative: f64, key: &str) {
    if relative <= 0.0 {
        return;
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let seed = blake3::hash(key.as_bytes());
    let seed = u64::from_le_bytes(seed.as_bytes()[..8].try_into().expect("a hash has 32 bytes"));
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    for value in values {
        let z: f64 = StandardNormal.sample(&mut rng);
        *value = (*value + relative * mean * z).max(0.0);
    }
}

/// Adds independent noise to the channels of an image. The standard deviation is `relative` times
/// the mean of the channel, and `key` determines the seed. Negative values become zero.
pub(crate) fn add_noise_rgb(image: &mut [Vec3], relative: f64, key: &str) {
    for c in 0..3 {
        let mut values: Vec<f64> = image.iter().map(|rgb| f64::from(rgb[c])).collect();
        add_noise(&mut values, relative, &format!("{key} {c}"));
        image.iter_mut().zip(values).for_each(|(rgb, value)| rgb[c] = value as f32);
    }
}

/// White light, the same from all directions, for tests.
#[cfg(test)]
pub(crate) fn white() -> LightTree {
    use gonio::lighting::EnvironmentMap;
    use gonio::picture::Plane;
    LightTree::of_map(&EnvironmentMap::new(Plane::from_fn(16, 8, |_, _| Vec3::ONE)).expect("a map"))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn point() -> SurfacePoint {
        SurfacePoint { normal: DVec3::Z, view: DVec3::Z }
    }

    #[test]
    fn a_white_diffuse_surface_has_the_radiance_of_the_light() {
        let white_table = BivariateTable::from_fn(|_, _| std::f64::consts::FRAC_1_PI);
        let full = MerlTable::from_bivariate([&white_table; 3]);
        let got = render(&full, &white(), &[point(); 3]);
        // The error of the midpoint rule is one-sided under a constant light, and larger than under
        // any real light.
        assert!(got.rgb[1].iter().all(|c| (c - 1.0).abs() < 0.05), "{got:?}");
        // Each channel has its own albedo.
        let full = MerlTable::from_bivariate([&white_table, &white_table.scaled(0.5), &white_table.scaled(0.1)]);
        let [r, g, b] = render(&full, &white(), &[point()]).rgb[0];
        assert!((g / r - 0.5).abs() < 1e-3 && (b / r - 0.1).abs() < 1e-3, "{r} {g} {b}");
    }

    #[test]
    fn noise_has_the_stated_deviation_and_is_repeatable() {
        let clean = vec![2.0; 20_000];
        let (mut a, mut b) = (clean.clone(), clean.clone());
        add_noise(&mut a, 0.05, "k");
        add_noise(&mut b, 0.05, "k");
        assert_eq!(a, b);
        let sd = (a.iter().map(|x| (x - 2.0) * (x - 2.0)).sum::<f64>() / a.len() as f64).sqrt();
        assert!((sd - 0.1).abs() < 0.003, "{sd}");
    }
}
