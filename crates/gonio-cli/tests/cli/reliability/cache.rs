//! The cache of plans: an answer is the same whether its plan was built or found, and an entry that
//! is damaged is built anew.

use std::path::PathBuf;

use super::{Files, job, same, written};
use crate::support::Bench;

/// Runs the job with a cache; where its plan came from, and what it wrote.
fn answer(bench: &Bench) -> (String, Files) {
    let cache = bench.path("cache");
    bench.run_with(&job("infer_cached").to("out"), &[("GONIO_CACHE_DIR", cache.to_str().unwrap())]).succeeds();
    let origin = bench.json("out/result.json")["transfer"]["plan"].as_str().unwrap().to_owned();
    (origin, written(bench, "out"))
}

/// The only file in the cache.
fn entry(bench: &Bench) -> PathBuf {
    let names = bench.names("cache");
    assert_eq!(names.len(), 1, "{names:?}");
    bench.path("cache").join(&names[0])
}

#[test]
fn a_plan_from_the_cache_gives_the_same_answer_and_a_damaged_one_is_built_anew() {
    let job = job("infer_cached");
    let bench = job.bench();
    let whole = &job.undisturbed().files;
    let check = |origin: &str, what: &str| {
        let (found, files) = answer(&bench);
        assert_eq!(found, origin, "{what}");
        same(&files, whole, what);
    };
    check("built", "the first");
    check("cache", "the second");
    let path = entry(&bench);
    let good = std::fs::read(&path).unwrap();
    // What a machine that lost its power may leave.
    let zeros = vec![0; good.len() / 2];
    std::fs::write(&path, [&good[..good.len() - zeros.len()], &zeros[..]].concat()).unwrap();
    check("built", "with a damaged entry");
    assert!(std::fs::read(entry(&bench)).unwrap() == good, "the entry is not as it was");
}
