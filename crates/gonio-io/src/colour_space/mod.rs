//! Colour spaces of pictures: named spaces and the matrices between them and the working space.
//!
//! Every colour inside gonio is linear Rec. 709 with white D65. This module contains the linear
//! algebra; `picture` reads the colour space of a file and converts its colours.

mod primaries;

use glam::{DMat3, DVec2, DVec3, Vec3};

pub use primaries::{D65, Primaries, bradford};

/// A named colour space.
///
/// All numbers in memory are linear, so a space consists of primaries and a white point. Reading a
/// picture applies the curve of integer files of the space.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ColourSpace {
    /// Rec. ITU-R BT.709 primaries, white D65; the primaries of sRGB. The working space.
    #[default]
    Rec709,
    /// Display P3: DCI-P3 primaries (SMPTE EG 432-1), white D65.
    DisplayP3,
    /// Rec. ITU-R BT.2020 primaries, white D65.
    Rec2020,
    /// ACEScg: AP1 primaries, white near D60 (Academy S-2014-004).
    AcesCg,
    /// ACES2065-1: AP0 primaries, white near D60 (SMPTE ST 2065-1).
    Aces2065,
    /// CIE 1931 XYZ, relative to D65: white is (0.9505, 1, 1.0891). No chromatic adaptation
    /// applies.
    Xyz,
}

/// Largest difference between elements of two matrices of the same space. ICC profiles and image
/// files round their numbers.
const SAME_SPACE: f64 = 2e-3;

impl ColourSpace {
    /// All named spaces.
    pub const ALL: [Self; 6] = [Self::Rec709, Self::DisplayP3, Self::Rec2020, Self::AcesCg, Self::Aces2065, Self::Xyz];

    /// Returns the name in options and in `result.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rec709 => "rec709",
            Self::DisplayP3 => "display-p3",
            Self::Rec2020 => "rec2020",
            Self::AcesCg => "acescg",
            Self::Aces2065 => "aces2065-1",
            Self::Xyz => "xyz",
        }
    }

    /// Returns other names that [`named`](Self::named) accepts.
    pub fn aliases(self) -> &'static [&'static str] {
        match self {
            Self::Rec709 => &["srgb"],
            Self::DisplayP3 => &["p3"],
            Self::Rec2020 => &["bt2020"],
            Self::AcesCg => &["ap1"],
            Self::Aces2065 => &["aces", "ap0"],
            Self::Xyz => &[],
        }
    }

    /// Returns the description for help texts.
    pub fn description(self) -> &'static str {
        match self {
            Self::Rec709 => "Rec. 709 primaries, white point D65; integer files use the sRGB curve",
            Self::DisplayP3 => "P3 primaries, white point D65; integer files use the sRGB curve",
            Self::Rec2020 => "Rec. 2020 primaries, white point D65; integer files use the BT.2020 curve",
            Self::AcesCg => "ACES AP1 primaries; integer files are linear",
            Self::Aces2065 => "ACES AP0 primaries; integer files are linear",
            Self::Xyz => "CIE XYZ relative to D65; integer files are linear",
        }
    }

    /// Returns the space of a name or alias, in any case.
    pub fn named(name: &str) -> Option<Self> {
        let name = name.to_ascii_lowercase();
        Self::ALL.into_iter().find(|space| space.name() == name || space.aliases().contains(&name.as_str()))
    }

    /// Returns the chromaticities, which OpenEXR files store. Those of XYZ are the axes and the
    /// equal-energy white.
    pub fn primaries(self) -> Primaries {
        let aces_white = (0.32168, 0.33767);
        let (red, green, blue, white) = match self {
            Self::Rec709 => ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), D65),
            Self::DisplayP3 => ((0.68, 0.32), (0.265, 0.69), (0.15, 0.06), D65),
            Self::Rec2020 => ((0.708, 0.292), (0.17, 0.797), (0.131, 0.046), D65),
            Self::AcesCg => ((0.713, 0.293), (0.165, 0.83), (0.128, 0.044), aces_white),
            Self::Aces2065 => ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077), aces_white),
            Self::Xyz => ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (1.0 / 3.0, 1.0 / 3.0)),
        };
        Primaries {
            red: DVec2::from(red),
            green: DVec2::from(green),
            blue: DVec2::from(blue),
            white: DVec2::from(white),
        }
    }

    /// Returns the matrix from linear colours of this space to linear Rec. 709.
    ///
    /// White maps to white by Bradford adaptation, except that XYZ is not adapted.
    pub fn to_rec709(self) -> DMat3 {
        match self {
            Self::Rec709 => DMat3::IDENTITY,
            other => other.primaries().to_rec709().expect("the primaries of named spaces are independent"),
        }
    }

    /// Returns the matrix from linear Rec. 709 to linear colours of this space.
    pub fn from_rec709(self) -> DMat3 {
        self.to_rec709().inverse()
    }

    /// Converts a linear Rec. 709 colour to this space. Colours outside the gamut of the space get
    /// negative channels.
    pub fn encode(self, rgb: Vec3) -> Vec3 {
        if self == Self::Rec709 { rgb } else { (self.from_rec709() * rgb.as_dvec3()).as_vec3() }
    }

    /// Returns the named space of a matrix to linear Rec. 709, within the rounding of files.
    pub fn of_matrix(to_rec709: DMat3) -> Option<Self> {
        let far = |a: DVec3, b: DVec3| (a - b).abs().max_element();
        // Compares columns: the contribution of each channel to the colour.
        Self::ALL.into_iter().find(|space| {
            let named = space.to_rec709();
            (0..3).all(|k| far(named.col(k), to_rec709.col(k)) < SAME_SPACE)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_rows(space: ColourSpace, rows: [[f64; 3]; 3], tolerance: f64) {
        let got = space.to_rec709();
        for (i, row) in rows.iter().enumerate() {
            let off = (got.row(i) - DVec3::from(*row)).abs().max_element();
            assert!(off < tolerance, "{}: row {i} is {}, published {row:?}", space.name(), got.row(i));
        }
    }

    #[test]
    fn matrices_match_published_values() {
        // ACES 1.x, AP1 to Rec. 709 with Bradford adaptation from the ACES white to D65.
        let aces_cg = [
            [1.705_050_99, -0.621_792_12, -0.083_258_87],
            [-0.130_256_42, 1.140_804_74, -0.010_548_32],
            [-0.024_003_36, -0.128_968_98, 1.152_972_33],
        ];
        assert_rows(ColourSpace::AcesCg, aces_cg, 1e-6);
        // Rec. ITU-R BT.2087-0, four decimals.
        let rec2020 = [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]];
        assert_rows(ColourSpace::Rec2020, rec2020, 1e-4);
        // CSS Color Module Level 4, display-p3 to srgb-linear.
        let p3 = [
            [1.224_940_2, -0.224_940_2, 0.0],
            [-0.042_056_95, 1.042_056_95, 0.0],
            [-0.019_637_55, -0.078_636_05, 1.098_273_6],
        ];
        assert_rows(ColourSpace::DisplayP3, p3, 1e-5);
        // IEC 61966-2-1.
        let xyz = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]];
        assert_rows(ColourSpace::Xyz, xyz, 5e-4);
    }

    #[test]
    fn white_stays_white() {
        for space in ColourSpace::ALL.into_iter().filter(|space| *space != ColourSpace::Xyz) {
            let white = space.to_rec709() * DVec3::ONE;
            assert!((white - DVec3::ONE).abs().max_element() < 1e-9, "{}: {white}", space.name());
        }
        let white = ColourSpace::Xyz.encode(Vec3::ONE);
        assert!((white - Vec3::new(0.95046, 1.0, 1.08906)).abs().max_element() < 1e-4, "{white}");
    }

    #[test]
    fn names_and_matrices_identify_spaces() {
        for space in ColourSpace::ALL {
            assert_eq!(ColourSpace::named(&space.name().to_uppercase()), Some(space));
            assert!(space.aliases().iter().all(|alias| ColourSpace::named(alias) == Some(space)));
            assert_eq!(ColourSpace::of_matrix(space.to_rec709()), Some(space));
        }
        assert_eq!(ColourSpace::named("cmyk"), None);
        assert_eq!(ColourSpace::of_matrix(DMat3::from_diagonal(DVec3::new(1.0, 1.1, 1.0))), None);
    }
}
