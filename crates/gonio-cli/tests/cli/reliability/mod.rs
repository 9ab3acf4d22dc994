//! Tests of reliability: commands that are killed, that run out of disk space, whose output folder
//! is removed while they run, or that run concurrently. Afterwards, every output is complete or
//! absent (`docs/reliability.md`).
//!
//! The default tests take a few seconds each. The numbers in `docs/reliability.md` come from
//! `cargo test -p gonio-cli --test cli reliability -- --ignored --nocapture`.

/// Defines a module with one ignored test per command, so that the tests can run separately and in
/// parallel.
macro_rules! each_job {
    ($module:ident: $run:expr) => {
        mod $module {
            use super::*;
            use crate::reliability::JOBS;
            each_job!(@ $run; infer infer_paper batch train_lighting train_reflectance merge export);
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
        fn covers_all_jobs() {
            assert_eq!([$(stringify!($name)),*], JOBS.map(|job| job.name));
        }
    };
}

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
    /// Name in messages.
    pub(crate) name: &'static str,
    /// Arguments, with `OUT` in place of the output.
    line: &'static str,
    /// How the output is created.
    kind: Kind,
    /// Function that writes the input files.
    inputs: fn(&Bench),
}

/// How an output is created.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    /// A folder, by one rename.
    Folder,
    /// A file, by one rename.
    File,
    /// The folders of a batch, each by one rename.
    Batch,
}

/// All commands with an output that takes time to compute.
pub(crate) const JOBS: [Job; 7] = [
    Job { name: "infer", line: "infer ball.exr --grid 8 -o OUT", kind: Kind::Folder, inputs: ball },
    Job {
        name: "infer_paper",
        line: "infer ball.exr --normals normals.npy --method variational --starts 1 --all-observations --grid 8 -o OUT",
        kind: Kind::Folder,
        inputs: ball,
    },
    Job { name: "batch", line: "batch list.csv -o OUT", kind: Kind::Batch, inputs: list },
    Job {
        name: "train_lighting",
        line: "train lighting lights -o OUT --grid 16 --rotations 2",
        kind: Kind::File,
        inputs: crate::train::lights,
    },
    Job {
        name: "train_reflectance",
        line: "train reflectance materials -o OUT --rank 2 --starts 2",
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

/// Returns the job with a name.
pub(crate) fn job(name: &str) -> &'static Job {
    JOBS.iter().find(|job| job.name == name).unwrap()
}

impl Job {
    /// Returns the name of the output with this stem.
    fn output(&self, stem: &str) -> String {
        if self.kind == Kind::File { format!("{stem}.exr") } else { stem.to_owned() }
    }

    /// Returns the arguments with this output.
    fn to(&self, stem: &str) -> String {
        self.line.replace("OUT", &self.output(stem))
    }

    /// Creates a bench with the input files.
    fn bench(&self) -> Bench {
        let bench = Bench::new();
        (self.inputs)(&bench);
        bench
    }

    /// Returns the output and the duration of an undisturbed run on two threads, which all tests
    /// share.
    fn undisturbed(&self) -> &'static Undisturbed {
        static KNOWN: [OnceLock<Undisturbed>; JOBS.len()] = [const { OnceLock::new() }; JOBS.len()];
        let at = JOBS.iter().position(|job| job.name == self.name).unwrap();
        KNOWN[at].get_or_init(|| {
            let bench = self.bench();
            let start = Instant::now();
            bench.run(&format!("{} --threads 2", self.to("whole"))).succeeds();
            Undisturbed { time: start.elapsed(), files: written(&bench, &self.output("whole")) }
        })
    }
}

/// Output and duration of an undisturbed run.
struct Undisturbed {
    files: Files,
    time: Duration,
}

/// Contents of files by name.
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

/// Reads a file, or all files below a folder, without their [time-dependent parts](timeless).
/// Returns an empty map if there is no such file or folder.
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

/// Removes the parts of a file that vary between runs, such as seconds. Returns `None` for files
/// that contain such parts in another form.
fn timeless(name: &str, bytes: Vec<u8>) -> Option<Vec<u8>> {
    if name.ends_with("summary.png") || name.ends_with("batch.csv") {
        return None;
    }
    if !name.ends_with(".json") {
        return Some(bytes);
    }
    let mut notes: Value = serde_json::from_slice(&bytes).expect("the file is complete JSON");
    if let Some(notes) = notes.as_object_mut() {
        // The arguments of a row contain the output folder.
        notes.retain(|key, _| key != "seconds" && key != "arguments");
    }
    Some(notes.to_string().into_bytes())
}

/// Checks that an output is equal to `whole` or absent. Returns whether it exists.
#[track_caller]
fn whole_or_absent(bench: &Bench, name: &str, whole: &Files) -> bool {
    let found = written(bench, name);
    if found.is_empty() && !bench.path(name).exists() {
        return false;
    }
    same(&found, whole, name);
    true
}

/// Checks that two outputs are equal.
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

/// Lists the hidden files and folders that runs left below the bench.
fn leftovers(bench: &Bench) -> Vec<String> {
    let names = bench.tree().into_keys().map(|path| path.display().to_string());
    names.filter(|path| path.contains("/.gonio-")).collect()
}
