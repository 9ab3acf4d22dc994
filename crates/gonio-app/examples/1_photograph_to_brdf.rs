//! Estimates the BRDF of a ball from a photograph:
//! `cargo run --example 1_photograph_to_brdf -- PHOTO OUT.binary`

use gonio::estimate::{EstimateSettings, estimate};
use gonio::reflectance::MerlTable;
use gonio::scene::{Detection, ObjectShape, ObservationSettings};
use gonio_io::picture::{ReadOptions, read};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut paths = std::env::args().skip(1);
    let photo = paths.next().unwrap_or_else(|| "samples/ball.exr".into());
    let decoded = read(&photo, &ReadOptions::default())?;
    let settings = ObservationSettings { clip: decoded.full_scale, ..ObservationSettings::default() };
    let ball = Detection::of(&decoded.picture, None, ObjectShape::Sphere(None), &settings)?;
    let model = gonio_io::model::embedded()?;
    let found = estimate(&model, &ball.observations, &EstimateSettings::default(), &|_| ())?;
    for diagnostic in found.diagnostics() {
        println!("warning: {diagnostic}");
    }
    println!("{}; misfit {:.1} %", found.material.verdict(), 100.0 * found.light.misfit);
    if let Some(out) = paths.next() {
        gonio_io::merl::write(out, &MerlTable::from_bivariate(found.brdf().each_ref()))?;
    }
    Ok(())
}
