//! Estimates the light of a photograph, given the BRDF of the ball:
//! `cargo run --example 3_light_given_a_brdf -- PHOTO BRDF OUT.exr`

use gonio::estimate::{EstimateSettings, Light};
use gonio::reflectance::BivariateTable;
use gonio::scene::{Detection, ObjectShape, ObservationSettings};
use gonio_io::picture::{ReadOptions, encode_exr, read};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut paths = std::env::args().skip(1);
    let photo = paths.next().unwrap_or_else(|| "samples/ball.exr".into());
    let decoded = read(&photo, &ReadOptions::default())?;
    let settings = ObservationSettings { clip: decoded.full_scale, ..ObservationSettings::default() };
    let ball = Detection::of(&decoded.picture, None, ObjectShape::Sphere(None), &settings)?;
    let brdf = match paths.next() {
        Some(path) => {
            let table = gonio_io::brdf::read(path)?;
            BivariateTable::luminance(&[0, 1, 2].map(|channel| table.bivariate(channel)))
        }
        None => BivariateTable::from_fn(|theta_h, _| 0.1 + 2.0 * (-(theta_h / 0.1).powi(2)).exp()),
    };
    let model = gonio_io::model::embedded()?;
    let settings = EstimateSettings { side: 16, ..EstimateSettings::default() };
    let light = Light::of(&model.light, &ball.observations, &brdf, &settings, &|_| ())?;
    println!("misfit {:.1} %, {:.0} coefficients determined", 100.0 * light.misfit, light.effective);
    if let Some(out) = paths.next() {
        gonio_io::atomic::write_file(out, &encode_exr(&light.grid.to_lat_long(64), None))?;
    }
    Ok(())
}
