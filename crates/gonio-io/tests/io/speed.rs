//! How fast an entry of the cache loads: `cargo test -p gonio-io --release -- --ignored --nocapture speed`.

use std::time::Instant;

use gonio_io::cache::Cache;

#[test]
#[ignore = "a measurement"]
fn loading_a_large_entry() {
    let dir = tempfile::tempdir().unwrap();
    let cache = Cache::at(dir.path());
    for megabytes in [65, 130] {
        let content: Vec<u8> = (0..megabytes << 20).map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let start = Instant::now();
        cache.store("k", &content).unwrap();
        let stored = start.elapsed();
        let times: Vec<_> = (0..5)
            .map(|_| {
                let start = Instant::now();
                let loaded = cache.load("k").unwrap();
                let elapsed = start.elapsed();
                assert_eq!(loaded.len(), content.len());
                elapsed
            })
            .collect();
        eprintln!("{megabytes} MB: stored in {stored:?}, loaded in {times:?}");
    }
}
