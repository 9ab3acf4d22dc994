//! Seeds for fuzzing, in `fuzz/seeds/`: small valid files of each format for each of its readers.
//!
//! This module generates them from the valid files of the other tests. The meshes, the camera and
//! the pose exist only in that folder; `mutation` reads them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use gonio::bracket::Response;
use gonio::colour::{Chroma, ChromaField, SavedChroma};
use gonio::inference::{Embedding, Likelihood};
use gonio_io::picture::{self, ReadOptions};
use gonio_io::posterior::SavedPosterior;
use gonio_io::{brdf_csv, camera, lights, mbsdf, mesh, model, normals, npy, rgl, table};

use crate::{colour, damage, mutation};

const LIGHTS: &str = "# lights\n0 3 4  1 0.5 0.25\n-1 0 0 0 0 1\n";

const BRDF_TABLE: &str = "theta_h,theta_d,red,green,blue\n0,0,3,2,1\n0,45,3,2,1\n20,0,1,1,1\n20,45,1,1,1\n";
const TABLE: &str =
    "name,image,mask,grid,no-shadows\none,ball.exr,,8,yes\n# a remark\n\"a, \"\"b\"\"\",a.png;b.png,m.png,,no\n";

/// Files of a folder of results: `result.json`, `export/export.json` and `posterior.json`.
const RESULTS: [&str; 2] = [
    r#"{"format":"gonio-result","version":1,"colour":{"light":{"rgb":[1.0,0.9,0.8]}},"posterior":{"gloss":{"5":1.5,"50":3,"95":9},"materials":[{"name":"blue paint","weight":0.4}]}}
---
{"format":"gonio-export","exports":{"ward":{"files":["ward.json","light.exr"]}}}
---
"#,
    r#"{"format":"gonio-regions","regions":[{"folder":"1"},{"folder":"../keep"},{"folder":"export"}]}
---
{"format":"gonio-export","exports":{"ward":{"files":["../../keep","/dev/shm/keep"]}}}"#,
];

/// A TIFF file with camera settings: exposure time, f-number and sensitivity.
pub(crate) fn exif(big: bool) -> Vec<u8> {
    let [two, four]: [fn(u32) -> Vec<u8>; 2] = if big {
        [|v| (v as u16).to_be_bytes().to_vec(), |v| v.to_be_bytes().to_vec()]
    } else {
        [|v| (v as u16).to_le_bytes().to_vec(), |v| v.to_le_bytes().to_vec()]
    };
    let mut bytes = if big { b"MM".to_vec() } else { b"II".to_vec() };
    let entry = |tag: u32, kind: u32, value: Vec<u8>| [two(tag), two(kind), four(1), value].concat();
    bytes.extend([two(42), four(8), two(1), entry(0x8769, 4, four(26)), four(0)].concat());
    bytes.extend([two(4), entry(0x829a, 5, four(80)), entry(0x829d, 5, four(88))].concat());
    bytes.extend([entry(0x8827, 3, [two(200), two(0)].concat()), entry(0x9201, 10, four(96)), four(0)].concat());
    for value in [1, 30, 28, 10, 49, 10] {
        bytes.extend(four(value));
    }
    bytes
}

/// Returns the target, name and content of each seed.
fn seeds() -> Vec<(&'static str, String, Vec<u8>)> {
    let mut seeds = Vec::new();
    for (name, bytes) in
        mutation::good().into_iter().chain(damage::pictures().into_iter().chain(colour::tagged()).map(|p| (p.0, p.1)))
    {
        let targets: &[&str] = match name.split_once('.').map_or(name, |(_, extension)| extension) {
            "exr" | "pfm" | "png" => &["picture", "normals"],
            "hdr" | "jpg" | "tif" => &["picture"],
            "npy" => &["npy", "normals"],
            "obj" => &["mesh_obj"],
            "ply" => &["mesh_ply"],
            "glb" | "gltf" => &["mesh_gltf"],
            _ if name == "pose.json" => &["pose"],
            _ => &["camera"],
        };
        seeds.extend(targets.iter().map(|target| (*target, name.to_owned(), bytes.clone())));
    }
    let chroma = SavedChroma::of(&ChromaField::uniform(Chroma([0.1, -0.2])), [0.3, 0.1]);
    let likelihood = Likelihood::Embedding(Embedding::of(vec![1.0, -0.1, 1e-7]));
    let posterior = SavedPosterior::new("abc".into(), vec!["ball.exr".into()], likelihood, Some(chroma)).encode();
    let response = Response::from_curves([const { [-4.0, -2.0, -1.0, 0.5] }; 3].map(Vec::from)).unwrap();
    let mut merl = [90_i32, 90, 180].iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    merl.extend([0; 64]);
    let mut results = RESULTS.map(|text| text.as_bytes().to_vec());
    results[0].extend(&posterior);
    seeds.extend([
        ("rgl", "a.bsdf".to_owned(), crate::rgl::small()),
        ("mbsdf", "a.mbsdf".to_owned(), small_mbsdf()),
        ("brdf_csv", "a.csv".to_owned(), BRDF_TABLE.into()),
        ("model", "light.prior".to_owned(), include_bytes!("../../model/paper.prior").to_vec()),
        ("lights", "a.txt".to_owned(), LIGHTS.into()),
        ("manifest", "a.csv".to_owned(), TABLE.into()),
        ("response", "a.csv".to_owned(), picture::encode_response(&response)),
        ("merl", "a.binary".to_owned(), merl),
        ("exif", "little.tif".to_owned(), exif(false)),
        ("exif", "big.tif".to_owned(), exif(true)),
        ("posterior", "a.json".to_owned(), posterior),
    ]);
    seeds.extend(results.into_iter().enumerate().map(|(i, bytes)| ("results", format!("{i}.txt"), bytes)));
    seeds
}

/// Encodes a grey BSDF of one polar angle and two azimuths.
fn small_mbsdf() -> Vec<u8> {
    let mut bytes = b"NVIDIA ARC MBSDF V1\ncreator=\"a\"\nMBSDF_DATA=\n".to_vec();
    bytes.extend([0_u32, 1, 2].iter().flat_map(|n| n.to_le_bytes()));
    bytes.extend([0.3_f32, 0.2].iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds")
}

/// A seed that its reader rejects is useless.
#[test]
fn every_seed_is_read() {
    let read = ReadOptions { max_pixels: 1 << 14, linear: true, layer: None, colour_space: None };
    for (target, name, bytes) in seeds() {
        let path = Path::new(&name);
        let error = match target {
            "picture" => picture::decode(path, &bytes, &read).err(),
            "npy" => npy::decode(path, &bytes).err(),
            "normals" => normals::decode(path, &bytes, &read).err(),
            "mesh_obj" | "mesh_ply" | "mesh_gltf" => mesh::decode(path, &bytes).err(),
            "camera" => camera::decode_camera(path, &bytes, (640, 480)).err(),
            "pose" => camera::decode_pose(path, &bytes).err(),
            "rgl" => rgl::decode(path, &bytes).err(),
            "mbsdf" => mbsdf::decode(path, &bytes).err(),
            "brdf_csv" => brdf_csv::decode(path, &bytes).err(),
            "model" => model::decode_lighting(path, &bytes).err(),
            "lights" => lights::decode_lights(path, &bytes).err(),
            "manifest" => table::Table::decode(path, &bytes).err(),
            "response" => picture::decode_response(path, &bytes).err(),
            "posterior" => SavedPosterior::decode(path, &bytes).err(),
            "exif" => {
                let shot = picture::ExposureSettings::of(&bytes);
                assert_eq!((shot.seconds, shot.f_number, shot.iso), (Some(1.0 / 30.0), Some(2.8), Some(200.0)));
                None
            }
            // A MERL table is too large for a seed, so the file is truncated.
            "merl" | "results" => None,
            other => panic!("{other}: no such target"),
        };
        assert!(error.is_none(), "{target}: {}", error.unwrap());
    }
}

/// Writes the seeds: `cargo test -p gonio-io --test io seeds -- --ignored`.
#[test]
#[ignore = "writes into the repository"]
fn write() {
    for (target, name, bytes) in seeds() {
        let folder = folder().join(target);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(name), bytes).unwrap();
    }
}

/// Checks that the repository contains these seeds.
#[test]
fn the_seeds_are_in_the_repository() {
    let names: BTreeSet<(&str, String)> = seeds().into_iter().map(|(target, name, _)| (target, name)).collect();
    assert_eq!(names.len(), seeds().len(), "two seeds have the same name");
    for (target, name, bytes) in seeds() {
        let file = folder().join(target).join(&name);
        let there = std::fs::read(&file).unwrap_or_default();
        assert!(
            there == bytes,
            "{}: write it with `cargo test -p gonio-io --test io seeds -- --ignored`",
            file.display()
        );
    }
}
