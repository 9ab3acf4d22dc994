//! The highlight of a material in terms that renderers and glossmeters use.

use super::material::{ALBEDO, MaterialEstimate};
use crate::gloss::{GgxWidths, Glossmeter};
use crate::inference::learnt::MaterialPosterior;
use crate::reflectance::trusted_cells;

/// Ratio between the ends of a 90 % interval above which it is reported as uncertain. Materials at
/// its two ends look clearly different.
pub const WIDE: f64 = 3.0;

/// Quantiles at 5, 50 and 95 % of the width and gloss of a highlight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Highlight {
    /// Width `alpha` of the GGX lobe of equal sharpness ([`GgxWidths`]); one if there is no
    /// highlight. The 5 % quantile is the sharpest.
    pub alpha: [f64; 3],
    /// Gloss units at 20 and 60 degrees ([`Glossmeter`]) of a material whose albedo along the
    /// normal is [`ALBEDO`]. They are proportional to that albedo, which a photograph under unknown
    /// illumination does not determine.
    pub units: [[f64; 3]; 2],
}

/// Finish of a surface in words, in increasing order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Finish {
    /// Roughness of at least 0.6, or fewer than 10 gloss units.
    Matte,
    /// Roughness of 0.4 to 0.6, or 10 to 35 gloss units.
    Satin,
    /// Roughness of 0.25 to 0.4, or 35 to 70 gloss units.
    SemiGloss,
    /// Roughness of 0.1 to 0.25.
    Gloss,
    /// Roughness below 0.1.
    Mirror,
}

impl Finish {
    /// Returns the finish that a roughness implies.
    fn of_roughness(roughness: f64) -> Self {
        match roughness {
            r if r < 0.1 => Self::Mirror,
            r if r < 0.25 => Self::Gloss,
            r if r < 0.4 => Self::SemiGloss,
            r if r < 0.6 => Self::Satin,
            _ => Self::Matte,
        }
    }

    /// Returns the finish that gloss units at 60 degrees imply.
    fn of_units(units: f64) -> Self {
        match units {
            units if units < 10.0 => Self::Matte,
            units if units < 35.0 => Self::Satin,
            units if units < 70.0 => Self::SemiGloss,
            _ => Self::Mirror,
        }
    }

    /// Returns the duller of the two finishes that roughness and gloss units at 60 degrees imply.
    ///
    /// A rough highlight is dull even if the surface reflects much light, and so is a sharp
    /// highlight that is hardly brighter than the body.
    fn of(roughness: f64, units: f64) -> Self {
        Self::of_roughness(roughness).min(Self::of_units(units))
    }

    /// Returns the name of the finish.
    pub fn name(self) -> &'static str {
        match self {
            Self::Matte => "matte",
            Self::Satin => "satin",
            Self::SemiGloss => "semi-gloss",
            Self::Gloss => "gloss",
            Self::Mirror => "mirror",
        }
    }
}

/// Describes the finish of a surface with this roughness and these gloss units at 60 degrees.
fn in_words(roughness: f64, units: f64) -> String {
    let finish = Finish::of(roughness, units);
    let is_weak = finish < Finish::of_roughness(roughness);
    format!("{}{}", finish.name(), if is_weak { " (weak highlight)" } else { "" })
}

/// Formats a positive number with two significant digits.
pub fn two_digits(value: f64) -> String {
    if !value.is_finite() || value <= 0.0 {
        return format!("{value}");
    }
    let digits = |value: f64| 1 - value.log10().floor() as i32;
    let rounded = |digits: i32| (value * 10_f64.powi(digits)).round() * 10_f64.powi(-digits);
    // Rounding may add a digit: 9.97 is 10.
    let digits = digits(rounded(digits(value)));
    if digits > 0 { format!("{value:.*}", digits as usize) } else { format!("{}", rounded(digits)) }
}

impl Highlight {
    /// Computes the quantiles of a posterior.
    pub fn of(posterior: &MaterialPosterior) -> Self {
        let (widths, shares) = (GgxWidths::new(), [0.05, 0.5, 0.95]);
        let three = |quantiles: Vec<f64>| [quantiles[0], quantiles[1], quantiles[2]];
        let alpha = posterior.number_quantiles(|table| widths.alpha_of(table).unwrap_or(1.0), &shares);
        // The draws have an albedo of one.
        let read = |meter: Glossmeter| {
            three(posterior.number_quantiles(|table| meter.read(table), &shares)).map(|units| ALBEDO * units)
        };
        Self {
            alpha: three(alpha).map(|alpha| alpha.min(1.0)),
            units: [Glossmeter::at_20(), Glossmeter::at_60()].map(read),
        }
    }

    /// Returns the roughness of the principled models of Mitsuba and Blender: `sqrt(alpha)`.
    pub fn roughness(&self) -> [f64; 3] {
        self.alpha.map(f64::sqrt)
    }
}

impl MaterialEstimate {
    /// Returns the ratio between the ends of the 90 % interval of the peak, relative to the body.
    pub fn peak_factor(&self) -> f64 {
        self.peak_height[2] / self.peak_height[0].max(1e-300)
    }

    /// Returns the share (0..=1) of the trusted cells whose 90 % interval spans more than `factor`.
    ///
    /// This measures the interval itself, whereas [`MaterialEstimate::undetermined_share`] compares
    /// it with the interval without the photograph.
    pub fn wider_than(&self, factor: f64) -> f64 {
        let (low, high) = (&self.quantiles[0], &self.quantiles[self.quantiles.len() - 1]);
        let trusted = trusted_cells();
        let (wide, all) = trusted.fold((0_usize, 0_usize), |(wide, all), c| {
            let is_wide = f64::from(high[c]) > factor * f64::from(low[c]);
            (wide + usize::from(is_wide), all + 1)
        });
        wide as f64 / all as f64
    }

    /// Returns the finish by the medians of roughness and gloss units, for an albedo of [`ALBEDO`].
    pub fn finish(&self) -> Finish {
        let [_, at_60] = self.highlight.units;
        Finish::of(self.highlight.roughness()[1], at_60[1])
    }

    /// Describes finish, roughness and peak height in one line, with 90 % intervals.
    pub fn verdict(&self) -> String {
        let [sharp, roughness, dull] = self.highlight.roughness();
        let [_, at_60] = self.highlight.units;
        let [low, peak, high] = self.peak_height.map(two_digits);
        format!(
            "{}: roughness {roughness:.2} ({sharp:.2} to {dull:.2}), peak height {peak} ({low} to {high})",
            in_words(roughness, at_60[1])
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoother_surfaces_have_a_higher_finish() {
        let names = [0.02, 0.1, 0.3, 0.41, 0.6, 1.0].map(|roughness| Finish::of(roughness, 100.0).name());
        assert_eq!(names, ["mirror", "gloss", "semi-gloss", "satin", "matte", "matte"]);
    }

    #[test]
    fn numbers_have_two_digits() {
        let numbers = [0.004_56, 0.997, 1.0, 9.94, 9.97, 12.4, 99.6, 1749.0, f64::INFINITY].map(two_digits);
        assert_eq!(numbers, ["0.0046", "1.0", "1.0", "9.9", "10", "12", "100", "1700", "inf"]);
    }

    #[test]
    fn weak_highlights_are_dull() {
        let names = [2.0, 20.0, 50.0, 70.0].map(|units| Finish::of(0.18, units).name());
        assert_eq!(names, ["matte", "satin", "semi-gloss", "gloss"]);
        assert_eq!(Finish::of(0.5, 1000.0), Finish::Satin);
        assert_eq!(in_words(0.18, 20.0), "satin (weak highlight)");
        assert_eq!([in_words(0.5, 20.0), in_words(0.18, 70.0)], ["satin", "gloss"]);
    }
}
