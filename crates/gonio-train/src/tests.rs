use gonio::inference::learnt::Step;

use crate::initial::Regression;
use crate::loss::contrast;
use crate::parameters::Parameters;
use crate::train::{Batch, MicroBatch, Model};
use crate::{Checkpoint, MICRO_BATCH, Monitor, Samples, TrainError, Trained, TrainingSettings};

/// Samples of a bright spot in a noisy image: the targets are its width and horizontal position,
/// and one of the globals gives its vertical position.
struct Spots {
    side: usize,
    channels: usize,
}

/// Uniform pseudo-random number in -1..1.
fn uniform(index: u64, at: u64) -> f32 {
    let mut x = index.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ at.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    for shift in [30, 27, 31] {
        x = (x ^ (x >> shift)).wrapping_mul(0x94d0_49bb_1331_11eb);
    }
    (x >> 40) as f32 / (1u64 << 23) as f32 - 1.0
}

impl Samples for Spots {
    fn side(&self) -> usize {
        self.side
    }

    fn channels(&self) -> usize {
        self.channels
    }

    fn globals(&self) -> usize {
        2
    }

    fn dimensions(&self) -> usize {
        2
    }

    fn draw(&self, index: u64, image: &mut [f32], globals: &mut [f32], target: &mut [f32]) {
        let (width, x, y) = (uniform(index, 1), 0.6 * uniform(index, 2), 0.6 * uniform(index, 3));
        let narrow = 1.0 / (0.25 * width.exp());
        for (at, cell) in image.chunks_exact_mut(self.channels).enumerate() {
            let centre = |i: usize| (2 * i + 1) as f32 / self.side as f32 - 1.0;
            let square = (centre(at % self.side) - x).powi(2) + (centre(at / self.side) - y).powi(2);
            cell[0] = 3.0 * (-square * narrow * narrow).exp() - 0.5 + 0.1 * uniform(index, 10 + at as u64);
            cell[1..].iter_mut().enumerate().for_each(|(c, v)| *v = centre((at + c) % self.side));
        }
        globals.copy_from_slice(&[1.6 * y, uniform(index, 4)]);
        // Scaled to deviations of one; the second is the horizontal position.
        target.copy_from_slice(&[1.732 * width, 2.887 * x]);
    }
}

const SMALL: Spots = Spots { side: 16, channels: 2 };

/// Trains on small images, without a checkpoint.
fn train(settings: &TrainingSettings) -> Result<Trained, TrainError> {
    Ok(crate::train(&mut { SMALL }, settings, None, None, &Monitor::new(&|_, _| ()))?.0)
}

fn small() -> TrainingSettings {
    TrainingSettings {
        steps: 4,
        batch: 20,
        embedding: 5,
        negatives: 50,
        materials: vec![7],
        widths: vec![4, 6, 8],
        hidden: vec![10, 9],
        ..TrainingSettings::default()
    }
}

#[test]
fn the_gradient_matches_the_loss() {
    let model = Model::new(&SMALL, &small()).unwrap();
    let values = model.parameters.random(7);
    let negatives: Vec<f32> = (0..14).map(|at| uniform(at, 77)).collect();
    let batch = Batch { samples: &SMALL, first: 5, count: MICRO_BATCH + 3, negatives: &negatives };
    let gradient = model.learn(&values, batch).gradient;
    assert_eq!(gradient.len(), values.len());
    // Check each tensor along its gradient: the effect of a single entry is below the rounding
    // of the loss.
    let ranges = model.parameters.ranges();
    // The last bias adds the same value to the scores of all materials, and has no gradient.
    for range in &ranges[..ranges.len() - 1] {
        let length = gradient[range.clone()].iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        assert!(length > 1e-4, "{range:?}");
        let moved = |step: f64| {
            let mut values = values.clone();
            let ways = values[range.clone()].iter_mut().zip(&gradient[range.clone()]);
            ways.for_each(|(v, g)| *v += (step / length) as f32 * g);
            model.learn(&values, batch).loss
        };
        let step = 5e-3;
        let numeric = (moved(step) - moved(-step)) / (2.0 * step);
        assert!((numeric - length).abs() < 0.01 * length + 3e-4, "{range:?}: {numeric} {length}");
    }
    // Check random directions in the space of all parameters.
    for direction in 0..10 {
        let way: Vec<f32> = (0..values.len()).map(|at| uniform(at as u64, direction)).collect();
        let moved = |step: f32| {
            let values: Vec<f32> = values.iter().zip(&way).map(|(v, w)| v + step * w).collect();
            model.learn(&values, batch).loss
        };
        let step = 1e-3;
        let numeric = (moved(step) - moved(-step)) / f64::from(2.0 * step);
        let got: f64 = gradient.iter().zip(&way).map(|(g, w)| f64::from(g * w)).sum();
        assert!((numeric - got).abs() < 0.02 * (1.0 + numeric.abs()), "{direction}: {numeric} {got}");
    }
}

#[test]
fn the_exported_encoder_matches_the_forward_pass() {
    let model = Model::new(&SMALL, &small()).unwrap();
    assert!(model.shape.steps().contains(&Step::Pool));
    let mut values = model.parameters.random(7);
    values.iter_mut().enumerate().for_each(|(i, v)| *v += 0.1 * uniform(i as u64, 9));
    let encoder = model.parameters.export(&values, &model.shape).unwrap();
    let weights = model.parameters.weights(&values);
    let part = MicroBatch::draw(&SMALL, 3, 4);
    let trace = model.layers.forward(part.images.clone(), &part.globals, 4, &weights);
    for (at, want) in trace.outputs().chunks_exact(5).enumerate() {
        let (got, features) = encoder.apply(&part.images[at * 512..][..512], &part.globals[at * 2..][..2]);
        assert_eq!(features.len(), 9);
        for (got, want) in got.iter().zip(want) {
            assert!((got - want).abs() < 1e-4 * (1.0 + want.abs()), "{got} {want}");
        }
    }
}

#[test]
fn threads_do_not_change_the_result() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| train(&small())).unwrap().encoder
    };
    assert_eq!(run(1), run(3));
}

/// Mean loss of samples, each among all others.
fn loss_of(trained: &Trained, first: u64, count: usize) -> f64 {
    let part = MicroBatch::draw(&SMALL, first, count);
    let width = trained.encoder.shape().outputs;
    let image = |at: usize| trained.encoder.apply(&part.images[at * 512..][..512], &part.globals[at * 2..][..2]).0;
    // The loss divides by the root of the width itself.
    let material =
        |at: usize| trained.embed(&part.targets[at * 2..][..2]).into_iter().map(|v| v * (width as f32).sqrt());
    let materials: Vec<Vec<f32>> = (0..count).map(|at| material(at).collect()).collect();
    let loss = |at: usize| {
        let negatives = [&materials[..at], &materials[at + 1..]].concat().concat();
        contrast(&mut image(at), &mut materials[at].clone(), &negatives, &mut vec![0.0; negatives.len()], width)
    };
    (0..count).map(loss).sum::<f64>() / count as f64
}

#[test]
fn training_learns_visible_targets() {
    let (steps, hidden) = (300, vec![32, 32]);
    let settings = TrainingSettings { steps, batch: 32, learning_rate: 5e-3, ema_decay: 0.98, hidden, ..small() };
    let trained = train(&settings).unwrap();
    // The loss is 0 for a guess, and -log 200 = -5.3 for certainty.
    let loss = loss_of(&trained, 1_000_000, 200);
    assert!(loss < -2.5, "{loss}");
    // Among 50 others, the loss for certainty is -log 51 = -3.9.
    let among = trained.loss(&SMALL, 1_000_000, 200);
    assert!((-3.9..-1.5).contains(&among), "{among}");
}

#[test]
fn rejects_wrong_settings_and_reports_divergence() {
    let wrong = [TrainingSettings { embedding: 0, ..small() }, TrainingSettings { widths: vec![4; 8], ..small() }];
    for settings in wrong {
        assert!(train(&settings).is_err());
    }
    let wild = TrainingSettings { learning_rate: f64::NAN, ..small() };
    assert!(matches!(train(&wild), Err(TrainError::Diverged { step: 1 })));
}

#[test]
fn a_resumed_training_gives_the_same_result() {
    let kept: std::cell::RefCell<Vec<Checkpoint>> = std::cell::RefCell::default();
    let keep = |checkpoint: &dyn Fn() -> Checkpoint| kept.borrow_mut().push(checkpoint());
    let monitor = Monitor { progress: &|_, _| (), keep: &keep };
    let settings = small();
    let (whole, losses) = crate::train(&mut { SMALL }, &settings, None, None, &monitor).unwrap();
    let kept = kept.into_inner();
    assert_eq!(kept.iter().map(Checkpoint::step).collect::<Vec<_>>(), [1, 2, 3, 4]);
    for start in [&kept[1], &kept[3]] {
        let resume = |start| crate::train(&mut { SMALL }, &settings, None, Some(start), &Monitor::new(&|_, _| ()));
        let (resumed, again) = resume(start.clone()).unwrap();
        assert_eq!((&resumed.encoder, &again), (&whole.encoder, &losses));
        let other = Checkpoint { values: vec![0.0; 3], ..start.clone() };
        assert!(matches!(resume(other), Err(TrainError::Checkpoint)));
    }
}

#[test]
fn imported_parameters_reproduce_the_encoder() {
    let trained = train(&small()).unwrap();
    let model = Model::new(&SMALL, &small()).unwrap();
    let values = model.parameters.import(&trained.encoder, 5);
    let imported = model.parameters.export(&values, &model.shape).unwrap();
    for ((name, _, before), (_, _, after)) in trained.encoder.tensors().iter().zip(imported.tensors()) {
        let close = before.iter().zip(after).all(|(a, b)| (a - b).abs() < 1e-4 * (1.0 + a.abs()));
        assert!(close, "{name}");
    }
}

#[test]
fn regression_reaches_the_target_embeddings() {
    let model = Model::new(&SMALL, &small()).unwrap();
    let parameters = Parameters::new(model.materials.layers.iter());
    let before = parameters.random(3);
    let regression = Regression {
        network: &model.materials,
        parameters: &parameters,
        inputs: (0..8).map(|at| uniform(at, 5)).collect(),
        targets: (0..20).map(|at| uniform(at, 6)).collect(),
        count: 4,
    };
    let mut values = before.clone();
    regression.fit(&mut values);
    let size = |values: &[f32]| regression.gradient(values, 0..4).iter().map(|g| g * g).sum::<f32>().sqrt();
    assert!(size(&values) < 0.05 * size(&before), "{} {}", size(&values), size(&before));
}
