//! Speed of the cache: a plan that is found there must cost next to nothing against the seconds
//! that it took to build.
//!
//! `cargo bench -p gonio-io`.

use divan::counter::BytesCount;
use divan::{Bencher, black_box};
use gonio::transfer::{Plan, PlanSettings};
use gonio_io::cache::Cache;
use gonio_io::plan::{decode_plan, encode_plan};

fn main() {
    divan::main();
}

const KEY: &str = "plan";

/// A plan of about 70 MB, a little more than that of a sphere at the default settings (9,916
/// points, rank 800); values do not matter here.
fn plan() -> Plan {
    let settings = PlanSettings { rank: 868, ..PlanSettings::default() };
    let (points, k, rank) = (9_916, 10, settings.rank);
    let values = |n: usize| (0..n).map(|i| (i % 8191) as f32 * 1e-3).collect();
    Plan {
        settings,
        points,
        k,
        q: values(points * rank),
        r: values(rank * k * settings.side * settings.side),
        energies: vec![1.0; rank],
        total_energy: rank as f64,
    }
}

/// The cache, kept for as long as its folder, and the size of its one entry.
fn filled() -> (tempfile::TempDir, Cache, usize) {
    let dir = tempfile::tempdir().expect("there is a folder for temporary files");
    let cache = Cache::at(dir.path());
    let bytes = encode_plan(&plan());
    cache.store(KEY, &bytes).expect("the folder takes 70 MB");
    (dir, cache, bytes.len())
}

/// Reading and checking the bytes.
#[divan::bench(sample_count = 20, sample_size = 1)]
fn load(bencher: Bencher<'_, '_>) {
    let (_dir, cache, bytes) = filled();
    bencher.counter(BytesCount::new(bytes)).bench_local(|| cache.load(black_box(KEY)).expect("the entry is there"));
}

/// The same, and the plan made of them: all that stands between a photograph and its inference at
/// the second time.
#[divan::bench(sample_count = 20, sample_size = 1)]
fn load_and_decode(bencher: Bencher<'_, '_>) {
    let (_dir, cache, bytes) = filled();
    bencher.counter(BytesCount::new(bytes)).bench_local(|| {
        let bytes = cache.load(black_box(KEY)).expect("the entry is there");
        decode_plan(&bytes).expect("the entry is a plan")
    });
}

/// Writing an entry in place of another.
#[divan::bench(sample_count = 10, sample_size = 1)]
fn store(bencher: Bencher<'_, '_>) {
    let (_dir, cache, bytes) = filled();
    let content = encode_plan(&plan());
    bencher
        .counter(BytesCount::new(bytes))
        .bench_local(|| cache.store(black_box(KEY), &content).expect("the folder takes 70 MB"));
}
