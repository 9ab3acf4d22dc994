//! `gonio-eval quadrature`: error and cost of the adaptive quadrature, against a reference in polar
//! coordinates about the mirror direction.

use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use gonio::picture::luminance;
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio::render::{Brdf, IntegratorSettings, radiance};
use gonio::shape::SurfacePoint;
use gonio::sphere::{OctahedralMap, fibonacci_hemisphere};
use gonio::transfer::{InterleavedTables, Quadrature, QuadratureSettings, polar_reference};

use rayon::prelude::*;

use crate::data::Lights;
use crate::materials::Materials;
use crate::metrics::relight;

/// Materials: chrome, a phenolic, a metallic paint and a fabric, and the sharpest other metal.
const MATERIALS: [&str; 5] =
    ["chrome", "specular-black-phenolic", "blue-metallic-paint", "red-fabric", "tungsten-carbide"];
const GRID_SIDE: usize = 32;
const POINTS: usize = 24;

pub(crate) fn run(folder: &Path) -> Result<()> {
    let all = Materials::open(folder, None)?;
    let tables: Vec<BivariateTable> = MATERIALS
        .iter()
        .map(|name| {
            let mut table = all.green(all.index(name)?).clone();
            table.extend_from_trusted();
            Ok(table)
        })
        .collect::<Result<_>>()?;
    let points: Vec<SurfacePoint> = fibonacci_hemisphere(POINTS)
        .filter(|n| n.z > 80.0_f64.to_radians().cos())
        .map(|normal| SurfacePoint { normal, view: glam::DVec3::Z })
        .collect();
    let reference: Vec<Vec<Vec<f64>>> = points
        .iter()
        .map(|p| {
            tables.iter().map(|t| polar_reference(p, t, OctahedralMap::EqualArea, GRID_SIDE, 2500, 2000)).collect()
        })
        .collect();
    let interleaved = InterleavedTables::new(&tables);
    println!(
        "Relative error of T over the 32 x 32 texels (root mean square over {} points; worst point):\n",
        points.len()
    );
    println!("| base | ratio | core (deg) | ms a point | {} |", MATERIALS.join(" | "));
    println!("|---|---|---|---|{}", "---|".repeat(MATERIALS.len()));
    let uniform = |base| QuadratureSettings { base, ratio: f32::INFINITY, core: 1.0 };
    let default = QuadratureSettings::default();
    let scaled = |s: f32, base| QuadratureSettings { base, ratio: default.ratio * s, core: default.core * s };
    let list = [
        uniform(5),
        uniform(7),
        uniform(8),
        scaled(4.0, 5),
        scaled(2.0, 5),
        scaled(1.0, 5),
        default,
        scaled(0.5, 7),
        scaled(0.25, 8),
    ];
    for settings in list {
        let quadrature = Quadrature::new(OctahedralMap::EqualArea, GRID_SIDE, settings);
        let stride = interleaved.stride();
        let mut errors = vec![Vec::new(); tables.len()];
        let mut seconds = 0.0;
        for (point, reference) in points.iter().zip(&reference) {
            let mut out = vec![0.0; GRID_SIDE * GRID_SIDE * stride];
            let start = Instant::now();
            quadrature.integrate(point, &interleaved, &mut out);
            seconds += start.elapsed().as_secs_f64();
            for (k, reference) in reference.iter().enumerate() {
                let norm: f64 = reference.iter().map(|r| r * r).sum();
                let error: f64 =
                    reference.iter().enumerate().map(|(t, r)| (f64::from(out[t * stride + k]) - r).powi(2)).sum();
                errors[k].push(error / norm);
            }
        }
        let cells: Vec<String> = errors
            .iter()
            .map(|e| {
                let mean = (e.iter().sum::<f64>() / e.len() as f64).sqrt();
                let worst = e.iter().copied().fold(0.0, f64::max).sqrt();
                format!("{:.2} %; {:.2} %", 100.0 * mean, 100.0 * worst)
            })
            .collect();
        let (ratio, core) = if settings.ratio.is_finite() {
            (format!("{:.3}", settings.ratio), format!("{:.3}", settings.core.to_degrees()))
        } else {
            ("uniform".into(), "-".into())
        };
        let ms = 1e3 * seconds / points.len() as f64;
        println!("| {} | {ratio} | {core} | {ms:.2} | {} |", settings.base, cells.join(" | "));
    }
    renders(folder, &all)
}

/// Lights that the renderer is tested in.
const LIGHTS: [&str; 3] = ["debevec_grace", "noon_grass", "debevec_rnl"];

/// Prints the error of rendered pictures against pictures with a far finer division of the light,
/// after the best common scale.
fn renders(folder: &Path, all: &Materials) -> Result<()> {
    let lights = Lights::open(folder)?;
    let points: Vec<SurfacePoint> = fibonacci_hemisphere(200)
        .filter(|n| n.z > 80.0_f64.to_radians().cos())
        .map(|normal| SurfacePoint { normal, view: glam::DVec3::Z })
        .collect();
    println!("\nRelight error of renders (and its log version) against tolerance 0.01 over {} points:\n", points.len());
    println!("| light | tolerance | {} |", MATERIALS.join(" | "));
    println!("|---|---|{}", "---|".repeat(MATERIALS.len()));
    for light in LIGHTS {
        let tree = lights.tree(light)?;
        let tables = MATERIALS.iter().map(|name| Ok(all.rgb(all.index(name)?))).collect::<Result<Vec<_>>>()?;
        let picture = |tables: &[BivariateTable; 3], tolerance: f64| -> Vec<f64> {
            let full = MerlTable::from_bivariate(tables.each_ref());
            let (envelope, settings) = (full.envelope(), IntegratorSettings { tolerance, max_cells: 400_000 });
            let values = points.par_iter().map(|p| radiance(p, &full, &envelope, &tree, &settings));
            values.map(|rgb| f64::from(luminance(rgb.as_vec3()))).collect()
        };
        let references: Vec<Vec<f64>> = tables.iter().map(|t| picture(t, 0.01)).collect();
        for tolerance in [0.4, 0.2, 0.1, 0.05] {
            let cells: Vec<String> = tables
                .iter()
                .zip(&references)
                .map(|(t, reference)| {
                    let error = relight(&picture(t, tolerance), reference);
                    format!("{:.2} % ({:.2} %)", 100.0 * error.relative, 100.0 * error.log)
                })
                .collect();
            println!("| {light} | {tolerance} | {} |", cells.join(" | "));
        }
    }
    Ok(())
}
