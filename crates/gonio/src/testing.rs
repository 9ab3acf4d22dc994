//! Helpers for tests of several modules.

use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};

use crate::lighting::EnvironmentMap;
use crate::picture::Plane;
use crate::reflectance::BivariateTable;
use crate::shape::SurfacePoint;
use crate::sphere::{direction_of_lat_long, fibonacci_hemisphere};

/// Runs `f` on a new pool of `threads` threads.
pub(crate) fn on_threads<R: Send>(threads: usize, f: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(f)
}

/// Returns random numbers from -1 to 1.
pub(crate) fn random(n: usize, seed: u64) -> Vec<f64> {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    (0..n).map(|_| rng.random_range(-1.0..1.0)).collect()
}

/// Inner product.
pub(crate) fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns the sum of a constant and a Gaussian lobe over the half angle; `width` in radians.
pub(crate) fn lobe(floor: f64, strength: f64, width: f64) -> BivariateTable {
    BivariateTable::from_fn(move |h, _| floor + strength * (-(h / width).powi(2)).exp())
}

/// Returns a grey light map with radiance `f(direction)`.
pub(crate) fn light_map(columns: usize, f: impl Fn(DVec3) -> f64) -> EnvironmentMap {
    let rows = columns / 2;
    let direction =
        |x: usize, y: usize| direction_of_lat_long((x as f64 + 0.5) / columns as f64, (y as f64 + 0.5) / rows as f64);
    EnvironmentMap::new(Plane::from_fn(columns, rows, |x, y| Vec3::splat(f(direction(x, y)) as f32))).unwrap()
}

/// Returns points on the front of a ball.
pub(crate) fn ball(count: usize) -> Vec<SurfacePoint> {
    fibonacci_hemisphere(count).map(|normal| SurfacePoint { normal, view: DVec3::Z }).collect()
}
