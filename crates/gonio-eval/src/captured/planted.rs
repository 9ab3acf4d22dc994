//! A ball whose BRDF is known, for tests.

use glam::{DVec3, Vec3};
use gonio::picture::{Picture, Plane};
use gonio::reflectance::BivariateTable;

use super::object::{Captured, Directional, Photograph};
use super::slice::Slice;

/// Pixels along a side.
const PICTURE_SIDE: usize = 48;

/// Builds a ball of the given BRDF with two photographs, measured below 30 degrees of `theta_d`.
pub(super) fn ball(table: &BivariateTable) -> Captured {
    let radius = 0.5 * PICTURE_SIDE as f32 - 2.0;
    let normal = |x: usize, y: usize| {
        let at = |i: usize| (i as f32 + 0.5 - 0.5 * PICTURE_SIDE as f32) / radius;
        let (x, y) = (at(x), -at(y));
        let z = 1.0 - x * x - y * y;
        if z > 0.0 { Vec3::new(x, y, z.sqrt()) } else { Vec3::ZERO }
    };
    let normals = Plane::from_fn(PICTURE_SIDE, PICTURE_SIDE, normal);
    let mask = normals.map(|n| f32::from(n.z > 0.0));
    let light = |x: f64, y: f64, weight: f64| Directional {
        direction: DVec3::new(x, y, 1.0).normalize(),
        weight: DVec3::splat(weight),
    };
    let photograph = |name: &str, lights: Vec<Directional>| {
        let rgb = Plane::from_fn(PICTURE_SIDE, PICTURE_SIDE, |_, _| Vec3::ZERO);
        Photograph { name: name.to_owned(), picture: Picture { rgb, alpha: None }, lights }
    };
    let mut object = Captured {
        name: "planted".to_owned(),
        normals,
        mask,
        photographs: vec![
            photograph("left", vec![light(-0.6, 0.2, 1.0), light(-0.3, -0.4, 0.5)]),
            photograph("top", vec![light(0.1, 0.7, 2.0)]),
        ],
        slice: measured(|h, d| table.eval(h, d)),
    };
    for i in 0..object.photographs.len() {
        let sent = object.render(i, |h, d| table.eval(h, d));
        object.photographs[i].picture.rgb = sent.map(|p| p.as_vec3());
    }
    object
}

/// A measurement of a BRDF below 30 degrees of `theta_d`, with a hundred observations in each cell.
pub(super) fn measured(f: impl Fn(f64, f64) -> f64) -> Slice {
    let centre = |i: usize| (i as f64 + 0.5).to_radians();
    let cells: Vec<(usize, usize)> = (0..90 * 90).map(|c| (c / 90, c % 90)).collect();
    Slice::new(
        cells.iter().map(|&(h, d)| f(centre(h), centre(d)) as f32).collect(),
        cells.iter().map(|&(_, d)| if d < 30 { 100.0 } else { 0.0 }).collect(),
    )
}
