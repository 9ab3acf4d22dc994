//! Trains a light prior and a reflectance basis on lights and materials in memory:
//! `cargo run --example 4_train -- OUT.model`

use gonio::lighting::{lamp_light, sky_light, studio_light};
use gonio::reflectance::parametric::{Ggx, Parametric};
use gonio_app::training::{self, LightingSettings, Lights, Materials, ReflectanceSettings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let maps = vec![studio_light(64), sky_light(64), lamp_light(64)];
    let settings = LightingSettings { grid: 16, ..LightingSettings::default() };
    let (prior, from) = training::lighting(&Lights::Maps(maps), &settings, &|_, _| ())?;
    println!("{from}");
    let material = |i: i32| {
        let table = Ggx { diffuse: 0.3, f0: 0.05, alpha: 0.05 * f64::from(i + 1) }.to_bivariate();
        (format!("gloss {i}"), [table.clone(), table.clone(), table])
    };
    let materials = Materials::Tables((0..6).map(material).collect());
    let settings = ReflectanceSettings { rank: 3, ..ReflectanceSettings::default() };
    let (basis, report, origin) = training::reflectance(&materials, &settings, &|_, _| ())?;
    println!("{origin}; {} starts tried", report.candidates.len());
    let model = training::join(Some((prior, from)), Some((basis, origin)), None)?;
    if let Some(out) = std::env::args().nth(1) {
        gonio_io::atomic::write_file(out, &gonio_io::model::encode_model(&model))?;
    }
    Ok(())
}
