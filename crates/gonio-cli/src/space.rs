//! Options for colour spaces.

use clap::ValueEnum;
use clap::builder::PossibleValue;
use gonio_io::colour_space::ColourSpace;

/// Name of a colour space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SpaceName(pub(crate) ColourSpace);

impl ValueEnum for SpaceName {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [SpaceName; 6] = {
            let [a, b, c, d, e, f] = ColourSpace::ALL;
            [SpaceName(a), SpaceName(b), SpaceName(c), SpaceName(d), SpaceName(e), SpaceName(f)]
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()).aliases(self.0.aliases()).help(self.0.description()))
    }
}

/// Option for the colour space of the output.
#[derive(Clone, clap::Args)]
pub(crate) struct OutputSpace {
    /// Linear colour space of the BRDF and light files to write [default: rec709]
    ///
    /// PNG images for display are always sRGB.
    #[arg(long, value_enum, value_name = "SPACE", help_heading = "Output")]
    output_colorspace: Option<SpaceName>,
}

impl OutputSpace {
    /// Returns the space.
    pub(crate) fn space(&self) -> ColourSpace {
        self.output_colorspace.map_or(ColourSpace::Rec709, |name| name.0)
    }
}
