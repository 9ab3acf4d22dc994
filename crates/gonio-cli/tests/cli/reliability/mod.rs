//! Nothing is lost: commands that are killed, that run out of disk, whose folder goes while they
//! run, that run beside each other. Every output is whole or absent afterwards
//! (`docs/reliability.md`).
//!
//! The tests that are run by default take a few moments each; the numbers of the page come from
//! `cargo test -p gonio-cli --test cli reliability -- --ignored --nocapture`.

/// One ignored test for each command, in a module of its own: they can be run apart and beside each
/// other.
macro_rules! each_job {
    ($module:ident: $run:expr) => {
        mod $module {
            use super::*;
            use crate::reliability::JOBS;
            each_job!(@ $run; infer infer_cached batch train_lighting train_reflectance merge export);
        }
    };
    (@ $run:expr; $($name:ident)*) => {
        $(
            #[test]
            #[ignore = "takes some minutes"]
            fn $name() {
                $run(job(stringify!($name)));
            }
        )*

        #[test]
        fn none_is_left_out() {
            assert_eq!([$(stringify!($name)),*], JOBS.map(|job| job.name));
        }
    };
}

mod cache;
mod crowd;
mod disk;
mod killed;
mod threads;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::{Bench, encode_normals, exr, material, merl};

/// Rows of the batch.
const ROWS: [&str; 3] = ["one", "two", "three"];

/// A command with one output, a file or a folder.
pub(crate) struct Job {
    /// For messages.
    pub(crate) name: &'static str,
    /// Its arguments, with `OUT` for the output.
    line: &'static str,
    /// Whether the output is a folder that appears as one, files that do so each, or a folder that
    /// fills one after the other.
    kind: Kind,
    /// Writes the files that it reads.
    inputs: fn(&Bench),
}

/// How an output comes to be.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    /// A folder by one rename.
    Folder,
    /// A file by one rename.
    File,
    /// Folders of a batch, each by one rename.
    Batch,
}

/// All commands that write something that takes its time.
pub(crate) const JOBS: [Job; 7] = [
    Job { name: "infer", line: "infer ball.exr --grid 8 -o OUT", kind: Kind::Folder, inputs: ball },
    Job {
        name: "infer_cached",
        line: "infer ball.exr --normals normals.npy --method variational --starts 1 --grid 8 -o OUT",
        kind: Kind::Folder,
        inputs: ball,
    },
    Job { name: "batch", line: "batch list.csv -o OUT", kind: Kind::Batch, inputs: list },
    Job {
        name: "train_lighting",
        line: "train lighting lights -o OUT --grid 16 --turns 2",
        kind: Kind::File,
        inputs: crate::train::lights,
    },
    Job {
        name: "train_reflectance",
        line: "train reflectance materials -o OUT --rank 2 --restarts 2",
        kind: Kind::File,
        inputs: crate::train::materials,
    },
    Job {
        name: "merge",
        line: "merge a.png b.png c.png --times 1,0.5,0.25 -o OUT",
        kind: Kind::File,
        inputs: exposures,
    },
    Job { name: "export", line: "export in.binary --to merl,ward,mtlx -o OUT", kind: Kind::Folder, inputs: table },
];

/// The job of a name.
pub(crate) fn job(name: &str) -> &'static Job {
    JOBS.iter().find(|job| job.name == name).unwrap()
}

impl Job {
    /// Name of its output when called by `stem`.
    fn output(&self, stem: &str) -> String {
        if self.kind == Kind::File { format!("{stem}.exr") } else { stem.to_owned() }
    }

    /// Its arguments, with this output.
    fn to(&self, stem: &str) -> String {
        self.line.replace("OUT", &self.output(stem))
    }

    /// A folder with its inputs.
    fn bench(&self) -> Bench {
        let bench = Bench::new();
        (self.inputs)(&bench);
        bench
    }

    /// What it writes on two threads when nobody disturbs it, and how long that took: found once
    /// for all tests.
    fn undisturbed(&self) -> &'static Undisturbed {
        static KNOWN: [OnceLock<Undisturbed>; JOBS.len()] = [const { OnceLock::new() }; JOBS.len()];
        let at = JOBS.iter().position(|job| job.name == self.name).unwrap();
        KNOWN[at].get_or_init(|| {
            let bench = self.bench();
            let start = Instant::now();
            bench.run_with(&format!("{} --threads 2", self.to("whole")), &[("GONIO_CACHE_DIR", "")]).succeeds();
            Undisturbed { time: start.elapsed(), files: written(&bench, &self.output("whole")) }
        })
    }
}

/// A run of a job that nothing came in the way of.
struct Undisturbed {
    files: Files,
    time: Duration,
}

/// Content by name.
type Files = BTreeMap<String, Vec<u8>>;

fn ball(bench: &Bench) {
    bench.write("ball.exr", &exr(&crate::support::ball()));
    bench.write("normals.npy", &encode_normals(&crate::support::normals(crate::support::SIZE)));
}

fn list(bench: &Bench) {
    ball(bench);
    let rows: String = ROWS.map(|name| format!("{name},ball.exr,8\n")).concat();
    bench.write("list.csv", format!("name,image,grid\n{rows}").as_bytes());
}

fn exposures(bench: &Bench) {
    let ball = crate::support::ball();
    for (name, gain) in [("a.png", 1.0), ("b.png", 0.5), ("c.png", 0.25)] {
        let shot = ball.rgb.map(|v| gain * *v);
        bench.write(name, &gonio_io::picture::encode_png(&shot));
    }
}

fn table(bench: &Bench) {
    gonio_io::merl::write(bench.path("in.binary"), &merl(&material(0.1, 0.3))).unwrap();
}

/// A file or the files of a folder and of those in it, by name, without what tells the time.
/// Empty if there is nothing.
fn written(bench: &Bench, name: &str) -> Files {
    let path = bench.path(name);
    if path.is_file() {
        return [(String::new(), std::fs::read(&path).unwrap())].into();
    }
    if !path.is_dir() {
        return BTreeMap::new();
    }
    let mut files = BTreeMap::new();
    for inner in bench.names(name) {
        let below = format!("{name}/{inner}");
        if bench.path(&below).is_dir() {
            let found = written(bench, &below).into_iter();
            files.extend(found.map(|(file, bytes)| (Path::new(&inner).join(file).display().to_string(), bytes)));
        } else {
            files.insert(inner, bench.read(&below));
        }
    }
    files.into_iter().filter_map(|(name, bytes)| Some((name.clone(), timeless(&name, bytes)?))).collect()
}

/// The file without what it tells of its making, such as seconds; `None` for pictures with a
/// caption that has them.
fn timeless(name: &str, bytes: Vec<u8>) -> Option<Vec<u8>> {
    if name.ends_with("summary.png") || name.ends_with("batch.csv") {
        return None;
    }
    if !name.ends_with(".json") {
        return Some(bytes);
    }
    let mut notes: Value = serde_json::from_slice(&bytes).expect("whole JSON");
    if let Some(notes) = notes.as_object_mut() {
        // The folder of the output is among the arguments of a row.
        notes.retain(|key, _| key != "seconds" && key != "arguments");
        // Whether the plan came from the cache.
        if let Some(transfer) = notes.get_mut("transfer").and_then(Value::as_object_mut) {
            transfer.remove("plan");
        }
    }
    Some(notes.to_string().into_bytes())
}

/// Checks that an output is as it should be, or is not there; whether it is there.
#[track_caller]
fn whole_or_absent(bench: &Bench, name: &str, whole: &Files) -> bool {
    let found = written(bench, name);
    if found.is_empty() && !bench.path(name).exists() {
        return false;
    }
    same(&found, whole, name);
    true
}

/// Checks that two outputs are the same.
#[track_caller]
fn same(found: &Files, whole: &Files, what: &str) {
    assert_eq!(found.keys().collect::<Vec<_>>(), whole.keys().collect::<Vec<_>>(), "{what}: files");
    for (file, bytes) in whole {
        let at = found[file].iter().zip(bytes).position(|(a, b)| a != b);
        let near = |bytes: &[u8]| {
            let from = at.unwrap_or(bytes.len()).saturating_sub(40).min(bytes.len());
            String::from_utf8_lossy(&bytes[from..bytes.len().min(from + 200)]).into_owned()
        };
        assert!(found[file] == *bytes, "{what}: {file} differs: {} | {}", near(&found[file]), near(bytes));
    }
}

/// Hidden files and folders below the bench that a run left.
fn leftovers(bench: &Bench) -> Vec<String> {
    let names = bench.tree().into_keys().map(|path| path.display().to_string());
    names.filter(|path| path.contains("/.gonio-")).collect()
}
