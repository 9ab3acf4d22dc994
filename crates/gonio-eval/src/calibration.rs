//! `gonio-eval calibration`: measures the coverage of intervals, and the widths that give nominal
//! coverage.
//!
//! Photographs show materials outside all training data, in training lights. For each band of half
//! angle the table lists how often intervals contain the measured value, and the spread that they
//! need. This spread is a standard deviation: added to that of the draws, it gives 90 % intervals a
//! coverage of 90 %. It is a quantile of the errors that the draws leave unexplained (split
//! conformal prediction).

mod residuals;

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use gonio::colour::{Chroma, ChromaField, ChromaInterval, ColourEstimate};
use gonio::estimate::{Colouring, EstimateSettings, Light, MaterialEstimate, expected_misfit};
use gonio::gloss::GgxWidths;
use gonio::inference::learnt::peak_height;
use gonio::reflectance::{BivariateTable, THETA_D, brdf_scale, theta_d_of, theta_h_of, trusted_cells};

use self::residuals::Residual;
use crate::colour::{ColourEstimator, Subject, photographs, subjects, train_colours};
use crate::data::{Lights, ModelOption};
use crate::metrics::brdf_error;

/// Ends of the bands of half angle, in degrees.
pub(crate) const BANDS: [f64; 7] = [0.0, 4.0, 10.0, 20.0, 35.0, 55.0, 80.0];

/// Ends of the bands of difference angle, in degrees.
const DIFFERENCE_BANDS: [f64; 4] = [0.0, 30.0, 60.0, 80.0];

/// Quantiles at 95 and 75 % of the distribution of unexplained errors, Student's with three degrees
/// of freedom.
const HALF_WIDTHS: [f64; 2] = [2.353, 0.765];

/// Reflectances below this value (1/sr) count as equal to it, because measurements are not exact
/// there.
const DARK: f64 = 1e-3;

/// Options of `gonio-eval calibration`.
#[derive(clap::Args)]
pub(crate) struct CalibrationOptions {
    #[command(flatten)]
    model: ModelOption,
    /// Lights of the photographs
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "courtyard,old_hall,kloppenheim_02,studio_small_03,venice_sunset,artist_workshop"
    )]
    lights: Vec<String>,
    /// Use test lights instead of training lights, to check a calibration
    #[arg(long)]
    test: bool,
    /// Use only every N-th material
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Train the colours in every N-th training light
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u32).range(1..))]
    stride: u32,
    /// Index of the first of these materials
    #[arg(long, default_value_t = 0)]
    first: usize,
}

/// A cell of one estimate.
#[derive(Clone, Copy)]
struct Cell {
    group: usize,
    lit: bool,
    /// 0 for luminance, then red, green and blue.
    channel: usize,
    band: usize,
    difference_band: usize,
    /// Logarithm of the measured value over the median of the draws.
    error: f64,
    /// Logarithms of quantiles of the draws over their median, on the side of the error: at 5 and
    /// 25 %, or at 95 and 75 %.
    ends: [f64; 2],
    /// Whether the 90 % and the 50 % interval contain the measured value.
    held: [bool; 2],
}

/// Whether the 90 % intervals of gloss, roughness and chroma of one estimate contain the true
/// values.
struct Numbers {
    group: usize,
    lit: bool,
    gloss: bool,
    alpha: bool,
    /// Share of the two components of the body's chroma that lie in their intervals.
    body: f64,
    /// The same for the highlight.
    highlight: f64,
}

/// Step between the evaluated cells; neighbouring cells have the same errors.
const CELL_STEP: usize = 7;

const GROUPS: [&str; 3] = ["measured_extra", "rgl", "formulas"];

pub(crate) fn run(data: &Path, options: &CalibrationOptions) -> Result<()> {
    let mut model = options.model.read()?;
    train_colours(&mut model, data, options.stride)?;
    let subjects: Vec<Subject> =
        subjects(data)?.into_iter().skip(options.first).step_by(options.every as usize).collect();
    let lights = if options.test { Lights::open(data)? } else { Lights::training(data)? };
    let (mut cells, mut numbers, mut residuals) = (Vec::new(), Vec::new(), Vec::new());
    photographs(&model, &lights, &options.lights, &subjects, |photograph, subject, light| {
        for estimator in [ColourEstimator::Blind, ColourEstimator::KnownLight] {
            let (material, colouring, _) = estimator.posterior(photograph)?;
            let lit = estimator == ColourEstimator::KnownLight;
            if !lit {
                let settings = EstimateSettings::default();
                let found = Light::of(&model.light, &photograph.observations, &material.table, &settings, &|_| ())?;
                residuals.push(Residual {
                    misfit: found.misfit,
                    expected: expected_misfit(&material),
                    fineness: material.fineness,
                    peak_height: material.peak_height[1],
                    error: brdf_error(&material.table, &BivariateTable::luminance(&subject.rgb)),
                    name: format!("{} in {light}", subject.name),
                });
            }
            add_cells(&mut cells, subject, lit, &material, &colouring);
            numbers.push(Numbers::of(subject, lit, &material, &colouring));
        }
        Ok(())
    })?;
    print!("{}{}{}", report(&cells), report_of_numbers(&numbers), residuals::report(&residuals));
    Ok(())
}

/// Index of the band that an angle lies in.
pub(crate) fn band_of(bands: &[f64], angle: f64) -> usize {
    bands[1..bands.len() - 1].iter().filter(|end| angle.to_degrees() >= **end).count()
}

fn add_cells(cells: &mut Vec<Cell>, subject: &Subject, lit: bool, material: &MaterialEstimate, colouring: &Colouring) {
    let truth = BivariateTable::luminance(&subject.rgb);
    let scale = 1.0 / brdf_scale(&material.table, &truth);
    let colours = match colouring {
        Colouring::Estimate(found) => Some(found.draws.as_slice()),
        _ => None,
    };
    let (channel_quantiles, grey) = (colouring.quantiles(material), [ChromaField::GREY]);
    let floor = scale * DARK;
    for channel in 0..4 {
        let (table, quantiles) = match channel {
            0 => (&truth, &material.quantiles),
            c => (&subject.rgb[c - 1], &channel_quantiles[c - 1]),
        };
        let fields = colours.filter(|_| channel > 0).unwrap_or(&grey);
        let logs = material.posterior.channel_logs(fields, channel.max(1) - 1);
        for cell in trusted_cells().step_by(CELL_STEP) {
            let mut values: Vec<f64> =
                logs.iter().map(|log| (f64::from(log[cell]) + material.scale.ln()).max(floor.ln())).collect();
            values.sort_by(f64::total_cmp);
            let quantile = |share: f64| values[(share * values.len() as f64) as usize];
            let value = (scale * f64::from(table.as_slice()[cell])).max(floor);
            let (h, d) = (theta_h_of(cell / THETA_D), theta_d_of(cell % THETA_D));
            let holds = |low: usize, high: usize| {
                let end = |k: usize| f64::from(quantiles[k][cell]).max(floor);
                end(low) <= value * (1.0 + 1e-6) && value <= end(high) * (1.0 + 1e-6)
            };
            let error = value.ln() - quantile(0.5);
            let shares = if error < 0.0 { [0.05, 0.25] } else { [0.95, 0.75] };
            cells.push(Cell {
                group: group_of(subject),
                lit,
                channel,
                band: band_of(&BANDS, h),
                difference_band: band_of(&DIFFERENCE_BANDS, d),
                error,
                ends: shares.map(|share| quantile(share) - quantile(0.5)),
                held: [holds(0, 3), holds(1, 2)],
            });
        }
    }
}

fn group_of(subject: &Subject) -> usize {
    GROUPS.iter().position(|g| *g == subject.group).unwrap_or(0)
}

impl Numbers {
    fn of(subject: &Subject, lit: bool, material: &MaterialEstimate, colouring: &Colouring) -> Self {
        let truth = BivariateTable::luminance(&subject.rgb);
        let gloss = peak_height(&truth);
        let alpha = GgxWidths::new().alpha_of(&truth).unwrap_or(1.0);
        let field = ChromaField::of_tables(&subject.rgb);
        let chroma = |part: fn(&ColourEstimate) -> &ChromaInterval, want: Chroma| match colouring {
            Colouring::Estimate(found) => {
                let ends = part(found).interval;
                (0..2).filter(|&c| ends[c][0] <= want.0[c] && want.0[c] <= ends[c][1]).count() as f64 / 2.0
            }
            _ => 0.0,
        };
        let within = |ends: [f64; 3], value: f64| ends[0] <= value && value <= ends[2];
        Self {
            group: group_of(subject),
            lit,
            gloss: within(material.peak_height, gloss),
            alpha: within(material.highlight.alpha, alpha),
            body: chroma(|found| &found.body, field.body(&truth)),
            highlight: chroma(|found| &found.highlight, field.highlight(&truth)),
        }
    }
}

/// Returns the spread with which the interval of this index contains this share of the cells.
fn needed(cells: &[&Cell], interval: usize, share: f64) -> f64 {
    let mut unexplained: Vec<f64> = cells.iter().map(|c| c.error.powi(2) - c.ends[interval].powi(2)).collect();
    unexplained.sort_by(f64::total_cmp);
    let at = (share * unexplained.len() as f64) as usize;
    unexplained[at.min(unexplained.len() - 1)].max(0.0).sqrt() / HALF_WIDTHS[interval]
}

fn report_of_numbers(numbers: &[Numbers]) -> String {
    let mut out = String::from(
        "\n| | group | gloss held | alpha held | body held | highlight held |\n|---|---|---|---|---|---|\n",
    );
    for lit in [false, true] {
        for (at, group) in GROUPS.iter().enumerate() {
            let chosen: Vec<&Numbers> = numbers.iter().filter(|n| n.lit == lit && n.group == at).collect();
            if chosen.is_empty() {
                continue;
            }
            let share =
                |held: fn(&Numbers) -> f64| 100.0 * chosen.iter().map(|n| held(n)).sum::<f64>() / chosen.len() as f64;
            let _ = writeln!(
                out,
                "| {} | {group} | {:.0} % | {:.0} % | {:.0} % | {:.0} % |",
                if lit { "known light" } else { "blind" },
                share(|n| f64::from(u8::from(n.gloss))),
                share(|n| f64::from(u8::from(n.alpha))),
                share(|n| n.body),
                share(|n| n.highlight),
            );
        }
    }
    out
}

/// Reports the coverage of the intervals by band.
fn report(cells: &[Cell]) -> String {
    let mut out = String::new();
    for lit in [false, true] {
        for (title, channels) in [("luminance", 0..1), ("channels", 1..4)] {
            let _ = writeln!(
                out,
                "\n{}, {title}: 90 / 50 % of cells held, spread needed for both, rms error, 95 % end of draws\n\n\
                 | group | half angle | difference angle | held | spread needed | error | draws |\n\
                 |---|---|---|---|---|---|---|",
                if lit { "known light" } else { "blind" }
            );
            for group in (0..GROUPS.len()).map(Some).chain([None]) {
                for band in 0..BANDS.len() - 1 {
                    for difference in [None, Some(0), Some(1), Some(2)] {
                        let chosen: Vec<&Cell> = cells
                            .iter()
                            .filter(|c| c.lit == lit && channels.contains(&c.channel) && c.band == band)
                            .filter(|c| group.is_none_or(|g| c.group == g))
                            .filter(|c| difference.is_none_or(|d| c.difference_band == d))
                            .collect();
                        if chosen.is_empty() {
                            continue;
                        }
                        let count = chosen.len() as f64;
                        let rms = |value: &dyn Fn(&Cell) -> f64| {
                            (chosen.iter().map(|c| value(c).powi(2)).sum::<f64>() / count).sqrt()
                        };
                        let held = |k: usize| 100.0 * chosen.iter().filter(|c| c.held[k]).count() as f64 / count;
                        let _ = writeln!(
                            out,
                            "| {} | {}-{} | {} | {:.0} / {:.0} | {:.3} / {:.3} | {:.3} | {:.3} |",
                            group.map_or("all", |g| GROUPS[g]),
                            BANDS[band],
                            BANDS[band + 1],
                            difference.map_or("all".to_owned(), |d| format!(
                                "{}-{}",
                                DIFFERENCE_BANDS[d],
                                DIFFERENCE_BANDS[d + 1]
                            )),
                            held(0),
                            held(1),
                            needed(&chosen, 0, 0.9),
                            needed(&chosen, 1, 0.5),
                            rms(&|c| c.error),
                            rms(&|c| c.ends[0]),
                        );
                    }
                }
            }
        }
    }
    out
}
