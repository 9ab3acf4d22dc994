//! Speed of the cache. Loading a plan must take far less time than building it, which takes
//! seconds.
//!
//! `cargo bench -p gonio-io`.

use divan::counter::BytesCount;
use divan::{Bencher, black_box};
use gonio_io::cache::Cache;
use gonio_io::plan::{decode_plan, encode_plan};
use gonio_paper::{Plan, PlanSettings};

fn main() {
    divan::main();
}

const KEY: &str = "plan";

/// Returns a plan of about 70 MB. That of a sphere at the default settings (9,916 points, rank 800)
/// is slightly smaller. The values do not matter.
fn plan() -> Plan {
    let settings = PlanSettings { rank: 868, ..PlanSettings::default() };
    let (points, k, rank) = (9_916, 10, settings.rank);
    let values = |n: usize| (0..n).map(|i| (i % 8191) as f32 * 1e-3).collect();
    Plan {
        settings,
        points,
        k,
        q: values(points * rank),
        r: values(rank * k * settings.transfer.side.pow(2)),
        energies: vec![1.0; rank],
        total_energy: rank as f64,
    }
}

/// Returns a cache with one entry, its temporary folder, and the size of the entry in bytes.
fn filled() -> (tempfile::TempDir, Cache, usize) {
    let dir = tempfile::tempdir().expect("there is a folder for temporary files");
    let cache = Cache::at(dir.path());
    let bytes = encode_plan(&plan());
    cache.store(KEY, &bytes).expect("the folder has room for 70 MB");
    (dir, cache, bytes.len())
}

/// Reads and checks the bytes.
#[divan::bench(sample_count = 20, sample_size = 1)]
fn load(bencher: Bencher<'_, '_>) {
    let (_dir, cache, bytes) = filled();
    bencher.counter(BytesCount::new(bytes)).bench_local(|| cache.load(black_box(KEY)).expect("the entry is there"));
}

/// Reads and checks the bytes and decodes the plan, as a second run does before its inference.
#[divan::bench(sample_count = 20, sample_size = 1)]
fn load_and_decode(bencher: Bencher<'_, '_>) {
    let (_dir, cache, bytes) = filled();
    bencher.counter(BytesCount::new(bytes)).bench_local(|| {
        let bytes = cache.load(black_box(KEY)).expect("the entry is there");
        decode_plan(&bytes).expect("the entry is a plan")
    });
}

/// Replaces an entry.
#[divan::bench(sample_count = 10, sample_size = 1)]
fn store(bencher: Bencher<'_, '_>) {
    let (_dir, cache, bytes) = filled();
    let content = encode_plan(&plan());
    bencher
        .counter(BytesCount::new(bytes))
        .bench_local(|| cache.store(black_box(KEY), &content).expect("the folder has room for 70 MB"));
}
