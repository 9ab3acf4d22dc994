//! Colour without brightness.

use glam::{DVec3, Vec3};

use crate::picture::luminance;

/// Smallest value of a channel, relative to the luminance: below it, the logarithm depends on noise
/// more than on colour.
pub(super) const CHANNEL_FLOOR: f64 = 0.02;

/// Chroma of linear RGB (Rec. 709) as `(ln R/G, ln B/G)`; `(0, 0)` is grey.
///
/// The chromas of light and surface add up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Chroma(pub [f64; 2]);

impl Chroma {
    /// Returns the chroma of a linear RGB value.
    ///
    /// Channels below a fiftieth of the luminance are raised to it; black is grey.
    pub fn of(rgb: DVec3) -> Self {
        let brightness = luminance_of(rgb);
        if brightness.is_nan() || brightness <= 0.0 {
            return Self::default();
        }
        let [r, g, b] = rgb.max(DVec3::splat(CHANNEL_FLOOR * brightness)).to_array().map(f64::ln);
        Self([r - g, b - g])
    }

    /// Returns the linear RGB value of luminance one.
    pub fn rgb(self) -> DVec3 {
        let [r, b] = self.0.map(f64::exp);
        let rgb = DVec3::new(r, 1.0, b);
        rgb / luminance_of(rgb)
    }

    /// Returns the distance in natural logarithms: the root of the sum of the squared differences.
    pub fn distance(self, other: Self) -> f64 {
        (self.0[0] - other.0[0]).hypot(self.0[1] - other.0[1])
    }
}

/// Returns the luminance in double precision.
pub(super) fn luminance_of(rgb: DVec3) -> f64 {
    DVec3::from_array(luminance_weights()).dot(rgb)
}

/// Returns the weights of red, green and blue in the luminance.
pub(crate) fn luminance_weights() -> [f64; 3] {
    [Vec3::X, Vec3::Y, Vec3::Z].map(|unit| f64::from(luminance(unit)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chroma_recovers_the_colour_and_is_additive() {
        let rgb = DVec3::new(0.7, 0.4, 0.2);
        let back = Chroma::of(rgb).rgb();
        assert!((luminance_of(back) - 1.0).abs() < 1e-12);
        assert!((back * luminance_of(rgb) - rgb).length() < 1e-12, "{back}");
        // Light on a surface.
        let light = DVec3::new(1.0, 0.8, 0.5);
        let (sum, both) = (Chroma::of(light).0, Chroma::of(light * rgb).0);
        assert!((sum[0] + Chroma::of(rgb).0[0] - both[0]).abs() < 1e-12);
    }

    #[test]
    fn neutral_black_and_invalid_colours_are_grey() {
        assert_eq!(Chroma::of(DVec3::splat(3.0)).0, [0.0, 0.0]);
        assert_eq!(Chroma::of(DVec3::ZERO), Chroma::default());
        assert_eq!(Chroma::of(DVec3::splat(f64::NAN)), Chroma::default());
        // A missing channel has a finite chroma.
        assert!(Chroma::of(DVec3::new(1.0, 1.0, 0.0)).0[1] > -4.0);
    }
}
