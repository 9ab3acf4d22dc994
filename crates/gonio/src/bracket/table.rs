//! Lookup tables from the codes of one channel to exposures, for merging and checking.

/// Tolerance of codes, as a share of the largest: rounding, noise, and JPEG artefacts at edges.
const CODE_TOLERANCE: f64 = 5.0 / 255.0;

/// Lookup tables over the codes of one channel.
pub(super) struct Table {
    pub(super) exposure: Vec<f64>,
    /// Inverse variance of the exposure for an error of one code, reduced towards both ends; 0 for
    /// uninformative codes.
    pub(super) weight: Vec<f64>,
    /// Inverse variance without this reduction, for the error from rounding.
    pub(super) precision: Vec<f64>,
    /// Smallest and largest logarithm that each code may represent.
    bounds: Vec<(f64, f64)>,
    /// Lowest code that is clipped.
    pub(super) white: u16,
    /// Highest code that is black.
    pub(super) black: u16,
}

impl Table {
    /// Builds the tables of a curve of logarithms of exposure.
    ///
    /// `white` is the share of the largest code at or above which codes are clipped.
    pub(super) fn new(curve: &[f64], white: f64) -> Self {
        let max = curve.len() - 1;
        let exposure: Vec<f64> = curve.iter().map(|g| g.exp()).collect();
        let white = ((white.clamp(0.0, 1.0) * max as f64).ceil() as usize).clamp(1, max);
        let black = curve.iter().take_while(|g| **g <= curve[0]).count() - 1;
        let slack = (CODE_TOLERANCE * max as f64).ceil() as usize;
        let informs = |code: usize| code > black && code < white;
        let precision = |code: usize| {
            let (a, b) = (code.saturating_sub(1), (code + 1).min(max));
            let slope = (exposure[b] - exposure[a]) / (b - a) as f64;
            if informs(code) && slope > 0.0 { slope.powi(-2) } else { 0.0 }
        };
        let precision: Vec<f64> = (0..=max).map(precision).collect();
        let fading = |code: usize| 1.0 - (2.0 * code as f64 / max as f64 - 1.0).abs().powi(12);
        let bounds = |code: usize| {
            let (a, b) = (code.saturating_sub(slack), code + slack);
            let low = if a <= black { f64::NEG_INFINITY } else { curve[a.min(white)] };
            (low, if b >= white { f64::INFINITY } else { curve[b] })
        };
        Self {
            weight: precision.iter().enumerate().map(|(code, p)| p * fading(code)).collect(),
            precision,
            exposure,
            bounds: (0..=max).map(bounds).collect(),
            white: white as u16,
            black: black as u16,
        }
    }

    pub(super) fn bounds(&self, code: u16) -> (f64, f64) {
        self.bounds[usize::from(code)]
    }

    pub(super) fn is_known(&self, code: u16) -> bool {
        self.weight[usize::from(code)] > 0.0
    }
}
