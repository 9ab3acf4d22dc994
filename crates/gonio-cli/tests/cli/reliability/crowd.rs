//! Tests of four concurrent processes with one output, and of output folders that are
//! removed while a command runs.

use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::Duration;

use super::{Job, Kind, Undisturbed, job, leftovers, same, whole_or_absent, written};
use crate::support::Bench;

/// Number of concurrent processes.
const CROWD: usize = 4;

fn start(bench: &Bench, line: &str) -> Child {
    let mut command = bench.command(line);
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

/// Waits for a process. Returns its exit code and its standard error.
fn end(child: Child) -> (Option<i32>, String) {
    let output = child.wait_with_output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn together(job: &Job) {
    let bench = job.bench();
    let whole = &job.undisturbed().files;
    let children: Vec<Child> = (0..CROWD).map(|_| start(&bench, &job.to("out"))).collect();
    for (code, printed) in children.into_iter().map(end) {
        assert_eq!(code, Some(0), "{}: {printed}", job.name);
    }
    same(&written(&bench, &job.output("out")), whole, job.name);
    assert_eq!(leftovers(&bench), Vec::<String>::new(), "{}", job.name);
}

#[test]
fn four_concurrent_processes_write_one_output() {
    for name in ["infer_paper", "merge"] {
        together(job(name));
    }
}

each_job!(five_runs_of_four_processes: |job| (0..5).for_each(|_| together(job)));

/// Removes the folder of the output while the command runs, after these fractions of its duration.
fn removed(job: &Job, parts: &[f64]) {
    let bench = job.bench();
    let Undisturbed { files: whole, time } = job.undisturbed();
    let deep = bench.path("deep");
    for part in parts {
        std::fs::create_dir(&deep).unwrap();
        let child = start(&bench, &job.to("deep/out"));
        sleep(time.mul_f64(*part).min(Duration::from_secs(60)));
        // The command can write to the folder during the removal.
        while deep.exists() && std::fs::remove_dir_all(&deep).is_err() {}
        let (code, printed) = end(child);
        if whole_or_absent(&bench, &job.output("deep/out"), whole) {
            assert_eq!(code, Some(0), "{}: {printed}", job.name);
        } else {
            assert!(code == Some(0) || printed.contains("deep"), "{}: {code:?} {printed}", job.name);
            assert!(code != Some(101), "{}: {printed}", job.name);
        }
        assert_eq!(leftovers(&bench), Vec::<String>::new(), "{}", job.name);
        // The command creates the folder again if it was removed early.
        if deep.exists() {
            std::fs::remove_dir_all(&deep).unwrap();
        }
    }
}

#[test]
fn errors_name_a_removed_folder() {
    removed(job("export"), &[0.5]);
}

/// Calls [`removed`], except for a batch, which creates its folder again for each row.
fn removed_at_any_moment(job: &Job) {
    if job.kind != Kind::Batch {
        removed(job, &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9]);
    }
}

each_job!(folder_removed_at_any_time: removed_at_any_moment);
