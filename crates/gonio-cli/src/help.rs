//! Help texts, shell completions, manual pages and the text of `gonio --version`.
//!
//! All are generated from the definitions of the options.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use anyhow::Context;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, FromArgMatches};
use clap_complete::Shell;
use gonio_io::picture::EXTENSIONS;
use serde_json::json;

use crate::Args;
use crate::outcome::Outcome;

/// Options that `gonio infer -h` shows; `--help` shows all.
const COMMON: [&str; 13] = [
    "images",
    "mask",
    "circle",
    "mesh",
    "normals",
    "camera",
    "light",
    "method",
    "light_color",
    "output",
    "json",
    "quiet",
    "help",
];

/// Commands whose `-h` shows only the common options.
const COMMANDS_WITH_SHORT_HELP: [&str; 2] = ["infer", "check"];

/// Whether a file name has the extension of an image.
pub(crate) fn is_picture(path: &Path) -> bool {
    path.extension().is_some_and(|e| EXTENSIONS.contains(&e.to_string_lossy().to_ascii_lowercase().as_str()))
}

/// Builds the command with all options.
pub(crate) fn command() -> clap::Command {
    let mut command = Args::command();
    // Global options reach a subcommand only when it is built, so they cannot be hidden here.
    for name in COMMANDS_WITH_SHORT_HELP {
        command = command.mut_subcommand(name, |long| {
            long.mut_args(|arg| {
                let is_common = COMMON.contains(&arg.get_id().as_str());
                arg.hide_short_help(!is_common)
            })
        });
    }
    command
}

/// Parses arguments.
pub(crate) fn parse<T: Into<OsString> + Clone>(words: impl IntoIterator<Item = T>) -> Result<Args, clap::Error> {
    let mut command = command();
    let found = command.try_get_matches_from_mut(words)?;
    Args::from_arg_matches(&found).map_err(|error| error.format(&mut command))
}

/// Suggests a correction for arguments that cannot be parsed, if there is a probable one.
pub(crate) fn hint(error: &clap::Error) -> Option<String> {
    let (ErrorKind::InvalidSubcommand, Some(ContextValue::String(word))) =
        (error.kind(), error.get(ContextKind::InvalidSubcommand))
    else {
        return None;
    };
    let path = Path::new(word);
    (is_picture(path) || path.is_file()).then(|| format!("to process a photograph, run gonio infer {word}"))
}

/// Options of `gonio completions`.
#[derive(clap::Args)]
pub(crate) struct Completions {
    /// Shell that the script is for
    shell: Shell,
}

/// Options of `gonio man`.
#[derive(clap::Args)]
pub(crate) struct Man {
    /// Folder for the manual pages: gonio.1 and one page per command
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// Returns the version, the licence of the code, and the licences of the model's training data.
pub(crate) fn version() -> &'static str {
    static TEXT: LazyLock<String> = LazyLock::new(|| {
        let library = match cfg!(feature = "raw") {
            true => "\nReader of camera raw files: library rawler, LGPL-2.1",
            false => "",
        };
        format!(
            "{}\n\nCode: {}{library}\n\nModel: gonio-1.model, embedded in the program.\n\
             The licence of the code does not cover the model's training data:\n{}\n\n\
             To train a model on data that allow commercial use, see docs/licences.md in the source",
            env!("CARGO_PKG_VERSION"),
            env!("CARGO_PKG_LICENSE"),
            gonio_io::model::EMBEDDED_SOURCES,
        )
    });
    &TEXT
}

pub(crate) fn completions(options: &Completions) -> anyhow::Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(options.shell, &mut command(), "gonio", &mut script);
    let mut script = String::from_utf8(script).context("the completion script is not valid UTF-8")?;
    if options.shell == Shell::Zsh {
        // After a photograph, two colons restrict zsh to photographs; one colon also allows options
        // (clap-rs/clap#4652).
        script = script.replace("\n'*::", "\n'*:");
    }
    let fields = json!({ "shell": options.shell.to_string(), "script": script });
    Ok(Outcome::new(script.trim_end(), fields))
}

pub(crate) fn man(options: &Man) -> anyhow::Result<Outcome> {
    let dir = options.output.display().to_string();
    let failed = || format!("{dir}: cannot write the manual pages");
    std::fs::create_dir_all(&options.output).with_context(failed)?;
    clap_mangen::generate_to(command(), &options.output).with_context(failed)?;
    Ok(Outcome::new(
        format!("{dir}: manual pages written; read them with man -l {dir}/gonio.1"),
        json!({ "output": dir }),
    ))
}
