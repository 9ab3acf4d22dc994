//! Tests on the measured data. Without the data (`GONIO_DATA`) every test prints a message and
//! passes.

use std::path::PathBuf;

use glam::DVec3;
use gonio::reflectance::BivariateTable;
use gonio::shape::SurfacePoint;
use gonio::sphere::{OctahedralMap, fibonacci_hemisphere};
use gonio::transfer::{InterleavedTables, Quadrature, QuadratureSettings, polar_reference};

fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("GONIO_DATA").map(PathBuf::from).filter(|p| p.is_dir());
    if folder.is_none() {
        eprintln!("skipped: GONIO_DATA is not a folder");
    }
    folder
}

/// Green channel of all materials.
fn green(data: &std::path::Path) -> Vec<(String, BivariateTable)> {
    let set = gonio_io::bivariate::read_bivariate_set(data.join("merl")).unwrap();
    set.into_iter().map(|(name, rgb)| (name, rgb[1].clone())).collect()
}

#[test]
fn the_quadrature_resolves_measured_lobes() {
    let Some(data) = data() else { return };
    let names = ["chrome", "specular-black-phenolic", "blue-metallic-paint", "red-fabric"];
    let materials = green(&data);
    let tables: Vec<BivariateTable> = names
        .iter()
        .map(|name| {
            let mut table = materials.iter().find(|(n, _)| n == name).unwrap().1.clone();
            table.extend_from_trusted();
            table
        })
        .collect();
    let interleaved = InterleavedTables::new(&tables);
    let quadrature = Quadrature::new(OctahedralMap::EqualArea, 32, QuadratureSettings::default());
    let stride = interleaved.stride();
    for normal in fibonacci_hemisphere(6).filter(|n| n.z > 0.2) {
        let point = SurfacePoint { normal, view: DVec3::Z };
        let mut out = vec![0.0; 1024 * stride];
        quadrature.integrate(&point, &interleaved, &mut out);
        for (k, table) in tables.iter().enumerate() {
            let reference = polar_reference(&point, table, OctahedralMap::EqualArea, 32, 2000, 1500);
            let error: f64 =
                reference.iter().enumerate().map(|(t, r)| (f64::from(out[t * stride + k]) - r).powi(2)).sum();
            let relative = (error / reference.iter().map(|r| r * r).sum::<f64>()).sqrt();
            assert!(relative < 0.015, "{} at {normal}: {relative}", names[k]);
        }
    }
}

#[test]
fn the_embedded_model_matches_the_data() {
    let Some(data) = data() else { return };
    let model = gonio_io::model::embedded().unwrap();
    let names: Vec<String> = green(&data).into_iter().map(|(name, _)| name).collect();
    let embedded: Vec<String> = model.reflectance.materials.iter().map(|m| m.name.clone()).collect();
    assert_eq!(names, embedded);
    assert_eq!((model.light.lights, model.light.scales, model.reflectance.len()), (72, 7, 10));
}
