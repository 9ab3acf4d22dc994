//! Pictures computed pixel by pixel.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::Vec3;

use crate::parallel;
use crate::picture::{Picture, Plane};

/// Computes pictures of `count` materials pixel by pixel, with rows in parallel.
///
/// `pixel` returns at `(x, y)` the colour of each material and alpha, or no colours if they are
/// black. `progress` receives a fraction in 0..=1 after each row.
pub(super) fn pictures_of(
    count: usize,
    (width, height): (usize, usize),
    pixel: impl Fn(usize, usize) -> (Vec<Vec3>, f32) + Sync,
    progress: &(dyn Fn(f64) + Sync),
) -> Vec<Picture> {
    let done = AtomicUsize::new(0);
    let rows: Vec<(Vec<Vec3>, Vec<f32>)> = parallel::map_range(height, |y| {
        let (mut colours, mut alpha) = (vec![Vec3::ZERO; count * width], vec![0.0; width]);
        for x in 0..width {
            let (found, coverage) = pixel(x, y);
            found.into_iter().enumerate().for_each(|(material, colour)| colours[material * width + x] = colour);
            alpha[x] = coverage;
        }
        progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / height as f64);
        (colours, alpha)
    });
    let alpha: Vec<f32> = rows.iter().flat_map(|row| &row.1).copied().collect();
    let picture = |material: usize| {
        let rgb = rows.iter().flat_map(|row| &row.0[material * width..][..width]).copied().collect();
        let alpha = Plane::from_vec(width, height, alpha.clone());
        Picture { rgb: Plane::from_vec(width, height, rgb), alpha: Some(alpha) }
    };
    (0..count).map(picture).collect()
}
