//! Helpers for tests of several modules.
//!
//! Some are copies of helpers in `gonio`. A shared crate of test helpers would depend on `gonio`,
//! and its types would differ from those in the unit tests of `gonio`.

use std::collections::BTreeMap;
use std::sync::Mutex;

use glam::{DVec3, Vec3};
use gonio::lighting::{LightGrid, LightPrior, PriorSettings};
use gonio::reflectance::BivariateTable;
use gonio::shape::SurfacePoint;
use gonio::sphere::{OctahedralMap, fibonacci_hemisphere};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Runs `f` on a new pool of `threads` threads.
pub(crate) fn on_threads<R: Send>(threads: usize, f: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(f)
}

/// Returns random numbers from -1 to 1.
pub(crate) fn random(n: usize, seed: u64) -> Vec<f64> {
    let mut rng = Pcg64::seed_from_u64(seed);
    (0..n).map(|_| rng.random_range(-1.0..1.0)).collect()
}

/// Inner product.
pub(crate) fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns random lamps over a sky that is brighter above.
pub(crate) fn toy_sky(side: usize, rng: &mut Pcg64) -> LightGrid {
    let texel = |t: usize| {
        let lamp = if rng.random_range(0..40) == 0 { 15.0 } else { 0.0 };
        Vec3::splat(lamp + rng.random_range(0.2..1.0) + if t < side * side / 2 { 1.0 } else { 0.0 })
    };
    LightGrid::from_texels(OctahedralMap::EqualArea, side, (0..side * side).map(texel).collect())
}

/// Returns the prior learnt from thirty toy skies, computed once for each side.
pub(crate) fn toy_prior(side: usize) -> LightPrior {
    static LEARNT: Mutex<BTreeMap<usize, LightPrior>> = Mutex::new(BTreeMap::new());
    let learn = || {
        let mut rng = Pcg64::seed_from_u64(4);
        let lights: Vec<LightGrid> = (0..30).map(|_| toy_sky(side, &mut rng)).collect();
        LightPrior::learn(&lights, 30, &PriorSettings::default()).unwrap()
    };
    LEARNT.lock().unwrap().entry(side).or_insert_with(learn).clone()
}

/// Returns a diffuse table and two lobes.
pub(crate) fn toy_tables() -> Vec<BivariateTable> {
    let lobe = |strength: f64, width: f64| BivariateTable::from_fn(move |h, _| strength * (-(h / width).powi(2)).exp());
    vec![BivariateTable::from_fn(|_, _| 0.3), lobe(1.0, 0.1), lobe(1.0, 0.4)]
}

/// Returns points on the front of a ball, without its rim.
pub(crate) fn sphere_points(count: usize) -> Vec<SurfacePoint> {
    let points = fibonacci_hemisphere(count).map(|normal| SurfacePoint { normal, view: DVec3::Z });
    points.filter(|p| p.normal.z > 80.0_f64.to_radians().cos()).collect()
}
