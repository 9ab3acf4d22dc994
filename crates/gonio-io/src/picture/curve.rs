//! Curves from the codes of a file to linear values.

use gonio::picture::srgb_decode;
use moxcms::{ToneCurveEvaluator, ToneReprCurve, TransferCharacteristics};

use crate::colour_space::ColourSpace;

/// Largest difference up to which a curve counts as sRGB or linear; files round their curves.
const SAME_CURVE: f32 = 1e-3;

/// Exponent by which moxcms converts HLG from scene light to display light. Source: ITU-R BT.2100,
/// table 5. Photographs need scene light.
const HLG_SYSTEM_GAMMA: f32 = 1.2;

/// Curve from codes in 0..=1 to linear values.
pub(super) enum Curve {
    /// IEC 61966-2-1.
    Srgb,
    /// Codes are linear values.
    Linear,
    /// Another curve for red, green and blue.
    Other([Channel; 3]),
}

/// Curve of one channel.
pub(super) enum Channel {
    /// Power of the code.
    Power(f32),
    /// A curve of an ICC profile, or of ITU-T H.273, and a power applied to its result.
    Evaluated(Box<dyn ToneCurveEvaluator + Send + Sync>, f32),
}

impl Curve {
    /// Builds the curve with an exponent, `1 / gamma` of the chunk `gAMA`. The usual 1/2.2 means
    /// sRGB, because programs write it for sRGB images.
    pub(super) fn power(exponent: f64) -> Self {
        if (exponent - 2.2).abs() < 0.01 {
            return Self::Srgb;
        }
        Self::other([0; 3].map(|_| Channel::Power(exponent as f32)))
    }

    /// Builds the curve of the transfer characteristics of ITU-T H.273; `None` if the code defines
    /// no curve.
    pub(super) fn of_cicp(code: u8) -> Option<Self> {
        let transfer = TransferCharacteristics::try_from(code).ok()?;
        let power = if transfer == TransferCharacteristics::Hlg { 1.0 / HLG_SYSTEM_GAMMA } else { 1.0 };
        let channel = || {
            let curve = match transfer {
                // This evaluator avoids the rounding of a table.
                TransferCharacteristics::Smpte2084 => ToneReprCurve::make_cicp_linear_evaluator(transfer).ok()?,
                _ => ToneReprCurve::try_from(transfer).ok()?.make_linear_evaluator().ok()?,
            };
            Some(Channel::Evaluated(curve, power))
        };
        Some(Self::other([channel()?, channel()?, channel()?]))
    }

    /// Builds the curves of an ICC profile; `None` if they are damaged.
    pub(super) fn of_icc(curves: [&ToneReprCurve; 3]) -> Option<Self> {
        let channel = |curve: &ToneReprCurve| Some(Channel::Evaluated(curve.make_linear_evaluator().ok()?, 1.0));
        let [r, g, b] = curves.map(channel);
        let curve = Self::other([r?, g?, b?]);
        let is_sound = |i: u32| (0..3).all(|channel| curve.decode(channel, i as f32 / 255.0).is_finite());
        (0..=255).all(is_sound).then_some(curve)
    }

    /// Returns the curve of integer files of a space.
    pub(super) fn of_space(space: ColourSpace) -> Self {
        match space {
            ColourSpace::Rec709 | ColourSpace::DisplayP3 => Self::Srgb,
            // Rec. ITU-R BT.2020, table 4.
            ColourSpace::Rec2020 => Self::of_cicp(14).unwrap_or(Self::Srgb),
            ColourSpace::AcesCg | ColourSpace::Aces2065 | ColourSpace::Xyz => Self::Linear,
        }
    }

    /// Builds a curve of three channels and recognises sRGB and linear curves.
    fn other(channels: [Channel; 3]) -> Self {
        let curve = Self::Other(channels);
        let all = |of: &dyn Fn(f32) -> f32| {
            (0..=255).map(|i| i as f32 / 255.0).all(|v| (0..3).all(|c| (curve.decode(c, v) - of(v)).abs() < SAME_CURVE))
        };
        if all(&|v| v) {
            Self::Linear
        } else if all(&srgb_decode) {
            Self::Srgb
        } else {
            curve
        }
    }

    /// Returns the linear value of a code. Curves are odd functions. Beyond 1, which occurs in
    /// float files, curves of profiles and of ITU-T H.273 continue as a power.
    pub(super) fn decode(&self, channel: usize, code: f32) -> f32 {
        match self {
            Self::Linear => code,
            Self::Srgb if code.abs() > 1.0 => ((code.abs() + 0.055) / 1.055).powf(2.4).copysign(code),
            Self::Srgb => srgb_decode(code.abs()).copysign(code),
            Self::Other(channels) => match &channels[channel] {
                Channel::Power(exponent) => code.abs().powf(*exponent).copysign(code),
                Channel::Evaluated(curve, power) => beyond(code, &|v| curve.evaluate_value(v).max(0.0).powf(*power)),
            },
        }
    }
}

/// Evaluates a curve on 0..=1 and its continuations. These are the odd function below 0 and, above
/// 1, the power with the slope of the curve at 1.
fn beyond(code: f32, curve: &dyn Fn(f32) -> f32) -> f32 {
    if code.is_nan() {
        return code;
    }
    if code < 0.0 {
        return -beyond(-code, curve);
    }
    if code <= 1.0 {
        return curve(code);
    }
    const STEP: f32 = 1.0 / 64.0;
    let (top, below) = (curve(1.0), curve(1.0 - STEP));
    let exponent = (top / below.max(f32::MIN_POSITIVE)).ln() / (1.0 / (1.0 - STEP)).ln();
    top * code.powf(exponent.clamp(0.1, 20.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_cicp(code: u8, value: f32) -> f32 {
        Curve::of_cicp(code).unwrap().decode(1, value)
    }

    #[test]
    fn curves_match_their_standards() {
        // SMPTE ST 2084: 100 and 1000 cd/m2 of 10000 are at 0.5081 and 0.7518.
        assert!((of_cicp(16, 0.508_078) * 1e4 - 100.0).abs() < 0.1);
        assert!((of_cicp(16, 0.751_827) * 1e4 - 1000.0).abs() < 1.0);
        // ITU-R BT.2100, HLG: the signal 0.5 is the scene light 1/12.
        assert!((of_cicp(18, 0.5) - 1.0 / 12.0).abs() < 1e-4, "{}", of_cicp(18, 0.5));
        // ITU-R BT.709: a signal of 0.5 is 0.2597.
        assert!((of_cicp(1, 0.5) - ((0.5 + 0.099) / 1.099_f32).powf(1.0 / 0.45)).abs() < 1e-3);
        assert!(matches!(Curve::of_cicp(13), Some(Curve::Srgb)) && matches!(Curve::of_cicp(8), Some(Curve::Linear)));
        assert!(Curve::of_cicp(2).is_none() && Curve::of_cicp(200).is_none());
    }

    #[test]
    fn powers_give_linear_srgb_or_power_curves() {
        assert!(matches!(Curve::power(1.0), Curve::Linear) && matches!(Curve::power(1.0 / 0.45455), Curve::Srgb));
        assert!((Curve::power(1.8).decode(0, 0.5) - 0.5_f32.powf(1.8)).abs() < 1e-6);
    }

    #[test]
    fn curves_continue_beyond_one() {
        let bt709 = Curve::of_cicp(1).unwrap();
        let published = |v: f32| ((v + 0.099) / 1.099_f32).powf(1.0 / 0.45);
        for (at, slack) in [(1.0_f32, 2e-3), (1.05, 0.005), (2.0, 0.2)] {
            assert!((bt709.decode(0, at) - published(at)).abs() < slack, "{at}: {}", bt709.decode(0, at));
            assert_eq!(bt709.decode(0, -at), -bt709.decode(0, at));
        }
        assert!((Curve::Srgb.decode(0, 2.0) - (2.055 / 1.055_f32).powf(2.4)).abs() < 1e-5);
        assert_eq!(Curve::Srgb.decode(1, -0.5), -Curve::Srgb.decode(1, 0.5));
        assert!(Curve::Srgb.decode(0, f32::NAN).is_nan() && bt709.decode(0, f32::NAN).is_nan());
    }
}
