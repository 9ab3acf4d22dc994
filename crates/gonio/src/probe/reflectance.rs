//! Reflectance of a mirror ball.

use glam::DVec3;
use serde::Serialize;

use super::ProbeError;

/// Reflectance of a mirror, by Schlick's approximation of a metal.
///
/// It increases from the reflectance at normal incidence to one at grazing incidence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Reflectance(DVec3);

impl Reflectance {
    /// Builds a mirror that reflects these shares of red, green and blue at normal incidence.
    ///
    /// # Errors
    /// [`ProbeError::Reflectance`] unless each is above 0 and at most 1.
    pub fn new(normal: [f64; 3]) -> Result<Self, ProbeError> {
        match normal.into_iter().find(|share| !(*share > 0.0 && *share <= 1.0)) {
            Some(wrong) => Err(ProbeError::Reflectance(wrong)),
            None => Ok(Self(normal.into())),
        }
    }

    /// Returns the reflected share of each channel at a cosine between normal and view.
    pub fn at(&self, cosine: f64) -> DVec3 {
        self.0 + (DVec3::ONE - self.0) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
    }
}

/// A perfect mirror.
impl Default for Reflectance {
    fn default() -> Self {
        Self(DVec3::ONE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirrors_reflect_all_light_at_grazing_incidence() {
        let chrome = Reflectance::new([0.55, 0.56, 0.58]).unwrap();
        assert_eq!(chrome.at(1.0), DVec3::new(0.55, 0.56, 0.58));
        assert_eq!(chrome.at(0.0), DVec3::ONE);
        assert_eq!(Reflectance::default().at(0.3), DVec3::ONE);
        for wrong in [0.0, -0.1, 1.01, f64::NAN] {
            assert!(Reflectance::new([0.5, wrong, 0.5]).is_err(), "{wrong}");
        }
    }
}
