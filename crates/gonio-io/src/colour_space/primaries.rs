//! Chromaticities of primaries and white, and the matrices that follow from them.

use glam::{DMat3, DVec2, DVec3};

use super::ColourSpace;

/// Chromaticity (x, y) of D65, as Rec. ITU-R BT.709 and IEC 61966-2-1 round it.
pub const D65: (f64, f64) = (0.3127, 0.3290);

/// Smallest determinant of the chromaticities of three primaries that counts as a triangle. That of
/// Rec. 709 is 0.11.
const MIN_DETERMINANT: f64 = 1e-4;

/// CIE 1931 chromaticities (x, y) of the primaries and the white of an RGB space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Primaries {
    /// Red.
    pub red: DVec2,
    /// Green.
    pub green: DVec2,
    /// Blue.
    pub blue: DVec2,
    /// The colour of (1, 1, 1).
    pub white: DVec2,
}

impl Primaries {
    /// Builds primaries from x and y of red, green, blue and white, as most files list them.
    pub fn from_array(xy: [f64; 8]) -> Self {
        let [rx, ry, gx, gy, bx, by, wx, wy] = xy;
        Self { red: DVec2::new(rx, ry), green: DVec2::new(gx, gy), blue: DVec2::new(bx, by), white: DVec2::new(wx, wy) }
    }

    /// Returns the matrix from linear RGB to XYZ in which white has Y = 1 (SMPTE RP 177). `None` if
    /// the primaries lie on a line, white has no luminance, or a number is not finite.
    pub fn to_xyz(&self) -> Option<DMat3> {
        let point = |c: DVec2| DVec3::new(c.x, c.y, 1.0 - c.x - c.y);
        let columns = DMat3::from_cols(point(self.red), point(self.green), point(self.blue));
        let sound = columns.is_finite() && columns.determinant().abs() > MIN_DETERMINANT && self.white.y > 1e-3;
        let scale = columns.inverse() * point(self.white) / self.white.y;
        let matrix = columns * DMat3::from_diagonal(scale);
        // White outside the triangle is an error of the file, except by rounding.
        (sound && matrix.is_finite() && scale.min_element() > 0.0).then_some(matrix)
    }

    /// Returns the matrix from linear RGB to linear Rec. 709, with Bradford adaptation of white to
    /// D65. XYZ axes are not adapted, because such files contain XYZ relative to D65.
    ///
    /// `None` as in [`to_xyz`](Self::to_xyz).
    pub fn to_rec709(&self) -> Option<DMat3> {
        let xyz = ColourSpace::Xyz.primaries();
        let near = |a: DVec2, b: DVec2| (a - b).abs().max_element() < 1e-3;
        let is_xyz = near(self.red, xyz.red) && near(self.green, xyz.green) && near(self.blue, xyz.blue);
        let to_xyz = if is_xyz { DMat3::IDENTITY } else { bradford(self.white, D65.into()) * self.to_xyz()? };
        let rec709 = ColourSpace::Rec709.primaries().to_xyz()?;
        let matrix = rec709.inverse() * to_xyz;
        matrix.is_finite().then_some(matrix)
    }
}

/// Returns the matrix in XYZ of the Bradford adaptation from one white to another. Source: Lam
/// 1985; ICC.1:2022 annex E. Both whites are chromaticities with `y > 0`.
pub fn bradford(from: DVec2, to: DVec2) -> DMat3 {
    let cone = DMat3::from_cols(
        DVec3::new(0.8951, -0.7502, 0.0389),
        DVec3::new(0.2664, 1.7135, -0.0685),
        DVec3::new(-0.1614, 0.0367, 1.0296),
    );
    let response = |white: DVec2| cone * DVec3::new(white.x / white.y, 1.0, (1.0 - white.x - white.y) / white.y);
    cone.inverse() * DMat3::from_diagonal(response(to) / response(from)) * cone
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rec_709_has_its_luminance_weights() {
        let to_xyz = ColourSpace::Rec709.primaries().to_xyz().unwrap();
        // IEC 61966-2-1.
        assert!((to_xyz.row(1) - DVec3::new(0.2126, 0.7152, 0.0722)).abs().max_element() < 1e-4);
        assert!((to_xyz.row(0) - DVec3::new(0.4124, 0.3576, 0.1805)).abs().max_element() < 1e-4);
    }

    #[test]
    fn bradford_matches_the_published_matrix() {
        // Lindbloom, D50 to D65.
        let d50 = DVec2::new(0.345_669, 0.358_496);
        let published = DMat3::from_cols(
            DVec3::new(0.955_576_6, -0.028_289_5, 0.012_298_2),
            DVec3::new(-0.023_039_3, 1.009_941_6, -0.020_483_0),
            DVec3::new(0.063_163_6, 0.021_007_7, 1.329_909_8),
        );
        let off = bradford(d50, DVec2::from(D65)) - published;
        assert!((0..3).all(|k| off.col(k).abs().max_element() < 5e-4), "{off}");
    }

    #[test]
    fn degenerate_primaries_are_rejected() {
        let zeros = Primaries::from_array([0.0; 8]);
        let line = Primaries::from_array([0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.3127, 0.329]);
        let nan = Primaries::from_array([0.64, 0.33, 0.3, f64::NAN, 0.15, 0.06, 0.3127, 0.329]);
        let white = Primaries::from_array([0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.9, 0.05]);
        for bad in [zeros, line, nan, white] {
            assert_eq!(bad.to_rec709(), None, "{bad:?}");
        }
    }
}
