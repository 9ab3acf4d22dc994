//! `gonio`: one photograph of an object of known shape in, its BRDF out.
//!
//! The program is thin: it translates its options for `gonio-app`, shows what goes on, and writes
//! what is found. Anything wrong with the input ends in one line on standard error and exit code 2,
//! with nothing half-written.

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
mod outcome;
mod progress;
mod reading;
mod remedy;
mod render;
mod scene;
mod space;
mod surface;
mod train;

use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook};
use std::process::ExitCode;
use std::sync::Mutex;

use clap::{Parser, Subcommand};

use progress::{Talk, set_talk};

/// The BRDF of an object of known shape, from one photograph under unknown illumination.
#[derive(Parser)]
#[command(
    name = "gonio",
    version,
    long_version = help::version(),
    disable_help_flag = true,
    after_help = "Begin with: gonio infer photo.exr"
)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    general: General,
}

/// Options of every command.
#[derive(clap::Args)]
#[command(next_help_heading = "General")]
struct General {
    /// Print one JSON object instead of lines: what was done, or the error
    #[arg(long, global = true)]
    json: bool,
    /// Print errors alone
    #[arg(short, long, global = true, conflicts_with_all = ["json", "verbose"])]
    quiet: bool,
    /// Print each stage with its seconds
    #[arg(short, long, global = true)]
    verbose: bool,
    /// Threads to work with; one for each core if not given
    #[arg(long, global = true, value_name = "N", allow_negative_numbers = true,
          value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print help: -h what is common, --help everything
    #[arg(short, long, global = true, action = clap::ArgAction::Help)]
    help: Option<bool>,
}

#[derive(Subcommand)]
pub(crate) enum Command {
    /// Infer the BRDF of the object in a photograph
    Infer(Box<infer::Options>),
    /// Show what would be inferred from: the object, clipped and faulty pixels
    Check(Box<check::Options>),
    /// Infer many: photographs, the rows of a table, or a shard of them
    Batch(batch::Options),
    /// Combine several photographs of one material
    Combine(combine::Options),
    /// Show several results side by side on one page
    Compare(compare::Options),
    /// Write a BRDF for renderers: Mitsuba, pbrt, Blender, glTF, MaterialX
    Export(export::Options),
    /// Render a sphere or a mesh of a BRDF under a light
    Render(render::Options),
    /// Merge exposures of one scene to an HDR picture
    Merge(merge::Options),
    /// Unwrap a photograph of a mirror ball to the light around it
    Light(Box<light::Options>),
    /// Convert a BRDF between file formats
    Convert(convert::Options),
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
    let Args { general, command } = match help::parse(std::env::args_os()) {
        Ok(args) => args,
        Err(error) => return refuse(&error),
    };
    let json = general.json;
    set_talk(match general {
        // A script is what was asked for, and no talk.
        General { quiet: true, .. } if !matches!(command, Command::Completions(_)) => Talk::Quiet,
        General { verbose: true, .. } => Talk::Verbose,
        _ => Talk::Usual,
    });
    if let Some(threads) = general.threads {
        // Fails only where a pool is there already, and none is.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    }
    set_hook(Box::new(note));
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
    let hint = help::hint(error).unwrap_or_else(|| "see --help".to_owned());
    tell(&format!("{}; {hint}", problem(error)), std::env::args_os().any(|a| a == "--json"));
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
    text.replace(controls, " ")
}

/// As [`one_line`], of a text of several lines.
pub(crate) fn lines(text: &str) -> String {
    text.replace(|c| controls(c) && c != '\n' && c != '\t', " ")
}

/// Whether a terminal does something else than to show this: also what turns the direction of text,
/// by which a name looks like another.
fn controls(c: char) -> bool {
    c.is_control() || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_controls_the_terminal() {
        let name = "a\u{1b}[31m\u{9b}2J\u{7}\u{202e}gnp.exr\r\nerror: forged\t.";
        assert_eq!(one_line(name), "a [31m 2J  gnp.exr  error: forged .");
        assert_eq!(lines(name), "a [31m 2J  gnp.exr \nerror: forged\t.");
    }
}
