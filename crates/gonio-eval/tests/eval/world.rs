//! A small synthetic world: a few lights and materials by formulas, laid out like the data folder.

use std::path::Path;

use glam::Vec3;
use gonio::picture::Plane;
use gonio::reflectance::parametric::{Ggx, Parametric};
use gonio::reflectance::{BivariateTable, CELLS, MerlTable, THETA_D, THETA_H};
use gonio::sphere::direction_of_lat_long;
use gonio_io::picture::encode_hdr;

/// Name of the material that also has a full table.
pub(crate) const FULL: &str = "m4";

/// Ten materials `m0` to `m9`, from matte to sharp, dark to bright.
fn material(i: usize) -> BivariateTable {
    let diffuse = [0.6, 0.1, 0.3, 0.05, 0.4, 0.02, 0.2, 0.5, 0.01, 0.15][i];
    let alpha = [0.7, 0.5, 0.35, 0.3, 0.25, 0.2, 0.4, 0.15, 0.3, 0.6][i];
    let f0 = [0.04, 0.04, 0.04, 0.5, 0.04, 0.8, 0.04, 0.06, 0.6, 0.04][i];
    Ggx { diffuse, f0, alpha }.to_bivariate()
}

/// A sky with one or more lamps.
fn light(lamps: &[Vec3], phase: f64) -> Plane<Vec3> {
    let lamps: Vec<_> = lamps.iter().map(|lamp| lamp.normalize().as_dvec3()).collect();
    Plane::from_fn(128, 64, |x, y| {
        let d = direction_of_lat_long((x as f64 + 0.5) / 128.0, (y as f64 + 0.5) / 64.0);
        let bright = if lamps.iter().any(|lamp| d.angle_between(*lamp) < 0.15) { 60.0 } else { 0.0 };
        let sky = 0.6 + 0.4 * d.y + 0.3 * (3.0 * d.x + phase).sin() * d.z;
        Vec3::splat((sky.max(0.05) + bright) as f32)
    })
}

/// Writes the tables of materials, each in one colour.
fn write_tables(merl: &Path, tables: &[BivariateTable], colour: &dyn Fn(usize) -> [f32; 3]) {
    let cell = |i: usize, c: usize| colour(i).map(|x| x * tables[i].as_slice()[c]);
    let values = (0..tables.len()).flat_map(|i| (0..CELLS).flat_map(move |c| cell(i, c))).collect();
    let array = gonio_io::npy::Array { shape: vec![tables.len(), THETA_H, THETA_D, 3], values };
    std::fs::write(merl.join("bivariate_rgb_f32.npy"), gonio_io::npy::encode(&array)).unwrap();
}

/// Gives the materials colours from red to blue, without full tables.
pub(crate) fn colour(dir: &Path) {
    let merl = dir.join("merl");
    let tables: Vec<BivariateTable> = (0..10).map(material).collect();
    write_tables(&merl, &tables, &|i| [[1.0, 0.4, 0.2], [0.3, 0.8, 0.4], [0.2, 0.4, 1.0], [0.9, 0.8, 0.3]][i % 4]);
    std::fs::remove_file(merl.join(format!("{FULL}.binary"))).unwrap();
}

/// Writes `lighting/test` with four lights `l0` to `l3`, `lighting/train` with three others, and
/// `merl` with ten materials, one of them also as a full table.
pub(crate) fn write(dir: &Path) {
    let (lights, training, merl) = (dir.join("lighting/test"), dir.join("lighting/train"), dir.join("merl"));
    std::fs::create_dir_all(&lights).unwrap();
    std::fs::create_dir_all(&training).unwrap();
    std::fs::create_dir_all(&merl).unwrap();
    let lamps =
        [Vec3::new(0.5, 0.6, 0.6), Vec3::new(-0.7, 0.4, 0.6), Vec3::new(0.1, 0.9, -0.3), Vec3::new(-0.5, -0.1, 0.8)];
    for (i, lamp) in lamps.into_iter().enumerate() {
        std::fs::write(lights.join(format!("l{i}.hdr")), encode_hdr(&light(&[lamp], i as f64))).unwrap();
    }
    let lamps = [Vec3::new(0.8, 0.3, 0.5), Vec3::new(-0.2, 0.7, 0.7), Vec3::new(0.0, 0.2, 1.0)];
    for i in 0..3 {
        std::fs::write(training.join(format!("t{i}.hdr")), encode_hdr(&light(&lamps[..=i], 0.5 * i as f64))).unwrap();
    }
    let tables: Vec<BivariateTable> = (0..10).map(material).collect();
    write_tables(&merl, &tables, &|_| [1.0; 3]);
    let names: Vec<String> = (0..10).map(|i| format!("m{i}")).collect();
    std::fs::write(merl.join("materials.txt"), names.join("\n")).unwrap();
    let full = MerlTable::from_bivariate([&tables[4]; 3]);
    gonio_io::merl::write(merl.join(format!("{FULL}.binary")), &full).unwrap();
}
