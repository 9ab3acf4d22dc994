//! Renders a sphere with a BRDF: `cargo run --example 2_brdf_to_picture -- BRDF OUT.exr`

use gonio::lighting::studio_light;
use gonio::reflectance::parametric::{Ggx, Parametric};
use gonio::render::{Brdf, LightTree, SphereSettings, render_sphere};
use gonio_io::picture::encode_exr;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut paths = std::env::args().skip(1);
    let brdf: Box<dyn Brdf> = match paths.next() {
        Some(path) => Box::new(gonio_io::brdf::read(path)?),
        None => Box::new(Ggx { diffuse: 0.3, f0: 0.04, alpha: 0.1 }.to_bivariate()),
    };
    let light = LightTree::of_map(&studio_light(128));
    let settings = SphereSettings { size: 64, ..SphereSettings::default() };
    let picture = render_sphere(&*brdf, &light, &settings, &|_| ());
    println!("radiance in the middle: {:.3}", picture.rgb[(32, 32)]);
    if let Some(out) = paths.next() {
        gonio_io::atomic::write_file(out, &encode_exr(&picture.rgb, picture.alpha.as_ref()))?;
    }
    Ok(())
}
