//! `gonio`: one photograph of an object of known shape in, its BRDF out.
//!
//! The program is thin: it translates its options for `gonio-app`, shows what goes on, and writes
//! what is found. Anything wrong with the input ends in one line on standard error and exit code 2,
//! with nothing half-written.

mod batch;
mod combine;
mod convert;
mod export;
mod help;
mod infer;
mod input;
mod light;
mod merge;
mod outcome;
mod progress;
mod reading;
mod remedy;
mod render;
mod surface;
mod train;

use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook};
use std::process::ExitCode;
use std::sync::Mutex;

use clap::{Parser, Subcommand};

/// The BRDF of an object of known shape, from one photograph under unknown illumination.
#[derive(Parser)]
#[command(name = "gonio", version, long_version = help::version())]
pub(crate) struct Args {
    /// Print one JSON object instead of lines: what was done, or the error
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
pub(crate) enum Command {
    /// Infer many: the rows of a table, or a shard of them
    Batch(batch::Options),
    /// Combine several photographs of one material
    Combine(combine::Options),
    /// Convert a BRDF between file formats
    Convert(convert::Options),
    /// Write a BRDF for renderers: Mitsuba, pbrt, Blender, glTF, MaterialX
    Export(export::Options),
    /// Infer the BRDF of the object in a photograph
    Infer(Box<infer::Options>),
    /// Unwrap a photograph of a mirror ball to the light around it
    Light(Box<light::Options>),
    /// Merge exposures of one scene to an HDR picture
    Merge(merge::Options),
    /// Render a sphere of a BRDF under a light
    Render(render::Options),
    /// Learn the priors of light and reflectance
    #[command(subcommand)]
    Train(train::Command),
    /// Print what makes a shell complete the arguments
    Completions(help::Completions),
    /// Write the manual pages
    Man(help::Man),
}

/// Message of the last panic. Decoders of third parties panic on damaged files; `gonio-io` catches
/// that and says what is wrong in one line, to which the message of the panic would only add noise.
static PANIC: Mutex<String> = Mutex::new(String::new());

fn note(panic: &PanicHookInfo<'_>) {
    if let Ok(mut noted) = PANIC.lock() {
        *noted = panic.to_string();
    }
}

fn main() -> ExitCode {
    let Args { json, command } = match Args::try_parse() {
        Ok(args) => args,
        Err(error) => return refuse(&error),
    };
    set_hook(Box::new(note));
    let run = || match &command {
        Command::Batch(options) => batch::run(options),
        Command::Combine(options) => combine::run(options),
        Command::Convert(options) => convert::run(options),
        Command::Export(options) => export::run(options),
        Command::Infer(options) => infer::run(options),
        Command::Light(options) => light::run(options),
        Command::Merge(options) => merge::run(options),
        Command::Render(options) => render::run(options),
        Command::Train(command) => train::run(command),
        Command::Completions(options) => help::completions(options),
        Command::Man(options) => help::man(options),
    };
    match catch_unwind(AssertUnwindSafe(run)) {
        Ok(Ok(outcome)) => {
            outcome.print(json);
            ExitCode::SUCCESS
        }
        Ok(Err(error)) => {
            tell(&one_line(&format!("{error:#}")), json);
            ExitCode::from(2)
        }
        Err(_) => {
            let said = PANIC.lock().map(|noted| noted.clone()).unwrap_or_default();
            tell(&format!("a fault of gonio itself: {}; please report it", one_line(&said)), json);
            ExitCode::from(101)
        }
    }
}

/// Says what is wrong: in a line on standard error, or in an object on standard output.
fn tell(error: &str, json: bool) {
    if json {
        println!("{}", serde_json::json!({ "error": error }));
    } else {
        eprintln!("error: {error}");
    }
}

/// Help and version as they are; what is wrong with the arguments in one line, without the usage.
fn refuse(error: &clap::Error) -> ExitCode {
    use clap::error::ErrorKind as K;
    if matches!(error.kind(), K::DisplayHelp | K::DisplayVersion | K::DisplayHelpOnMissingArgumentOrSubcommand) {
        error.exit();
    }
    // The option itself may be among what could not be understood.
    tell(&format!("{}; see --help", problem(error)), std::env::args_os().any(|a| a == "--json"));
    ExitCode::from(2)
}

/// Describes what is wrong with the arguments, in one line.
pub(crate) fn problem(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let is_problem = |p: &&str| !p.starts_with("Usage:") && !p.starts_with("For more information");
    let problem: Vec<String> = text.split("\n\n").map(str::trim).filter(is_problem).map(squeeze).collect();
    problem.join("; ").trim_start_matches("error: ").to_owned()
}

/// Every run of white space becomes a blank.
fn squeeze(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Line breaks and whatever else controls a terminal become blanks; names of files may hold any.
pub(crate) fn one_line(text: &str) -> String {
    text.replace(char::is_control, " ")
}
