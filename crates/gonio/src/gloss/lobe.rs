//! Width and tip of the lobe of a table.

use crate::reflectance::{BivariateTable, THETA_H, theta_h_of};

/// Half angle (radians) at which a table shows its body, without the lobe.
const BODY: f64 = 30.0 * std::f64::consts::PI / 180.0;

/// Difference angles (degrees) below which a profile is averaged.
const DIFFERENCES: usize = 45;

/// Lobe of a table: the mean over the difference angles below 45 degrees, above that at a half
/// angle of 30 degrees.
struct Lobe {
    /// Value at each half angle up to 30 degrees, not negative.
    profile: Vec<f64>,
}

impl Lobe {
    fn of(table: &BivariateTable) -> Self {
        let mean = |i: usize| (0..DIFFERENCES).map(|j| f64::from(table.cell(i, j))).sum::<f64>() / DIFFERENCES as f64;
        let means: Vec<f64> = (0..THETA_H).take_while(|&i| i == 0 || theta_h_of(i - 1) < BODY).map(mean).collect();
        let body = means[means.len() - 1];
        Self { profile: means.into_iter().map(|mean| (mean - body).max(0.0)).collect() }
    }

    /// Returns the sample below the half angle that contains half of the energy, and the share of
    /// the way to the next sample; `None` without energy.
    fn half_energy(&self) -> Option<(usize, f64)> {
        let last = self.profile.len() - 1;
        let energy = |i: usize| {
            let (from, to) = (theta_h_of(i), theta_h_of(i + 1));
            0.5 * (self.profile[i] + self.profile[i + 1]) * (0.5 * (from + to)).sin() * (to - from)
        };
        let mut left = 0.5 * (0..last).map(energy).sum::<f64>();
        for i in 0..last {
            let here = energy(i);
            if here > 0.0 && here >= left {
                return Some((i, left / here));
            }
            left -= here;
        }
        None
    }
}

/// Returns the half angle (radians) that contains half of the energy of the lobe; `None` without a
/// lobe.
///
/// The lobe is the mean of the table over the difference angles below 45 degrees, above that at a
/// half angle of 30 degrees.
pub fn lobe_radius(table: &BivariateTable) -> Option<f64> {
    let (below, share) = Lobe::of(table).half_energy()?;
    Some(theta_h_of(below) + share * (theta_h_of(below + 1) - theta_h_of(below)))
}

/// Returns the natural logarithm of the height of the lobe over its value at the
/// [radius](lobe_radius); `None` without a lobe.
///
/// The number describes the shape of the lobe, not its width: it is `ln 2` for a Gaussian lobe and
/// `ln 4` for a GGX lobe. It is larger for a lobe with a sharp tip above wide tails.
pub fn tip_sharpness(table: &BivariateTable) -> Option<f64> {
    let lobe = Lobe::of(table);
    let (below, share) = lobe.half_energy()?;
    let at_radius = lobe.profile[below] + share * (lobe.profile[below + 1] - lobe.profile[below]);
    Some((lobe.profile[0].max(1e-300) / at_radius).ln())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::lobe;

    #[test]
    fn the_radius_contains_half_of_the_energy() {
        assert_eq!(lobe_radius(&BivariateTable::from_fn(|_, _| 0.3)), None);
        assert_eq!(lobe_radius(&BivariateTable::from_fn(|h, _| 0.3 + h)), None);
        // A Gaussian lobe of width w has half of its energy within w sqrt(ln 2).
        for width in [0.2, 0.05, 0.02] {
            let radius = lobe_radius(&lobe(0.1, 5.0, width)).unwrap() / 2.0_f64.ln().sqrt();
            assert!((radius / width - 1.0).abs() < 0.05, "{width} {radius}");
        }
    }

    #[test]
    fn the_sharpness_describes_the_shape_and_not_the_width() {
        assert_eq!(tip_sharpness(&BivariateTable::from_fn(|_, _| 0.3)), None);
        for width in [0.1, 0.05, 0.02] {
            let sharpness = tip_sharpness(&lobe(0.1, 5.0, width)).unwrap();
            assert!((sharpness - 2.0_f64.ln()).abs() < 0.1, "{width} {sharpness}");
            // GGX without masking and Fresnel factor; half of its energy lies within its width.
            let ggx = |h: f64| (1.0 + (h.tan() / width).powi(2)).powi(-2);
            let sharpness = tip_sharpness(&BivariateTable::from_fn(|h, _| 0.1 + ggx(h))).unwrap();
            assert!((sharpness - 4.0_f64.ln()).abs() < 0.15, "{width} {sharpness}");
            let spiked =
                BivariateTable::from_fn(|h, _| 0.1 + (-(h / width).powi(2)).exp() + if h == 0.0 { 20.0 } else { 0.0 });
            assert!(tip_sharpness(&spiked).unwrap() > 3.0, "{width}");
        }
    }
}
