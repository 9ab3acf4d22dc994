//! Posteriors whose encoder gives the same output for every image.

use std::sync::LazyLock;

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::*;
use crate::appearance::disk::{GLOBALS, on_disk};
use crate::lighting::EnvironmentMap;
use crate::reflectance::{BivariateTable, CELLS, Dictionary, DictionarySettings, LogBasis, Prior, trusted_cells};
use crate::testing;

/// A sky, a ground and a few lamps.
pub(crate) fn environment_map(seed: u64) -> EnvironmentMap {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut draw = |low: f64, high: f64| -> f64 { rng.random_range(low..high) };
    let lamps: Vec<(DVec3, f64, f64)> = (0..4)
        .map(|_| {
            let direction = DVec3::new(draw(-1.0, 1.0), draw(-0.2, 1.0), draw(-1.0, 1.0)).normalize();
            (direction, draw(0.04, 0.4), draw(1.0, 5.0).exp())
        })
        .collect();
    let sky = draw(0.5, 2.0);
    testing::environment_map(96, |d| {
        let base = if d.y > 0.0 { sky } else { 0.3 };
        let lit = lamps.iter().filter(|(lamp, width, _)| d.angle_between(*lamp) < *width).map(|l| l.2).sum::<f64>();
        base + lit
    })
}

fn lobe(width: f64, strength: f64) -> BivariateTable {
    BivariateTable::from_fn(move |h, d| 0.1 + strength * (-(h / width).powi(2)).exp() * (1.0 + d.powi(4)))
}

/// Six materials and sixty mixtures of the prior.
pub(crate) static WORLD: LazyLock<Dictionary> = LazyLock::new(|| {
    let set = [(0.06, 30.0), (0.1, 8.0), (0.2, 3.0), (0.4, 1.0), (1.0, 0.05), (0.06, 2.0)];
    let tables: Vec<(String, BivariateTable)> = set.iter().map(|&(w, s)| (format!("{w} {s}"), lobe(w, s))).collect();
    // Six axes express mixtures, but no random fields.
    let shares = [0.1, 0.1, 0.25, 0.12, 0.1, 0.06, 0.13, 0.08, 0.06, 0.0, 0.0];
    let prior = Prior { shares, fields: 0.0 };
    let settings = DictionarySettings { draws: 60, dimensions: 6, seed: 1, prior };
    Dictionary::new(LogBasis::fit(&tables, 8), &settings)
});

/// Measured materials, with embeddings `(z, -z^2 / 2)`. Their product with an image's embedding
/// `(m, 1) / s^2` is `-(z - m)^2 / 2 s^2` up to a constant: a Gaussian around `m`, of standard
/// deviation `s` along each coordinate.
fn measured() -> Candidates {
    let materials = &WORLD.coordinates[..WORLD.measured.len()];
    let wide = |coordinates: &Vec<f64>| coordinates.iter().map(|z| *z as f32).collect::<Vec<f32>>();
    let embedding = |coordinates: &Vec<f64>| {
        let square: f64 = coordinates.iter().map(|z| z * z).sum();
        wide(coordinates).into_iter().chain([(-0.5 * square) as f32]).collect()
    };
    Candidates::of_prior(materials.iter().map(wide).collect(), materials.iter().map(embedding).collect())
}

/// Materials around given coordinates, all of the same weight.
fn draws_around(coordinates: &[f64], deviation: f32) -> Candidates {
    let mut rng = Pcg64::seed_from_u64(8);
    let mut near = |z: &f64| *z as f32 + deviation * Distribution::<f32>::sample(&StandardNormal, &mut rng);
    let materials: Vec<Vec<f32>> = (0..300).map(|_| coordinates.iter().map(&mut near).collect()).collect();
    let embeddings = vec![vec![0.0; coordinates.len() + 1]; materials.len()];
    Candidates::of_prior(materials, embeddings)
}

/// Posterior that assigns to every image the materials around given coordinates.
fn around(coordinates: &[f64], deviation: f32) -> LearntPosterior {
    let outputs = coordinates.len() + 1;
    let shape = EncoderShape { widths: vec![1, 1], hidden: vec![2], ..EncoderShape::new(CHANNELS, GLOBALS, outputs) };
    let sizes: Vec<(String, Vec<usize>, usize)> = shape
        .convolutions()
        .into_iter()
        .chain(shape.dense_layers())
        .map(|l| (l.name.clone(), l.dimensions(), l.geometry.outputs))
        .collect();
    let answer: Vec<f32> = coordinates.iter().chain([&1.0]).map(|z| *z as f32 / deviation.powi(2)).collect();
    let find = |name: &str| {
        let (layer, part) = name.rsplit_once('.')?;
        let (_, dimensions, outputs) = sizes.iter().find(|s| s.0 == layer)?;
        match (layer, part) {
            ("outputs", "bias") => Some((vec![*outputs], answer.clone())),
            (_, "bias") => Some((vec![*outputs], vec![0.5; *outputs])),
            _ => Some((dimensions.clone(), vec![0.0; dimensions.iter().product()])),
        }
    };
    let tables: Vec<BivariateTable> = WORLD.entries.iter().map(|e| WORLD.table(e)).collect();
    LearntPosterior {
        names: WORLD.measured.names.clone(),
        measured: measured(),
        prior: draws_around(coordinates, deviation),
        latent_space: WORLD.latent_space.clone(),
        widths: interval_widths(&tables),
        encoder: Encoder::from_tensors(shape, find).unwrap(),
        ranges: vec![(0.0, 1.0); 2],
        colours: None,
    }
}

/// Posterior that is concentrated on one of the six materials, for any image.
pub(crate) fn knowing(material: usize) -> LearntPosterior {
    around(&WORLD.coordinates[material], 0.05)
}

fn any_image() -> DiskImage {
    let on = |c: usize| f32::from(u8::from(on_disk(c)));
    let all: Vec<f32> = (0..DISK_SIDE * DISK_SIDE).map(on).collect();
    DiskImage::of_cells(all.clone(), all, vec![None; DISK_SIDE * DISK_SIDE], 0.01)
}

#[test]
fn the_estimate_is_the_material_of_a_concentrated_posterior() {
    for material in [0, 2, 4] {
        let posterior = knowing(material).posterior(&any_image());
        let truth = WORLD.table(&WORLD.entries[material]);
        for (a, b) in WORLD.latent_space.of(&posterior.mean).iter().zip(WORLD.latent_space.of(&truth)) {
            assert!((a - b).abs() < 0.1, "{material}: {a} {b}");
        }
        assert_eq!(posterior.neighbours[0].name, WORLD.measured.names[material]);
        assert!((posterior.neighbours.iter().map(|n| n.weight).sum::<f64>() - 1.0).abs() < 1e-9);
        assert!(posterior.draws.iter().all(|t| (t.normal_albedo() - 1.0).abs() < 1e-4));
        assert_eq!(knowing(material).posterior(&any_image()), posterior);
    }
}

#[test]
fn intervals_are_ordered_and_contain_the_mean_material() {
    let learnt = around(&WORLD.coordinates[2], 0.5);
    let posterior = learnt.posterior(&any_image());
    let quantiles = posterior.quantiles(&[0.05, 0.5, 0.95]);
    let trusted: Vec<usize> = trusted_cells().collect();
    for pair in quantiles.windows(2) {
        assert!(trusted.iter().all(|&c| pair[0][c] < pair[1][c]));
    }
    let mean = posterior.mean.as_slice();
    let inside = trusted.iter().filter(|&&c| (quantiles[0][c]..=quantiles[2][c]).contains(&mean[c])).count();
    assert!(inside as f64 > 0.95 * trusted.len() as f64, "{inside}");
    // With draws as wide as the prior, most trusted cells are undetermined. With a concentrated
    // posterior, hardly any trusted cell is undetermined.
    let open = |a: &LearntPosterior| a.posterior(&any_image()).undetermined(a).iter().filter(|o| **o).count();
    let nothing = CELLS - trusted.len();
    assert!(open(&around(&[0.0; 6], 1.0)) > nothing + trusted.len() / 2);
    assert!(open(&knowing(2)) < nothing + trusted.len() / 50);
}

#[test]
fn out_of_distribution_is_the_share_of_features_out_of_range() {
    let mut learnt = knowing(1);
    assert_eq!(learnt.encode(&any_image()).out_of_distribution, 0.0);
    learnt.ranges[0] = (5.0, 6.0);
    assert_eq!(learnt.encode(&any_image()).out_of_distribution, 0.5);
}

/// Quantiles of predictive draws are the intervals, up to the approximation of their sum.
#[test]
fn predictive_draws_are_as_wide_as_the_intervals() {
    let learnt = around(&WORLD.coordinates[2], 0.3);
    let posterior = learnt.posterior(&any_image());
    let intervals = posterior.quantiles(&[0.05, 0.95]);
    let draws = predict(&learnt, &posterior.likelihood, 1000, 3).unwrap();
    assert!(draws == predict(&learnt, &posterior.likelihood, 1000, 3).unwrap());
    let widths = interval_widths(&draws);
    let plain = interval_widths(&sample(&learnt, &posterior.likelihood, 1000, 3).unwrap());
    let ratios = |widths: &[f32]| {
        let ratio = |c: usize| widths[c] / (intervals[1][c] / intervals[0][c]).ln();
        let mut ratios: Vec<f32> = trusted_cells().map(ratio).collect();
        ratios.sort_by(f32::total_cmp);
        [0.05, 0.5, 0.95].map(|share| ratios[(share * ratios.len() as f64) as usize])
    };
    let [low, median, high] = ratios(&widths);
    assert!(low > 0.75 && (0.85..1.1).contains(&median) && high < 1.25, "{low} {median} {high}");
    assert!(ratios(&plain)[1] < 0.8 * median, "{:?}", ratios(&plain));
    assert!(draws.iter().all(|draw| (draw.normal_albedo() - 1.0).abs() < 1e-3));
}
