//! `gonio-eval paper`: reproduces every figure and table of the paper from the data, as one HTML
//! file.
//!
//! One file per figure: [`trivial_solution`] (Fig. 1), [`lighting`] (Fig. 2), [`reflectance`] (Fig.
//! 3), [`appearance`] (Fig. 4), [`stability`] (Fig. 5), [`captured`] (Fig. 6), [`gloss`] (the
//! remark on Fig. 6). [`context`] holds the data, model and estimator that they share. [`recovery`]
//! computes the estimates of Figs. 4, 5 and of the gloss order once. [`show`] converts radiance to
//! pictures.

mod appearance;
mod captured;
mod context;
mod fits;
mod gloss;
mod lighting;
mod recovery;
mod reflectance;
pub(crate) mod show;
mod stability;
mod trivial_solution;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};
use maud::html;

use context::PaperContext;
use gonio_report::page::{Section, document};

/// Options of `gonio-eval paper`.
#[derive(clap::Args)]
pub(crate) struct PaperOptions {
    /// HTML file of the report
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Folder of full MERL `.binary` files; for materials without a file, the bivariate tables of
    /// the data are spread over phi_d
    #[arg(long, value_name = "DIR")]
    merl: Option<PathBuf>,
    /// Random starts of each inference
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    starts: u32,
    /// Estimator of reflectance
    #[arg(long, value_enum, default_value_t = Estimator::CKl)]
    estimator: Estimator,
}

/// Estimators of reflectance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Estimator {
    /// The separable posterior that minimises C_KL (Algorithm 1's cost, block solver)
    CKl,
    /// The joint maximum of light and reflectance
    JointMap,
}

impl Estimator {
    /// Name within a sentence.
    fn words(self) -> &'static str {
        match self {
            Self::CKl => "the mean of the separable posterior (least C_KL, block solver)",
            Self::JointMap => "the joint maximum of light and reflectance",
        }
    }
}

pub(crate) fn run(data: &Path, options: &PaperOptions) -> Result<()> {
    let start = Instant::now();
    // Check now, not after minutes of computation.
    let folder = options.output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() || options.output.is_dir() {
        bail!("{}: specify a file in an existing folder", options.output.display());
    }
    let context = step("data", || PaperContext::open(data, options))?;
    let mut sections = Vec::new();
    let mut add = |id: &str, title: &str, body| sections.push(Section { id: id.into(), title: title.into(), body });
    add("trivial", "Fig. 1: the single best explanation", trivial_solution::section(&context)?);
    add("light", "Fig. 2: light and its statistics", lighting::section(&context)?);
    add("reflectance", "Fig. 3: reflectance in a basis of few functions", reflectance::section(&context)?);
    let recovered = recovery::recover(&context)?;
    add("appearance", "Fig. 4: appearance in a novel light", appearance::section(&context, &recovered));
    add(
        "stability",
        "Fig. 5: the same material from two lights",
        step("Fig. 5", || Ok(stability::section(&context, &recovered)))?,
    );
    add("captured", "Fig. 6: a real photograph", captured::section(&context)?);
    add("gloss", "The order of gloss", gloss::section(&context, &recovered));
    let lead = html! {
        p {
            "The figures and tables of " em { "Blind Reflectometry" } ", reproduced by gonio " (env!("CARGO_PKG_VERSION")) ". "
            "From one high-dynamic-range picture under unknown light the BRDF is inferred as " (options.estimator.words())
            ", best of " (options.starts) @if options.starts == 1 { " start" } @else { " starts" } ". "
            "Such a picture does not determine the scale of a BRDF; every error is measured after the best scale."
        }
        p.note {
            "Materials are the " em { "reconstructed" } " MERL database, not the original measurements. The basis of the inference "
            "holds all 100 materials, as in the paper; the lights of the inputs were not used for the prior of light. " (context.inputs_note())
        }
    };
    let page = document("Blind reflectometry: the paper's figures", &lead, &sections);
    gonio_io::atomic::write_file(&options.output, page.as_bytes())?;
    println!(
        "{}: {:.1} MB in {:.0} s",
        options.output.display(),
        page.len() as f64 / 1e6,
        start.elapsed().as_secs_f64()
    );
    Ok(())
}

/// Runs `work`, and prints its duration to standard error.
fn step<T>(label: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
    let start = Instant::now();
    let result = work()?;
    eprintln!("{label}: {:.1} s", start.elapsed().as_secs_f64());
    Ok(result)
}
