//! How the files of a photograph are read, as the options say it.

use std::path::PathBuf;

use gonio_app::{Curve, Reading};
use gonio_io::colour_space::ColourSpace;

use crate::space::SpaceName;

/// Options of reading a photograph.
#[derive(clap::Args)]
pub(crate) struct ReadingOptions {
    /// Values of an integer picture are linear radiance, not sRGB-coded
    ///
    /// For exposures it is the same as --response linear.
    #[arg(long, conflicts_with = "response")]
    pub(crate) linear: bool,
    /// Exposure times in seconds, in place of those of the EXIF data
    #[arg(long, value_name = "1/30,1/8,0.5,...", value_parser = parse_times)]
    times: Option<Times>,
    /// The camera's curve, if it is not to be recovered from the exposures
    ///
    /// srgb, linear, or a file as gonio merge --save-response writes.
    #[arg(long, value_name = "FILE|srgb|linear")]
    response: Option<String>,
    /// Black level of linear integer files, in their codes
    ///
    /// 0 to 255, or to 65535.
    #[arg(long, value_name = "CODE")]
    black_level: Option<f64>,
    /// Picture of an evenly lit surface by the same lens, to divide by
    ///
    /// It takes vignetting away.
    #[arg(long, value_name = "FILE")]
    flat: Option<PathBuf>,
    /// Layer of an OpenEXR file that holds several
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Colour space of files that state none, light maps too [default: rec709]
    ///
    /// A file states its space by chromaticities (EXR), PRIMARIES (HDR), cICP, cHRM or gAMA (PNG)
    /// or an ICC profile; that space is used, with a warning if this one differs. See
    /// docs/colour-spaces.md.
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
    times.map(Times).ok_or_else(|| "give positive times in seconds with commas between, like 1/30,1/8,0.5".into())
}

impl ReadingOptions {
    /// Returns the colour space of files that state none.
    pub(crate) fn colour_space(&self) -> Option<ColourSpace> {
        self.colorspace.map(|name| name.0)
    }

    /// Returns the settings that the options ask for.
    pub(crate) fn reading(&self) -> Reading {
        Reading {
            linear: self.linear,
            times: self.times.as_ref().map(|times| times.0.clone()),
            response: self.response.as_deref().map(|name| match name {
                "srgb" => Curve::Srgb,
                "linear" => Curve::Linear,
                path => Curve::File(path.into()),
            }),
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
