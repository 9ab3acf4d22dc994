//! Response of a camera: the exposure that each code represents.

use super::BracketError;
use crate::picture::srgb_decode;

/// Value of the code 0, in codes: values below half a code are rounded to 0, and the logarithm must
/// be finite.
const BLACK: f64 = 0.25;

/// Response of a camera: the natural logarithm of the exposure of each code, for each channel.
///
/// The logarithm increases with the code. The scale of each channel is free.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    channels: [Vec<f64>; 3],
}

impl Response {
    /// Builds a linear response of codes `0..=max` above the code `black`.
    ///
    /// The exposure is proportional to the code above `black`; the largest code represents 1.
    ///
    /// # Panics
    /// If `black` is not below `max`.
    pub fn linear(max: u16, black: f64) -> Self {
        let max = f64::from(max);
        assert!((0.0..max).contains(&black), "the black level must be below the largest code");
        Self::of(max as u16, |code| (code - black).max(BLACK) / (max - black))
    }

    /// Builds the response of codes `0..=max` on the sRGB curve; the largest code represents 1.
    pub fn srgb(max: u16) -> Self {
        Self::of(max, |code| f64::from(srgb_decode((code.max(BLACK) / f64::from(max)) as f32)))
    }

    /// Builds a response with the same curve for all channels.
    fn of(max: u16, exposure: impl Fn(f64) -> f64) -> Self {
        let curve: Vec<f64> = (0..=max).map(|code| exposure(code.into()).ln()).collect();
        Self { channels: [curve.clone(), curve.clone(), curve] }
    }

    /// Builds a response from the logarithms of the exposures of all codes, for red, green and
    /// blue.
    ///
    /// # Errors
    /// [`BracketError::Curve`] if a curve decreases, is constant, is not finite, or does not have 2
    /// to 65536 codes, as many as the others.
    pub fn from_curves(channels: [Vec<f64>; 3]) -> Result<Self, BracketError> {
        let length = channels[0].len();
        for (i, curve) in channels.iter().enumerate() {
            let wrong = |problem| Err(BracketError::Curve { channel: i + 1, problem });
            if curve.len() != length {
                return wrong("does not have as many codes as the first channel");
            }
            if !(2..=1 << 16).contains(&length) {
                return wrong("does not have 2 to 65536 codes");
            }
            // Later arithmetic overflows beyond e^80.
            if curve.iter().any(|g| g.is_nan() || g.abs() > 80.0) {
                return wrong("has values that are not log exposures");
            }
            if curve.windows(2).any(|w| w[1] < w[0]) {
                return wrong("falls");
            }
            if curve[length - 1] <= curve[0] {
                return wrong("is flat");
            }
        }
        Ok(Self { channels })
    }

    /// Returns the largest code.
    pub fn max(&self) -> u16 {
        (self.channels[0].len() - 1) as u16
    }

    /// Returns the logarithms of the exposures of the codes `0..=max`; channel 0 is red, 1 green, 2
    /// blue.
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn curve(&self, channel: usize) -> &[f64] {
        &self.channels[channel]
    }

    /// Resamples the response to codes `0..=max`, by interpolation or thinning.
    #[must_use]
    pub fn resampled(&self, max: u16) -> Self {
        if max == self.max() {
            return self.clone();
        }
        let ratio = f64::from(self.max()) / f64::from(max.max(1));
        let at = |curve: &Vec<f64>, code: u16| interpolate(curve, f64::from(code) * ratio);
        Self { channels: self.channels.each_ref().map(|curve| (0..=max).map(|code| at(curve, code)).collect()) }
    }
}

/// Interpolates a curve between its codes, linearly in exposure over code.
///
/// The logarithm bends sharply near black.
pub(super) fn interpolate(curve: &[f64], position: f64) -> f64 {
    let lower = (position.max(0.0) as usize).min(curve.len() - 1);
    let upper = (lower + 1).min(curve.len() - 1);
    let share = (position - lower as f64).clamp(0.0, 1.0);
    if share == 0.0 || curve[lower] == curve[upper] {
        return curve[lower];
    }
    (curve[lower].exp() * (1.0 - share) + curve[upper].exp() * share).ln()
}
