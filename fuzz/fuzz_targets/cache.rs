#![no_main]
//! The cache: foreign files in its folder, and plans in intact entries.

use gonio_fuzz::Scratch;
use gonio_io::cache::Cache;
use gonio_io::plan::{decode_plan, load_plan};
use gonio_paper::PlanSettings;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    let scratch = Scratch::folder("cache");
    let cache = Cache::at(scratch.path());
    std::fs::write(scratch.path().join("a.plan"), bytes).unwrap();
    if cache.load("a").is_none() {
        assert!(!scratch.path().join("a.plan").exists(), "a damaged entry is kept");
    }
    if let Some(plan) = decode_plan(bytes) {
        assert_eq!(plan.q.len(), plan.points * plan.energies.len());
    }
    cache.store("b", bytes).unwrap();
    assert_eq!(cache.load("b").as_deref(), Some(bytes));
    let _ = load_plan(&cache, "b", 3, 1, &PlanSettings::default());
});
