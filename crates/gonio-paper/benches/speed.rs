//! Speed of the methods of the paper: the plan, Algorithm 1 and the block solver.
//!
//! Run with `cargo bench -p gonio-paper`. Lights and reflectances are synthetic and have the sizes
//! of a real photograph of a sphere: a light of 32 x 32 texels (M = 1024), ten basis functions
//! (K = 10), a projection on 800 directions.

use std::sync::LazyLock;

use divan::{Bencher, black_box};
use glam::Vec3;
use gonio::inference::Hyperparameters;
use gonio::lighting::{LightGrid, LightPrior, PriorSettings};
use gonio::reflectance::BivariateTable;
use gonio::reflectance::parametric::{Ggx, Parametric};
use gonio::scene::{ObservationSettings, sphere_points};
use gonio::shape::SurfacePoint;
use gonio::sphere::OctahedralMap;
use gonio_paper::{
    Bilinear, Expectations, Method, Plan, PlanSettings, Problem, Projected, Solver, VariationalParameters,
    VariationalSettings, infer,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn main() {
    divan::main();
}

const SIDE: usize = 32;
/// Widths of the lobes, from lacquer to chalk.
const WIDTHS: [f64; 10] = [0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.25, 0.4, 0.6, 1.0];
/// Number of normals that suffices for a plan of full rank.
const FEW: usize = 1500;

/// Inputs of a plan except the points.
struct World {
    lights: Vec<LightGrid>,
    prior: LightPrior,
    tables: Vec<BivariateTable>,
    rates: Vec<f64>,
}

impl World {
    fn plan(&self, points: &[SurfacePoint]) -> Plan {
        Plan::build(points, &self.tables, &self.prior, &PlanSettings::default(), &|_| ())
            .expect("the inputs of the plan are valid")
    }
}

/// Twelve skies with lamps, and ten lobes of maximum one, like the functions of a trained basis.
static WORLD: LazyLock<World> = LazyLock::new(|| {
    let mut rng = Pcg64::seed_from_u64(1);
    let lights: Vec<LightGrid> = (0..12)
        .map(|_| {
            let texel = |t: usize| {
                let lamp = if rng.random_range(0..60) == 0 { 30.0 } else { 0.0 };
                let sky = if t < SIDE * SIDE / 2 { 2.0 } else { 0.5 };
                Vec3::splat(sky + lamp + rng.random_range(0.0..1.0_f32))
            };
            LightGrid::from_texels(OctahedralMap::EqualArea, SIDE, (0..SIDE * SIDE).map(texel).collect())
        })
        .collect();
    let prior = LightPrior::learn(&lights, lights.len(), &PriorSettings::default()).expect("the lights vary");
    let lobe = |alpha: f64| {
        let table = Ggx { diffuse: 0.0, f0: 0.05, alpha }.to_bivariate();
        let max = table.trusted_max();
        let scaled = table.as_slice().iter().map(|x| (x / max).min(1.0)).collect();
        BivariateTable::from_vec(scaled)
    };
    World { lights, prior, tables: WIDTHS.map(lobe).to_vec(), rates: vec![5.0; WIDTHS.len()] }
});

/// Image of a sphere in the form of the likelihood, with one percent of noise.
static IMAGE: LazyLock<Projected> = LazyLock::new(|| {
    let world = &*WORLD;
    let plan = world.plan(&points(FEW));
    let l = world.lights[0].normalised_coefficients().expect("the light is not black");
    let f = [0.05, 0.0, 0.2, 0.0, 0.0, 0.3, 0.0, 0.0, 0.5, 0.4];
    let rank = plan.rank();
    let clean = Bilinear::new(rank, plan.k, plan.m(), plan.r.clone()).apply(&l, &f);
    let mut image: Vec<f64> =
        plan.q.chunks_exact(rank).map(|row| row.iter().zip(&clean).map(|(q, y)| f64::from(*q) * y).sum()).collect();
    let noise = 0.01 * image.iter().sum::<f64>() / image.len() as f64;
    let mut rng = Pcg64::seed_from_u64(2);
    image.iter_mut().for_each(|x| *x += noise * rng.random_range(-1.7..1.7));
    let image: Vec<Option<f64>> = image.into_iter().map(Some).collect();
    plan.project(&image, 0.0).expect("every point has a value")
});

fn points(normals: usize) -> Vec<SurfacePoint> {
    sphere_points(&ObservationSettings { normals, ..ObservationSettings::default() })
}

fn problem() -> Problem<'static> {
    Problem::blind(&IMAGE, &WORLD.prior, &WORLD.rates, Hyperparameters::default()).expect("the image is not black")
}

/// Quadrature and sketch for a sphere with `normals` normals; the program uses 12,000.
#[divan::bench(args = [FEW, 12_000], sample_count = 2, sample_size = 1)]
fn plan(bencher: Bencher<'_, '_>, normals: usize) {
    let points = points(normals);
    let world = &*WORLD;
    bencher.bench_local(|| world.plan(black_box(&points)));
}

/// One parallel update of all parameters: the step "Update" of Algorithm 1.
#[divan::bench(sample_count = 20)]
fn sweep(bencher: Bencher<'_, '_>) {
    let problem = problem();
    let ensemble = VariationalParameters::random(&problem, 0.1, &mut Pcg64::seed_from_u64(3));
    let now = Expectations::new(&problem, &ensemble);
    bencher.bench_local(|| now.update(&problem, black_box(&ensemble)));
}

/// One evaluation of `C_KL`; a line search requires several.
#[divan::bench(sample_count = 20)]
fn cost(bencher: Bencher<'_, '_>) {
    let problem = problem();
    let ensemble = VariationalParameters::random(&problem, 0.1, &mut Pcg64::seed_from_u64(3));
    bencher.bench_local(|| Expectations::new(&problem, black_box(&ensemble)).cost(&problem));
}

/// One iteration from a random start.
///
/// With [`Solver::Printed`], this is an update and its line search. With [`Solver::Blocks`], it is
/// a round of the block solver and, once per image, the Gram matrices that [`grams`] measures.
#[divan::bench(args = [Solver::Printed, Solver::Blocks], sample_count = 10, sample_size = 1)]
fn iteration(bencher: Bencher<'_, '_>, solver: Solver) {
    let problem = problem();
    let settings = VariationalSettings { solver, starts: 1, max_iterations: 1, ..VariationalSettings::default() };
    bencher.bench_local(|| infer(black_box(&problem), &Method::Variational(settings), &|_| ()));
}

/// Gram matrices, which the block solver computes once per image.
#[divan::bench(sample_count = 10, sample_size = 1)]
fn grams(bencher: Bencher<'_, '_>) {
    bencher.bench_local(|| black_box(&IMAGE.bilinear).reflectance_grams());
}
