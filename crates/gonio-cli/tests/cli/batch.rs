//! Tests of `gonio batch`.

use std::process::Command;

use crate::support::Bench;

/// Three rows; the image of the second row does not exist.
const TABLE: &str = "name,image,normals,grid,no-shadows\n\
                     one,ball.exr,,8,\n\
                     # a remark\n\
                     two,none.exr,,8,\n\
                     three,ball.exr,normals.npy,8,yes\n";

fn bench() -> Bench {
    let bench = Bench::with_ball();
    std::fs::create_dir(bench.path("photos")).unwrap();
    for file in ["ball.exr", "normals.npy"] {
        std::fs::rename(bench.path(file), bench.path("photos").join(file)).unwrap();
    }
    bench.write("photos/list.csv", TABLE.as_bytes());
    bench
}

fn column(bench: &Bench, index: usize) -> Vec<String> {
    let text = String::from_utf8(bench.read("out/batch.csv")).unwrap();
    text.lines().skip(1).map(|line| line.split(',').nth(index).unwrap().to_owned()).collect()
}

#[test]
fn failed_rows_do_not_stop_the_batch_and_run_again() {
    let bench = bench();
    let run = bench.run("batch photos/list.csv -o out");
    assert_eq!(run.code, Some(2));
    assert!(run.stderr.contains("out: 1 of 3 rows failed (two)"), "{run:?}");
    assert!(run.stderr.contains("[2/3] two: failed: none.exr"), "{run:?}");
    assert_eq!(column(&bench, 1), ["done", "failed", "done"]);
    assert!(!column(&bench, 3)[0].is_empty());
    assert!(!bench.path("out/two").exists());
    let first = bench.read("out/one/result.json");
    // Once the image exists, only the failed row is inferred.
    std::fs::copy(bench.path("photos/ball.exr"), bench.path("photos/none.exr")).unwrap();
    let run = bench.run("--json batch photos/list.csv -o out").succeeds();
    let printed: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((printed["inferred"].as_u64(), printed["skipped"].as_u64()), (Some(1), Some(2)));
    assert_eq!(bench.read("out/one/result.json"), first);
    assert_eq!(column(&bench, 1), ["done"; 3]);
    // A row is inferred again if its arguments change.
    bench.write("photos/list.csv", TABLE.replace("one,ball.exr,,8", "one,ball.exr,,4").as_bytes());
    let run = bench.run("--json batch photos/list.csv -o out").succeeds();
    let printed: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(printed["inferred"].as_u64(), Some(1));
    assert_eq!(bench.json("out/one/result.json")["settings"]["grid"], 4);
}

#[test]
fn the_slurm_example_runs() {
    let bench = bench();
    std::fs::copy(bench.path("photos/ball.exr"), bench.path("photos/none.exr")).unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/slurm/infer.sbatch");
    let program = std::path::Path::new(env!("CARGO_BIN_EXE_gonio"));
    let path = format!("{}:{}", program.parent().unwrap().display(), std::env::var("PATH").unwrap());
    for task in ["4", "6"] {
        let status = Command::new("bash")
            .args([script, "photos/list.csv", "out"])
            .current_dir(bench.path(""))
            .env("PATH", &path)
            .env("GONIO_NO_REPORT", "true")
            .env("GONIO_NO_PICTURES", "true")
            .env("SLURM_CPUS_PER_TASK", "2")
            .env("SLURM_ARRAY_TASK_ID", task)
            .env("SLURM_ARRAY_TASK_MIN", "4")
            .env("SLURM_ARRAY_TASK_COUNT", "2")
            .env("SLURM_ARRAY_TASK_STEP", "2")
            .status()
            .unwrap();
        assert!(status.success());
        assert!(!bench.path("out/batch.csv").exists());
    }
    let run = bench.run("batch --collect photos/list.csv -o out").succeeds();
    assert!(run.stdout.contains("3 done, 0 failed, 0 missing"), "{run:?}");
    bench.run("batch --collect -o out").succeeds();
    assert_eq!(column(&bench, 0), ["one", "three", "two"]);
}

#[test]
fn rejects_invalid_tables() {
    let bench = bench();
    for (table, message) in [
        ("name\none\n", "the table has no column \"image\""),
        ("image\n", "has no rows"),
        ("image,colour\nball.exr,red\n", "column \"colour\" is not an option of gonio infer"),
        ("image,output\nball.exr,x\n", "column \"output\" is not supported"),
        ("image\nball.exr\nball.exr\n", "row 2: duplicate name ball"),
        ("image,name\nball.exr,../up\n", "row 1: \"../up\" is not a valid folder name"),
        ("image,name\nball.exr,rows\n", "row 1: \"rows\" is not a valid folder name"),
        ("image,no-shadows\nball.exr,perhaps\n", "--no-shadows: invalid value perhaps; use yes or no"),
        ("image,mask\nball.exr\n", "row 1 cannot be read"),
        ("image,mask\n,ball.exr\n", "row 1: the cell of column \"image\" is empty"),
    ] {
        bench.write("photos/bad.csv", table.as_bytes());
        bench.refuses("batch photos/bad.csv -o x", &["photos/bad.csv", message]);
    }
    // Aliases of options are columns, too.
    bench.write("photos/bad.csv", b"image,gray-card\nball.exr,none.png\n");
    let run = bench.run("batch photos/bad.csv -o aliases");
    assert!(run.code != Some(0) && format!("{run:?}").contains("none.png: cannot open"), "{run:?}");
    bench.refuses("batch none.csv -o x", &["none.csv: cannot open"]);
    bench.refuses("batch photos/list.csv -o x --shard 4/3", &["--shard"]);
    bench.refuses("batch --collect -o x", &["x/rows: cannot list"]);
    std::fs::create_dir_all(bench.path("x/rows")).unwrap();
    bench.refuses("batch --collect -o x", &["x: contains no results of gonio batch"]);
    assert!(!bench.path("x/batch.csv").exists());
    bench.refuses("batch -o x", &["<IMAGE|TABLE>"]);
}
