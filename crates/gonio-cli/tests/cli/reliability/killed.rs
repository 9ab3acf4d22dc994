//! Commands that are killed at random moments.

use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::{JOBS, Job, Kind, ROWS, bench, job, leftovers, same, whole_or_absent, written};
use crate::support::Bench;

/// Moments in the full test.
const MANY: usize = 50;

/// A fixed stream of numbers in 0..1 (SplitMix64), so that the moments can be repeated.
struct Moments(u64);

impl Moments {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) as f64 / u64::MAX as f64
    }
}

/// What became of the runs of a job.
#[derive(Debug, Default)]
struct Ends {
    /// Killed before its end.
    killed: usize,
    /// After which the output was there.
    there: usize,
}

/// Kills a command after a while; whether it was still running.
fn kill_after(bench: &Bench, line: &str, while_: Duration) -> bool {
    let mut command = bench.command(line);
    command.env("GONIO_CACHE_DIR", bench.path("cache")).stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = command.spawn().unwrap();
    sleep(while_);
    let running = child.try_wait().unwrap().is_none();
    child.kill().unwrap();
    child.wait().unwrap();
    running
}

/// Kills a job at some moments of its time and looks at what is there each time. Half of the
/// moments are in the last third, where output is written.
fn kill(job: &Job, moments: usize) {
    let bench = bench();
    let whole = job.undisturbed(&bench);
    let start = Instant::now();
    bench.run_with(&job.to("timed"), &[("GONIO_CACHE_DIR", "")]).succeeds();
    let mut time = start.elapsed().as_secs_f64();
    let (mut stream, mut ends) = (Moments(job.line.len() as u64), Ends::default());
    let output = job.output("out");
    for moment in 0..moments {
        let (low, high) = if moment % 2 == 0 { (0.0, 1.0) } else { (0.67, 1.05) };
        let after = Duration::from_secs_f64(time * (low + (high - low) * stream.next()));
        let killed = kill_after(&bench, &job.to("out"), after);
        ends.killed += usize::from(killed);
        if !killed && ends.killed == 0 {
            // The machine was busier when the time was taken.
            time *= 0.5;
        }
        if job.kind == Kind::Batch {
            ends.there += usize::from(rows_are_whole(&bench, &whole) == ROWS.len());
        } else if whole_or_absent(&bench, &output, &whole) {
            ends.there += 1;
            let path = bench.path(&output);
            // A batch goes on where it was; the others begin again.
            if path.is_dir() { std::fs::remove_dir_all(path).unwrap() } else { std::fs::remove_file(path).unwrap() }
        }
    }
    // The next one ends well, with the cache as the killed ones left it, and clears away.
    let cache = bench.path("cache");
    bench.run_with(&job.to("out"), &[("GONIO_CACHE_DIR", cache.to_str().unwrap())]).succeeds();
    same(&written(&bench, &output), &whole, job.name);
    assert!(ends.killed > 0, "{}: none was killed", job.name);
    let left: Vec<String> = leftovers(&bench).into_iter().filter(|path| path.ends_with(".unfinished")).collect();
    assert_eq!(left, Vec::<String>::new(), "{}", job.name);
    println!(
        "{}: {time:.2} s, {} of {moments} killed, {} times the output was there, {} hidden files left",
        job.name,
        ends.killed,
        ends.there,
        leftovers(&bench).len()
    );
}

/// Checks the rows of a batch that are there; how many.
#[track_caller]
fn rows_are_whole(bench: &Bench, whole: &std::collections::BTreeMap<String, Vec<u8>>) -> usize {
    let found = written(bench, "out");
    let of = |files: &std::collections::BTreeMap<String, Vec<u8>>, row: &str| {
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
fn what_is_killed_leaves_whole_outputs_or_none() {
    for (name, moments) in [("infer with the cache", 3), ("train lighting", 3), ("merge", 3), ("export", 3)] {
        kill(job(name), moments);
    }
}

#[test]
#[ignore = "takes some minutes"]
fn what_is_killed_at_fifty_moments_leaves_whole_outputs_or_none() {
    std::thread::scope(|scope| JOBS.iter().for_each(|job| drop(scope.spawn(|| kill(job, MANY)))));
}
