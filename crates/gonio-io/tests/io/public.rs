//! Files like those in public bug reports, in `tests/corpus/public/`.
//!
//! Each must be read with the correct values.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec3};
use gonio::picture::Plane;
use gonio::scene::{Detection, NormalMap, ObjectShape, ObservationSettings, SceneWarning};
use gonio_io::picture::{Encoding, ExposureSettings, ReadOptions, read, read_mask};
use gonio_io::{Kind, merl, mesh, normals};

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus/public").join(name)
}

fn radiance(name: &str) -> Plane<Vec3> {
    read(file(name), &ReadOptions::default()).unwrap().picture.rgb
}

#[test]
fn reads_obj_files_with_missing_normals_and_with_comments() {
    for name in ["vn-missing.obj", "vn-zero.obj", "face-comment.obj", "fourth-number.obj"] {
        let (mesh, defects) = mesh::read_mesh(file(name)).unwrap();
        assert_eq!(defects.triangles, 12, "{name}");
        let corner = |p: &DVec3| p.abs().abs_diff_eq(DVec3::ONE, 1e-9);
        assert!(mesh.positions().iter().all(corner), "{name}: {:?}", mesh.positions());
    }
}

#[test]
fn nodes_of_scale_zero_are_hidden() {
    let (mesh, defects) = mesh::read_mesh(file("zero-scale-helper-node.glb")).unwrap();
    assert!(defects.triangles > 0 && mesh.positions().iter().any(|p| p.length() > 0.5));
}

#[test]
fn quantised_positions_are_read() {
    let (mesh, defects) = mesh::read_mesh(file("quantised.glb")).unwrap();
    assert_eq!((defects.triangles, defects.normals_computed, defects.inconsistent_normals), (320, false, 0));
    // Codes of the first two vertices; the node scales by 1.3.
    for (i, codes) in
        [DVec3::new(-11_017.0, 15_009.0, 0.0), DVec3::new(15_486.0, 15_009.0, 0.0)].into_iter().enumerate()
    {
        assert!((mesh.positions()[i] - 1.3 * codes / 32_767.0).length() < 1e-6, "{}", mesh.positions()[i]);
    }
    let largest = mesh.positions().iter().fold(DVec3::ZERO, |largest, p| largest.max(p.abs()));
    assert!((largest - DVec3::new(1.0, 0.7, 0.5)).length() < 1e-4, "{largest}");
}

#[test]
fn morph_targets_with_weights_displace_the_vertices() {
    let (mesh, defects) = mesh::read_mesh(file("morph-weight1.glb")).unwrap();
    assert_eq!(defects.triangles, 320);
    // The target adds 0.8 x to y.
    for (i, (x, y)) in [(-0.437_089_3, 0.595_455_6), (0.614_372_97, 0.595_455_6)].into_iter().enumerate() {
        let want = DVec3::new(x, y + 0.8 * x, 0.0);
        assert!((mesh.positions()[i] - want).length() < 1e-6, "{}", mesh.positions()[i]);
    }
}

#[test]
fn tiff_files_of_wide_integers_and_half_floats_are_read() {
    let linear = ReadOptions { linear: true, ..ReadOptions::default() };
    let got = read(file("uint32-rgb.tif"), &linear).unwrap();
    assert_eq!((got.encoding, got.picture.rgb.size()), (Encoding::Linear { bits: 32 }, (64, 64)));
    for ((x, y), codes) in [
        ((32, 32), [2_780_783_616_u32, 2_214_507_264, 1_872_344_704]),
        ((0, 0), [1_925_219_584, 1_549_935_104, 1_303_027_712]),
        ((40, 20), [3_928_841_728, 3_419_466_496, 3_065_322_496]),
    ] {
        let want = codes.map(|code| (f64::from(code) / 4_294_967_295.0) as f32);
        assert_eq!(got.picture.rgb[(x, y)].to_array(), want, "{x},{y}");
    }
    let got = read(file("half-rgb.tif"), &ReadOptions::default()).unwrap();
    assert_eq!((got.encoding, got.full_scale), (Encoding::LinearFloat, None));
    let want = Vec3::new(0.376_708_98, 0.228_759_77, 0.159_423_83);
    assert_eq!((got.picture.rgb.size(), got.picture.rgb[(64, 64)]), ((128, 128), want));
}

#[test]
fn variants_of_a_photograph_have_its_radiance() {
    let want = radiance("ball.exr");
    let brightest = want.as_slice().iter().fold(0.0_f32, |most, rgb| most.max(rgb.max_element()));
    // The variants have their own units. Those of 16 bits clip the highlight.
    for name in ["alpha-opaque.exr", "linear-gama-1.png", "linear-icc.png", "photoshop.pfm"] {
        let got = radiance(name);
        assert_eq!(got.size(), want.size(), "{name}");
        let pairs = || got.as_slice().iter().zip(want.as_slice()).filter(|(_, want)| want.y > 0.05 * brightest);
        let mut ratios: Vec<f32> = pairs().map(|(got, want)| got.y / want.y).collect();
        ratios.sort_by(f32::total_cmp);
        let unit = ratios[ratios.len() / 2];
        let close = pairs().filter(|(got, want)| (**got - unit * **want).abs().max_element() < 0.01 * unit * want.y);
        assert!(100 * close.count() > 98 * ratios.len(), "{name}");
    }
}

#[test]
fn radiance_headers_may_have_cr_lf_and_exposures() {
    for name in ["crlf-header.hdr", "xyze-in-command-line.hdr"] {
        let rgb = radiance(name);
        assert!(rgb.as_slice().iter().all(|v| v.is_finite() && v.min_element() >= 0.0), "{name}");
        assert!(rgb.as_slice().iter().any(|v| v.max_element() > 0.01), "{name}");
    }
    let (plain, exposed) = (radiance("light.hdr"), radiance("light-exposure-4.hdr"));
    for (a, b) in plain.as_slice().iter().zip(exposed.as_slice()) {
        assert!((*a - *b).abs().max_element() <= 0.01 * a.max_element() + 1e-6, "{a} {b}");
    }
}

#[test]
fn masks_of_0_and_1_are_scaled() {
    assert_eq!(read_mask(file("mask-0-1.png")).unwrap(), read_mask(file("mask.png")).unwrap());
}

#[test]
fn encoded_normals_are_decoded() {
    let mask = read_mask(file("mask.png")).unwrap();
    // Mean of the pixels of the ball, which is its centre.
    let (width, height) = mask.size();
    let pixels = (0..width * height).filter(|&at| mask.as_slice()[at] > 0.9);
    let places: Vec<Vec3> = pixels.map(|at| Vec3::new((at % width) as f32, -((at / width) as f32), 0.0)).collect();
    let centre = places.iter().sum::<Vec3>() / places.len() as f32;
    for name in ["normals-0-1.exr", "normals.jpg"] {
        let normals = normals::read_normals(file(name)).unwrap();
        let inside = normals.as_slice().iter().zip(mask.as_slice()).filter(|(_, m)| **m > 0.9);
        let (sound, all) = inside.fold((0, 0), |(sound, all), (n, _)| {
            (sound + usize::from((n.length() - 1.0).abs() < 1e-3 && n.z > 0.0), all + 1)
        });
        assert!(sound > 95 * all / 100, "{name}: {sound} of {all}");
        // They point away from the centre of the ball.
        let outwards = places.iter().map(|place| {
            let normal = normals[(place.x as usize, (-place.y) as usize)];
            normal.with_z(0.0).dot((*place - centre).normalize_or_zero()) / normal.with_z(0.0).length().max(1e-6)
        });
        assert!(outwards.sum::<f32>() / places.len() as f32 > 0.98, "{name}");
    }
}

#[test]
fn a_flat_background_of_a_normal_map_is_ignored() {
    let picture = read(file("ball-clutter.exr"), &ReadOptions::default()).unwrap().picture;
    let mask = read_mask(file("mask.png")).unwrap();
    let detect = |mask: Option<Plane<f32>>| {
        let normals = normals::read_normals(file("normals-flat-background.png")).unwrap();
        let view = NormalMap { normals, camera: None, positions: None, trusted: false, error: 0.0 };
        Detection::of(&picture, mask, ObjectShape::Normals(Arc::new(view)), &ObservationSettings::default()).unwrap()
    };
    let (alone, masked) = (detect(None), detect(Some(mask.clone())));
    let outside = mask.as_slice().iter().filter(|m| **m < 0.5).count();
    assert_eq!(alone.scene_warnings[0], SceneWarning::FlatBackground { pixels: outside });
    assert!(!masked.scene_warnings.iter().any(|it| matches!(it, SceneWarning::FlatBackground { .. })));
    let pixels = |detection: &Detection| detection.observations.report.observed_pixels;
    let (alone, masked) = (pixels(&alone), pixels(&masked));
    assert!(alone <= masked && 100 * alone > 95 * masked, "{alone} of {masked}");
}

#[test]
fn exif_without_the_pointer_to_a_next_directory_is_read() {
    let bytes = std::fs::read(file("exif-no-next-pointer-1.jpg")).unwrap();
    assert!(ExposureSettings::of(&bytes).seconds.is_some());
}

#[test]
fn analytic_brdf_files_are_reported() {
    let error = merl::read(file("analytic.brdf")).unwrap_err();
    assert!(error.kind() == Kind::Unsupported && error.to_string().contains("BRDF Explorer"), "{error}");
}
