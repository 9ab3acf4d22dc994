//! `gonio-eval`: the measurements behind the figures in `docs/`. The data are not part of the
//! repository: `--data` or `GONIO_DATA` names their folder.

mod bases;
mod bench;
mod cache;
mod calibration;
mod camera;
mod captured;
mod colour;
mod data;
mod exports;
mod folds;
mod lights;
mod materials;
mod metrics;
mod multi_view;
mod out_of_domain;
mod outlines;
mod paper;
mod patterns;
mod posteriors;
mod prior;
mod quadrature;
mod scales;
mod shapes;
mod silhouettes;
mod tints;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Measures how well gonio recovers reflectance.
#[derive(Parser)]
#[command(version, args_override_self = true)]
struct Args {
    /// Folder of the data (lighting/, merl/, captured/, rgl/).
    #[arg(long, env = "GONIO_DATA", global = true)]
    data: Option<PathBuf>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Every figure and table of the paper, as one HTML file.
    Paper(paper::PaperOptions),
    /// Convergence of the transfer's quadrature against a brute-force reference.
    Quadrature,
    /// Compares methods of estimating the light given the BRDF, on training lights and materials.
    Lights(lights::LightsOptions),
    /// Compares methods of colouring a BRDF, on test materials in test lights.
    Colour(colour::ColourOptions),
    /// Measures the coverage of intervals on photographs of new materials in training lights.
    Calibration(calibration::CalibrationOptions),
    /// Measures how the colour of training lights varies over their directions.
    Tints,
    /// Measures errors on shapes other than a sphere, with and without modelling self-shadowing.
    Shapes(shapes::ShapesOptions),
    /// Measures errors of estimates whose shape is inflated from the outline.
    Silhouettes(silhouettes::SilhouettesOptions),
    /// Measures estimates of balls that are painted in two paints.
    Patterns(patterns::PatternsOptions),
    /// Evaluates the default method on photographs of real objects, against their measured BRDF and
    /// their photographs in other lights.
    Captured(captured::CapturedOptions),
    /// Compares estimators and references over a grid of materials and lights.
    Bench(Box<bench::BenchOptions>),
    /// Measures the error that each camera effect adds to the learnt posterior, on test materials
    /// in test lights.
    Camera(camera::CameraOptions),
    /// Evaluates the prior of materials on materials that it was not built from.
    Prior(prior::PriorOptions),
    /// Measures the detection of balls in simulated photographs.
    Outlines(outlines::OutlinesOptions),
    /// Measures errors of the models of renderers that `gonio export` fits to measured materials.
    Exports(exports::ExportsOptions),
    /// Cross-validates the learnt posterior on training materials in training lights.
    Folds(folds::FoldsOptions),
    /// Measures errors of estimates from several photographs of one material, and from several
    /// materials under one light.
    MultiView(multi_view::MultiViewOptions),
    /// Measures the error of the absolute albedo from a neutral reference in the picture.
    Scales(scales::ScalesOptions),
}

fn main() -> ExitCode {
    let args = Args::parse();
    let data = args.data.unwrap_or_else(|| PathBuf::from("data"));
    let result = match args.command {
        Command::Outlines(options) => outlines::run(&data, &options),
        Command::Paper(options) => paper::run(&data, &options),
        Command::Quadrature => quadrature::run(&data),
        Command::Lights(options) => lights::run(&data, &options),
        Command::Colour(options) => colour::run(&data, &options),
        Command::Calibration(options) => calibration::run(&data, &options),
        Command::Tints => tints::run(&data),
        Command::Shapes(options) => shapes::run(&data, &options),
        Command::Silhouettes(options) => silhouettes::run(&data, &options),
        Command::Patterns(options) => patterns::run(&data, &options),
        Command::Captured(options) => captured::run(&data, &options),
        Command::Bench(options) => bench::bench(&data, &options),
        Command::Camera(options) => camera::run(&data, &options),
        Command::Exports(options) => exports::run(&data, &options),
        Command::Folds(options) => folds::run(&data, &options),
        Command::Prior(options) => prior::run(&data, &options),
        Command::MultiView(options) => multi_view::run(&data, &options),
        Command::Scales(options) => scales::run(&data, &options),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}
