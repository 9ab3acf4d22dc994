//! What the options are: for people who ask `-h`, and by `gonio completions` and `gonio man` for a
//! shell and for `man`, made from the options themselves; and what `gonio --version` says.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use anyhow::Context;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, FromArgMatches};
use clap_complete::Shell;
use serde_json::json;

use crate::Args;
use crate::outcome::Outcome;

/// What `gonio infer -h` shows; the rest is for `--help`.
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

/// Commands with more options than a screen has lines.
const LONG: [&str; 2] = ["infer", "check"];

/// Endings of the names of pictures.
pub(crate) const PICTURES: [&str; 9] = ["exr", "hdr", "pic", "pfm", "png", "jpg", "jpeg", "tif", "tiff"];

/// Whether a file is a picture, by its name.
pub(crate) fn is_picture(path: &Path) -> bool {
    path.extension().is_some_and(|e| PICTURES.contains(&e.to_string_lossy().to_ascii_lowercase().as_str()))
}

/// The program with its options.
pub(crate) fn command() -> clap::Command {
    let mut command = Args::command();
    // Options of all commands come to each when it is built, and cannot be hidden for one before.
    for name in LONG {
        command = command.mut_subcommand(name, |long| {
            long.mut_args(|arg| {
                let is_common = COMMON.contains(&arg.get_id().as_str());
                arg.hide_short_help(!is_common)
            })
        });
    }
    command
}

/// Understands arguments.
pub(crate) fn parse<T: Into<OsString> + Clone>(words: impl IntoIterator<Item = T>) -> Result<Args, clap::Error> {
    let mut command = command();
    let found = command.try_get_matches_from_mut(words)?;
    Args::from_arg_matches(&found).map_err(|error| error.format(&mut command))
}

/// What to do about arguments that cannot be understood, where it can be guessed.
pub(crate) fn hint(error: &clap::Error) -> Option<String> {
    let (ErrorKind::InvalidSubcommand, Some(ContextValue::String(word))) =
        (error.kind(), error.get(ContextKind::InvalidSubcommand))
    else {
        return None;
    };
    let path = Path::new(word);
    (is_picture(path) || path.is_file()).then(|| format!("to infer from a photograph: gonio infer {word}"))
}

/// Options of `gonio completions`.
#[derive(clap::Args)]
pub(crate) struct Completions {
    /// The shell
    shell: Shell,
}

/// Options of `gonio man`.
#[derive(clap::Args)]
pub(crate) struct Man {
    /// Folder for gonio.1 and a page for each command
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// The version with the terms of the code and, apart from them, of what the model was learnt from.
pub(crate) fn version() -> &'static str {
    static TEXT: LazyLock<String> = LazyLock::new(|| {
        let library = match cfg!(feature = "raw") {
            true => "\nCamera raw files: by the library rawler, LGPL-2.1",
            false => "",
        };
        format!(
            "{}\n\nCode: {}{library}\n\nModel: gonio-1.model, part of the program.\n\
             The licence of the code does not speak for what it was learnt from:\n{}\n\n\
             Models of sources that all allow commercial use: docs/licences.md in the source",
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
    let mut script = String::from_utf8(script).context("a script that is no text")?;
    if options.shell == Shell::Zsh {
        // Two colons let zsh complete nothing but photographs behind a photograph, one colon lets
        // it complete options, too (clap-rs/clap#4652).
        script = script.replace("\n'*::", "\n'*:");
    }
    let fields = json!({ "shell": options.shell.to_string(), "script": script });
    Ok(Outcome::new(script.trim_end(), fields))
}

pub(crate) fn man(options: &Man) -> anyhow::Result<Outcome> {
    let dir = options.output.display().to_string();
    let failed = || format!("{dir}: the pages cannot be written there");
    std::fs::create_dir_all(&options.output).with_context(failed)?;
    clap_mangen::generate_to(command(), &options.output).with_context(failed)?;
    Ok(Outcome::new(format!("{dir}: see man -l {dir}/gonio.1"), json!({ "output": dir })))
}
