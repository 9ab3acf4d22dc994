//! Figures: objects on which a normal is seen in several places.
//!
//! The pixels of a figure that share a normal lie on different parts of its surface, some in the shadow of others, some
//! lit by them, some worn. A part shows a region of normals and no more, so that what they share of a cell
//! changes abruptly from one cell to the next: streaks and edges on the disk that are none of the reflected light.

use rand::Rng;

use super::fields::{between, field, gauss};
use crate::appearance::disk::{SIDE, centre, on_disk};

/// Strengths of what differs between the parts, as in [`Camera`](super::Camera).
#[derive(Clone, Copy, Debug)]
pub(super) struct Regions {
    pub(super) stains: f32,
    pub(super) shadow: f32,
    pub(super) bounce: f32,
}

/// The parts of a figure, summed over in each cell.
pub(super) struct Figure {
    /// Pixels of all parts, with mean one over the disk.
    pub(super) density: Vec<f32>,
    /// Mean of what the scene is multiplied by.
    factor: Vec<f32>,
    /// Mean of what is added to it.
    added: Vec<f32>,
    /// Variances of both among the pixels of a cell, and half of their covariance.
    spread: [Vec<f32>; 3],
}

/// A region of normals, `(x, y)` of the disk: an ellipse, its edge made uneven by a field.
struct Part {
    middle: (f32, f32),
    /// Unit vector of the longer axis.
    along: (f32, f32),
    /// Half axes.
    reach: (f32, f32),
    /// Pixels of a cell.
    weight: f32,
    /// Logarithm of the albedo.
    albedo: f32,
    /// How deep the part lies in shadow, and how that changes over it.
    dark: (f32, f32, f32),
    /// How much light it gets from others.
    lit: f32,
}

impl Part {
    fn draw(rng: &mut impl Rng) -> Self {
        let angle = between(rng, 0.0, std::f32::consts::PI);
        let distance = between(rng, 0.0, 1.0).sqrt();
        let direction = between(rng, 0.0, std::f32::consts::TAU);
        let long = between(rng, 0.1_f32.ln(), 0.0).exp();
        Self {
            middle: (distance * direction.cos(), distance * direction.sin()),
            along: (angle.cos(), angle.sin()),
            reach: (long, long * between(rng, 0.15_f32.ln(), 0.0).exp()),
            weight: between(rng, 0.3_f32.ln(), 5.0_f32.ln()).exp(),
            ..Self::lit(rng)
        }
    }

    /// The body of the figure, which shows all normals.
    fn whole(rng: &mut impl Rng) -> Self {
        Self { reach: (9.0, 9.0), ..Self::lit(rng) }
    }

    fn lit(rng: &mut impl Rng) -> Self {
        Self {
            middle: (0.0, 0.0),
            along: (1.0, 0.0),
            reach: (1.0, 1.0),
            weight: 1.0,
            albedo: gauss(rng),
            dark: (between(rng, -0.6, 1.0), 0.5 * gauss(rng), 0.5 * gauss(rng)),
            lit: between(rng, -0.5, 1.0),
        }
    }

    /// Squared distance from the middle in half axes.
    fn distance(&self, (x, y): (f32, f32)) -> f32 {
        let (x, y) = (x - self.middle.0, y - self.middle.1);
        let (along, across) = (x * self.along.0 + y * self.along.1, y * self.along.0 - x * self.along.1);
        (along / self.reach.0).powi(2) + (across / self.reach.1).powi(2)
    }
}

impl Figure {
    pub(super) fn draw(strength: Regions, rng: &mut impl Rng) -> Self {
        let count = between(rng, 3.0_f32.ln(), 60.0_f32.ln()).exp() as usize;
        let parts: Vec<Part> = std::iter::once(Part::whole(rng)).chain((0..count).map(|_| Part::draw(rng))).collect();
        let (edge, dark, lit) = (field(9, rng), field(5, rng), field(4, rng));
        let zeros = || vec![0.0_f32; SIDE * SIDE];
        let mut figure =
            Self { density: zeros(), factor: zeros(), added: zeros(), spread: [zeros(), zeros(), zeros()] };
        for part in &parts {
            let cells = |low: f32, high: f32| {
                let cell = |at: f32| ((0.5 * at + 0.5) * SIDE as f32).clamp(0.0, SIDE as f32) as usize;
                cell(low)..(cell(high) + 1).min(SIDE)
            };
            // An uneven edge may reach half as far again.
            let reach = 1.6 * part.reach.0;
            let columns = cells(part.middle.0 - reach, part.middle.0 + reach);
            // Rows of the disk go down, y goes up.
            for row in cells(-part.middle.1 - reach, -part.middle.1 + reach) {
                for cell in row * SIDE + columns.start..row * SIDE + columns.end {
                    let (x, y) = centre(cell);
                    if part.distance((x, y)) > (1.0 + 0.5 * edge[cell]).max(0.1) {
                        continue;
                    }
                    let depth = part.dark.0
                        + part.dark.1 * (x - part.middle.0)
                        + part.dark.2 * (y - part.middle.1)
                        + 0.4 * dark[cell];
                    let factor =
                        (1.0 - strength.shadow * depth.clamp(0.0, 1.0)) * (strength.stains * part.albedo).exp();
                    let added = strength.bounce * (part.lit + 0.5 * lit[cell]).max(0.0);
                    figure.density[cell] += part.weight;
                    figure.factor[cell] += part.weight * factor;
                    figure.added[cell] += part.weight * added;
                    for (sum, square) in figure.spread.iter_mut().zip([factor * factor, added * added, factor * added])
                    {
                        sum[cell] += part.weight * square;
                    }
                }
            }
        }
        figure.normalise();
        figure
    }

    fn normalise(&mut self) {
        for cell in 0..SIDE * SIDE {
            let weight = self.density[cell].max(1e-6);
            self.factor[cell] /= weight;
            self.added[cell] /= weight;
            let (factor, added) = (self.factor[cell], self.added[cell]);
            for (sum, mean) in self.spread.iter_mut().zip([factor * factor, added * added, factor * added]) {
                sum[cell] = sum[cell] / weight - mean;
            }
        }
        let on: Vec<usize> = (0..SIDE * SIDE).filter(|&c| on_disk(c)).collect();
        let mean = on.iter().map(|&c| self.density[c]).sum::<f32>() / on.len() as f32;
        self.density.iter_mut().for_each(|d| *d /= mean);
    }

    /// What a scene of some mean shows of the figure: values and details are changed, and what comes back is
    /// the variance among the pixels of each cell.
    pub(super) fn show(&self, image: &mut [f32], details: &mut [f32], mean: f32) -> Vec<f32> {
        let cell = |c: usize| {
            let value = image[c];
            let [factor, added, both] = [0, 1, 2].map(|i: usize| self.spread[i][c]);
            image[c] = value * self.factor[c] + mean * self.added[c];
            details[c] *= self.factor[c];
            (value * value * factor + mean * mean * added + 2.0 * value * mean * both).max(0.0)
        };
        (0..SIDE * SIDE).map(cell).collect()
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;

    const ALL: Regions = Regions { stains: 0.2, shadow: 0.6, bounce: 0.1 };

    fn shown(strength: Regions, seed: u64) -> (Vec<f32>, Vec<f32>) {
        let (mut image, mut details) = (vec![2.0; SIDE * SIDE], vec![0.1; SIDE * SIDE]);
        let variance = Figure::draw(strength, &mut Pcg64::seed_from_u64(seed)).show(&mut image, &mut details, 2.0);
        (image, variance)
    }

    #[test]
    fn without_faults_every_part_is_alike() {
        let (image, variance) = shown(Regions { stains: 0.0, shadow: 0.0, bounce: 0.0 }, 1);
        assert!(image.iter().all(|v| (v - 2.0).abs() < 1e-4) && variance.iter().all(|v| *v < 1e-4));
    }

    #[test]
    fn every_normal_is_seen_and_some_more_often() {
        let density = Figure::draw(ALL, &mut Pcg64::seed_from_u64(2)).density;
        let on: Vec<f32> = (0..SIDE * SIDE).filter(|&c| on_disk(c)).map(|c| density[c]).collect();
        let mean = on.iter().sum::<f32>() / on.len() as f32;
        assert!((mean - 1.0).abs() < 1e-3 && on.iter().all(|d| *d > 0.0));
        assert!(on.iter().any(|d| *d > 1.5));
    }

    #[test]
    fn parts_end_abruptly() {
        // Larger steps between neighbouring cells than a smooth field of the same variance has, whose
        // waves are no shorter than a dozen cells.
        let (mut steps, mut total) = (0.0, 0.0);
        for seed in 0..8 {
            let (image, _) = shown(ALL, seed);
            let on: Vec<usize> = (0..SIDE * SIDE).filter(|&c| on_disk(c) && on_disk(c + 1)).collect();
            let mean = on.iter().map(|&c| image[c]).sum::<f32>() / on.len() as f32;
            let largest = on.iter().map(|&c| (image[c + 1] - image[c]).abs()).fold(0.0, f32::max);
            steps += largest;
            total += (on.iter().map(|&c| (image[c] - mean).powi(2)).sum::<f32>() / on.len() as f32).sqrt();
        }
        assert!(steps > 1.0 * total, "{steps} {total}");
    }

    #[test]
    fn the_variance_is_that_among_the_parts() {
        // Nothing but the mean is seen where the body is alone.
        let strength = Regions { stains: 0.3, shadow: 0.0, bounce: 0.0 };
        let mut rng = Pcg64::seed_from_u64(5);
        let figure = Figure::draw(strength, &mut rng);
        let alone = figure.density.iter().copied().fold(f32::INFINITY, f32::min);
        let (mut image, mut details) = (vec![1.0; SIDE * SIDE], vec![0.0; SIDE * SIDE]);
        let variance = figure.show(&mut image, &mut details, 1.0);
        let mut several = 0;
        for cell in (0..SIDE * SIDE).filter(|&c| on_disk(c)) {
            if figure.density[cell] < 1.0001 * alone {
                assert!(variance[cell] < 1e-5);
            } else {
                several += usize::from(variance[cell] > 1e-4);
            }
        }
        assert!(several > 100);
    }
}
