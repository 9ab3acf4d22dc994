//! Tests of commands that are killed at random times.

use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{Files, Job, Kind, ROWS, Undisturbed, job, leftovers, same, whole_or_absent, written};
use crate::support::Bench;

/// Number of kills of each command in the ignored tests.
const MANY: usize = 50;

/// Environment variable with the seed of the random times, an integer.
const SEED: &str = "GONIO_TEST_SEED";

/// Returns reproducible random numbers, which determine the times.
fn random_numbers(job: &Job) -> Pcg64 {
    let seed = std::env::var(SEED).map_or(0, |seed| seed.parse().expect("the seed is an integer"));
    Pcg64::seed_from_u64((seed << 32) + job.line.len() as u64)
}

/// Numbers of runs of a job by their end.
#[derive(Debug, Default)]
struct Ends {
    /// Killed before their end.
    killed: usize,
    /// Killed, with a complete output.
    killed_there: usize,
    /// Ended before the kill.
    ended: usize,
}

/// Kills a command after a time. Returns `None` if it was still running, or else its duration.
fn kill_after(bench: &Bench, line: &str, while_: Duration) -> Option<Duration> {
    let mut command = bench.command(line);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = command.spawn().unwrap();
    let start = Instant::now();
    while start.elapsed() < while_ {
        if child.try_wait().unwrap().is_some() {
            return Some(start.elapsed());
        }
        sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    None
}

/// Kills a job at random times, and checks the output after each kill. Half of the times are in the
/// last third of the duration, in which the output is written.
fn kill(job: &Job, moments: usize) {
    let bench = job.bench();
    let Undisturbed { files: whole, time } = job.undisturbed();
    let mut time = *time;
    let (mut rng, mut ends) = (random_numbers(job), Ends::default());
    let output = job.output("out");
    while ends.killed < moments {
        let (low, high) = if ends.killed % 2 == 0 { (0.0, 1.0) } else { (0.67, 1.05) };
        let part = rng.random_range(low..=high);
        let ended = kill_after(&bench, &job.to("out"), time.mul_f64(part));
        let there = match job.kind {
            Kind::Batch => rows_are_whole(&bench, whole) == ROWS.len(),
            Kind::Folder | Kind::File => whole_or_absent(&bench, &output, whole),
        };
        // Track the current duration, which depends on the load of the machine.
        match ended {
            Some(took) => {
                assert!(there, "{}: ended without its output", job.name);
                ends.ended += 1;
                time = (time + took) / 2;
                assert!(ends.ended < 10 * moments, "{}: ends before the kill too often", job.name);
            }
            None => {
                ends.killed += 1;
                ends.killed_there += usize::from(there);
                if part >= 1.0 && !there {
                    time = time.mul_f64(1.1);
                }
            }
        }
        if there {
            // Remove a complete output. An incomplete batch resumes.
            let path = bench.path(&output);
            if path.is_dir() { std::fs::remove_dir_all(path).unwrap() } else { std::fs::remove_file(path).unwrap() }
        }
    }
    // The next run succeeds, and removes the unfinished files of the killed runs.
    bench.run(&job.to("out")).succeeds();
    same(&written(&bench, &output), whole, job.name);
    let left: Vec<String> = leftovers(&bench).into_iter().filter(|path| path.ends_with(".unfinished")).collect();
    assert_eq!(left, Vec::<String>::new(), "{}", job.name);
    println!(
        "{}: {:.2} s, {} killed, {} of them with a complete output, {} ended before, {} hidden files left",
        job.name,
        time.as_secs_f64(),
        ends.killed,
        ends.killed_there,
        ends.ended,
        leftovers(&bench).len()
    );
}

/// Checks the existing rows of a batch. Returns their number.
#[track_caller]
fn rows_are_whole(bench: &Bench, whole: &Files) -> usize {
    let found = written(bench, "out");
    let of = |files: &Files, row: &str| {
        let own = files.iter().filter(|(name, _)| name.starts_with(&format!("{row}/")));
        own.map(|(name, bytes)| (name.clone(), bytes.clone())).collect()
    };
    let there = |row: &&str| {
        if !bench.path(&format!("out/{row}")).exists() {
            return false;
        }
        same(&of(&found, row), &of(whole, row), row);
        true
    };
    ROWS.iter().filter(|row| there(row)).count()
}

#[test]
fn killed_commands_leave_complete_or_no_outputs() {
    for name in ["infer_paper", "train_lighting", "merge"] {
        kill(job(name), 2);
    }
}

each_job!(killed_fifty_times: |job| kill(job, MANY));
