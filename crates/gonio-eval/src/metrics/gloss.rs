//! Gloss of a BRDF.

use gonio::reflectance::{BivariateTable, THETA_D, THETA_H, diffuse_level, theta_d_of, theta_h_of};
use serde::{Deserialize, Serialize};

/// The highlight of a BRDF: its height and its width.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Gloss {
    /// Natural logarithm of the specular peak over the value of a Lambertian surface of the same
    /// albedo. The value is zero for a Lambertian surface, near 1 for satin paint, 6 for polished
    /// plastic, 10 for chrome. It is the gloss index of the benchmark. Unlike the other two values,
    /// it is well defined both for a metal without a diffuse part and for a surface without a
    /// highlight.
    pub(crate) peak: f64,
    /// Natural logarithm of the specular peak over the diffuse level: zero for a Lambertian
    /// surface, 3 for satin paint, above 10 for a mirror.
    pub(crate) contrast: f64,
    /// Half angle (radians) at which the excess over the diffuse level has fallen to half; `pi / 2`
    /// without a highlight.
    pub(crate) width: f64,
}

/// Largest `theta_d`, in degrees, at which highlights are measured: most photographs show this part
/// of the domain, and all measurements contain it.
const FURTHEST_D: f64 = 45.0;

impl Gloss {
    /// Measures the peak (`theta_h` below half a degree), averaged over `theta_d` up to 45 degrees,
    /// against the median of the trusted cells with `theta_h` above 45 degrees.
    pub(crate) fn of(table: &BivariateTable) -> Self {
        let diffuse = diffuse_level(table);
        let columns: Vec<usize> = (0..THETA_D).filter(|&j| theta_d_of(j).to_degrees() <= FURTHEST_D).collect();
        let profile: Vec<f64> = (0..THETA_H)
            .map(|i| columns.iter().map(|&j| f64::from(table.cell(i, j))).sum::<f64>() / columns.len() as f64)
            .collect();
        let near: Vec<f64> = (0..THETA_H).filter(|&i| theta_h_of(i).to_degrees() < 0.5).map(|i| profile[i]).collect();
        let peak = near.iter().sum::<f64>() / near.len() as f64;
        // Peak and diffuse level are at least a millionth of the peak, because a black diffuse part
        // is common in metals.
        let floor = (1e-6 * peak).max(1e-30);
        let contrast = (peak.max(floor) / diffuse.max(floor)).ln();
        let half = diffuse + 0.5 * (peak - diffuse);
        let width = if peak > 1.05 * diffuse { crossing(&profile, half) } else { std::f64::consts::FRAC_PI_2 };
        let albedo = table.normal_albedo();
        let relative = if albedo > 0.0 { (std::f64::consts::PI * peak.max(floor) / albedo).ln() } else { 0.0 };
        Self { peak: relative, contrast, width }
    }
}

/// Classes of materials by their highlight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Class {
    /// Almost no highlight: the peak is less than twice the mean.
    Matte,
    /// A broad highlight, up to thirty times the mean.
    Satin,
    /// A sharp highlight over a diffuse body that makes up at least two fifths of the albedo.
    DielectricGloss,
    /// A sharp highlight over little diffuse reflection, up to three thousand times the mean:
    /// metals, metallic paints.
    Metal,
    /// A sharper highlight, above three thousand times the mean.
    Mirror,
}

impl Class {
    /// All classes, from matte to mirror.
    pub(crate) const ALL: [Self; 5] = [Self::Matte, Self::Satin, Self::DielectricGloss, Self::Metal, Self::Mirror];

    /// Title for readers.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Matte => "matte",
            Self::Satin => "satin",
            Self::DielectricGloss => "dielectric gloss",
            Self::Metal => "metal",
            Self::Mirror => "mirror",
        }
    }

    /// Class of a highlight.
    pub(crate) fn of(gloss: &Gloss) -> Self {
        // pi * diffuse / albedo = exp(peak - contrast)
        let diffuse_share = (gloss.peak - gloss.contrast).exp();
        match gloss.peak {
            p if p < 0.7 => Self::Matte,
            p if p < 3.5 => Self::Satin,
            _ if diffuse_share >= 0.4 => Self::DielectricGloss,
            p if p < 8.0 => Self::Metal,
            _ => Self::Mirror,
        }
    }
}

/// Half angle (radians) at which the profile first falls below `level`, interpolated between
/// samples.
fn crossing(profile: &[f64], level: f64) -> f64 {
    match profile.iter().position(|&p| p < level) {
        None => std::f64::consts::FRAC_PI_2,
        Some(0) => theta_h_of(0),
        Some(i) => {
            let t = (profile[i - 1] - level) / (profile[i - 1] - profile[i]).max(1e-300);
            theta_h_of(i - 1) + t * (theta_h_of(i) - theta_h_of(i - 1))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lobe(peak: f64, width: f64) -> BivariateTable {
        BivariateTable::from_fn(|h, _| 1.0 + peak * (-std::f64::consts::LN_2 * (h / width).powi(2)).exp())
    }

    #[test]
    fn contrast_and_width_match_the_lobe() {
        for (peak, width) in [(4.0, 0.3), (100.0, 0.1), (3000.0, 0.02)] {
            let gloss = Gloss::of(&lobe(peak, width));
            assert!((gloss.contrast - (1.0 + peak).ln()).abs() < 0.05, "{peak} {gloss:?}");
            assert!((gloss.width / width - 1.0).abs() < 0.1, "{width} {gloss:?}");
        }
    }

    #[test]
    fn classes_follow_the_highlight() {
        let over = |diffuse: f64, peak: f64, width: f64| {
            Class::of(&Gloss::of(&BivariateTable::from_fn(|h, _| diffuse + peak * (-(h / width).powi(2)).exp())))
        };
        assert_eq!(over(1.0, 0.3, 0.3), Class::Matte);
        assert_eq!(over(1.0, 9.0, 0.1), Class::Satin);
        assert_eq!(over(1.0, 900.0, 0.01), Class::DielectricGloss);
        assert_eq!(over(0.01, 900.0, 0.03), Class::Metal);
        assert_eq!(over(0.0, 900.0, 0.002), Class::Mirror);
    }

    #[test]
    fn gloss_ignores_scale_and_a_lambertian_surface_has_no_highlight() {
        let a = lobe(20.0, 0.2);
        let scaled = a.scaled(1e-3);
        let (a, b) = (Gloss::of(&a), Gloss::of(&scaled));
        assert!((a.contrast - b.contrast).abs() < 1e-5 && (a.width - b.width).abs() < 1e-5);
        let flat = Gloss::of(&BivariateTable::from_fn(|_, _| 0.3));
        assert!(flat.peak.abs() < 1e-4 && flat.contrast.abs() < 1e-6 && flat.width > 1.5, "{flat:?}");
    }

    #[test]
    fn gloss_of_black_surfaces_is_finite() {
        let black = Gloss::of(&BivariateTable::from_fn(|_, _| 0.0));
        assert!(black.peak.is_finite() && black.contrast.is_finite() && black.width.is_finite());
        let no_diffuse = Gloss::of(&BivariateTable::from_fn(|h, _| if h < 0.05 { 900.0 } else { 0.0 }));
        assert!((10.0..15.0).contains(&no_diffuse.contrast), "{no_diffuse:?}");
    }
}
