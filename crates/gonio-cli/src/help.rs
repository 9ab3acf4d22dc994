//! `gonio completions` and `gonio man`: what a shell and `man` want to know, made from the options
//! themselves.

use std::path::PathBuf;

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
