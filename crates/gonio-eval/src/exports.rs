//! Errors of the models of renderers that `gonio export` fits to measured materials.

use std::path::Path;

use anyhow::Result;
use gonio::estimate::ALBEDO;
use gonio::reflectance::BivariateTable;
use gonio::shading::{BlenderPrincipled, ColourCookTorrance, Fitted, Fitter, Layered, MetallicRoughness, Principled};

use crate::materials::Materials;
use crate::metrics::median;

/// Errors of the exports of measured materials.
#[derive(clap::Args)]
pub(crate) struct ExportsOptions {
    /// Interval of the materials, counted from the third.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..))]
    every: u16,
}

/// Models in the columns of the table.
const MODELS: [&str; 5] = ["OpenPBR", "Blender", "Mitsuba `principled`", "glTF", "Cook-Torrance"];

/// Errors of a model: relight and log relight.
type Errors = (f64, f64);

pub(crate) fn run(data: &Path, options: &ExportsOptions) -> Result<()> {
    let materials = Materials::open(data, None)?;
    println!("| material | albedo | {} |", MODELS.join(" | "));
    println!("|---|---|{}", "---|".repeat(MODELS.len()));
    let (mut fixed, mut fitted) = (Vec::new(), Vec::new());
    for at in materials.database().skip(2).step_by(usize::from(options.every)) {
        let mut tables = materials.rgb(at).clone();
        tables.iter_mut().for_each(BivariateTable::extend_from_trusted);
        // The photograph does not determine the scale: results have this albedo.
        let scale = ALBEDO / BivariateTable::luminance(&tables).normal_albedo();
        let fitter = Fitter::new(&tables.map(|table| table.scaled(scale)));
        fixed.push(errors(&fitter));
        let factor = fitter.plausible_scale();
        let found = errors(&fitter.scaled(factor));
        println!("| {} | {:.2} | {} |", materials.names[at], ALBEDO * factor, row(&found));
        fitted.push(found);
    }
    println!("| **median, albedo of the best fit** | | {} |", row(&medians(&fitted)));
    println!("| median, albedo {ALBEDO} | | {} |", row(&medians(&fixed)));
    Ok(())
}

fn errors(fitter: &Fitter) -> [Errors; 5] {
    fn of<S>(fitted: Fitted<S>) -> Errors {
        (fitted.relight, fitted.log_relight)
    }
    [
        of(fitter.fit::<Layered>()),
        of(fitter.fit::<BlenderPrincipled>()),
        of(fitter.fit::<Principled>()),
        of(fitter.fit::<MetallicRoughness>()),
        of(fitter.fit::<ColourCookTorrance>()),
    ]
}

fn row(errors: &[Errors; 5]) -> String {
    errors.map(|(relight, log)| format!("{:.1} / {:.1} %", 100.0 * relight, 100.0 * log)).join(" | ")
}

fn medians(all: &[[Errors; 5]]) -> [Errors; 5] {
    std::array::from_fn(|model| {
        let of = |error: fn(&Errors) -> f64| median(all.iter().map(|errors| error(&errors[model])).collect());
        (of(|e| e.0), of(|e| e.1))
    })
}
