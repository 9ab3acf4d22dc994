//! Learning of a posterior from lights and materials given by formulas.

use glam::{DVec3, Vec3};
use gonio::lighting::EnvironmentMap;
use gonio::picture::Plane;
use gonio::reflectance::{BivariateTable, Dictionary, DictionarySettings, LogBasis};
use gonio::simulation::{ScenePool, ScenePoolSettings};
use gonio::sphere::direction_of_lat_long;
use gonio_train::{Monitor, Photographs, TrainingSettings, learn};

/// A sky with a lamp whose position, width and power depend on the number.
fn light(number: u32) -> EnvironmentMap {
    let turn = f64::from(number) * 2.4;
    let lamp = DVec3::new(turn.cos(), 0.6, turn.sin()).normalize();
    let (width, power) = (0.05 + 0.04 * f64::from(number % 5), 5.0 * f64::from(1 + number % 7));
    EnvironmentMap::new(Plane::from_fn(96, 48, |x, y| {
        let d = direction_of_lat_long((x as f64 + 0.5) / 96.0, (y as f64 + 0.5) / 48.0);
        Vec3::splat((if d.angle_between(lamp) < width { power } else { 1.2 + d.y }) as f32)
    }))
    .unwrap()
}

fn dictionary() -> Dictionary {
    let lobe = |w: f64, s: f64| BivariateTable::from_fn(move |h, _| 0.1 + s * (-(h / w).powi(2)).exp());
    let set = [(0.06, 30.0), (0.1, 8.0), (0.2, 3.0), (0.4, 1.0), (1.0, 0.05)];
    let tables: Vec<(String, BivariateTable)> = set.iter().map(|&(w, s)| (format!("{w}"), lobe(w, s))).collect();
    let settings = DictionarySettings { draws: 60, dimensions: 3, ..DictionarySettings::default() };
    Dictionary::new(LogBasis::fit(&tables, 8), &settings)
}

fn scene_pool(lights: u32) -> ScenePool {
    let settings = ScenePoolSettings { groups: 3, views: 1, group_materials: 12, ..ScenePoolSettings::default() };
    let mut pool = ScenePool::new(dictionary(), (0..lights).map(light).collect(), settings);
    pool.load_groups(0);
    pool
}

/// A pool in lights that are not those of [`scene_pool`].
fn other(lights: u32) -> ScenePool {
    let settings = ScenePoolSettings { groups: 2, views: 1, group_materials: 12, ..ScenePoolSettings::default() };
    ScenePool::new(dictionary(), (100..100 + lights).map(light).collect(), settings)
}

fn settings(steps: usize) -> TrainingSettings {
    TrainingSettings {
        steps,
        batch: 16,
        learning_rate: 6e-3,
        ema_decay: 0.9,
        embedding: 8,
        negatives: 128,
        materials: vec![32],
        widths: vec![4, 6, 8],
        hidden: vec![32],
        candidates: 512,
        ..TrainingSettings::default()
    }
}

#[test]
fn embeddings_identify_the_materials_of_new_photographs() {
    let mut pool = scene_pool(4);
    assert_eq!(pool.scenes(), 3 * 12);
    let monitor = Monitor::new(&|_, _| ());
    let (posterior, losses) = learn(&mut pool, Some(other(4)), &settings(60), None, None, &monitor).unwrap();
    assert!(losses.training < -0.5 && losses.new_scenes < -0.1, "{losses:?}");
    // Four lights are too few to generalise to other lights.
    assert!(losses.new_lights.unwrap() > losses.new_scenes, "{losses:?}");
    // The embeddings identify the materials of photographs outside the training, and no photograph
    // is out of distribution.
    let (mut along, mut out_of_distribution, mut certain) = (0.0, 0.0, 0.0);
    let unseen = (1 << 41)..(1 << 41) + 60;
    for number in unseen {
        let photograph = pool.photograph(number);
        let reading = posterior.encode(&photograph.image);
        let weights = posterior.prior.weights(&reading.embedding);
        let mean: f64 = weights.iter().zip(&posterior.prior.coordinates).map(|(w, z)| w * f64::from(z[0])).sum();
        along += photograph.coordinates[0] * mean / 60.0;
        out_of_distribution += reading.out_of_distribution / 60.0;
        certain += weights.iter().map(|w| w * (w * weights.len() as f64).max(1e-300).ln()).sum::<f64>() / 60.0;
    }
    assert!(along > 0.1 && certain > 0.2, "{along} {certain}");
    assert!(out_of_distribution < 0.1, "{out_of_distribution}");
    assert_eq!((posterior.names.len(), posterior.measured.coordinates.len()), (5, 5));
}

#[test]
fn the_encoder_does_not_depend_on_the_number_of_threads() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (trained, _) = gonio_train::train(
                &mut Photographs(&mut scene_pool(1)),
                &settings(2),
                None,
                None,
                &Monitor::new(&|_, _| ()),
            )
            .unwrap();
            trained.encoder
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn a_training_begins_with_an_initial_posterior() {
    let short = TrainingSettings { steps: 1, learning_rate: 1e-9, ..settings(1) };
    let monitor = Monitor::new(&|_, _| ());
    let mut pool = scene_pool(4);
    let (first, _) = learn(&mut pool, None, &settings(20), None, None, &monitor).unwrap();
    let mut train = |initial| learn(&mut pool, None, &short, initial, None, &monitor).unwrap().0;
    let (random, continued) = (train(None), train(Some(&first)));
    // The encoder and the embeddings of materials are those of the first training.
    let photograph = pool.photograph(1 << 41).image;
    let [of_first, of_random, of_continued] =
        [&first, &random, &continued].map(|posterior| posterior.encode(&photograph).embedding);
    let distance = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
    let size = distance(&of_first, &vec![0.0; of_first.len()]);
    assert!(distance(&of_first, &of_continued) < 1e-2 * size && distance(&of_first, &of_random) > 0.3 * size);
    let products = |posterior: &gonio::inference::learnt::LearntPosterior| -> Vec<f32> {
        let materials = posterior.measured.embeddings.iter();
        materials.map(|m| m.iter().zip(&of_first).map(|(a, b)| a * b).sum()).collect()
    };
    let (before, after) = (products(&first), products(&continued));
    let spread = distance(&before, &vec![0.0; before.len()]);
    assert!(distance(&before, &after) < 0.2 * spread, "{before:?} {after:?}");
    let other = TrainingSettings { hidden: vec![16], ..short };
    let problem = learn(&mut pool, None, &other, Some(&first), None, &monitor).unwrap_err();
    assert!(matches!(problem, gonio_train::TrainError::Initial), "{problem}");
}
