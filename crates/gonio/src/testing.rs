//! Helpers for tests of several modules.

use std::collections::BTreeMap;
use std::sync::Mutex;

use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};

use crate::lighting::{EnvironmentMap, LightGrid, LightPrior, PriorSettings};
use crate::picture::Plane;
use crate::reflectance::BivariateTable;
use crate::shape::SurfacePoint;
use crate::sphere::{OctahedralMap, direction_of_lat_long, fibonacci_hemisphere};

/// Runs `f` on a new pool of `threads` threads.
pub(crate) fn on_threads<R: Send>(threads: usize, f: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(f)
}

/// Returns random numbers from -1 to 1.
pub(crate) fn random(n: usize, seed: u64) -> Vec<f64> {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    (0..n).map(|_| rng.random_range(-1.0..1.0)).collect()
}

/// Returns the sum of a constant and a Gaussian lobe over the half angle; `width` in radians.
pub(crate) fn lobe(floor: f64, strength: f64, width: f64) -> BivariateTable {
    BivariateTable::from_fn(move |h, _| floor + strength * (-(h / width).powi(2)).exp())
}

/// Returns a grey environment map with radiance `f(direction)`.
pub(crate) fn environment_map(columns: usize, f: impl Fn(DVec3) -> f64) -> EnvironmentMap {
    let rows = columns / 2;
    let direction =
        |x: usize, y: usize| direction_of_lat_long((x as f64 + 0.5) / columns as f64, (y as f64 + 0.5) / rows as f64);
    EnvironmentMap::new(Plane::from_fn(columns, rows, |x, y| Vec3::splat(f(direction(x, y)) as f32))).unwrap()
}

/// Returns points on the front of a ball.
pub(crate) fn ball(count: usize) -> Vec<SurfacePoint> {
    fibonacci_hemisphere(count).map(|normal| SurfacePoint { normal, view: DVec3::Z }).collect()
}

/// Returns random lamps over a sky.
pub(crate) fn toy_sky(side: usize, rng: &mut rand_pcg::Pcg64) -> LightGrid {
    let texels = (0..side * side)
        .map(|t| {
            let lamp = if rng.random_range(0..40) == 0 { 15.0 } else { 0.0 };
            Vec3::splat(lamp + rng.random_range(0.2..1.0) + if t < side * side / 2 { 1.0 } else { 0.0 })
        })
        .collect();
    LightGrid::from_texels(OctahedralMap::EqualArea, side, texels)
}

/// Returns the prior learnt from thirty toy skies, computed once for each side.
pub(crate) fn toy_prior(side: usize) -> LightPrior {
    static LEARNT: Mutex<BTreeMap<usize, LightPrior>> = Mutex::new(BTreeMap::new());
    let learn = || {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(4);
        let lights: Vec<LightGrid> = (0..30).map(|_| toy_sky(side, &mut rng)).collect();
        LightPrior::learn(&lights, 30, &PriorSettings::default()).unwrap()
    };
    LEARNT.lock().unwrap().entry(side).or_insert_with(learn).clone()
}

/// Returns a diffuse table and two lobes.
pub(crate) fn toy_tables() -> Vec<BivariateTable> {
    vec![lobe(0.3, 0.0, 1.0), lobe(0.0, 1.0, 0.1), lobe(0.0, 1.0, 0.4)]
}

/// Returns points on the front of a ball, without its rim.
pub(crate) fn sphere_points(count: usize) -> Vec<SurfacePoint> {
    ball(count).into_iter().filter(|p| p.normal.z > 80.0_f64.to_radians().cos()).collect()
}
