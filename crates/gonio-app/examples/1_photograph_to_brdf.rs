//! Estimates the BRDF of a ball from a photograph:
//! `cargo run --example 1_photograph_to_brdf -- PHOTO OUT.binary`

use gonio::estimate::{EstimateSettings, estimate};
use gonio::reflectance::MerlTable;
use gonio::scene::{Detection, Object, ObservationSettings};
use gonio_io::picture::{ReadOptions, read};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut paths = std::env::args().skip(1);
    let photo = paths.next().unwrap_or_else(|| "samples/ball.exr".into());
    let picture = read(&photo, &ReadOptions::default())?.picture;
    let ball = Detection::of(&picture, None, Object::Sphere(None), &ObservationSettings::default())?;
    let model = gonio_io::model::embedded()?;
    let found = estimate(&model, &ball.observations, &EstimateSettings::default(), &|_| ())?;
    for diagnostic in found.diagnostics() {
        println!("warning: {diagnostic}");
    }
    let [low, median, high] = found.material.gloss;
    println!("gloss {median:.1}, between {low:.1} and {high:.1}; misfit {:.1} %", 100.0 * found.light.misfit);
    let tables = found.colouring.field().tables(&found.material.table);
    if let Some(out) = paths.next() {
        gonio_io::merl::write(out, &MerlTable::from_bivariate(tables.each_ref()))?;
    }
    Ok(())
}
