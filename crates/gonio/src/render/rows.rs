//! Pictures computed pixel by pixel.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use crate::picture::{Picture, Plane};

/// Computes a picture pixel by pixel, with rows in parallel.
///
/// `pixel` returns colour and alpha at `(x, y)`. `progress` receives a fraction in 0..=1 after each
/// row.
pub(super) fn picture_of(
    (width, height): (usize, usize),
    pixel: impl Fn(usize, usize) -> (Vec3, f32) + Sync,
    progress: &(dyn Fn(f64) + Sync),
) -> Picture {
    let done = AtomicUsize::new(0);
    let pixels: Vec<(Vec3, f32)> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let row: Vec<(Vec3, f32)> = (0..width).map(|x| pixel(x, y)).collect();
            progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / height as f64);
            row
        })
        .collect();
    let (rgb, alpha) = pixels.into_iter().unzip();
    Picture { rgb: Plane::from_vec(width, height, rgb), alpha: Some(Plane::from_vec(width, height, alpha)) }
}
