//! Tasks of the workspace that cargo has no command for: `cargo run -p xtask -- TASK`.
//!
//! The task `web` requires the feature of this name.

#[cfg(feature = "web")]
mod relaxed;
mod sbom;
#[cfg(feature = "web")]
mod web;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

/// Tasks of the gonio workspace.
#[derive(Parser)]
#[command(name = "xtask")]
enum Task {
    /// Lists the components of the program with licences and checksums, as CycloneDX 1.5 JSON
    Sbom {
        /// File to write
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
    },
    /// Builds the page for inference in the browser as one self-contained file
    #[cfg(feature = "web")]
    Web {
        /// Folder for index.html
        #[arg(short, long, value_name = "DIR", default_value = "target/web")]
        output: PathBuf,
    },
}

fn main() -> ExitCode {
    let done = match Task::parse() {
        Task::Sbom { output } => sbom::make(&output),
        #[cfg(feature = "web")]
        Task::Web { output } => web::make(&output),
    };
    match done {
        Ok(line) => {
            println!("{line}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}
