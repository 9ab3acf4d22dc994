//! Tests of malicious input: names with control characters or formulas, and oversized files in
//! result folders. `report.rs` tests names with markup.

use std::fs::File;

use crate::support::{Bench, has_controls};

#[test]
fn errors_contain_no_control_characters() {
    let bench = Bench::new();
    bench.write("\u{1b}]0;x\u{7}.exr", b"no picture");
    let run = bench.command("check").arg("\u{1b}]0;x\u{7}.exr").output().unwrap();
    let printed = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.code() == Some(2) && printed.contains("]0;x") && !has_controls(&printed), "{printed:?}");
}

#[test]
fn batch_table_contains_no_formulas() {
    let bench = Bench::with_ball();
    bench.write("list.csv", b"name,image,grid\n=1+1,=none.exr,8\none,ball.exr,8\n");
    assert_eq!(bench.run("batch list.csv -o out").code, Some(2));
    // The result contains a formula instead of the name of a material.
    let mut result = bench.json("out/one/result.json");
    result["posterior"]["materials"][0]["name"] = "@SUM(1+1)*cmd|' /C calc'!A0".into();
    bench.write("out/one/result.json", result.to_string().as_bytes());
    bench.run("batch list.csv -o out --collect").succeeds();
    let table = String::from_utf8(bench.read("out/batch.csv")).unwrap();
    assert!(table.contains("\n'=1+1,failed,") && table.contains(",'@SUM(1+1)*cmd|"), "{table}");
    assert!(table.contains(",'=none.exr: "), "{table}");
}

#[test]
fn limits_the_size_of_result_files() {
    let bench = Bench::with_ball();
    bench.run("batch ball.exr -o out").succeeds();
    // Sparse files of 8 TiB, and JSON with too many levels.
    let vast = |name: &str| File::create(bench.path(name)).unwrap().set_len(1 << 43).unwrap();
    vast("out/ball/result.json");
    bench.run("batch -o out --collect").succeeds();
    vast("out/rows/ball.json");
    bench.run("batch -o out --collect").succeeds();
    assert!(String::from_utf8(bench.read("out/batch.csv")).unwrap().contains("ball,missing"));
    vast("out/ball/posterior.json");
    bench.run("combine out/ball out/ball -o both").fails(&["posterior.json: is larger than"]);
    vast("out/ball/brdf.npz");
    bench.run("export out/ball").fails(&["result.json: is larger than"]);
    bench.run("convert out/ball/brdf.npz a.binary").fails(&["brdf.npz: is larger than"]);
    bench.write("out/ball/posterior.json", "[".repeat(1 << 20).as_bytes());
    bench.run("combine out/ball out/ball -o both").fails(&["posterior.json: is not a posterior"]);
}
