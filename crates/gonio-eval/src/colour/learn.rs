//! Learning the model of colours from training materials in training lights.

use anyhow::Result;
use glam::{DQuat, Vec3};
use gonio::colour::{ColourModel, Sample, TwoColours, white_chroma};
use gonio::inference::learnt::LearntPosterior;
use gonio::reflectance::BivariateTable;
use gonio::render::{LightTree, Relighter};
use gonio::sphere::OctahedralMap;
use rayon::prelude::*;

use super::{Bench, picture, trusted};
use crate::bench::{DRAFT, Progress};
use crate::data::Lights;
use crate::materials::Materials;
use crate::metrics::median;
use crate::posteriors::ball;

/// Parts that the materials and the lights are divided into; one part of each is left out, in turn.
const FOLDS: usize = 4;

/// Learns from one photograph of each training material in each training light, and prints the
/// model. The luminance posterior is the existing one, learnt from the same materials and lights:
/// [`validate`] leaves them out of the model of colours alone.
pub(super) fn run(
    materials: &Materials,
    training: &[usize],
    lights: &Lights,
    posterior: &LearntPosterior,
) -> Result<()> {
    let bench = Bench::new(posterior.clone());
    let rgb: Vec<[BivariateTable; 3]> = training.iter().map(|&at| trusted(materials.rgb(at))).collect();
    let truths: Vec<TwoColours> = rgb.iter().map(TwoColours::of).collect();
    let examples: Vec<BivariateTable> = rgb.iter().map(BivariateTable::luminance).collect();
    let names = lights.names();
    // Indices of material and light, and the sample.
    let mut samples: Vec<(usize, usize, Sample)> = Vec::new();
    let progress = Progress::new("lights", names.len());
    for (at, name) in names.iter().enumerate() {
        let map = lights.map(name)?;
        let camera = DQuat::from_rotation_y((137.5 * at as f64).to_radians());
        let light = white_chroma(&map.to_grid(OctahedralMap::EqualArea, 32), camera);
        let points = ball(camera);
        let operator = Relighter::of_channels(&points, &examples, &LightTree::of_map(&map), &DRAFT);
        let images: Vec<Vec<Vec3>> = rgb.par_iter().map(|rgb| picture(&operator, rgb)).collect();
        let found: Vec<Sample> = images
            .par_iter()
            .zip(&truths)
            .map(|(image, colours)| {
                let (_, clues) = bench.read(&points, image)?;
                Ok(Sample { clues, colours: *colours, light })
            })
            .collect::<Result<_>>()?;
        samples.extend(found.into_iter().enumerate().map(|(material, sample)| (material, at, sample)));
        progress.step();
    }
    progress.finish();
    validate(&samples);
    let all: Vec<Sample> = samples.into_iter().map(|(.., sample)| sample).collect();
    println!("{:#?}", ColourModel::learn(&all));
    Ok(())
}

/// Prints errors and coverage on left-out materials in left-out lights.
fn validate(samples: &[(usize, usize, Sample)]) {
    let (mut errors, mut inside) = ([const { Vec::new() }; 6], [0, 0]);
    for materials in 0..FOLDS {
        for lights in 0..FOLDS {
            let seen: Vec<Sample> = samples
                .iter()
                .filter(|(m, l, _)| m % FOLDS != materials && l % FOLDS != lights)
                .map(|(.., s)| s.clone())
                .collect();
            let model = ColourModel::learn(&seen);
            for (.., s) in samples.iter().filter(|(m, l, _)| m % FOLDS == materials && l % FOLDS == lights) {
                let (blind, known) = (model.posterior(&s.clues, None), model.posterior(&s.clues, Some(s.light)));
                let median = s.clues.chromas[1];
                let each = [TwoColours::same(median), blind.colours(), known.colours()];
                for (k, colours) in each.into_iter().enumerate() {
                    errors[2 * k].push(colours.body.distance(s.colours.body));
                    errors[2 * k + 1].push(colours.highlight.distance(s.colours.highlight));
                }
                let truth = [s.colours.body.0, s.colours.highlight.0].concat();
                for (k, found) in [&blind, &known].into_iter().enumerate() {
                    let within = |([low, high], x): (&[f64; 2], &f64)| low <= x && x <= high;
                    inside[k] += found.intervals().iter().zip(&truth).filter(|pair| within(*pair)).count();
                }
            }
        }
    }
    let share = |count: usize| 25.0 * count as f64 / samples.len() as f64;
    println!("left out: body / highlight (medians of {} photographs)", samples.len());
    for (name, pair) in ["median colour", "estimate", "estimate, light given"].iter().zip(errors.chunks_exact(2)) {
        println!("{name}: {:.3} / {:.3}", median(pair[0].clone()), median(pair[1].clone()));
    }
    println!("in 90 % intervals: {:.0} %, light given {:.0} %", share(inside[0]), share(inside[1]));
}
