//! Four of each command at once, on one output and one cache; and folders that go while a command
//! runs.

use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::Duration;

use super::{JOBS, Job, bench, job, leftovers, same, whole_or_absent, written};
use crate::support::Bench;

/// Processes at once.
const CROWD: usize = 4;

fn start(bench: &Bench, line: &str) -> Child {
    let mut command = bench.command(line);
    command.env("GONIO_CACHE_DIR", bench.path("cache")).stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

/// Exit code and the first line of standard error.
fn end(child: Child) -> (Option<i32>, String) {
    let output = child.wait_with_output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn together(job: &Job) {
    let bench = bench();
    let whole = job.undisturbed(&bench);
    let children: Vec<Child> = (0..CROWD).map(|_| start(&bench, &job.to("out"))).collect();
    for (code, said) in children.into_iter().map(end) {
        assert_eq!(code, Some(0), "{}: {said}", job.name);
    }
    same(&written(&bench, &job.output("out")), &whole, job.name);
    assert_eq!(leftovers(&bench), Vec::<String>::new(), "{}", job.name);
}

#[test]
fn four_at_once_write_one_output() {
    for name in ["infer with the cache", "merge"] {
        together(job(name));
    }
}

#[test]
#[ignore = "takes some minutes"]
fn four_of_every_command_at_once_write_one_output() {
    for _ in 0..5 {
        for job in &JOBS {
            together(job);
        }
    }
}

/// Removes the folder of the output while the command runs, `after` as a part of its time.
fn removed(job: &Job, after: f64) {
    let bench = bench();
    let whole = job.undisturbed(&bench);
    let begin = std::time::Instant::now();
    bench.run_with(&job.to("timed"), &[("GONIO_CACHE_DIR", "")]).succeeds();
    let time = begin.elapsed().mul_f64(after);
    std::fs::create_dir(bench.path("deep")).unwrap();
    let child = start(&bench, &job.to("deep/out"));
    sleep(time.min(Duration::from_secs(60)));
    // Something may be written into it meanwhile.
    while bench.path("deep").exists() && std::fs::remove_dir_all(bench.path("deep")).is_err() {}
    let (code, said) = end(child);
    let output = job.output("deep/out");
    if whole_or_absent(&bench, &output, &whole) {
        assert_eq!(code, Some(0), "{}: {said}", job.name);
    } else {
        assert!(code == Some(0) || said.contains("deep"), "{}: {code:?} {said}", job.name);
        assert!(code != Some(101), "{}: {said}", job.name);
    }
    assert_eq!(leftovers(&bench), Vec::<String>::new(), "{}", job.name);
}

#[test]
fn a_folder_that_goes_is_named() {
    removed(job("export"), 0.5);
}

#[test]
#[ignore = "takes some minutes"]
fn a_folder_that_goes_at_any_moment_is_named() {
    for job in JOBS.iter().filter(|job| job.kind != super::Kind::Batch) {
        for part in 1..10 {
            removed(job, f64::from(part) / 10.0);
        }
    }
}
