//! `gonio`: one photograph of an object of known shape in, its BRDF out.
//!
//! The program is thin: it reads files with `gonio-io`, calls `gonio`, and writes files with `gonio-io`. Anything wrong with
//! the input ends in one line on standard error and exit code 2, with nothing half-written.

mod infer;
mod input;
mod progress;
mod render;
mod summary;
mod train;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The BRDF of an object of known shape, from one photograph under light that nobody measured.
#[derive(Parser)]
#[command(name = "gonio", version)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Infer the BRDF of the object in a photograph
    Infer(infer::Options),
    /// Render a sphere of a BRDF under a light
    Render(render::Options),
    /// Learn the priors of light and reflectance
    #[command(subcommand)]
    Train(train::Command),
}

fn main() -> ExitCode {
    let result = match Args::parse().command {
        Command::Infer(options) => infer::run(&options),
        Command::Render(options) => render::run(&options),
        Command::Train(command) => train::run(&command),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", format!("{error:#}").replace('\n', " "));
            ExitCode::from(2)
        }
    }
}
