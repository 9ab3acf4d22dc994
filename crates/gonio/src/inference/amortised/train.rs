//! Fitting the network to simulated photographs.

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::network::{Adam, Network};
use super::{Amortised, Simulation, head};
use crate::appearance::STATISTICS;

/// How the network is trained.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingSettings {
    /// Units of each of the two hidden layers.
    pub hidden: usize,
    /// Passes over the simulated photographs.
    pub epochs: usize,
    /// Photographs between steps.
    pub batch: usize,
    /// Largest rate of the optimiser; it rises over the first third of the steps and falls over the rest.
    pub rate: f64,
    /// Decay of weights.
    pub decay: f64,
    /// Share of hidden units left out at random.
    pub drop: f64,
    /// Standard deviation of the noise added to the scaled statistics.
    pub jitter: f64,
    /// Seed of weights, order and noise.
    pub seed: u64,
}

impl Default for TrainingSettings {
    /// Chosen by leaving out a quarter of the training lights and materials at a time (`docs/trials.md`).
    fn default() -> Self {
        Self { hidden: 256, epochs: 9, batch: 256, rate: 2e-3, decay: 1e-3, drop: 0.2, jitter: 0.05, seed: 1 }
    }
}

/// How statistics are brought to a common scale: cut to the range seen, centred, divided by their deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scaling {
    /// Values below count as this.
    pub low: f32,
    /// Values above count as this.
    pub high: f32,
    /// Mean of the cut values.
    pub centre: f32,
    /// Their standard deviation.
    pub deviation: f32,
}

impl Scaling {
    /// One in a thousand values of either end is cut.
    fn of(mut values: Vec<f32>) -> Self {
        values.sort_by(f32::total_cmp);
        let at = |q: f64| values[(q * (values.len() - 1) as f64).round() as usize];
        let (low, high) = (at(0.001), at(0.999));
        let cut = || values.iter().map(|v| f64::from(v.clamp(low, high)));
        let centre = cut().sum::<f64>() / values.len() as f64;
        let variance = cut().map(|v| (v - centre).powi(2)).sum::<f64>() / values.len() as f64;
        Self { low, high, centre: centre as f32, deviation: (variance.sqrt() + 1e-6) as f32 }
    }

    pub(super) fn apply(&self, value: f32) -> f32 {
        (value.clamp(self.low, self.high) - self.centre) / self.deviation
    }
}

impl Simulation {
    /// Fits a network to all that was simulated. `progress` is told a fraction in 0..=1. Deterministic for the seed.
    ///
    /// # Panics
    /// If nothing was simulated.
    pub fn train(&self, settings: &TrainingSettings, progress: &(dyn Fn(f64) + Sync)) -> Amortised {
        let (count, dimensions) = (self.count(), self.dictionary.coordinates.axes.len());
        assert!(count > 0, "no simulated photographs");
        let column = |s: usize| self.statistics_of_all.iter().skip(s).step_by(STATISTICS).copied().collect();
        let scaling: Vec<Scaling> = (0..STATISTICS).map(|s| Scaling::of(column(s))).collect();
        let widths = [STATISTICS, settings.hidden, settings.hidden, head::outputs(dimensions)];
        let mut network = Network::random(&widths, settings.seed);
        // An output layer near zero starts from the prior: mean zero, precision one.
        let last = network.layers.last_mut().expect("three layers");
        last.weights.iter_mut().for_each(|w| *w *= 0.1);
        let mut optimiser = Adam::new(&network, settings.decay as f32);
        let mut rng = Pcg64::seed_from_u64(settings.seed);
        let mut order: Vec<usize> = (0..count).collect();
        let batch = settings.batch.min(count);
        let steps = settings.epochs * (count / batch);
        let mut step = 0;
        for _ in 0..settings.epochs {
            order.shuffle(&mut rng);
            for samples in order.chunks_exact(batch) {
                let seed: u64 = rng.random();
                let input = |sample: usize, out: &mut [f32]| {
                    let mut noise = Pcg64::seed_from_u64(seed ^ (sample as u64) << 20);
                    let raw = &self.statistics_of_all[sample * STATISTICS..][..STATISTICS];
                    for ((out, raw), scaling) in out.iter_mut().zip(raw).zip(&scaling) {
                        let z: f64 = StandardNormal.sample(&mut noise);
                        *out = scaling.apply(*raw) + (settings.jitter * z) as f32;
                    }
                };
                let loss = |sample: usize, outputs: &mut [f32]| {
                    head::loss(outputs, &self.places_of_all[sample * dimensions..][..dimensions])
                };
                let (_, mut gradient) = network.gradient(samples, &input, &loss, settings.drop as f32, seed);
                gradient.iter_mut().for_each(|g| *g /= batch as f32);
                let rate = settings.rate * one_cycle(step as f64 / steps as f64);
                optimiser.step(&mut network, &gradient, rate as f32, 5.0);
                step += 1;
                progress(step as f64 / steps as f64);
            }
        }
        Amortised { dictionary: self.dictionary.clone(), scaling, network }
    }
}

/// Share of the largest rate at a share of the steps: a rise over three tenths and a fall over the rest, both along a cosine
/// (Smith & Topin 2019).
fn one_cycle(at: f64) -> f64 {
    let cosine = |from: f64, to: f64, t: f64| to + 0.5 * (from - to) * (1.0 + (std::f64::consts::PI * t).cos());
    if at < 0.3 { cosine(0.04, 1.0, at / 0.3) } else { cosine(1.0, 1e-5, (at - 0.3) / 0.7) }
}
