//! Published fits of parametric models to the MERL materials (Ngan et al. 2005), one text file per
//! model.
//!
//! A line is
//! `NAME = Aggregate(Lambertian(albedo = [r, g, b]), NganMODEL(albedo = [r, g, b], ...))`.

use std::path::Path;

use anyhow::{Context as _, Result};
use gonio::reflectance::BivariateTable;
use gonio::reflectance::parametric::{CookTorrance, Lafortune, Parametric, Ward};

/// Reads one channel of all materials of a file, in file order.
pub(super) fn read(path: &Path, channel: usize) -> Result<Vec<(String, BivariateTable)>> {
    let text = std::fs::read_to_string(path).with_context(|| format!("{}: cannot read the fits", path.display()))?;
    let lines = (1..).zip(text.lines()).filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let fit = |(number, line): (usize, &str)| {
        parse(line, channel).with_context(|| format!("{}: line {number} is not a fit of Ngan et al.", path.display()))
    };
    lines.map(fit).collect()
}

/// Parses a line: the name of the material, and one channel of its BRDF.
fn parse(line: &str, c: usize) -> Option<(String, BivariateTable)> {
    let (name, fit) = line.split_once(" = ")?;
    let numbers: Vec<f64> = fit.split(['[', ']', '(', ')', ',', ' ']).filter_map(|word| word.parse().ok()).collect();
    let (diffuse, specular) = (*numbers.get(c)?, *numbers.get(3 + c)?);
    let table = match (fit.split_once("Ngan")?.1.split_once('(')?.0, numbers.get(6..)?) {
        ("CookTorrance", &[f0, roughness]) => CookTorrance { diffuse, specular, f0, roughness }.to_bivariate(),
        ("Ward", &[roughness]) => Ward { diffuse, specular, roughness }.to_bivariate(),
        ("Lafortune", &[cxy, cz, exponent]) => Lafortune { diffuse, specular, cxy, cz, exponent }.to_bivariate(),
        _ => return None,
    };
    Some((name.to_owned(), table))
}

#[cfg(test)]
mod tests {
    use gonio_paper::training::{TrainSettings, train};

    use super::super::reflectance::rms;
    use super::*;
    use crate::metrics::median;

    #[test]
    fn the_three_models_parse() {
        let head = "a-1 = Aggregate(Lambertian(albedo = [0.1, 0.0, 1e-3]), Ngan";
        let (diffuse, specular) = (1e-3, 3.0);
        let cook_torrance = CookTorrance { diffuse, specular, f0: 0.117, roughness: 0.0137 };
        let lafortune = Lafortune { diffuse, specular, cxy: -0.577, cz: 0.577, exponent: 4060.0 };
        let ward = Ward { diffuse, specular, roughness: 0.5 };
        for (tail, table) in [
            ("CookTorrance(albedo = [1, 2, 3], eta = 0.117, roughness = 0.0137))", cook_torrance.to_bivariate()),
            ("Ward(albedo = [1, 2, 3], roughness = 0.5))", ward.to_bivariate()),
            ("Lafortune(albedo = [1, 2, 3], Cxy = -0.577, Cz = 0.577, sharpness = 4060.0))", lafortune.to_bivariate()),
        ] {
            assert_eq!(parse(&format!("{head}{tail}"), 2), Some(("a-1".to_owned(), table)), "{tail}");
        }
        for tail in ["Ward(albedo = [1, 2, 3]))", "Ward(albedo = [1, 2], roughness = 1))", "Phong(albedo = [1, 2, 3]))"]
        {
            assert_eq!(parse(&format!("{head}{tail}"), 2), None, "{tail}");
        }
    }

    #[test]
    #[ignore = "slow: fits 100 materials; tools/nightly.sh runs it"]
    fn rank_ten_beats_cook_torrance_by_thirteen_and_seven() {
        let Some(data) = std::env::var_os("GONIO_DATA").map(|data| Path::new(&data).join("merl")) else {
            return eprintln!("skipped: GONIO_DATA is not set");
        };
        let set = gonio_io::bivariate::read_bivariate_set(&data).unwrap();
        let materials: Vec<_> = set.into_iter().map(|(name, rgb)| (name, rgb[1].clone())).collect();
        let (_, report) = train(&materials, &TrainSettings::default()).unwrap();
        let (mut nmf, mut cook_torrance) = (Vec::new(), Vec::new());
        for (name, model) in read(&data.join("ngan2005_cooktorrance.fit"), 1).unwrap() {
            cook_torrance.push(rms(&model, &materials.iter().find(|(n, _)| *n == name).unwrap().1));
            nmf.push(report.fits.iter().find(|f| f.name == name).unwrap().rms);
        }
        assert_eq!(nmf.len(), 86);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let (means, medians) = (mean(&cook_torrance) / mean(&nmf), median(cook_torrance) / median(nmf));
        assert!(means > 13.0 && medians > 7.0, "ratios of mean {means:.2} and median {medians:.2}");
    }
}
