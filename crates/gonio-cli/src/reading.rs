//! Options for reading the files of a photograph.

use std::path::PathBuf;

use gonio_app::{Curve, Reading};
use gonio_io::colour_space::ColourSpace;

use crate::space::SpaceName;

/// Options for reading a photograph.
#[derive(clap::Args)]
pub(crate) struct ReadingOptions {
    /// Interpret the values of an 8- or 16-bit image as linear radiance, not as sRGB
    ///
    /// For exposures, this is equivalent to --response linear.
    #[arg(long, conflicts_with = "response")]
    pub(crate) linear: bool,
    /// Exposure time of each image in seconds; overrides the EXIF data
    #[arg(long, value_name = "1/30,1/8,0.5,...", value_parser = parse_times)]
    times: Option<Times>,
    /// Use the exposure times without checking or correcting them
    ///
    /// gonio merges exposures that contradict each other, and ignores the inconsistent pixels.
    #[arg(long)]
    trust_times: bool,
    /// Do not align the exposures
    ///
    /// By default, gonio shifts exposures by whole pixels so that they match the first one.
    #[arg(long)]
    no_align: bool,
    /// Response curve of the camera [default: recovered from the exposures]
    ///
    /// FILE is a curve that gonio merge --save-response wrote; srgb is the sRGB curve; linear means
    /// that code values are proportional to radiance.
    #[arg(long, value_name = "FILE|srgb|linear")]
    response: Option<String>,
    /// Black level of linear 8- or 16-bit images, as a code value
    ///
    /// Codes run from 0 to 255 in 8-bit images and from 0 to 65535 in 16-bit images.
    #[arg(long, value_name = "CODE")]
    black_level: Option<f64>,
    /// Flat field: image of an evenly lit surface, taken with the same lens
    ///
    /// gonio divides the photograph by the flat field to remove vignetting.
    #[arg(long, value_name = "FILE")]
    flat: Option<PathBuf>,
    /// Layer to read from a multi-layer OpenEXR file
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Colour space of input images that do not state one [default: rec709]
    ///
    /// A file can state its colour space by chromaticities (EXR), PRIMARIES (HDR), cICP, cHRM or
    /// gAMA (PNG), or an ICC profile. The stated space takes precedence over this option; gonio
    /// warns if they differ. See docs/colour-spaces.md.
    #[arg(long, value_enum, value_name = "SPACE")]
    colorspace: Option<SpaceName>,
}

/// Exposure times in seconds.
#[derive(Clone, Debug)]
struct Times(Vec<f64>);

fn parse_times(text: &str) -> Result<Times, String> {
    let one = |word: &str| -> Option<f64> {
        let (a, b) = word.split_once('/').unwrap_or((word, "1"));
        let time = a.trim().parse::<f64>().ok()? / b.trim().parse::<f64>().ok()?;
        (time.is_finite() && time > 0.0).then_some(time)
    };
    let times: Option<Vec<f64>> = text.split(',').map(one).collect();
    times
        .map(Times)
        .ok_or_else(|| "expected positive times in seconds, separated by commas, such as 1/30,1/8,0.5".into())
}

impl ReadingOptions {
    /// The file of the flat field.
    pub(crate) fn flat(&self) -> &Option<PathBuf> {
        &self.flat
    }

    /// Returns the colour space of files that state none.
    pub(crate) fn colour_space(&self) -> Option<ColourSpace> {
        self.colorspace.map(|name| name.0)
    }

    /// Returns the settings for reading a photograph.
    pub(crate) fn reading(&self) -> Reading {
        Reading {
            linear: self.linear,
            times: self.times.as_ref().map(|times| times.0.clone()),
            response: self.response.as_deref().map(|name| match name {
                "srgb" => Curve::Srgb,
                "linear" => Curve::Linear,
                path => Curve::File(path.into()),
            }),
            no_align: self.no_align,
            trust_times: self.trust_times,
            black_level: self.black_level,
            flat: self.flat.clone(),
            layer: self.layer.clone(),
            colour_space: self.colour_space(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_fractions_or_numbers() {
        assert_eq!(parse_times("1/4, 0.5,2").unwrap().0, [0.25, 0.5, 2.0]);
        for bad in ["", "1/0", "0", "-1", "1,,2", "a", "1/2/3", "nan", "inf"] {
            assert!(parse_times(bad).is_err(), "{bad}");
        }
    }
}
