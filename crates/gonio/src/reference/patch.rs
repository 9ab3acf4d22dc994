//! A uniform neutral patch.

use glam::{DVec3, Vec3};

use super::light::REFLECTANCE_LOG_SD;
use super::{ReferenceError, ReferenceLight};
use crate::colour::Chroma;
use crate::picture::{Plane, luminance};
use crate::scene::{clip_level, is_clipped};

/// Smallest number of usable pixels.
const MIN_PIXELS: usize = 25;
/// Largest fraction of clipped pixels.
pub(super) const MAX_CLIPPED: f64 = 0.03;
/// Largest relative standard deviation of the luminance over a patch.
const MAX_VARIATION: f64 = 0.15;
/// Largest relative standard deviation of a channel relative to the luminance.
const MAX_CHROMA_VARIATION: f64 = 0.25;
/// Largest distance of the chroma of a neutral patch from white.
///
/// Captured light has standard deviations of 0.46 and 0.12.
pub(super) const MAX_CHROMA: f64 = 1.5;
/// Largest fraction of pixels on the object, whose outline is accurate to about a pixel.
const MAX_OVERLAP: f64 = 0.01;

/// Radiance of a neutral patch.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchReading {
    /// Median radiance of each channel, linear RGB on the scale of the photograph.
    pub colour: DVec3,
    /// Number of pixels.
    pub pixels: usize,
    /// Number of clipped pixels, which are ignored.
    pub clipped: usize,
    /// Relative standard deviation of the luminance over the patch.
    pub variation: f64,
}

/// Level at which channels are clipped, and whether it was given.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clipping {
    level: Option<f32>,
    given: bool,
}

/// Statistics of the pixels of a patch.
#[derive(Clone, Debug, Default)]
pub(super) struct PatchPixels {
    /// Median of each channel.
    pub(super) median: DVec3,
    /// Number of pixels.
    pub(super) pixels: usize,
    /// Number of clipped pixels.
    pub(super) clipped: usize,
    /// Number of pixels that are finite and not clipped.
    pub(super) usable: usize,
    /// Relative standard deviation of the luminance.
    pub(super) variation: f64,
    /// Largest relative standard deviation of a channel relative to the luminance.
    pub(super) chroma_variation: f64,
}

impl Clipping {
    /// Returns the given clip level, or the largest value if many pixels share it.
    pub(super) fn of(rgb: &Plane<Vec3>, given: Option<f32>) -> Self {
        let everywhere = rgb.map(|pixel| pixel.is_finite());
        Self { level: clip_level(rgb, &everywhere, given), given: given.is_some() }
    }

    /// Returns the clip level for one patch.
    ///
    /// A patch without noise whose channels differ is a rendering and not clipped: saturated pixels
    /// vary in the other channels, or have the same value in all channels.
    pub(super) fn within(self, pixels: &[Vec3]) -> Option<f32> {
        let first = pixels.first().copied().unwrap_or_default();
        let differs = first.max_element() > first.min_element();
        if !self.given && differs && pixels.iter().all(|pixel| *pixel == first) { None } else { self.level }
    }
}

impl PatchPixels {
    /// Measures a patch; `None` if it has no pixels.
    pub(super) fn of(values: &[Vec3], clipping: Clipping) -> Option<Self> {
        let level = clipping.within(values);
        let clipped = values.iter().filter(|pixel| is_clipped(**pixel, level)).count();
        let usable: Vec<DVec3> = values
            .iter()
            .filter(|pixel| pixel.is_finite() && !is_clipped(**pixel, level))
            .map(|pixel| pixel.as_dvec3())
            .collect();
        if usable.is_empty() {
            return (!values.is_empty()).then(|| Self { pixels: values.len(), clipped, ..Self::default() });
        }
        let brightness = |pixel: &DVec3| f64::from(luminance(pixel.as_vec3()));
        let median = DVec3::from_array([0, 1, 2].map(|c| spread(usable.iter().map(|pixel| pixel[c]).collect()).0));
        let (middle, deviation) = spread(usable.iter().map(brightness).collect());
        let relative = |c: usize| {
            let ratios = usable.iter().map(|pixel| pixel[c] / brightness(pixel)).filter(|ratio| ratio.is_finite());
            let (middle, deviation) = spread(ratios.collect());
            if middle > 0.0 { deviation / middle } else { 0.0 }
        };
        Some(Self {
            median,
            pixels: values.len(),
            clipped,
            usable: usable.len(),
            variation: if middle > 0.0 { deviation / middle } else { 0.0 },
            chroma_variation: (0..3).map(relative).fold(0.0, f64::max),
        })
    }

    /// Returns the fraction of the pixels that are clipped.
    pub(super) fn clipped_share(&self) -> f64 {
        self.clipped as f64 / self.pixels.max(1) as f64
    }
}

/// Returns the median and a robust standard deviation.
///
/// The latter is half the distance of the 16 and 84 % quantiles, which hot pixels do not affect.
fn spread(mut values: Vec<f64>) -> (f64, f64) {
    if values.is_empty() {
        return (0.0, 0.0);
    }
    values.sort_unstable_by(f64::total_cmp);
    let at = |share: f64| values[(share * (values.len() - 1) as f64).round() as usize];
    (at(0.5), 0.5 * (at(0.84) - at(0.16)))
}

/// Returns the pixels of a disk, in a plane of the size of the photograph.
///
/// `x` and `y` are the centre in pixels from the top left corner.
///
/// # Errors
/// [`ReferenceError::Outside`] if the disk is not entirely within the photograph.
pub fn disk(size: (usize, usize), (x, y): (f64, f64), radius: f64) -> Result<Plane<bool>, ReferenceError> {
    let within = |at: f64, length: usize| at - radius >= 0.0 && at + radius <= length as f64;
    // Comparisons with NaN are false.
    if !(radius > 0.0 && within(x, size.0) && within(y, size.1)) {
        return Err(ReferenceError::Outside { size });
    }
    Ok(Plane::from_fn(size.0, size.1, |column, row| (column as f64 + 0.5 - x).hypot(row as f64 + 0.5 - y) <= radius))
}

/// Checks that a reference is not on the object.
///
/// `on_object` returns whether the pixel at a column and row is on the object.
///
/// # Errors
/// [`ReferenceError::Overlap`] if more than 1 % of the pixels of the region are on the object.
pub fn check_apart(region: &Plane<bool>, on_object: impl Fn(usize, usize) -> bool) -> Result<(), ReferenceError> {
    let width = region.width().max(1);
    let inside = || region.as_slice().iter().enumerate().filter(|(_, inside)| **inside).map(|(i, _)| i);
    let (all, shared) = (inside().count(), inside().filter(|i| on_object(i % width, i / width)).count());
    let share = shared as f64 / all.max(1) as f64;
    if share > MAX_OVERLAP { Err(ReferenceError::Overlap { share }) } else { Ok(()) }
}

impl PatchReading {
    /// Measures the patch in a region of a photograph.
    ///
    /// `clip` is the radiance at or above which a channel is clipped; without it, the level is
    /// detected in the photograph.
    ///
    /// # Errors
    /// If too many pixels are clipped, too few are usable, or the patch is black in a channel, not
    /// uniform, or more coloured than a neutral patch under captured light.
    ///
    /// # Panics
    /// If picture and region differ in size.
    pub fn of(rgb: &Plane<Vec3>, region: &Plane<bool>, clip: Option<f32>) -> Result<Self, ReferenceError> {
        assert_eq!(rgb.size(), region.size(), "picture and region differ in size");
        let inside = rgb.as_slice().iter().zip(region.as_slice()).filter(|(_, inside)| **inside);
        let values: Vec<Vec3> = inside.map(|(pixel, _)| *pixel).collect();
        let few = |pixels| ReferenceError::TooFewPixels { pixels, least: MIN_PIXELS };
        let read = PatchPixels::of(&values, Clipping::of(rgb, clip)).ok_or(few(0))?;
        if read.clipped_share() > MAX_CLIPPED {
            return Err(ReferenceError::Clipped { share: read.clipped_share() });
        }
        if read.usable < MIN_PIXELS {
            return Err(few(read.usable));
        }
        check_positive(read.median)?;
        for (what, variation, most) in
            [("brightness", read.variation, MAX_VARIATION), ("colour", read.chroma_variation, MAX_CHROMA_VARIATION)]
        {
            if variation > most {
                return Err(ReferenceError::Uneven { what, variation, most });
            }
        }
        check_neutral(read.median)?;
        Ok(Self { colour: read.median, pixels: read.pixels, clipped: read.clipped, variation: read.variation })
    }

    /// Returns the light on the patch, given its diffuse reflectance.
    ///
    /// # Errors
    /// [`ReferenceError::Reflectance`] unless the reflectance is above 0 and at most 1.
    pub fn light(&self, reflectance: f64) -> Result<ReferenceLight, ReferenceError> {
        check_reflectance(reflectance)?;
        let error = self.variation / (self.pixels.max(1) as f64).sqrt();
        Ok(ReferenceLight { white: self.colour / reflectance, ball: None, log_sd: error.hypot(REFLECTANCE_LOG_SD) })
    }
}

/// Checks that no channel is black.
pub(super) fn check_positive(colour: DVec3) -> Result<(), ReferenceError> {
    let names = ["red", "green", "blue"];
    let black = names.into_iter().zip(colour.to_array()).find(|(_, value)| value.is_nan() || *value <= 0.0);
    black.map_or(Ok(()), |(channel, _)| Err(ReferenceError::Black { channel }))
}

/// Checks the diffuse reflectance of a reference.
pub(super) fn check_reflectance(reflectance: f64) -> Result<(), ReferenceError> {
    let valid = reflectance > 0.0 && reflectance <= 1.0;
    if valid { Ok(()) } else { Err(ReferenceError::Reflectance(reflectance)) }
}

/// Checks that a colour is plausible for a neutral patch under captured light.
pub(super) fn check_neutral(colour: DVec3) -> Result<(), ReferenceError> {
    let chroma = Chroma::of(colour);
    let distance = chroma.distance(Chroma::default());
    if distance > MAX_CHROMA {
        return Err(ReferenceError::NotNeutral { log_chroma: chroma.0, distance });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::testing::noise;

    const LIGHT: Vec3 = Vec3::new(1.3, 1.0, 0.6);

    /// Returns a patch in the middle of a darker, noisy picture.
    fn picture(patch: impl Fn(usize, usize) -> Vec3) -> Plane<Vec3> {
        Plane::from_fn(100, 80, |x, y| {
            let inside = (30..70).contains(&x) && (20..60).contains(&y);
            let colour = if inside { patch(x, y) } else { Vec3::new(0.1, 0.2, 0.1) };
            colour * (1.0 + 0.03 * noise(x, y))
        })
    }

    fn middle() -> Plane<bool> {
        disk((100, 80), (50.0, 40.0), 15.0).unwrap()
    }

    #[test]
    fn measures_the_light_on_a_patch() {
        let patch = picture(|_, _| 0.18 * LIGHT);
        let read = PatchReading::of(&patch, &middle(), None).unwrap();
        assert!((read.colour / (0.18 * LIGHT.as_dvec3()) - 1.0).abs().max_element() < 0.01, "{}", read.colour);
        assert!(read.variation > 0.01 && read.variation < 0.05 && read.clipped == 0, "{read:?}");
        let light = read.light(0.18).unwrap();
        assert!((light.white / LIGHT.as_dvec3() - 1.0).abs().max_element() < 0.01);
        assert!(light.chroma().distance(Chroma::of(LIGHT.as_dvec3())) < 0.01);
        for wrong in [0.0, -0.1, 1.2, f64::NAN] {
            assert!(matches!(read.light(wrong), Err(ReferenceError::Reflectance(_))), "{wrong}");
        }
    }

    #[test]
    fn ignores_hot_and_invalid_pixels() {
        let mut patch = picture(|_, _| 0.18 * LIGHT);
        patch[(50, 40)] = Vec3::splat(f32::NAN);
        patch[(51, 41)] = Vec3::splat(1e4);
        patch[(49, 44)] = Vec3::splat(-3.0);
        let read = PatchReading::of(&patch, &middle(), None).unwrap();
        assert!((read.colour / (0.18 * LIGHT.as_dvec3()) - 1.0).abs().max_element() < 0.01);
    }

    #[test]
    fn rejects_clipped_patches() {
        let clipped = picture(|_, _| Vec3::ONE).map(|pixel| pixel.min(Vec3::ONE));
        let error = PatchReading::of(&clipped, &middle(), Some(1.0)).unwrap_err();
        assert!(matches!(error, ReferenceError::Clipped { share } if share > 0.3), "{error}");
        // Without a given level, the level that many pixels share is detected.
        assert!(matches!(PatchReading::of(&clipped, &middle(), None), Err(ReferenceError::Clipped { .. })));
    }

    #[test]
    fn accepts_a_rendered_patch_without_noise() {
        let flat = Plane::from_fn(100, 80, |x, y| {
            if (30..70).contains(&x) && (20..60).contains(&y) { LIGHT } else { Vec3::splat(0.01 * x as f32 / 100.0) }
        });
        let read = PatchReading::of(&flat, &middle(), None).unwrap();
        assert_eq!(read.colour.as_vec3(), LIGHT);
        // A patch with equal channels may be saturated.
        let white = flat.map(|pixel| if *pixel == LIGHT { Vec3::ONE } else { *pixel });
        assert!(matches!(PatchReading::of(&white, &middle(), None), Err(ReferenceError::Clipped { .. })));
        assert!(PatchReading::of(&white, &middle(), Some(2.0)).is_ok());
    }

    #[test]
    fn rejects_patches_that_are_not_neutral_and_uniform() {
        let of = |patch: Plane<Vec3>| PatchReading::of(&patch, &middle(), None).unwrap_err();
        let shaded = of(picture(|x, _| LIGHT * x as f32 / 50.0));
        assert!(matches!(shaded, ReferenceError::Uneven { what: "brightness", .. }), "{shaded}");
        let halves = of(picture(|x, _| if x < 50 { Vec3::new(0.8, 0.4, 0.3) } else { Vec3::new(0.1, 0.6, 0.3) }));
        assert!(matches!(halves, ReferenceError::Uneven { .. }), "{halves}");
        let red = of(picture(|_, _| Vec3::new(1.0, 0.1, 0.1)));
        assert!(matches!(red, ReferenceError::NotNeutral { .. }), "{red}");
        let black = of(picture(|_, _| Vec3::new(1.0, 0.9, 0.0)));
        assert_eq!(black, ReferenceError::Black { channel: "blue" });
        let empty = PatchReading::of(&picture(|_, _| LIGHT), &Plane::from_fn(100, 80, |_, _| false), None);
        assert_eq!(empty, Err(ReferenceError::TooFewPixels { pixels: 0, least: MIN_PIXELS }));
        let small = disk((100, 80), (50.0, 40.0), 2.0).unwrap();
        let few = PatchReading::of(&picture(|_, _| LIGHT), &small, None);
        assert!(matches!(few, Err(ReferenceError::TooFewPixels { .. })), "{few:?}");
        let nothing = picture(|_, _| Vec3::splat(f32::NAN));
        assert!(matches!(PatchReading::of(&nothing, &middle(), None), Err(ReferenceError::TooFewPixels { .. })));
    }

    #[test]
    fn rejects_disks_outside_the_picture_and_on_the_object() {
        for (x, y, radius) in [(5.0, 40.0, 10.0), (50.0, 75.0, 10.0), (-20.0, 40.0, 5.0), (50.0, 40.0, f64::NAN)] {
            assert!(matches!(disk((100, 80), (x, y), radius), Err(ReferenceError::Outside { .. })), "{x} {y} {radius}");
        }
        let region = middle();
        assert_eq!(check_apart(&region, |x, _| x > 80), Ok(()));
        let shared = check_apart(&region, |x, _| x >= 50);
        assert!(matches!(shared, Err(ReferenceError::Overlap { share }) if (share - 0.5).abs() < 0.05), "{shared:?}");
    }
}
