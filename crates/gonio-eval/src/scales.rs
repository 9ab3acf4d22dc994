//! `gonio-eval scales`: measures the error of the absolute albedo from a neutral reference.
//!
//! The reference is exact, so the error is that of the irradiance of the estimated light. Materials
//! are those outside of the MERL database (`DATA/rgl` and formulas), lights are the test lights.

use std::f64::consts::PI;
use std::path::Path;

use anyhow::Result;
use glam::DVec3;
use gonio::estimate::{ColouringRule, EstimateSettings, estimate, irradiance};
use gonio::reference::ReferenceLight;
use gonio::reflectance::BivariateTable;
use gonio::sphere::OctahedralMap;

use crate::data::{Lights, ModelOption};
use crate::metrics::{mean, median};
use crate::multi_view::photograph;

/// Rows to which an environment map is reduced, and texels along a side of the grid of its
/// irradiance.
const GRID: (usize, usize) = (512, 128);

/// Options of `gonio-eval scales`.
#[derive(clap::Args)]
pub(crate) struct ScalesOptions {
    #[command(flatten)]
    model: ModelOption,
    /// Test lights of the photographs; each material is photographed in all of them
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "debevec_stpeters,debevec_grace,debevec_rnl,noon_grass,photo_studio_01,urban_street_01"
    )]
    lights: Vec<String>,
}

pub(crate) fn run(data: &Path, options: &ScalesOptions) -> Result<()> {
    let model = options.model.read()?;
    let lights = Lights::open(data)?;
    let settings = EstimateSettings { colouring: ColouringRule::Grey, ..EstimateSettings::default() };
    let mut errors = Vec::new();
    for (name, truth) in materials(data)? {
        for light in &options.lights {
            let map = lights.map(light)?;
            let true_light = irradiance(&map.reduced(GRID.0).to_grid(OctahedralMap::EqualArea, GRID.1));
            let found = estimate(&model, &photograph(&truth, &map)?, &settings, &|_| ())?;
            let reference = ReferenceLight { white: DVec3::splat(true_light / PI), ball: None, log_sd: 0.0 };
            let Some(scale) = reference.scale(&found.light.grid) else { continue };
            let error = (scale.factor * found.material.table.normal_albedo() / truth.normal_albedo()).ln();
            println!("{name}, {light}: {:.3} of the albedo", error.exp());
            errors.push(error);
        }
    }
    let off = |share: f64| {
        let mut sorted: Vec<f64> = errors.iter().map(|error: &f64| error.abs()).collect();
        sorted.sort_by(f64::total_cmp);
        sorted.get((share * sorted.len() as f64) as usize).map_or(f64::NAN, |error| 100.0 * (error.exp() - 1.0))
    };
    println!(
        "\n{} photographs: the albedo is off by {:.1} % in the median, by {:.1} % in nine of ten; logarithm: median {:.3}, mean {:.3}, \
         root mean square {:.3}",
        errors.len(),
        off(0.5),
        off(0.9),
        median(errors.clone()),
        mean(&errors),
        mean(&errors.iter().map(|error| error * error).collect::<Vec<_>>()).sqrt(),
    );
    Ok(())
}

/// Materials outside of the MERL database, in luminance.
fn materials(data: &Path) -> Result<Vec<(String, BivariateTable)>> {
    let materials = crate::out_of_domain::tables(data)?;
    Ok(materials.into_iter().map(|(name, rgb)| (name, BivariateTable::luminance(&rgb))).collect())
}
