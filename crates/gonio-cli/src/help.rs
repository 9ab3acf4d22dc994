//! `gonio completions` and `gonio man`: what a shell and `man` want to know, made from the options
//! themselves; and what `gonio --version` says.

use std::path::PathBuf;
use std::sync::LazyLock;

use anyhow::{Context, Result};
use clap::CommandFactory;
use clap_complete::Shell;
use serde_json::json;

use crate::Args;
use crate::outcome::Outcome;

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

pub(crate) fn completions(options: &Completions) -> Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(options.shell, &mut Args::command(), "gonio", &mut script);
    let script = String::from_utf8(script).context("a script that is no text")?;
    let fields = json!({ "shell": options.shell.to_string(), "script": script });
    Ok(Outcome::new(script.trim_end(), fields))
}

pub(crate) fn man(options: &Man) -> Result<Outcome> {
    let dir = options.output.display().to_string();
    let failed = || format!("{dir}: the pages cannot be written there");
    std::fs::create_dir_all(&options.output).with_context(failed)?;
    clap_mangen::generate_to(Args::command(), &options.output).with_context(failed)?;
    Ok(Outcome::new(format!("{dir}: see man -l {dir}/gonio.1"), json!({ "output": dir })))
}
