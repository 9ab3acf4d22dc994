//! Tests of the cache of plans: a result does not depend on whether its plan was cached, and a
//! damaged entry is replaced.

use std::path::PathBuf;

use super::{Files, job, same, written};
use crate::support::Bench;

/// Runs the job with a cache. Returns the origin of its plan, and its output.
fn answer(bench: &Bench) -> (String, Files) {
    let cache = bench.path("cache");
    bench.run_with(&job("infer_cached").to("out"), &[("GONIO_CACHE_DIR", cache.to_str().unwrap())]).succeeds();
    let origin = bench.json("out/result.json")["transfer"]["plan"].as_str().unwrap().to_owned();
    (origin, written(bench, "out"))
}

/// Returns the path of the only file in the cache.
fn entry(bench: &Bench) -> PathBuf {
    let names = bench.names("cache");
    assert_eq!(names.len(), 1, "{names:?}");
    bench.path("cache").join(&names[0])
}

#[test]
fn cached_and_rebuilt_plans_give_the_same_result() {
    let job = job("infer_cached");
    let bench = job.bench();
    let whole = &job.undisturbed().files;
    let check = |origin: &str, what: &str| {
        let (found, files) = answer(&bench);
        assert_eq!(found, origin, "{what}");
        same(&files, whole, what);
    };
    check("built", "first run");
    check("cache", "second run");
    let path = entry(&bench);
    let good = std::fs::read(&path).unwrap();
    // After a power failure, the end of a file can be zero.
    let zeros = vec![0; good.len() / 2];
    std::fs::write(&path, [&good[..good.len() - zeros.len()], &zeros[..]].concat()).unwrap();
    check("built", "run with a damaged entry");
    assert!(std::fs::read(entry(&bench)).unwrap() == good, "the new entry differs from the first one");
}
