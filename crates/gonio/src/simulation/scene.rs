//! Ideal pictures of a ball, on the disk of normals.

use std::sync::LazyLock;

use glam::Vec3;

use super::ball::{BallRenderer, Rings};
use super::orbit::Orbits;
use super::pyramid::LightPyramid;
use crate::appearance::detail::details;
use crate::appearance::disk::{self, DISK_SIDE, on_disk};
use crate::parallel;
use crate::reflectance::BivariateTable;

/// Ideal image of a ball, without camera effects. Both fields are zero off the disk.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Mean luminance of each cell.
    pub values: Vec<f32>,
    /// Detail finer than the cells, as
    /// [`DiskImage::details`](crate::appearance::DiskImage::details).
    pub details: Vec<f32>,
}

/// Renderer of scenes.
#[derive(Clone, Debug)]
pub struct SceneRenderer {
    ball: BallRenderer,
    cells: Vec<usize>,
    /// Normals at the middles of the cells.
    middles: Orbits,
    /// Normals at the middles of the quarters of the cells, four per cell.
    quarters: Orbits,
}

impl Default for SceneRenderer {
    fn default() -> Self {
        Self::new()
    }
}

impl SceneRenderer {
    /// Builds the renderer for the whole disk.
    pub fn new() -> Self {
        let cells: Vec<usize> = (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)).collect();
        let up = |(x, y): (f32, f32)| Vec3::new(x, y, (1.0 - x * x - y * y).sqrt());
        let middles: Vec<Vec3> = cells.iter().map(|&c| disk::normal(c)).collect();
        let quarters: Vec<Vec3> = cells.iter().flat_map(|&c| disk::quarters(c).map(up)).collect();
        Self { ball: BallRenderer::new(), cells, middles: Orbits::of(&middles), quarters: Orbits::of(&quarters) }
    }

    /// Renders the ball of each table in one light.
    ///
    /// Contributions of half vectors far from the normal change little within a cell and are
    /// rendered at its middle; the rest is rendered at its quarters.
    pub fn render(&self, tables: &[BivariateTable], light: &LightPyramid) -> Vec<Scene> {
        let far = self.ball.render(&self.middles, tables, light, Rings::Far);
        let near = self.ball.render(&self.quarters, tables, light, Rings::Near);
        parallel::map_range(far.len(), |at| self.scene(&far[at], &near[at]))
    }

    fn scene(&self, far: &[f32], near: &[f32]) -> Scene {
        let (mut values, mut quarters) = (vec![0.0; DISK_SIDE * DISK_SIDE], vec![[0.0; 4]; DISK_SIDE * DISK_SIDE]);
        for ((&cell, far), near) in self.cells.iter().zip(far).zip(near.as_chunks::<4>().0) {
            quarters[cell] = *near;
            values[cell] = far + 0.25 * near.iter().sum::<f32>();
        }
        // The plane is fitted to the near part, because the far part has no detail.
        let sharp: Vec<f32> = quarters.iter().map(|q| 0.25 * q.iter().sum::<f32>()).collect();
        let details = details(&sharp, &vec![1.0; DISK_SIDE * DISK_SIDE], |cell| Some(quarters[cell]));
        Scene { values, details: details.into_iter().map(|d| d.unwrap_or(0.0)).collect() }
    }
}

/// Scene in three bytes per cell: logarithms of values to 0.04 %, and of details to 3 %.
#[derive(Clone, Debug)]
pub(super) struct Packed {
    /// Logarithm of the largest value.
    top: f32,
    values: Vec<u16>,
    /// Encoded logarithm of the ratio of detail to value; zero if the detail is negligible.
    details: Vec<u8>,
}

/// Range of the logarithms of packed values.
const RANGE: f32 = 24.0;

/// Largest detail relative to the value, and the range of its logarithms.
const MAX_DETAIL: f32 = 2.0;
const DETAIL_RANGE: f32 = 7.0;

/// Exponentials of packed numbers.
struct Tables {
    /// Factors of the high and the low byte of a value.
    high: [f32; 256],
    low: [f32; 256],
    /// Ratios of detail to value.
    details: [f32; 256],
}

static TABLES: LazyLock<Tables> = LazyLock::new(|| {
    let (step, fine) = (RANGE / f32::from(u16::MAX), DETAIL_RANGE / 255.0);
    let detail = |k: usize| if k == 0 { 0.0 } else { MAX_DETAIL * (fine * (k as f32 - 255.0)).exp() };
    Tables {
        high: std::array::from_fn(|k| (-step * 256.0 * k as f32).exp()),
        low: std::array::from_fn(|k| (-step * k as f32).exp()),
        details: std::array::from_fn(detail),
    }
});

impl Packed {
    pub(super) fn of(scene: &Scene) -> Self {
        let on = || (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c));
        let top = scene.values.iter().copied().fold(1e-30, f32::max).ln();
        let steps = f32::from(u16::MAX) / RANGE;
        let value = |c: usize| ((top - scene.values[c].max(1e-35).ln()) * steps).round() as u16;
        let detail = |c: usize| {
            let relative = scene.details[c] / scene.values[c].max(1e-35);
            (255.0 + 255.0 / DETAIL_RANGE * (relative / MAX_DETAIL).ln()).round() as u8
        };
        Self { top, values: on().map(value).collect(), details: on().map(detail).collect() }
    }

    /// Adds the scene, multiplied by a weight.
    pub(super) fn add_to(&self, weight: f32, scene: &mut Scene) {
        let Tables { high, low, details } = &*TABLES;
        let scale = weight * self.top.exp();
        let cells = (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c));
        for ((cell, value), detail) in cells.zip(&self.values).zip(&self.details) {
            let [above, below] = value.to_be_bytes();
            let value = scale * high[usize::from(above)] * low[usize::from(below)];
            scene.values[cell] += value;
            scene.details[cell] += value * details[usize::from(*detail)];
        }
    }
}

impl Scene {
    /// Returns a black scene.
    pub(super) fn black() -> Self {
        Self { values: vec![0.0; DISK_SIDE * DISK_SIDE], details: vec![0.0; DISK_SIDE * DISK_SIDE] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lamp 1.5 degrees across on a grey background.
    fn lamp() -> LightPyramid {
        let lamp = glam::DVec3::new(0.3, 0.2, 0.9).normalize();
        LightPyramid::new(move |d| if d.angle_between(lamp) < 0.013 { 5000.0 } else { 1.0 })
    }

    fn shiny(width: f64) -> BivariateTable {
        crate::testing::lobe(0.1, 0.02 / (width * width), width)
    }

    #[test]
    fn sharper_materials_have_more_detail() {
        let scenes = SceneRenderer::new().render(&[shiny(0.005), shiny(0.02), shiny(0.08)], &lamp());
        let most = |s: &Scene| s.details.iter().zip(&s.values).map(|(d, v)| d / v.max(1e-9)).fold(0.0, f32::max);
        let [sharp, middle, wide] = [0, 1, 2].map(|at| most(&scenes[at]));
        assert!(sharp > 2.0 * middle && middle > 2.0 * wide, "{sharp} {middle} {wide}");
        assert!(scenes.iter().all(|s| s.values.iter().all(|v| v.is_finite())));
    }

    #[test]
    fn packing_preserves_a_scene() {
        let scene = SceneRenderer::new().render(&[shiny(0.01)], &lamp()).swap_remove(0);
        let packed = Packed::of(&scene);
        let mut back = Scene::black();
        packed.add_to(0.75, &mut back);
        packed.add_to(0.25, &mut back);
        for cell in (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)) {
            let (value, detail) = (scene.values[cell], scene.details[cell]);
            assert!((back.values[cell] / value - 1.0).abs() < 5e-4);
            assert!((back.details[cell] - detail).abs() < 0.02 * detail + 0.002 * value, "{}", back.details[cell]);
        }
    }
}
