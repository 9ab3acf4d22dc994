//! Misfits of estimates, for the calibration of
//! [`expected_misfit`](gonio::estimate::expected_misfit).

use std::fmt::Write;

/// Bounds of the classes of gloss: natural logarithms of the peak height.
const CLASSES: [f64; 6] = [f64::NEG_INFINITY, 1.5, 3.5, 6.0, 8.5, f64::INFINITY];

/// Bounds of the classes of the misfit over the expected one. The last one carries a warning.
const RATIOS: [f64; 5] = [0.0, 0.5, 1.0, 1.25, f64::INFINITY];

/// Number of photographs listed.
const LISTED: usize = 8;

/// Misfit of a photograph under unknown light.
#[derive(Clone, Debug)]
pub(super) struct Residual {
    pub misfit: f64,
    pub expected: f64,
    /// Share of fine detail in the photograph.
    pub fineness: f64,
    /// Median of the peak height.
    pub peak_height: f64,
    /// Error of the BRDF: root mean square logarithm.
    pub error: f64,
    /// Material and light.
    pub name: String,
}

impl Residual {
    fn over_expected(&self) -> f64 {
        self.misfit / self.expected
    }
}

/// Returns a table of the misfits by gloss, and the largest misfits relative to the expected ones.
pub(super) fn report(all: &[Residual]) -> String {
    let mut out = String::from(
        "\n| logarithm of the peak height | photographs | median of it | misfit: median | 80 % | 95 % | misfit over \
         expected: median | 95 % |\n|---|---|---|---|---|---|---|---|\n",
    );
    for bounds in CLASSES.windows(2) {
        let class: Vec<&Residual> =
            all.iter().filter(|one| (bounds[0]..bounds[1]).contains(&one.peak_height.ln())).collect();
        if class.is_empty() {
            continue;
        }
        let at = |value: &dyn Fn(&Residual) -> f64, share| quantile(&class, value, share);
        let _ = writeln!(
            out,
            "| {:.1} to {:.1} | {} | {:.1} | {:.3} | {:.3} | {:.3} | {:.2} | {:.2} |",
            bounds[0],
            bounds[1],
            class.len(),
            at(&|one| one.peak_height.ln(), 0.5),
            at(&|one| one.misfit, 0.5),
            at(&|one| one.misfit, 0.8),
            at(&|one| one.misfit, 0.95),
            at(&Residual::over_expected, 0.5),
            at(&Residual::over_expected, 0.95)
        );
    }
    out += "\n| misfit over expected | photographs | BRDF error: median | 80 % |\n|---|---|---|---|\n";
    for bounds in RATIOS.windows(2) {
        let class: Vec<&Residual> =
            all.iter().filter(|one| (bounds[0]..bounds[1]).contains(&one.over_expected())).collect();
        if !class.is_empty() {
            let [middle, large] = [0.5, 0.8].map(|share| quantile(&class, &|one| one.error, share));
            let _ = writeln!(out, "| {} to {} | {} | {middle:.2} | {large:.2} |", bounds[0], bounds[1], class.len());
        }
    }
    let mut sorted: Vec<&Residual> = all.iter().collect();
    sorted.sort_by(|a, b| b.over_expected().total_cmp(&a.over_expected()));
    out += "\nlargest misfits relative to the expected ones:\n";
    for one in sorted.iter().take(LISTED) {
        let _ = writeln!(
            out,
            "* {}: {:.3} of {:.3}, fineness {:.3}, peak height {:.0}, BRDF error {:.2}",
            one.name, one.misfit, one.expected, one.fineness, one.peak_height, one.error
        );
    }
    out
}

fn quantile(class: &[&Residual], value: &dyn Fn(&Residual) -> f64, share: f64) -> f64 {
    let mut values: Vec<f64> = class.iter().map(|one| value(one)).collect();
    values.sort_by(f64::total_cmp);
    values[(share * (values.len() - 1) as f64).round() as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_classes_of_gloss_and_the_largest_misfits() {
        let one = |i: usize| Residual {
            misfit: 0.01 * (1 + i) as f64,
            expected: 0.1,
            fineness: 0.2,
            peak_height: if i.is_multiple_of(2) { 1.0 } else { 150.0 },
            error: 0.02 * i as f64,
            name: format!("ball {i}"),
        };
        let text = report(&(0..40).map(one).collect::<Vec<_>>());
        assert!(text.contains("| -inf to 1.5 | 20 | 0.0 | 0.210 | 0.310 | 0.370 | 2.10 | 3.70 |"), "{text}");
        assert!(text.contains("| 3.5 to 6.0 | 20 | 5.0 | 0.220 | 0.320 | 0.380 | 2.20 | 3.80 |"), "{text}");
        assert!(text.contains("| 1.25 to inf | 28 | 0.52 | 0.68 |"), "{text}");
        assert!(text.contains("* ball 39: 0.400 of 0.100") && !text.contains("ball 31:"), "{text}");
    }
}
