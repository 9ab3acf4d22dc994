//! Figures: objects with the same normal at several places.
//!
//! Pixels of a figure with the same normal lie on different parts of its surface, which can be
//! shadowed or lit by other parts, or worn. Each part covers a region of normals, so the mixture of
//! parts changes abruptly between cells. This creates streaks and edges on the disk that are not
//! reflections.

use rand::Rng;

use super::PhotographEffects;
use super::fields::{between, field, gauss, log_between};
use crate::appearance::disk::{DISK_SIDE, centre, on_disk};

/// Statistics of the pixels of a cell: their number, and means over the parts that share the cell.
#[derive(Clone, Copy, Default)]
struct Shared {
    /// Number of pixels of all parts, with mean one over the disk.
    density: f32,
    /// Mean of the factor by which the scene is multiplied.
    factor: f32,
    /// Mean of the light added to the scene, relative to the scene's mean.
    added: f32,
    /// Variances of factor and added light among the pixels, and their covariance.
    spread: [f32; 3],
}

/// Parts of a figure, summed in each cell.
pub(super) struct MultiPartObject {
    cells: Vec<Shared>,
}

/// A region of normals, `(x, y)` on the disk: an ellipse whose edge a random field makes uneven.
struct Part {
    middle: (f32, f32),
    /// Unit vector of the longer axis.
    along: (f32, f32),
    /// Semi-axes.
    reach: (f32, f32),
    /// Number of pixels in a cell.
    weight: f32,
    albedo: f32,
    /// Depth of shadow at the middle of the part, and its slopes over the part.
    dark: (f32, f32, f32),
    /// Light received from other parts.
    lit: f32,
}

impl Part {
    fn draw(stains: f32, rng: &mut impl Rng) -> Self {
        let angle = between(rng, 0.0, std::f32::consts::PI);
        let distance = between(rng, 0.0, 1.0).sqrt();
        let direction = between(rng, 0.0, std::f32::consts::TAU);
        let long = log_between(rng, 0.1, 1.0);
        Self {
            middle: (distance * direction.cos(), distance * direction.sin()),
            along: (angle.cos(), angle.sin()),
            reach: (long, long * log_between(rng, 0.15, 1.0)),
            weight: log_between(rng, 0.3, 5.0),
            ..Self::whole(stains, rng)
        }
    }

    /// Draws the body of the figure, which shows all normals.
    fn whole(stains: f32, rng: &mut impl Rng) -> Self {
        Self {
            middle: (0.0, 0.0),
            along: (1.0, 0.0),
            reach: (9.0, 9.0),
            weight: 1.0,
            albedo: (stains * gauss(rng)).exp(),
            dark: (between(rng, -0.6, 1.0), 0.5 * gauss(rng), 0.5 * gauss(rng)),
            lit: between(rng, -0.5, 1.0),
        }
    }

    /// Returns the squared distance from the middle in semi-axes.
    fn distance(&self, (x, y): (f32, f32)) -> f32 {
        let (x, y) = (x - self.middle.0, y - self.middle.1);
        let (along, across) = (x * self.along.0 + y * self.along.1, y * self.along.0 - x * self.along.1);
        (along / self.reach.0).powi(2) + (across / self.reach.1).powi(2)
    }

    /// Iterates over the cells of the square that the part may reach.
    fn cells(&self) -> impl Iterator<Item = usize> + use<> {
        // The uneven edge may extend the part by about half its length.
        let reach = 1.6 * self.reach.0;
        let range = |middle: f32| {
            let cell = |at: f32| ((0.5 * at + 0.5) * DISK_SIDE as f32).clamp(0.0, DISK_SIDE as f32) as usize;
            cell(middle - reach)..(cell(middle + reach) + 1).min(DISK_SIDE)
        };
        // Row indices increase downwards; y points upwards.
        let (rows, columns) = (range(-self.middle.1), range(self.middle.0));
        rows.flat_map(move |row| columns.clone().map(move |column| row * DISK_SIDE + column))
    }

    /// Returns the depth of shadow at a place.
    fn depth(&self, (x, y): (f32, f32)) -> f32 {
        self.dark.0 + self.dark.1 * (x - self.middle.0) + self.dark.2 * (y - self.middle.1)
    }
}

impl MultiPartObject {
    /// Draws a figure with the stains, the shadow and the interreflections of a camera.
    pub(super) fn draw(camera: &PhotographEffects, rng: &mut impl Rng) -> Self {
        let count = log_between(rng, 3.0, 60.0) as usize;
        let whole = Part::whole(camera.stains, rng);
        let parts: Vec<Part> =
            std::iter::once(whole).chain((0..count).map(|_| Part::draw(camera.stains, rng))).collect();
        let (edge, dark, lit) = (field(9, rng), field(5, rng), field(4, rng));
        let mut cells = vec![Shared::default(); DISK_SIDE * DISK_SIDE];
        for part in &parts {
            let inside = |&c: &usize| part.distance(centre(c)) <= (1.0 + 0.5 * edge[c]).max(0.1);
            for cell in part.cells().filter(inside) {
                let depth = part.depth(centre(cell)) + 0.4 * dark[cell];
                let factor = (1.0 - camera.shadow * depth.clamp(0.0, 1.0)) * part.albedo;
                let added = camera.bounce * (part.lit + 0.5 * lit[cell]).max(0.0);
                cells[cell].add(part.weight, factor, added);
            }
        }
        cells.iter_mut().for_each(Shared::finish);
        let on = || (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c));
        let mean = on().map(|c| cells[c].density).sum::<f32>() / on().count() as f32;
        cells.iter_mut().for_each(|c| c.density /= mean);
        Self { cells }
    }

    /// Iterates over the number of pixels of each cell, with mean one over the disk.
    pub(super) fn densities(&self) -> impl Iterator<Item = f32> {
        self.cells.iter().map(|c| c.density)
    }

    /// Applies the figure to the values and details of a scene with the mean `mean`.
    ///
    /// Returns the variance among the pixels of each cell.
    pub(super) fn show(&self, image: &mut [f32], details: &mut [f32], mean: f32) -> Vec<f32> {
        let seen = image.iter_mut().zip(details).zip(&self.cells);
        let cell = |((image, detail), shared): ((&mut f32, &mut f32), &Shared)| {
            let (value, [factor, added, both]) = (*image, shared.spread);
            *image = value * shared.factor + mean * shared.added;
            *detail *= shared.factor;
            (value * value * factor + mean * mean * added + 2.0 * value * mean * both).max(0.0)
        };
        seen.map(cell).collect()
    }
}

impl Shared {
    /// Adds the pixels of a part. All fields are sums until [`Self::finish`].
    fn add(&mut self, weight: f32, factor: f32, added: f32) {
        self.density += weight;
        self.factor += weight * factor;
        self.added += weight * added;
        for (sum, square) in self.spread.iter_mut().zip([factor * factor, added * added, factor * added]) {
            *sum += weight * square;
        }
    }

    /// Converts sums to means and variances.
    fn finish(&mut self) {
        let weight = self.density.max(1e-6);
        self.factor /= weight;
        self.added /= weight;
        let (factor, added) = (self.factor, self.added);
        for (sum, mean) in self.spread.iter_mut().zip([factor * factor, added * added, factor * added]) {
            *sum = *sum / weight - mean;
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;

    const ALL: PhotographEffects =
        PhotographEffects { stains: 0.2, shadow: 0.6, bounce: 0.1, ..PhotographEffects::CLEAN };

    fn shown(camera: &PhotographEffects, seed: u64) -> (Vec<f32>, Vec<f32>) {
        let (mut image, mut details) = (vec![2.0; DISK_SIDE * DISK_SIDE], vec![0.1; DISK_SIDE * DISK_SIDE]);
        let variance =
            MultiPartObject::draw(camera, &mut Pcg64::seed_from_u64(seed)).show(&mut image, &mut details, 2.0);
        (image, variance)
    }

    #[test]
    fn without_effects_all_parts_are_equal() {
        let (image, variance) = shown(&PhotographEffects::CLEAN, 1);
        assert!(image.iter().all(|v| (v - 2.0).abs() < 1e-4) && variance.iter().all(|v| *v < 1e-4));
    }

    #[test]
    fn every_normal_has_pixels_and_some_have_more() {
        let density: Vec<f32> = MultiPartObject::draw(&ALL, &mut Pcg64::seed_from_u64(2)).densities().collect();
        let on: Vec<f32> = (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)).map(|c| density[c]).collect();
        let mean = on.iter().sum::<f32>() / on.len() as f32;
        assert!((mean - 1.0).abs() < 1e-3 && on.iter().all(|d| *d > 0.0));
        assert!(on.iter().any(|d| *d > 1.5));
    }

    #[test]
    fn parts_have_sharp_edges() {
        // Steps between neighbouring cells are larger than in a smooth field of the same variance,
        // whose waves are no shorter than a dozen cells.
        let (mut steps, mut total) = (0.0, 0.0);
        for seed in 0..8 {
            let (image, _) = shown(&ALL, seed);
            let on: Vec<usize> = (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c) && on_disk(c + 1)).collect();
            let mean = on.iter().map(|&c| image[c]).sum::<f32>() / on.len() as f32;
            let largest = on.iter().map(|&c| (image[c + 1] - image[c]).abs()).fold(0.0, f32::max);
            steps += largest;
            total += (on.iter().map(|&c| (image[c] - mean).powi(2)).sum::<f32>() / on.len() as f32).sqrt();
        }
        assert!(steps > 1.0 * total, "{steps} {total}");
    }

    #[test]
    fn only_cells_with_several_parts_have_variance() {
        // Cells that only the body covers have no variance.
        let figure = MultiPartObject::draw(
            &PhotographEffects { stains: 0.3, ..PhotographEffects::CLEAN },
            &mut Pcg64::seed_from_u64(5),
        );
        let alone = figure.densities().fold(f32::INFINITY, f32::min);
        let (mut image, mut details) = (vec![1.0; DISK_SIDE * DISK_SIDE], vec![0.0; DISK_SIDE * DISK_SIDE]);
        let variance = figure.show(&mut image, &mut details, 1.0);
        let mut several = 0;
        for cell in (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)) {
            if figure.cells[cell].density < 1.0001 * alone {
                assert!(variance[cell] < 1e-5);
            } else {
                several += usize::from(variance[cell] > 1e-4);
            }
        }
        assert!(several > 100);
    }
}
