//! `gonio-eval captured` on a synthetic ball: read from its files, estimated and judged.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use glam::Vec3;
use gonio::picture::Plane;
use gonio_io::npy::{Array, encode};
use gonio_io::picture::{encode_exr, encode_png};

use super::bench::run;

const SIDE: usize = 64;

/// Writes photographs of a matte ball under a lamp beside the camera and under a lamp above it. The
/// brightness is the cosine, and the measured slice is constant.
fn write(folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    let normal = |x: usize, y: usize| {
        let at = |i: usize| (i as f32 + 0.5 - 0.5 * SIDE as f32) / (0.5 * SIDE as f32 - 3.0);
        let (x, y) = (at(x), -at(y));
        let z = 1.0 - x * x - y * y;
        if z > 0.0 { Vec3::new(x, y, z.sqrt()) } else { Vec3::ZERO }
    };
    let normals = Plane::from_fn(SIDE, SIDE, normal);
    std::fs::write(folder.join("normal.exr"), encode_exr(&normals, None)).unwrap();
    let mask = normals.map(|n| if n.z > 0.0 { Vec3::ONE } else { Vec3::ZERO });
    std::fs::write(folder.join("mask.png"), encode_png(&mask)).unwrap();
    let lamps = [("side", Vec3::new(0.4, 0.1, 0.9)), ("top", Vec3::new(0.0, 0.6, 0.8))];
    for (name, lamp) in lamps {
        let lamp = lamp.normalize();
        let rgb = normals.map(|n| Vec3::splat(n.dot(lamp).max(0.0)));
        std::fs::write(folder.join(format!("{name}.exr")), encode_exr(&rgb, None)).unwrap();
        let mut lights = String::from("# direction, weight\n");
        writeln!(lights, "{} {} {} 1 1 1", lamp.x, lamp.y, lamp.z).unwrap();
        std::fs::write(folder.join(format!("{name}_lights.txt")), lights).unwrap();
    }
    let mut zip = zip::ZipWriter::new(std::fs::File::create(folder.join("measured_bivariate.npz")).unwrap());
    for (name, value) in [("mean", 0.3), ("count", 100.0)] {
        let values = (0..90 * 90).map(|c| if c % 90 < 22 { value } else { 0.0 }).collect();
        zip.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
        std::io::Write::write_all(&mut zip, &encode(&Array { shape: vec![90, 90], values })).unwrap();
    }
    zip.finish().unwrap();
}

#[test]
fn a_matte_ball_is_judged_by_slice_and_photographs() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("captured/chalk");
    write(&folder);
    let command = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gonio-eval"));
        command.arg("--data").arg(dir.path()).arg("captured").args(more);
        command
    };
    let out = dir.path().join("out");
    let output = run(command(&["--objects", "chalk", "-o"]).arg(&out));
    let table = String::from_utf8(output.stdout).unwrap();
    for row in ["| chalk | 2 |", "| chalk, side |", "| chalk, top |"] {
        assert!(table.contains(row), "{table}");
    }
    let records: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("captured.json")).unwrap()).unwrap();
    for record in records.as_array().unwrap() {
        // Chalk is Lambertian, also in the measurement.
        for reference in ["lambert", "measured", "profile"] {
            for error in ["slice", "relight", "relight_log"] {
                assert!(record[reference][error].as_f64().unwrap() < 1e-3, "{record}");
            }
        }
        assert!((record["gloss_measured"].as_f64().unwrap() - 1.0).abs() < 1e-6, "{record}");
        let error = record["estimate"]["slice"].as_f64().unwrap();
        assert!(error > 0.0 && error < 2.0, "{record}");
    }
    let csv = std::fs::read_to_string(out.join("captured.csv")).unwrap();
    assert_eq!(csv.lines().count(), 3);
    assert!(std::fs::read_to_string(out.join("captured.html")).unwrap().contains("chalk under top"));

    let refused = command(&["--objects", "vase"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("vase: there is no such object"));
    std::fs::write(folder.join("top_lights.txt"), "0 0 1 1 1\n").unwrap();
    let refused = command(&[]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("top_lights.txt: line 1"));
}
