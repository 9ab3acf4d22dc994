//! Tests that one wrong pixel in the sample photograph changes no interval.

use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use gonio::estimate::{Alignment, ColouringRule, MaterialEstimate, estimate_known_light};
use gonio::lighting::EnvironmentMap;
use gonio::model::Model;
use gonio::picture::{Picture, Plane};
use gonio::scene::{Detection, NormalMap, ObjectShape, ObservationSettings, PixelStatus, SceneWarning};
use gonio_io::picture::{ReadOptions, read};

/// Largest relative change of the end of an interval.
const TOLERANCE: f64 = 0.05;
/// Tested pixels: centre of the ball, middle of its highlight, dark flank, near the rim, and at 79
/// degrees.
const PLACES: [(usize, usize); 5] = [(128, 128), (78, 51), (60, 180), (240, 120), (4, 128)];

fn sample() -> Picture {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../samples/ball.exr");
    read(path, &ReadOptions::default()).unwrap().picture
}

/// Returns a normal map of the ball.
fn normals(picture: &Picture) -> Plane<Vec3> {
    let detection = Detection::of(picture, None, ObjectShape::Sphere(None), &ObservationSettings::default()).unwrap();
    let circle = detection.circle().unwrap();
    Plane::from_fn(picture.rgb.width(), picture.rgb.height(), |x, y| {
        let (nx, ny) = ((x as f64 + 0.5 - circle.x) / circle.radius, (circle.y - y as f64 - 0.5) / circle.radius);
        let square = 1.0 - nx * nx - ny * ny;
        if square > 0.0 { DVec3::new(nx, ny, square.sqrt()).as_vec3() } else { Vec3::ZERO }
    })
}

/// Returns the ends of the intervals of gloss, GGX width and some cells of the BRDF.
fn ends(model: &Model, detection: &Detection) -> Vec<f64> {
    let material = MaterialEstimate::of(model, &detection.observations, 8).unwrap();
    let cells = [(0, 0), (0, 60), (5, 10), (12, 30), (30, 0), (45, 45), (70, 20)].map(|(h, d)| 90 * h + d);
    let quantiles = cells.iter().flat_map(|cell| [0, 3].map(|q| f64::from(material.quantiles[q][*cell])));
    let ([low, _, high], [sharp, _, dull]) = (material.peak_height, material.highlight.alpha);
    [low, high, sharp, dull].into_iter().chain(quantiles).collect()
}

fn sphere(picture: &Picture) -> Detection {
    Detection::of(picture, None, ObjectShape::Sphere(None), &ObservationSettings::default()).unwrap()
}

/// Asserts that no end differs from that in `clean` by more than [`TOLERANCE`].
fn assert_same(clean: &[f64], ends: &[f64], what: &str) {
    for (i, (was, is)) in clean.iter().zip(ends).enumerate() {
        assert!((is / was - 1.0).abs() <= TOLERANCE, "{what}: end {i} was {was}, is {is}");
    }
}

#[test]
fn detects_hot_and_dead_pixels() {
    let picture = sample();
    assert_eq!(sphere(&picture).observations.report.outliers, 0);
    for (at, value) in PLACES.into_iter().zip([0.0, 5.0, 20.0, 1e4, 1e9]) {
        let mut bad = picture.clone();
        bad.rgb[at] = Vec3::splat(value);
        let observations = sphere(&bad).observations;
        assert_eq!(observations.report.outliers, 1, "{at:?} {value}");
        assert_eq!(observations.statuses.unwrap()[at], PixelStatus::Outlier);
    }
}

#[test]
fn warns_about_many_outliers() {
    let mut picture = sample();
    for i in 0..100 {
        picture.rgb[(60 + 13 * (i % 10), 60 + 13 * (i / 10))] = Vec3::splat(3.0 + i as f32);
    }
    let detection = sphere(&picture);
    let found = detection.observations.report.outliers;
    assert!((95..=100).contains(&found), "{found}");
    let warned =
        |warning: &SceneWarning| matches!(warning, SceneWarning::Outliers { outliers, .. } if *outliers == found);
    assert!(detection.scene_warnings.iter().any(warned), "{:?}", detection.scene_warnings);
}

#[test]
fn one_wrong_pixel_changes_no_interval() {
    let (picture, model) = (sample(), gonio_io::model::embedded().unwrap());
    let clean = ends(&model, &sphere(&picture));
    let white = [0.0, 20.0, 1e9].map(Vec3::splat);
    let red = [Vec3::new(5.0, 0.035, 0.035), Vec3::new(0.035, 0.024, 0.0)];
    for (at, value) in PLACES.into_iter().zip(white.into_iter().chain(red)) {
        let mut bad = picture.clone();
        bad.rgb[at] = value;
        assert_same(&clean, &ends(&model, &sphere(&bad)), &format!("{value} at {at:?}"));
    }
}

#[test]
fn one_wrong_pixel_changes_no_interval_of_an_object_with_normals() {
    let (picture, model) = (sample(), gonio_io::model::embedded().unwrap());
    let normals = normals(&picture);
    let seen = |picture: &Picture| {
        let view = NormalMap { normals: normals.clone(), camera: None, positions: None, trusted: true, error: 0.0 };
        Detection::of(picture, None, ObjectShape::Normals(Arc::new(view)), &ObservationSettings::default()).unwrap()
    };
    let clean_weights = seen(&picture).observations.weights;
    let clean = ends(&model, &seen(&picture));
    for (at, value) in [((128, 128), 5.0), ((78, 51), 0.0)] {
        let mut bad = picture.clone();
        bad.rgb[at] = Vec3::splat(value);
        let detection = seen(&bad);
        assert_eq!(detection.observations.report.outliers, 1);
        // The outlier does not change the estimated noise, and therefore not the other weights.
        let weights = detection.observations.weights.iter().zip(&clean_weights);
        assert!(weights.clone().all(|(is, was)| (is - was).abs() < 0.01));
        assert_same(&clean, &ends(&model, &detection), &format!("{value} at {at:?}"));
    }
}

#[test]
fn one_wrong_pixel_changes_no_interval_under_a_known_light() {
    let (picture, model) = (sample(), gonio_io::model::embedded().unwrap());
    // The light grows brighter towards the top and has a lamp at the highlight of the sample.
    let map = Plane::from_fn(64, 32, |x, y| {
        let lamp = (10..14).contains(&x) && (8..11).contains(&y);
        Vec3::splat(if lamp { 30.0 } else { 1.5 - y as f32 / 32.0 })
    });
    let map = EnvironmentMap::new(map).unwrap();
    let gloss = |picture: &Picture| {
        let observations = sphere(picture).observations;
        let light = (&map, Alignment::Fixed);
        let found = estimate_known_light(&model, &observations, light, &ColouringRule::Grey, &|_| ()).unwrap();
        found.material.peak_height.to_vec()
    };
    let clean = gloss(&picture);
    let red = Vec3::new(5.0, 0.035, 0.035);
    for (at, value) in [((128, 128), Vec3::splat(20.0)), ((78, 51), Vec3::splat(20.0)), ((60, 180), red)] {
        let mut bad = picture.clone();
        bad.rgb[at] = value;
        assert_same(&clean, &gloss(&bad), &format!("{value} at {at:?}"));
    }
}
