//! Tests with full disks.

use std::path::Path;
use std::process::Command;

use super::{Job, Kind, job, leftovers, same, written};

/// A small disk in memory, mounted at a folder; unmounted on drop.
struct SmallDisk<'a>(&'a Path);

impl<'a> SmallDisk<'a> {
    /// Mounts a disk. Returns `None` if mounting is not permitted.
    fn mount(folder: &'a Path, kilobytes: usize) -> Option<Self> {
        std::fs::create_dir_all(folder).unwrap();
        let size = format!("size={kilobytes}k");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", &size, "gonio-test"]).arg(folder).output();
        if mounted.is_ok_and(|out| out.status.success()) {
            return Some(Self(folder));
        }
        eprintln!("skipped: no permission to mount a small disk");
        None
    }
}

impl Drop for SmallDisk<'_> {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0).status();
    }
}

/// Runs a job with its output on disks of several sizes. Returns the number of complete outputs.
fn fill(job: &Job, sizes: &[usize]) -> Option<usize> {
    let bench = job.bench();
    let whole = &job.undisturbed().files;
    let mut there = 0;
    for size in sizes {
        let folder = bench.path("disk");
        let _disk = SmallDisk::mount(&folder, *size)?;
        let output = job.output("disk/out");
        let run = bench.run(&job.to("disk/out"));
        if run.code == Some(0) {
            same(&written(&bench, &output), whole, job.name);
            there += 1;
        } else {
            assert_eq!(run.code, Some(2), "{}: {run:?}", job.name);
            for message in ["disk/out", "No space left", "free disk space"] {
                assert!(run.stderr.contains(message), "{message}: {run:?}");
            }
            let nothing = job.kind == Kind::Batch || !bench.path(&output).exists();
            assert!(nothing, "{} on {size} kB: {:?}", job.name, bench.tree());
        }
        assert_eq!(leftovers(&bench), Vec::<String>::new(), "{}", job.name);
    }
    Some(there)
}

#[test]
fn a_full_disk_leaves_no_partial_output() {
    let Some(there) = fill(job("export"), &[64, 65_536]) else { return };
    assert_eq!(there, 1, "only the larger disk is sufficient");
}

/// Runs a job on disks of 4 KiB to 256 MiB.
fn fill_any(job: &Job) {
    let sizes: Vec<usize> = (2..19).map(|power| 1 << power).collect();
    let Some(there) = fill(job, &sizes) else { return };
    println!("{}: {there} of {} disks were large enough", job.name, sizes.len());
    assert!(there > 0, "{}", job.name);
}

#[test]
fn errors_name_a_full_output_folder() {
    let bench = job("infer").bench();
    let folder = bench.path("disk");
    let Some(_disk) = SmallDisk::mount(&folder, 1024) else { return };
    let before = bench.tree();
    let run = bench.run_with_pictures("infer ball.exr --grid 8 -o disk");
    run.fails(&["disk/summary.png: cannot write", "free disk space"]);
    assert_eq!(bench.tree(), before);
}

each_job!(disks_of_any_size: fill_any);
