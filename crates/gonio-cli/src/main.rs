//! The program `gonio` estimates the BRDF of an object of known shape from one photograph.
//!
//! It parses options, calls `gonio-app`, shows progress, and writes results. Invalid input produces
//! one line on standard error and exit code 2, and leaves no partial output.

mod batch;
mod check;
mod combine;
mod compare;
mod convert;
mod export;
mod help;
mod infer;
mod input;
mod interrupt;
mod light;
mod merge;
mod names;
mod outcome;
mod progress;
mod reading;
mod render;
mod scene;
mod space;
mod suggestion;
mod surface;
mod train;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use gonio_app::panics;

use progress::{Verbosity, set_verbosity};

/// Estimate the BRDF of an object from one photograph, under unknown or known light.
#[derive(Parser)]
#[command(
    name = "gonio",
    version,
    long_version = help::version(),
    disable_help_flag = true,
    after_help = "Start with: gonio infer photo.exr"
)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    general: General,
}

/// Options that all commands share.
#[derive(clap::Args)]
#[command(next_help_heading = "General")]
struct General {
    /// Print the result or the error as one JSON object
    #[arg(long, global = true)]
    json: bool,
    /// Print errors only
    #[arg(short, long, global = true, conflicts_with_all = ["json", "verbose"])]
    quiet: bool,
    /// Also print the duration of each stage in seconds
    #[arg(short, long, global = true)]
    verbose: bool,
    /// Number of threads [default: one per core]
    #[arg(long, global = true, value_name = "N", allow_negative_numbers = true,
          value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print help: -h prints a summary, --help describes every option
    #[arg(short, long, global = true, action = clap::ArgAction::Help)]
    help: Option<bool>,
}

#[derive(Subcommand)]
pub(crate) enum Command {
    /// Infer the BRDF of the object in a photograph
    Infer(Box<infer::InferOptions>),
    /// Show the object, clipped pixels and faulty pixels in a photograph
    Check(Box<check::CheckOptions>),
    /// Infer the BRDFs of many photographs, or of the rows of a table
    Batch(batch::BatchOptions),
    /// Combine the results of several photographs of one material
    Combine(combine::CombineOptions),
    /// Show several results side by side on one HTML page
    Compare(compare::CompareOptions),
    /// Export a BRDF to renderers: Mitsuba, pbrt, Blender, glTF, MaterialX
    Export(export::ExportOptions),
    /// Render a sphere or a mesh with a BRDF under an environment map
    Render(render::RenderOptions),
    /// Merge exposures of one scene into an HDR image
    Merge(merge::MergeOptions),
    /// Convert a photograph of a mirror ball to an environment map
    Light(Box<light::LightOptions>),
    /// Convert a BRDF between file formats
    Convert(convert::ConvertOptions),
    /// Train a model on environment maps and measured BRDFs
    #[command(subcommand)]
    Train(train::Command),
    /// Print a completion script for a shell
    Completions(help::Completions),
    /// Write the manual pages
    Man(help::Man),
}

fn main() -> ExitCode {
    let Args { general, command } = match help::parse(std::env::args_os()) {
        Ok(args) => args,
        Err(error) => return print_argument_error(&error),
    };
    let json = general.json;
    set_verbosity(match general {
        // `--quiet` does not suppress the completion script: it is the requested output.
        General { quiet: true, .. } if !matches!(command, Command::Completions(_)) => Verbosity::Quiet,
        General { verbose: true, .. } => Verbosity::Verbose,
        _ => Verbosity::Usual,
    });
    if let Some(threads) = general.threads {
        // This fails only if a global thread pool exists already, which is not the case.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    }
    panics::record();
    interrupt::watch();
    let run = || match &command {
        Command::Batch(options) => batch::run(options),
        Command::Check(options) => check::run(options),
        Command::Combine(options) => combine::run(options),
        Command::Compare(options) => compare::run(options),
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
            print_error(&one_line(&format!("{error:#}")), json);
            ExitCode::from(2)
        }
        Err(_) => {
            let message = one_line(&panics::message());
            print_error(&format!("internal error: {message}; please report this bug"), json);
            ExitCode::from(101)
        }
    }
}

/// Prints an error: one line on standard error, or a JSON object on standard output.
fn print_error(error: &str, json: bool) {
    if json {
        println!("{}", serde_json::json!({ "error": error }));
    } else {
        eprintln!("error: {error}");
    }
}

/// Prints help and version unchanged, and an error in the arguments as one line without the usage.
fn print_argument_error(error: &clap::Error) -> ExitCode {
    use clap::error::ErrorKind as K;
    if matches!(error.kind(), K::DisplayHelp | K::DisplayVersion | K::DisplayHelpOnMissingArgumentOrSubcommand) {
        error.exit();
    }
    // `--json` is read from the raw arguments because parsing failed.
    let hint = help::hint(error).unwrap_or_else(|| "see --help".to_owned());
    print_error(&format!("{}; {hint}", problem(error)), std::env::args_os().any(|a| a == "--json"));
    ExitCode::from(2)
}

/// Describes an error in the arguments in one line.
pub(crate) fn problem(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let is_problem = |p: &&str| !p.starts_with("Usage:") && !p.starts_with("For more information");
    let problem: Vec<String> = text.split("\n\n").map(str::trim).filter(is_problem).map(squeeze).collect();
    problem.join("; ").trim_start_matches("error: ").to_owned()
}

/// Replaces each run of white space by one space.
fn squeeze(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Replaces line breaks and other control characters, which file names can contain, by spaces.
pub(crate) fn one_line(text: &str) -> String {
    text.replace(controls, " ")
}

/// Like [`one_line`], but keeps line breaks and tabs.
pub(crate) fn lines(text: &str) -> String {
    text.replace(|c| controls(c) && c != '\n' && c != '\t', " ")
}

/// Whether a character controls the terminal or the text direction, which can disguise file names.
fn controls(c: char) -> bool {
    c.is_control() || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_control_characters() {
        let name = "a\u{1b}[31m\u{9b}2J\u{7}\u{202e}gnp.exr\r\nerror: forged\t.";
        assert_eq!(one_line(name), "a [31m 2J  gnp.exr  error: forged .");
        assert_eq!(lines(name), "a [31m 2J  gnp.exr \nerror: forged\t.");
    }
}
