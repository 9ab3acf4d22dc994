//! Width of the GGX lobe that is as sharp as the highlight of a table.

use crate::reflectance::BivariateTable;
use crate::reflectance::parametric::{Ggx, Parametric, directions};
use crate::reflectance::theta_h_of;

/// Samples of `theta_d` (degrees) over which highlights are averaged. Below 20 degrees, the Fresnel
/// reflectance is constant and does not change the shape of the lobe.
const DIFFERENCES: [usize; 5] = [0, 5, 10, 15, 20];

/// Range of half angles (degrees) of the floor below the highlight. With the difference angles
/// above, light and view stay above the horizon at all azimuths.
const FLOOR_ANGLES: (f64, f64) = (45.0, 60.0);

/// Relative excess of the peak over the floor that a highlight requires.
const CONTRAST: f64 = 0.02;

/// Width of the narrowest lobe that a table resolves: half of it lies within two samples.
const NARROWEST: f64 = 0.001;

/// Number of equal logarithmic steps from the narrowest width to one.
const WIDTH_STEPS: usize = 72;

/// Number of azimuths over which a lobe is averaged. A lobe is smooth in azimuth.
const AZIMUTHS: usize = 12;

/// Table of the half widths of GGX lobes, which maps the highlight of a table to `alpha`.
///
/// The profile of a highlight is the mean of the table over difference angles up to 20 degrees. Its
/// floor is the mean of the profile at half angles from 45 to 60 degrees. Its half width is the
/// half angle that contains half of the integral of its square above the floor. A Lambertian part
/// raises profile and floor equally, and a factor scales both halves equally, so the half width of
/// a GGX lobe with a Lambertian part depends on `alpha` alone.
///
/// If there are several parts, the square determines which one is the highlight. A sharp coat
/// outweighs the slope of a bright body below it, which has more energy. A satin lobe outweighs a
/// spike of negligible energy on top of it, which has a higher peak.
#[derive(Clone, Debug)]
pub struct GgxWidths {
    /// Logarithms of half width and `alpha`, ascending.
    entries: Vec<(f64, f64)>,
}

impl Default for GgxWidths {
    fn default() -> Self {
        Self::new()
    }
}

impl GgxWidths {
    /// Computes the half widths of lobes of all widths.
    pub fn new() -> Self {
        let entry = |step: usize| {
            let log = NARROWEST.ln() * (1.0 - step as f64 / WIDTH_STEPS as f64);
            Some((half_width(&lobe(log.exp()))?.ln(), log))
        };
        // The widest lobes have no peak along the normal, since masking makes them brighter off the
        // normal. Slightly narrower lobes have a high floor, above which they are no wider than
        // other lobes; they are removed.
        let mut entries: Vec<(f64, f64)> = (0..=WIDTH_STEPS).map_while(entry).collect();
        entries.dedup_by(|next, last| next.0 <= last.0);
        Self { entries }
    }

    /// Returns the width `alpha` of the GGX lobe with the half width of the table's highlight.
    ///
    /// Returns `None` if the table has no highlight along the normal, for example for a Lambertian
    /// surface or a cloth that is brightest at its rim. Lobes narrower than 0.001, which a table
    /// does not resolve, yield 0.001. Lobes above 0.56 yield 0.5 to 0.56: their floor rises with
    /// their width, so they are indistinguishable.
    pub fn alpha_of(&self, table: &BivariateTable) -> Option<f64> {
        let log = half_width(&profile(|i, j| f64::from(table.cell(i, j))))?.ln();
        let entries = &self.entries;
        let above = entries.partition_point(|entry| entry.0 < log);
        Some(match above {
            0 => NARROWEST,
            above if above == entries.len() => entries[above - 1].1.exp(),
            above => {
                let ((w0, a0), (w1, a1)) = (entries[above - 1], entries[above]);
                (a0 + (a1 - a0) * (log - w0) / (w1 - w0)).exp()
            }
        })
    }
}

/// Returns the profile over the half angle of a mirror with width `alpha`.
fn lobe(alpha: f64) -> Vec<f64> {
    let mirror = Ggx { diffuse: 0.0, f0: 1.0, alpha };
    profile(|i, j| {
        let at = |k: usize| {
            let phi = std::f64::consts::PI * k as f64 / AZIMUTHS as f64;
            let (wi, wo) = directions(theta_h_of(i), (j as f64).to_radians(), phi);
            mirror.eval(wi, wo)
        };
        (0..AZIMUTHS).map(at).sum::<f64>() / AZIMUTHS as f64
    })
}

/// Returns the mean over the difference angles, for each half angle up to the end of the floor.
fn profile(cell: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    (0..)
        .take_while(|&i| theta_h_of(i).to_degrees() <= FLOOR_ANGLES.1)
        .map(|i| DIFFERENCES.iter().map(|&j| cell(i, j)).sum::<f64>() / DIFFERENCES.len() as f64)
        .collect()
}

/// Returns the half angle that contains half of the squared highlight; `None` without a highlight.
fn half_width(profile: &[f64]) -> Option<f64> {
    let first = (0..profile.len()).find(|&i| theta_h_of(i).to_degrees() >= FLOOR_ANGLES.0)?;
    let floor = profile[first..].iter().sum::<f64>() / (profile.len() - first) as f64;
    // The negated condition also rejects NaN.
    if !(profile[0] > (1.0 + CONTRAST) * floor && profile[0].is_finite()) {
        return None;
    }
    // The variable of integration is the squared sine, in which projected solid angle is uniform.
    let place = |i: usize| theta_h_of(i).sin().powi(2);
    let square = |i: usize| (profile[i] - floor).max(0.0).powi(2);
    let within: Vec<f64> = (1..=first)
        .scan(0.0, |sum, i| {
            *sum += 0.5 * (square(i - 1) + square(i)) * (place(i) - place(i - 1));
            Some(*sum)
        })
        .collect();
    let half = 0.5 * within.last()?;
    let after = within.iter().position(|sum| *sum >= half)?;
    let before = if after == 0 { 0.0 } else { within[after - 1] };
    let share = (half - before) / (within[after] - before);
    Some((place(after) + share * (place(after + 1) - place(after))).sqrt().asin())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reflectance::parametric::{Lambert, Sheen};

    #[test]
    fn recovers_the_alpha_of_ggx_lobes() {
        let widths = GgxWidths::new();
        for alpha in [0.002, 0.005, 0.013, 0.05, 0.11, 0.3, 0.55] {
            for (diffuse, f0) in [(0.0, 0.9), (0.1, 0.04), (0.6, 0.04)] {
                let table = Ggx { diffuse, f0, alpha }.to_bivariate();
                let contrast = table.cell(0, 0) / table.cell(85, 10);
                match widths.alpha_of(&table) {
                    Some(got) => assert!((got / alpha - 1.0).abs() < 0.02, "{alpha} {diffuse} {f0}: {got}"),
                    None => assert!(contrast < 1.05, "{alpha} {diffuse} {f0}: contrast {contrast}"),
                }
                let scaled = widths.alpha_of(&table.scaled(7.0));
                assert!((scaled.unwrap_or(1.0) - widths.alpha_of(&table).unwrap_or(1.0)).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn widest_lobes_yield_a_large_alpha() {
        for alpha in [0.6, 0.7] {
            let got = GgxWidths::new().alpha_of(&Ggx { diffuse: 0.0, f0: 0.9, alpha }.to_bivariate()).unwrap();
            assert!((0.5..=0.7).contains(&got), "{alpha}: {got}");
        }
    }

    #[test]
    fn widths_rise_with_alpha() {
        let entries = GgxWidths::new().entries;
        assert!(entries.windows(2).all(|pair| pair[0].0 < pair[1].0 && pair[0].1 < pair[1].1));
        // Only steps of the widest lobes are removed.
        assert!(entries.len() > WIDTH_STEPS - 7 && entries[0].1.exp() < 1.001 * NARROWEST, "{}", entries.len());
    }

    #[test]
    fn returns_none_without_a_highlight() {
        let widths = GgxWidths::new();
        for table in [
            Lambert { albedo: 0.5 }.to_bivariate(),
            Sheen { factor: 0.7, width: 0.3 }.to_bivariate(),
            Ggx { diffuse: 0.0, f0: 1.0, alpha: 1.0 }.to_bivariate(),
            BivariateTable::from_fn(|_, _| 0.0),
            BivariateTable::from_fn(|_, _| f64::NAN),
        ] {
            assert_eq!(widths.alpha_of(&table), None);
        }
    }

    #[test]
    fn mirror_yields_the_narrowest_width() {
        // All light in the first sample of the half angle.
        let mirror = BivariateTable::from_fn(|h, _| if h == 0.0 { 1e6 } else { 1e-3 });
        assert_eq!(GgxWidths::new().alpha_of(&mirror), Some(NARROWEST));
    }

    #[test]
    fn ignores_a_spike_without_energy() {
        // The spike is twenty times as high as the lobe below it, with a thousandth of its light.
        let (spike, below) =
            (Ggx { diffuse: 0.0, f0: 0.0005, alpha: 0.001 }, Ggx { diffuse: 0.1, f0: 0.5, alpha: 0.15 });
        let both = BivariateTable::from_vec(
            spike.to_bivariate().as_slice().iter().zip(below.to_bivariate().as_slice()).map(|(a, b)| a + b).collect(),
        );
        assert!(both.cell(0, 10) > 15.0 * below.to_bivariate().cell(0, 10));
        let got = GgxWidths::new().alpha_of(&both).unwrap();
        assert!((got / 0.15 - 1.0).abs() < 0.1, "{got}");
    }

    #[test]
    fn coat_over_a_satin_body_determines_the_width() {
        let (coat, below) = (Ggx { diffuse: 0.0, f0: 0.04, alpha: 0.02 }, Ggx { diffuse: 0.1, f0: 0.04, alpha: 0.4 });
        let both = BivariateTable::from_vec(
            coat.to_bivariate().as_slice().iter().zip(below.to_bivariate().as_slice()).map(|(a, b)| a + b).collect(),
        );
        let got = GgxWidths::new().alpha_of(&both).unwrap();
        assert!((got / 0.02 - 1.0).abs() < 0.05, "{got}");
    }
}
