//! Commands that are killed at random moments.

use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::{Files, Job, Kind, ROWS, Undisturbed, job, leftovers, same, whole_or_absent, written};
use crate::support::Bench;

/// Moments of each command in the full tests.
const MANY: usize = 50;

/// Variable that gives a run of the full tests moments of its own: a number.
const SEED: &str = "GONIO_TEST_SEED";

/// A fixed stream of numbers in 0..1 (SplitMix64), so that the moments can be repeated.
struct Moments(u64);

impl Moments {
    fn of(job: &Job) -> Self {
        let seed = std::env::var(SEED).map_or(0, |seed| seed.parse().expect("a number"));
        Self((seed << 32) + job.line.len() as u64)
    }

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
    /// Killed before their end.
    killed: usize,
    /// Killed, with the output there.
    killed_there: usize,
    /// Ended before they were killed.
    ended: usize,
}

/// Kills a command after a while; `None` if it was still running, else how long it took.
fn kill_after(bench: &Bench, line: &str, while_: Duration) -> Option<Duration> {
    let mut command = bench.command(line);
    command.env("GONIO_CACHE_DIR", bench.path("cache")).stdout(Stdio::null()).stderr(Stdio::null());
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

/// Kills a job at so many moments of its time and looks at what is there each time. Half of the
/// moments are in the last third, where output is written.
fn kill(job: &Job, moments: usize) {
    let bench = job.bench();
    let Undisturbed { files: whole, time } = job.undisturbed();
    let mut time = *time;
    let (mut stream, mut ends) = (Moments::of(job), Ends::default());
    let output = job.output("out");
    while ends.killed < moments {
        let (low, high) = if ends.killed % 2 == 0 { (0.0, 1.0) } else { (0.67, 1.05) };
        let part = low + (high - low) * stream.next();
        let ended = kill_after(&bench, &job.to("out"), time.mul_f64(part));
        let there = match job.kind {
            Kind::Batch => rows_are_whole(&bench, whole) == ROWS.len(),
            Kind::Folder | Kind::File => whole_or_absent(&bench, &output, whole),
        };
        // The time is that of now: with the plan in the cache, and with what else the machine does.
        match ended {
            Some(took) => {
                assert!(there, "{}: ended without its output", job.name);
                ends.ended += 1;
                time = (time + took) / 2;
                assert!(ends.ended < 10 * moments, "{}: ends before it can be killed", job.name);
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
            // A batch that is not done goes on where it was; the others begin again.
            let path = bench.path(&output);
            if path.is_dir() { std::fs::remove_dir_all(path).unwrap() } else { std::fs::remove_file(path).unwrap() }
        }
    }
    // The next one ends well, with the cache as the killed ones left it, and clears away.
    let cache = bench.path("cache");
    bench.run_with(&job.to("out"), &[("GONIO_CACHE_DIR", cache.to_str().unwrap())]).succeeds();
    same(&written(&bench, &output), whole, job.name);
    let left: Vec<String> = leftovers(&bench).into_iter().filter(|path| path.ends_with(".unfinished")).collect();
    assert_eq!(left, Vec::<String>::new(), "{}", job.name);
    println!(
        "{}: {:.2} s, {} killed, {} of them with the whole output there, {} ended before, {} hidden files left",
        job.name,
        time.as_secs_f64(),
        ends.killed,
        ends.killed_there,
        ends.ended,
        leftovers(&bench).len()
    );
}

/// Checks the rows of a batch that are there; how many.
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
fn what_is_killed_leaves_whole_outputs_or_none() {
    for name in ["infer_cached", "train_lighting", "merge"] {
        kill(job(name), 2);
    }
}

each_job!(at_fifty_moments: |job| kill(job, MANY));
