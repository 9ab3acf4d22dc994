//! Times the parts of the training of a posterior: `cargo bench -p gonio-train`.
//! docs/performance.md contains a table of the results.

use std::time::Instant;

use gonio::lighting::studio_light;
use gonio::reflectance::parametric::{Ggx, Parametric};
use gonio::reflectance::{BivariateTable, Dictionary, DictionarySettings, LogBasis};
use gonio::simulation::{LightPyramid, ScenePool, ScenePoolSettings, SceneRenderer};
use gonio_train::{Monitor, Photographs, Samples, TrainingSettings, train};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// Number of simulated photographs.
const PHOTOGRAPHS: u64 = 512;

/// Steps of the training.
const STEPS: usize = 8;

fn main() {
    let measured = materials();
    let map = studio_light(128);
    let dictionary = timed("prior of materials", || {
        let basis = LogBasis::fit(&measured, LogBasis::RANK);
        Dictionary::new(basis, &DictionarySettings::default())
    });
    let settings = ScenePoolSettings { groups: 1, views: 4, ..ScenePoolSettings::default() };
    let mut rng = Pcg64::seed_from_u64(1);
    let drawn: Vec<_> = (0..settings.group_materials).map(|_| dictionary.draw(&settings.prior, &mut rng)).collect();
    let tables: Vec<BivariateTable> =
        timed("tables of 120 materials", || drawn.par_iter().map(|m| dictionary.table(m)).collect());
    timed("coordinates of 120 materials", || {
        tables.par_iter().map(|t| dictionary.latent_space.of(t)).collect::<Vec<_>>()
    });
    let light = timed("one light", || LightPyramid::new(|d| f64::from(gonio::picture::luminance(map.at(d)))));
    let renderer = SceneRenderer::new();
    timed("scenes of 120 materials", || renderer.render(&tables, &light));
    let mut pool = ScenePool::new(dictionary, vec![map], settings);
    timed("one group of four views", || pool.load_groups(0));
    let mut samples = Photographs(&mut pool);
    timed("512 photographs", || {
        (0..PHOTOGRAPHS).into_par_iter().for_each(|number| {
            let side = samples.side();
            let mut image = vec![0.0; side * side * samples.channels()];
            let mut globals = vec![0.0; samples.globals()];
            let mut target = vec![0.0; samples.dimensions()];
            samples.draw(number, &mut image, &mut globals, &mut target);
        });
    });
    let training = TrainingSettings { steps: STEPS, ..TrainingSettings::default() };
    timed("8 steps of 128 photographs", || {
        train(&mut samples, &training, None, None, &Monitor::new(&|_, _| ())).expect("finite losses")
    });
}

fn timed<T>(name: &str, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let done = work();
    println!("{name:40}{:10.4} s", start.elapsed().as_secs_f64());
    done
}

/// Returns a hundred materials of one formula.
fn materials() -> Vec<(String, BivariateTable)> {
    let of = |i: u32| {
        let share = |times: f64| (f64::from(i) * times).fract();
        let ggx = Ggx {
            diffuse: 0.02 + 0.4 * share(0.618_034),
            f0: 0.02 + 0.1 * share(0.754_878),
            alpha: 0.02 + 0.5 * share(0.569_84),
        };
        (format!("material {i}"), ggx.to_bivariate())
    };
    (0..100).map(of).collect()
}
