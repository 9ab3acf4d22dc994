//! Fig. 3: fits of a basis of few functions against parametric fits; the basis functions and how
//! materials use them.

use anyhow::{Context, Result};
use glam::Vec3;
use gonio::picture::Plane;
use gonio::reflectance::{BivariateTable, ReflectanceBasis, THETA_D, THETA_H, theta_d_of, theta_h_of, trusted_cells};
use gonio_paper::nmf::NmfSettings;
use gonio_paper::training::TrainSettings;
use maud::{Markup, html};

use super::context::{Material, PaperContext};
use super::fits;
use super::show::{self, Green};
use super::step;
use crate::bases::Trained;
use crate::metrics;
use gonio_report::page::chart::{self, Axis, Histogram, Series};
use gonio_report::page::{figure, table};

/// Materials rendered side by side.
const SHOWN: [&str; 6] =
    ["red-fabric", "pearl-paint", "blue-metallic-paint", "gold-metallic-paint2", "red-phenolic", "nickel"];
/// Ranks whose bases are rendered; the table also has [`FINEST`].
const RANKS: [usize; 3] = [3, 5, 10];
const FINEST: usize = 20;
/// The published fits, by name and file.
const MODELS: [(&str, &str); 3] = [
    ("Cook-Torrance", "ngan2005_cooktorrance.fit"),
    ("Ward", "ngan2005_ward.fit"),
    ("Lafortune", "ngan2005_lafortune.fit"),
];
/// Errors that the paper reports, mean and median, on the original measurements.
const PAPER: [(&str, f64, f64); 2] = [("NMF, K = 10", 1.58, 0.45), ("Cook-Torrance", 46.91, 17.11)];
const GREEN: usize = 1;

/// RMS errors (1/sr, green channel, trusted cells) of the materials that have published fits.
struct Errors {
    name: String,
    rms: Vec<f64>,
}

pub(super) fn section(context: &PaperContext) -> Result<Markup> {
    let green: Vec<(String, BivariateTable)> =
        context.all.names.iter().enumerate().map(|(at, name)| (name.clone(), context.all.green(at).clone())).collect();
    let trained = |rank: usize, cost_margin: f64| {
        let nmf = NmfSettings { rank, ..NmfSettings::default() };
        let settings = TrainSettings { nmf, cost_margin };
        step(&format!("Fig. 3, basis of rank {rank}"), || Trained::load_or_train(&context.cache, &green, &settings))
    };
    let margin = TrainSettings::default().cost_margin;
    let bases = RANKS.iter().map(|&rank| trained(rank, margin)).collect::<Result<Vec<_>>>()?;
    let ten = &bases[2];
    let (least, finest) = (trained(RANKS[2], 0.0)?, trained(FINEST, margin)?);
    let fits = MODELS
        .iter()
        .map(|(name, file)| (*name, context.data.join("merl").join(file)))
        // The database itself does not include the fits.
        .filter(|(_, path)| path.is_file())
        .map(|(name, path)| Ok((name, fits::read(&path, GREEN)?)))
        .collect::<Result<Vec<_>>>()?;
    let names: Vec<&str> = match fits.first() {
        Some((_, fits)) => fits.iter().map(|(name, _)| name.as_str()).collect(),
        None => context.all.names.iter().map(String::as_str).collect(),
    };
    let of_basis = |name: String, trained: &Trained| Errors {
        name,
        rms: trained.report.fits.iter().filter(|f| names.contains(&f.name.as_str())).map(|f| f.rms).collect(),
    };
    let mut errors: Vec<Errors> =
        RANKS.iter().zip(&bases).map(|(k, trained)| of_basis(format!("NMF, K = {k}"), trained)).collect();
    errors.push(of_basis(format!("NMF, K = {}, strictly least cost", RANKS[2]), &least));
    errors.push(of_basis(format!("NMF, K = {FINEST}"), &finest));
    step("Fig. 3, published fits", || {
        for (name, fits) in &fits {
            let rms = fits.iter().map(|(material, fit)| {
                let reference = green.iter().find(|(n, _)| n == material);
                let (_, reference) = reference.with_context(|| format!("there is no material {material}"))?;
                Ok(rms(fit, reference))
            });
            errors.push(Errors { name: (*name).to_owned(), rms: rms.collect::<Result<_>>()? });
        }
        Ok(())
    })?;
    let cards = step("Fig. 3, pictures", || {
        let cook_torrance = fits.first().map_or(&[][..], |(_, fits)| fits);
        let shown = context.materials.iter().filter(|m| SHOWN.contains(&m.name));
        shown.map(|m| spheres(context, m, &bases, cook_torrance)).collect::<Result<Vec<_>>>()
    })?;
    Ok(html! {
        h3 { "Fits" }
        p {
            "The non-negative basis with " (RANKS[0]) ", " (RANKS[1]) " and " (RANKS[2]) " functions, the material itself, and the published "
            "Cook-Torrance fit, under " (super::context::NOVEL.1) ", in the green channel, on which the bases were trained, shown in grey. "
            "All five have the exposure of the material itself. The fits minimise the squared error over the table, in which the dark parts of a BRDF "
            "with a bright highlight have little weight."
        }
        (figure::grid(30, &cards))
        (comparison(&errors, names.len()))
        (functions(ten))
    })
}

/// Root mean square difference over the trusted cells, each counting once.
pub(super) fn rms(a: &BivariateTable, b: &BivariateTable) -> f64 {
    let (sum, count) = trusted_cells()
        .fold((0.0, 0.0), |(sum, count), c| (sum + f64::from(a.as_slice()[c] - b.as_slice()[c]).powi(2), count + 1.0));
    (sum / count).sqrt()
}

fn spheres(
    context: &PaperContext,
    material: &Material,
    bases: &[Trained],
    fits: &[(String, BivariateTable)],
) -> Result<Markup> {
    let name = material.name;
    let reference = context.all.green(context.all.index(name)?);
    let truth = show::sphere(&Green(&material.full), &context.novel);
    let exposure = show::exposure(&truth);
    let tile = |label: String, picture: &gonio::picture::Picture| {
        let alt = format!("Sphere of {name}, green channel: {label}");
        (label, figure::picture(&show::display(picture, exposure), &alt))
    };
    let mut tiles = Vec::new();
    for (rank, trained) in RANKS.iter().zip(bases) {
        let fitted = trained.basis.combine(&trained.basis.project(reference)?)?;
        tiles.push(tile(format!("K = {rank}"), &show::sphere(&fitted, &context.novel)));
    }
    tiles.push(tile("truth".into(), &truth));
    let model = fits.iter().find(|(n, _)| n == name).map(|(_, fit)| fit.clone());
    if let Some(model) = &model {
        tiles.push(tile("Cook-Torrance".into(), &show::sphere(model, &context.novel)));
    }
    let tiles: Vec<(&str, Markup)> = tiles.iter().map(|(label, html)| (label.as_str(), html.clone())).collect();
    let errors: Vec<String> = RANKS
        .iter()
        .zip(bases)
        .filter_map(|(k, t)| {
            t.report.fits.iter().find(|f| f.name == name).map(|f| format!("{} with K = {k}", short(f.rms)))
        })
        .collect();
    let caption = html! {
        "RMS in green, 1/sr: " (errors.join(", "))
        @if let Some(model) = &model { "; Cook-Torrance " (short(rms(model, reference))) }
    };
    Ok(figure::card(name, &figure::tiles(&tiles), &caption))
}

/// Formats an error with four decimals below 0.1, and with two above.
fn short(error: f64) -> String {
    if error < 0.1 { format!("{error:.4}") } else { format!("{error:.2}") }
}

fn comparison(errors: &[Errors], count: usize) -> Markup {
    let statistics = |e: &Errors| (metrics::mean(&e.rms), metrics::median(e.rms.clone()));
    let rows: Vec<Vec<String>> = errors
        .iter()
        .map(|e| {
            let (mean, median) = statistics(e);
            let paper = PAPER.iter().find(|(name, ..)| *name == e.name);
            let of_paper = |f: &dyn Fn(&(&str, f64, f64)) -> f64| paper.map_or("".into(), |p| format!("{:.2}", f(p)));
            vec![e.name.clone(), format!("{mean:.2}"), format!("{median:.2}"), of_paper(&|p| p.1), of_paper(&|p| p.2)]
        })
        .collect();
    let sets: Vec<(&str, Vec<f64>)> =
        errors.iter().filter(|e| !e.name.contains("strictly")).map(|e| (e.name.as_str(), e.rms.clone())).collect();
    let find = |name: &str| errors.iter().find(|e| e.name == name).map(statistics);
    let ratio = match (find(PAPER[0].0), find(PAPER[1].0)) {
        (Some(nmf), Some(ct)) => format!(
            "The error of Cook-Torrance is {:.1} times (mean) and {:.1} times (median) that of ten functions; in the paper, {:.1} and {:.1} times.",
            ct.0 / nmf.0,
            ct.1 / nmf.1,
            PAPER[1].1 / PAPER[0].1,
            PAPER[1].2 / PAPER[0].2
        ),
        _ => String::new(),
    };
    html! {
        h3 { "Error of the fits" }
        (table::table(
            &format!("RMS error in 1/sr, green channel, angles below 80 degrees, {count} materials"),
            &["model", "mean", "median", "paper, mean", "paper, median"],
            &rows,
        ))
        p { (ratio) " The paper's numbers are for the original measurements." }
        (figure::figure(
            &chart::ecdf("RMS error over the materials", "RMS error (1/sr)", Axis::Log, &sets),
            &html! { "For each model, the share of the " (count) " materials whose error is at most that on the horizontal axis." },
        ))
    }
}

/// Finds the most specular function of a basis, and the most grazing one of the others.
///
/// Specularity is the ratio of a function's mean over `theta_h < 5`, `theta_d < 60` degrees to its
/// mean over all trusted cells. Grazing reflection is the ratio of its mean over `theta_h < 30`,
/// `theta_d > 65` to its mean over the same `theta_h` at `theta_d < 45`.
fn specular_and_grazing(basis: &ReflectanceBasis) -> Option<(usize, usize)> {
    let mean = |table: &BivariateTable, keep: &dyn Fn(f64, f64) -> bool| {
        let cells: Vec<f64> = trusted_cells()
            .filter(|c| keep(theta_h_of(c / THETA_D).to_degrees(), theta_d_of(c % THETA_D).to_degrees()))
            .map(|c| f64::from(table.as_slice()[c]))
            .collect();
        metrics::mean(&cells)
    };
    let ratio = |a: f64, b: f64| a / b.max(1e-6);
    let specular = |t: &BivariateTable| ratio(mean(t, &|h, d| h < 5.0 && d < 60.0), mean(t, &|_, _| true));
    let grazing =
        |t: &BivariateTable| ratio(mean(t, &|h, d| h < 30.0 && d > 65.0), mean(t, &|h, d| h < 30.0 && d < 45.0));
    let f = &basis.functions;
    let first = (0..f.len()).max_by(|&a, &b| specular(&f[a]).total_cmp(&specular(&f[b])))?;
    let second = (0..f.len()).filter(|k| *k != first).max_by(|&a, &b| grazing(&f[a]).total_cmp(&grazing(&f[b])))?;
    Some((first, second))
}

fn functions(trained: &Trained) -> Markup {
    let basis = &trained.basis;
    let Some((specular, grazing)) = specular_and_grazing(basis) else { return html! {} };
    let figures: Vec<Markup> = [("grazing", grazing), ("specular", specular)]
        .into_iter()
        .map(|(word, k)| {
            let function = &basis.functions[k];
            let grey = Plane::from_fn(THETA_D, THETA_H, |x, y| Vec3::splat(function.cell(y, x)));
            let picture = figure::cells(&grey, &format!("Basis function {k}, the most {word} one"), 3);
            let coefficients: Vec<f64> = basis.materials.iter().map(|m| m.coefficients[k]).collect();
            figure::card(
                &format!("Function {k}: the most {word}"),
                &html! {
                    (figure::tiles(&[("theta_d from 0 to 90 degrees across, theta_h down", picture)]))
                    (usage(&coefficients, basis.rates[k]))
                },
                &html! {
                    "Brightness is the value, at most one over the trusted cells. Zero in "
                    (coefficients.iter().filter(|c| **c <= 1e-9).count()) " of " (coefficients.len()) " materials; mean coefficient "
                    (format!("{:.3}", 1.0 / basis.rates[k])) "."
                },
            )
        })
        .collect();
    html! {
        h3 { "Two of the ten functions, and how materials use them" }
        p {
            "Rows are MERL's theta_h samples, dense at the top: highlights are at the top edge, grazing reflection at the top right, "
            "retro-reflection at the left. The charts show the coefficients of all " (basis.materials.len())
            " materials, each scaled to maximum one, and their prior, the exponential of the same mean."
        }
        (figure::grid(20, &figures))
    }
}

/// Histogram of the coefficients of one function.
fn usage(coefficients: &[f64], rate: f64) -> Markup {
    let largest = coefficients.iter().copied().fold(1e-9, f64::max);
    let reach = 1.02 * largest;
    let histogram = Histogram::new(coefficients, 0.0, reach, 20);
    let curve = (0..=100).map(|i| f64::from(i) / 100.0 * reach).map(|x| (x, rate * (-rate * x).exp())).collect();
    let exponential = Series::line(format!("exponential, rate {rate:.1}"), curve);
    chart::histogram("Coefficients", "coefficient", &histogram, &[exponential], Axis::Log)
}

#[cfg(test)]
mod tests {
    use gonio::reflectance::CELLS;

    use super::*;

    fn basis(functions: Vec<BivariateTable>) -> ReflectanceBasis {
        ReflectanceBasis { rates: vec![1.0; functions.len()], functions, materials: Vec::new() }
    }

    #[test]
    fn finds_the_specular_and_the_grazing_function() {
        let flat = BivariateTable::from_fn(|_, _| 1.0);
        let lobe = BivariateTable::from_fn(|h, _| (-(h / 0.03).powi(2)).exp());
        let broad = BivariateTable::from_fn(|h, _| (-(h / 0.4).powi(2)).exp());
        let edge = BivariateTable::from_fn(|h, d| (-(h / 0.2).powi(2)).exp() * d.sin().powi(12));
        let functions = vec![flat.clone(), edge, broad, lobe];
        assert_eq!(specular_and_grazing(&basis(functions)), Some((3, 1)));
        assert_eq!(specular_and_grazing(&basis(vec![flat])), None);
        assert_eq!(specular_and_grazing(&basis(vec![])), None);
    }

    #[test]
    fn rms_counts_trusted_cells_only() {
        let zero = BivariateTable::from_fn(|_, _| 0.0);
        let mut two = BivariateTable::from_fn(|_, _| 2.0);
        assert!((rms(&zero, &two) - 2.0).abs() < 1e-12);
        two.as_mut_slice()[CELLS - 1] = 1e9;
        assert!((rms(&zero, &two) - 2.0).abs() < 1e-12);
    }
}
