//! Times `infer` and each of its stages, relative to the time of matrix products on the same
//! machine: `cargo bench -p gonio-app`. docs/performance.md contains the results.
//!
//! `cargo bench -p gonio-app -- quick` leaves out the largest inputs; other words select the rows
//! whose names contain one of them.

use std::time::Instant;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use gonio::lighting::studio_light;
use gonio::model::Model;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::BivariateTable;
use gonio::reflectance::parametric::{Ggx, Parametric};
use gonio::render::{LightTree, SphereSettings, SurfaceSettings, render_sphere, render_surface};
use gonio::scene::Correction;
use gonio::shape::{BuiltInShape as OwnForm, GeometryBuffer, MeshParts};
use gonio_app::{
    ColourMode, Method, NormalSource, PhotographSource, ProgressLog, Reading, Scene, Settings, Shape, ShapeKind,
    Source, Spaces, infer,
};
use gonio_io::result::Light;

/// Side of the square matrices whose products are the unit of time, and number of products.
const PRODUCT: usize = 2000;
const PRODUCTS: usize = 3;

/// Number of runs of each input; the fastest run is reported.
const RUNS: usize = 5;

/// Stages of `infer`, in order.
const STAGES: [&str; 8] = ["reading", "shadows", "posterior", "transfer", "light", "colour", "drawing", "files"];

fn main() {
    // Cargo passes `--bench`.
    let mut words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let quick = words.iter().any(|word| word == "quick");
    words.retain(|word| word != "quick");
    let unit = products();
    let model = gonio_io::model::embedded().expect("the embedded model is valid");
    let bench = Bench { model, unit, words };
    let rate = bench.flops() / unit / 1e9;
    println!("{PRODUCTS} products of {PRODUCT} x {PRODUCT} in f64: {unit:.3} s, {rate:.0} GFLOP/s\n");
    bench.head();
    let sample = || Scene {
        photograph: PhotographSource::Files(vec![sample_file()]),
        ..scene(ball(8), ShapeKind::Sphere(None))
    };
    bench.row("samples/ball.exr", sample, 32, true);
    bench.row("the same, no report", sample, 32, false);
    bench.row("the same, light of 16 x 16", sample, 16, true);
    if !quick {
        bench.row("the same, light of 64 x 64", sample, 64, true);
    }
    bench.row("normals of 288 x 244", || by_normals(288, 244), 32, true);
    bench.row("normals of 576 x 488", || by_normals(576, 488), 32, true);
    for side in [64, 256, 1024, 4096].into_iter().filter(|side| !quick || *side < 4096) {
        bench.row(&format!("ball of {side} x {side}"), || scene(ball(side), ShapeKind::Sphere(None)), 32, true);
    }
    for cells in [40, 80, 190].into_iter().filter(|cells| !quick || *cells < 190) {
        bench.row(
            &format!("bunny of {} triangles, 256 x 256", bunny(cells).triangles.len()),
            || by_mesh(cells),
            32,
            true,
        );
    }
    println!();
    let light = LightTree::of_map(&studio_light(512));
    let settings = SphereSettings::default();
    let start = Instant::now();
    render_sphere(&material(), &light, &settings, &|_| ());
    let took = start.elapsed().as_secs_f64();
    println!("sphere of 256 x 256 under a map of 1024 x 512: {took:.2} s, {:.1} units", took / unit);
}

/// Measures the time of the products in seconds, the unit of all other times. It depends on the
/// machine and its current load.
fn products() -> f64 {
    let entry = |i: usize, j: usize| ((i * 7 + j * 13) % 17) as f64 / 17.0;
    let (a, b) = (Mat::from_fn(PRODUCT, PRODUCT, entry), Mat::from_fn(PRODUCT, PRODUCT, entry));
    let mut out = Mat::<f64>::zeros(PRODUCT, PRODUCT);
    #[expect(clippy::disallowed_methods, reason = "the unit is the product of faer on all threads")]
    let mut run = || {
        let start = Instant::now();
        for _ in 0..PRODUCTS {
            matmul(out.as_mut(), Accum::Replace, a.as_ref(), b.as_ref(), 1.0, Par::rayon(0));
        }
        start.elapsed().as_secs_f64()
    };
    run();
    (0..RUNS).map(|_| run()).fold(f64::INFINITY, f64::min)
}

/// Returns the number of floating-point operations of the factorisations and inverses on the finest
/// light grid. The light is the only stage that consists of matrix products. Rejected steps are not
/// counted.
fn products_of_light(light: &Light, side: usize) -> f64 {
    let m = (side * side) as f64;
    let steps = light.evidence.as_ref().map_or(0, |evidence| evidence.trace.len()) + light.steps.unwrap_or(0);
    // The factorisation and the inversion of the factor require m^3 / 3 operations each.
    steps as f64 * 2.0 / 3.0 * m.powi(3)
}

struct Bench {
    model: Model,
    /// Time of the products in seconds.
    unit: f64,
    /// Words that select the rows whose names contain one of them; an empty list selects all rows.
    words: Vec<String>,
}

impl Bench {
    fn head(&self) {
        println!(
            "times in seconds; units: total relative to the products; of peak: rate of the light stage relative to the products"
        );
        print!("{:42}", "");
        STAGES.iter().for_each(|stage| print!("{stage:>10}"));
        println!("{:>10}{:>10}{:>11}", "total", "units", "of peak");
    }

    /// Returns the number of floating-point operations of the products.
    fn flops(&self) -> f64 {
        PRODUCTS as f64 * 2.0 * (PRODUCT as f64).powi(3)
    }

    fn row(&self, name: &str, scene: impl FnOnce() -> Scene, side: usize, report: bool) {
        if !self.words.is_empty() && !self.words.iter().any(|word| name.contains(word)) {
            return;
        }
        let scene = scene();
        let settings = Settings {
            method: Method::Learnt,
            side,
            shadows: true,
            colours: ColourMode::Estimate,
            spaces: Spaces::default(),
            pictures: true,
            report,
            words: &|_| None,
        };
        let run = || {
            let listener = |_: &'static str, _: f64| ();
            let progress_log = ProgressLog::new("reading", &listener);
            let inferred = infer((&self.model, "the model"), scene.clone(), &settings, &progress_log)
                .unwrap_or_else(|problem| panic!("{name}: {problem:?}"));
            let mut seconds = progress_log.seconds();
            let start = Instant::now();
            let flops = inferred.document.light.as_ref().map_or(0.0, |light| products_of_light(light, side));
            assert!(inferred.files().encode().len() > 3, "{name}");
            // The files are encoded but not written.
            seconds.push(("files", start.elapsed().as_secs_f64()));
            let total: f64 = seconds.iter().map(|s| s.1).sum();
            (total, seconds, flops)
        };
        let best = (0..RUNS).map(|_| run()).min_by(|a, b| a.0.total_cmp(&b.0)).expect("at least one run");
        print!("{name:42}");
        for stage in STAGES {
            match best.1.iter().find(|s| s.0 == stage) {
                Some((_, seconds)) => print!("{seconds:>10.3}"),
                None => print!("{:>10}", ""),
            }
        }
        let light = best.1.iter().find(|s| s.0 == "light").map_or(f64::INFINITY, |s| s.1);
        let share = best.2 / light / (self.flops() / self.unit);
        println!("{:>10.3}{:>10.1}{:>9.0} %", best.0, best.0 / self.unit, 100.0 * share);
    }
}

fn sample_file() -> std::path::PathBuf {
    std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../samples/ball.exr")
}

fn material() -> BivariateTable {
    Ggx { diffuse: 0.3, f0: 0.04, alpha: 0.15 }.to_bivariate()
}

fn light() -> LightTree {
    LightTree::of_map(&studio_light(128))
}

fn scene(picture: Picture, form: ShapeKind) -> Scene {
    Scene {
        name: "the photograph".into(),
        photograph: PhotographSource::Memory(picture),
        reading: Reading::default(),
        clip: None,
        mask: None,
        one_material: false,
        force: false,
        reference: None,
        shape: Shape::of(form),
    }
}

/// Renders a photograph of a ball with at most 256 pixels a side, and enlarges it to `side`.
fn ball(side: usize) -> Picture {
    let small = side.min(256);
    let picture = render_sphere(&material(), &light(), &SphereSettings { size: small, ..Default::default() }, &|_| ());
    let times = side / small;
    let large = |from: usize| from / times;
    Picture {
        rgb: Plane::from_fn(side, side, |x, y| picture.rgb[(large(x), large(y))]),
        alpha: picture.alpha.map(|alpha| Plane::from_fn(side, side, |x, y| alpha[(large(x), large(y))])),
    }
}

/// Renders a mesh with the default camera. Returns the photograph and its geometry buffer.
fn photograph(mesh: MeshParts, size: (usize, usize)) -> (Picture, GeometryBuffer) {
    let shape = Shape::of(ShapeKind::Mesh(Source::Memory(mesh)));
    let placed = shape.surface(size, &mut Vec::new()).ok().flatten().expect("the mesh is in front of the camera");
    let settings = SurfaceSettings::default();
    let picture = render_surface(&material(), &light(), placed.surface.as_ref(), &placed.camera, &settings, &|_| ());
    (picture, GeometryBuffer::of(placed.surface.as_ref(), &placed.camera))
}

fn form(form: OwnForm, cells: usize) -> MeshParts {
    let mesh = form.mesh(cells).expect("a built-in form");
    MeshParts {
        positions: mesh.positions().to_vec(),
        triangles: mesh.triangles().to_vec(),
        normals: Some(mesh.normals().to_vec()),
    }
}

fn by_normals(width: usize, height: usize) -> Scene {
    let (picture, seen) = photograph(form(OwnForm::Blob, 60), (width, height));
    let normals = NormalSource {
        picture: Source::Memory(seen.normals),
        correction: Correction::default(),
        trusted: true,
        error: 0.0,
        positions: None,
    };
    scene(picture, ShapeKind::Normals(Box::new(normals)))
}

fn bunny(cells: usize) -> MeshParts {
    form(OwnForm::Bunny, cells)
}

fn by_mesh(cells: usize) -> Scene {
    let (picture, _) = photograph(bunny(cells), (256, 256));
    scene(picture, ShapeKind::Mesh(Source::Memory(bunny(cells))))
}
