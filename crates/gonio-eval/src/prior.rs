//! `gonio-eval prior`: evaluates the prior of materials alone, without training.
//!
//! A material that the prior was not built from should lie near the axes of the prior and near some
//! of its draws. It should also lie within the intervals of draws that resemble it: the draws that
//! agree best in the other bands of half angles predict the cells of each band.

use std::path::Path;

use anyhow::Result;
use gonio::reflectance::{
    BivariateTable, Dictionary, DictionarySettings, LatentSpace, LogBasis, MaterialKind, Prior, THETA_D, THETA_H,
    theta_d_of, theta_h_of,
};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use crate::calibration::{BANDS, band_of};
use crate::metrics::median;

/// Largest difference angle that is compared, in degrees; beyond it, real measurements are
/// unreliable.
const MAX_DIFFERENCE_ANGLE: f64 = 60.0;

/// Smallest compared value, relative to the largest of a table: reconstructed values below it are
/// accurate only to a factor of 1.5 to 2.
const VALUE_FLOOR: f64 = 1e-5;

/// Number of draws in a tested interval: those that resemble a material best.
const NEIGHBOURS: usize = 150;

/// Options of `gonio-eval prior`.
#[derive(clap::Args)]
pub(crate) struct PriorOptions {
    /// Build the prior also from the 41 extra measurements, instead of testing with them
    #[arg(long)]
    extra: bool,
    /// Number of draws
    #[arg(long, default_value_t = 16_384)]
    draws: usize,
    /// Number of axes
    #[arg(long, default_value_t = DictionarySettings::default().dimensions)]
    dimensions: usize,
    /// Share of the draws with a smooth random field
    #[arg(long, default_value_t = Prior::default().fields)]
    fields: f64,
    /// Draw no car paints and no dark bodies
    #[arg(long)]
    without_paints: bool,
}

pub(crate) fn run(data: &Path, options: &PriorOptions) -> Result<()> {
    let luminances = |folder: &str| -> Result<Vec<(String, BivariateTable)>> {
        let set = gonio_io::bivariate::read_bivariate_set(data.join(folder))?;
        let table = |(name, rgb): (String, [BivariateTable; 3])| {
            let mut table = BivariateTable::luminance(&rgb);
            table.extend_from_trusted();
            (name, table)
        };
        Ok(set.into_iter().map(table).collect())
    };
    let (mut known, extra) = (luminances("merl")?, luminances("measured_extra")?);
    let mut groups = Vec::new();
    if options.extra {
        known.extend(extra);
    } else {
        groups.push(("left-out reconstructed measurements", extra.into_iter().map(|(_, table)| table).collect()));
    }
    let mut real = Vec::new();
    for (_, rgb) in crate::out_of_domain::rgl_tables(&data.join("rgl"))? {
        real.push(BivariateTable::luminance(&rgb));
        real.extend(rgb);
    }
    groups.push(("RGL files, luminance and channels", real));
    groups.push(("formulas", crate::out_of_domain::formulas().iter().map(|(_, f)| f.to_bivariate()).collect()));
    let mut prior = Prior { fields: options.fields, ..Prior::default() };
    if options.without_paints {
        let kinds: Vec<MaterialKind> =
            MaterialKind::ALL.into_iter().filter(|k| !matches!(k, MaterialKind::Flakes | MaterialKind::Dark)).collect();
        prior.shares = Prior::of(&kinds).shares;
    }
    let settings = DictionarySettings { dimensions: options.dimensions, prior, ..DictionarySettings::default() };
    let dictionary = Dictionary::new(LogBasis::fit(&known, LogBasis::RANK), &settings);
    let cells = Cells::new();
    let draw = |number: usize| {
        let mut rng = Pcg64::seed_from_u64(1_000_000 + number as u64);
        cells.logs(&dictionary.table(&dictionary.draw(&prior, &mut rng)))
    };
    let draws: Vec<Vec<f64>> = (0..options.draws).into_par_iter().map(draw).collect();
    println!(
        "| materials | number | off the axes | nearest draw | 90 % intervals, by band of half angles | widths (ln) |"
    );
    println!("|---|---|---|---|---|---|");
    for (name, tables) in groups {
        let judged: Vec<Judged> =
            tables.par_iter().map(|table| judge(&cells, &dictionary.latent_space, &draws, table)).collect();
        let of = |f: &dyn Fn(&Judged) -> f64| median(judged.iter().map(f).collect());
        let mean = |f: &dyn Fn(&Judged) -> f64| judged.iter().map(f).sum::<f64>() / judged.len() as f64;
        let covered: Vec<String> = (0..6).map(|b| format!("{:.0}", 100.0 * mean(&|j| j.covered[b]))).collect();
        let widths: Vec<String> = (0..6).map(|b| format!("{:.1}", of(&|j| j.widths[b]))).collect();
        println!(
            "| {name} | {} | {:.2} | {:.2} | {} | {} |",
            judged.len(),
            of(&|j| j.off_axes),
            of(&|j| j.nearest),
            covered.join(" "),
            widths.join(" ")
        );
    }
    Ok(())
}

/// Cells at which tables are compared.
struct Cells {
    cells: Vec<usize>,
    /// Band of each cell.
    bands: Vec<usize>,
}

/// Distances of a material from the prior, and predictions of draws that resemble it.
struct Judged {
    /// Root mean square of the logarithm of the material over its projection to the axes.
    off_axes: f64,
    /// The same for the nearest draw.
    nearest: f64,
    /// Share of the cells of each band inside the interval of draws that resemble the material in
    /// the other bands.
    covered: [f64; 6],
    /// Mean width of these intervals, in the logarithm.
    widths: [f64; 6],
}

impl Cells {
    fn new() -> Self {
        let (mut cells, mut bands) = (Vec::new(), Vec::new());
        let end = BANDS[BANDS.len() - 1].to_radians();
        for row in (1..THETA_H).step_by(2).filter(|&row| theta_h_of(row) < end) {
            let band = band_of(&BANDS, theta_h_of(row));
            for column in (2..THETA_D).step_by(5).filter(|&c| theta_d_of(c).to_degrees() < MAX_DIFFERENCE_ANGLE) {
                cells.push(row * THETA_D + column);
                bands.push(band);
            }
        }
        Self { cells, bands }
    }

    fn logs(&self, table: &BivariateTable) -> Vec<f64> {
        let values: Vec<f64> = self.cells.iter().map(|&c| f64::from(table.as_slice()[c])).collect();
        let floor = VALUE_FLOOR * values.iter().copied().fold(0.0, f64::max);
        values.iter().map(|v| v.max(floor).max(1e-30).ln()).collect()
    }
}

/// Returns the mean of the differences over chosen cells, and their root mean square about the
/// mean.
fn difference(a: &[f64], b: &[f64], chosen: &[usize]) -> (f64, f64) {
    let (mut sum, mut squares) = (0.0, 0.0);
    for &cell in chosen {
        let difference = a[cell] - b[cell];
        (sum, squares) = (sum + difference, squares + difference * difference);
    }
    let (mean, square) = (sum / chosen.len() as f64, squares / chosen.len() as f64);
    (mean, (square - mean * mean).max(0.0).sqrt())
}

fn judge(cells: &Cells, coordinates: &LatentSpace, draws: &[Vec<f64>], table: &BivariateTable) -> Judged {
    let truth = cells.logs(table);
    let projected = &coordinates.tables(&[coordinates.of(table)])[0];
    let all: Vec<usize> = (0..truth.len()).collect();
    let nearest = draws.iter().map(|draw| difference(&truth, draw, &all).1).fold(f64::INFINITY, f64::min);
    let (mut covered, mut widths) = ([0.0; 6], [0.0; 6]);
    for band in 0..6 {
        let (inside, others): (Vec<usize>, Vec<usize>) = all.iter().partition(|&&cell| cells.bands[cell] == band);
        let mut like: Vec<(f64, f64, usize)> = draws
            .iter()
            .enumerate()
            .map(|(at, draw)| {
                let (mean, rms) = difference(&truth, draw, &others);
                (rms, mean, at)
            })
            .collect();
        like.sort_by(|a, b| a.0.total_cmp(&b.0));
        like.truncate(NEIGHBOURS);
        for &cell in &inside {
            let mut values: Vec<f64> = like.iter().map(|(_, mean, at)| draws[*at][cell] + mean).collect();
            values.sort_by(f64::total_cmp);
            let end = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
            let (low, high) = (end(0.05), end(0.95));
            covered[band] += f64::from(u8::from((low..=high).contains(&truth[cell]))) / inside.len() as f64;
            widths[band] += (high - low) / inside.len() as f64;
        }
    }
    Judged { off_axes: difference(&truth, &cells.logs(projected), &all).1, nearest, covered, widths }
}
