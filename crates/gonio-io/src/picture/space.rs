//! Colour space of an image file, and conversion to linear Rec. 709.

use std::path::Path;

use glam::{DMat3, Vec3};
use gonio::picture::Picture;
use rayon::prelude::*;

use super::{Decoded, Encoding, icc};
use crate::Error;
use crate::colour_space::{ColourSpace, Primaries};

/// Smallest number of pixels with the largest value that indicates clipping, as in `gonio::scene`.
const CLIPPED_PIXELS: usize = 12;

/// Largest negative channel, relative to the largest channel of the pixel, that counts as rounding.
const ROUNDING: f32 = 1e-4;

/// Source of the colour space of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpaceSource {
    /// The attribute `chromaticities` of an OpenEXR file.
    Chromaticities,
    /// The line `PRIMARIES` of a Radiance file.
    Primaries,
    /// An ICC profile.
    Icc,
    /// The chunk `cICP` of a PNG file.
    Cicp,
    /// The chunks `sRGB`, or `cHRM` and `gAMA`, of a PNG file.
    Chunks,
    /// Specified by the caller in [`ReadOptions::colour_space`](super::ReadOptions::colour_space);
    /// the file states no space.
    Given,
    /// Assumed, because neither the file nor the caller states a space.
    Assumed,
    /// Primaries of a camera raw file, not converted.
    Camera,
    /// A picture without colour, which is not converted.
    Grey,
}

impl SpaceSource {
    /// Describes the source in a few words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Chromaticities => "chromaticities of the file",
            Self::Primaries => "PRIMARIES of the file",
            Self::Icc => "ICC profile of the file",
            Self::Cicp => "cICP of the file",
            Self::Chunks => "sRGB, cHRM or gAMA of the file",
            Self::Given => "given",
            Self::Assumed => "assumed",
            Self::Camera => "camera raw",
            Self::Grey => "no colour",
        }
    }
}

/// Colour space of the values in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputSpace {
    /// Name of a [`ColourSpace`] or of the ICC profile, or else `custom`, `camera` or `grey`.
    pub name: String,
    /// Source of the colour space.
    pub source: SpaceSource,
    /// The given space, if the file states another one; the file's space was used.
    pub overridden: Option<ColourSpace>,
    /// Colour information of the file that could not be used, and why.
    pub unusable: Option<String>,
    /// Pixels with colours outside the gamut of Rec. 709, whose negative channels were set to zero.
    pub clamped: usize,
}

/// Conversion that a picture still needs to be in linear Rec. 709.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Conversion {
    None,
    /// Matrix from linear values of the file.
    Matrix(DMat3),
    /// Bytes of an ICC profile with a table from codes in 0..=1.
    Table(Vec<u8>),
}

/// Colour information of a file: its primaries, or a table instead of them.
#[derive(Clone, Debug, Default)]
pub(super) struct DeclaredSpace {
    /// Conversion, name (unless it is that of a named space) and source.
    pub(super) space: Option<(Conversion, Option<String>, SpaceSource)>,
    /// Colour information that could not be used, and why.
    pub(super) unusable: Option<String>,
}

impl DeclaredSpace {
    /// Returns the space of the chromaticities in a file; `field` is their name in messages.
    pub(super) fn primaries(primaries: &Primaries, source: SpaceSource, field: &str) -> Self {
        match primaries.to_rec709() {
            Some(matrix) => Self { space: Some((Conversion::Matrix(matrix), None, source)), unusable: None },
            None => Self { space: None, unusable: Some(format!("{field} are not valid primaries of a colour space")) },
        }
    }

    /// Settles the space of a picture, which may be grey. `linear` names its values if they are not
    /// codes; the table of an ICC profile then does not apply.
    pub(super) fn settle_values(
        self,
        is_grey: bool,
        linear: Option<&str>,
        given: Option<ColourSpace>,
    ) -> (Conversion, InputSpace) {
        match (&self.space, linear) {
            _ if is_grey => (Conversion::None, InputSpace::unconverted("grey", SpaceSource::Grey)),
            (Some((Conversion::Table(_), ..)), Some(values)) => {
                let unusable = format!("the table of the ICC profile (the table applies to codes, not to {values})");
                Self { space: None, unusable: Some(unusable) }.settle(given)
            }
            _ => self.settle(given),
        }
    }

    /// Combines the space of the file with the space of the caller; the file takes precedence.
    pub(super) fn settle(self, given: Option<ColourSpace>) -> (Conversion, InputSpace) {
        let Self { space, unusable } = self;
        let of_given = || {
            let source = if given.is_some() { SpaceSource::Given } else { SpaceSource::Assumed };
            (Conversion::Matrix(given.unwrap_or_default().to_rec709()), None, source)
        };
        let (conversion, name, source) = space.unwrap_or_else(of_given);
        let named = match &conversion {
            Conversion::Matrix(matrix) => ColourSpace::of_matrix(*matrix),
            Conversion::None | Conversion::Table(_) => None,
        };
        let overridden = given.filter(|given| named != Some(*given));
        let name = named.map(|space| space.name().to_owned()).or(name).unwrap_or_else(|| "custom".to_owned());
        let conversion = if named == Some(ColourSpace::Rec709) { Conversion::None } else { conversion };
        (conversion, InputSpace { name, source, overridden, unusable, clamped: 0 })
    }
}

impl InputSpace {
    /// Returns the space [`name`](Self::name) of a picture without colour or of a camera.
    pub(super) fn unconverted(name: &str, source: SpaceSource) -> Self {
        Self { name: name.to_owned(), source, overridden: None, unusable: None, clamped: 0 }
    }
}

impl Decoded {
    /// Wraps a picture in memory with linear colours in a colour space. `full_scale` is the
    /// radiance at or above which a channel is clipped.
    pub fn linear(picture: Picture, full_scale: Option<f32>, space: ColourSpace) -> Self {
        let (conversion, input) = DeclaredSpace::default().settle(Some(space));
        Self { picture, encoding: Encoding::LinearFloat, full_scale, layer: None, input, conversion }
    }

    /// Returns whether [`into_working`](Self::into_working) requires the table of an ICC profile.
    /// In this case, the picture contains codes instead of linear values before the conversion.
    pub fn needs_table(&self) -> bool {
        matches!(self.conversion, Conversion::Table(_))
    }

    /// Converts the picture to linear Rec. 709, if it is in another space.
    ///
    /// Channels that become negative, because Rec. 709 cannot express the colour, are set to zero
    /// and counted; negative channels of the file are converted unchanged. A pixel is clipped if a
    /// channel is at or above [`full_scale`](Self::full_scale), or at a largest value that many
    /// pixels share. Clipped pixels are scaled so that their largest channel exceeds those of all
    /// unclipped pixels. This value is the new `full_scale`. Call this function after corrections
    /// that act on the channels of the file.
    ///
    /// # Errors
    /// If the table of an ICC profile cannot be evaluated.
    pub fn into_working(mut self, path: &Path) -> Result<Self, Error> {
        let pixels = self.picture.rgb.as_slice();
        let converted: Vec<Vec3> = match std::mem::replace(&mut self.conversion, Conversion::None) {
            Conversion::None => return Ok(self),
            Conversion::Matrix(matrix) => {
                let matrix = matrix.as_mat3();
                pixels.par_iter().map(|v| matrix * *v).collect()
            }
            Conversion::Table(profile) => icc::apply_table(&profile, pixels).map_err(|problem| {
                let advice = "convert the image to sRGB or remove the profile";
                Error::unsupported(path, format!("has an unusable ICC profile ({problem})"), advice)
            })?,
        };
        let clip = self.full_scale.or_else(|| repeated_maximum(pixels));
        let is_clipped = |v: &Vec3| clip.is_some_and(|clip| v.max_element() >= clip);
        let mut out = self.picture.rgb.map(|_| Vec3::ZERO);
        let clamped: usize = (out.as_mut_slice(), pixels, &converted[..]).into_par_iter().map(clamp).sum();
        if let Some(clip) = clip {
            let largest = |clipped: bool| {
                let of_kind = out.as_slice().iter().zip(pixels).filter(|(_, old)| is_clipped(old) == clipped);
                of_kind.map(|(new, _)| new.max_element()).filter(|v| v.is_finite()).fold(0.0, f32::max)
            };
            let (clipped, rest) = (largest(true), largest(false));
            let level = if clipped > 0.0 { clipped } else { clip }.max(rest.next_up());
            for (new, _) in out.as_mut_slice().iter_mut().zip(pixels).filter(|(_, old)| is_clipped(old)) {
                raise(new, level);
            }
            self.full_scale = self.full_scale.map(|_| level);
        }
        self.picture.rgb = out;
        self.input.clamped += clamped;
        Ok(self)
    }
}

/// Stores the converted colour of a pixel; returns 1 if it clamped channels.
///
/// Negative channels are set to zero if the original colour has no negative channels.
fn clamp((new, old, converted): (&mut Vec3, &Vec3, &Vec3)) -> usize {
    let sound = old.cmpge(Vec3::ZERO).all();
    *new = if sound { converted.max(Vec3::ZERO) } else { *converted };
    usize::from(sound && converted.min_element() < -ROUNDING * converted.max_element().abs())
}

/// Scales a colour so that its largest channel is `level`.
fn raise(colour: &mut Vec3, level: f32) {
    let largest = colour.max_position();
    let factor = level / colour[largest];
    if factor.is_finite() && factor > 0.0 {
        *colour = (*colour * factor).min(Vec3::splat(level));
        colour[largest] = level;
    }
}

/// Returns the largest channel of all pixels if at least twelve of them have it, which indicates
/// clipping.
pub fn repeated_maximum(pixels: &[Vec3]) -> Option<f32> {
    let values = || pixels.iter().map(|v| v.max_element()).filter(|v| v.is_finite());
    let largest = values().fold(0.0, f32::max);
    (largest > 0.0 && values().filter(|v| *v == largest).count() >= CLIPPED_PIXELS).then_some(largest)
}

#[cfg(test)]
mod tests {
    use gonio::picture::Plane;

    use super::*;

    fn decoded(space: ColourSpace, pixels: Vec<Vec3>, full_scale: Option<f32>) -> Decoded {
        let stated = DeclaredSpace::primaries(&space.primaries(), SpaceSource::Chromaticities, "chromaticities");
        let (conversion, input) = stated.settle(None);
        let picture = Picture { rgb: Plane::from_vec(pixels.len(), 1, pixels), alpha: None };
        let decoded = Decoded { picture, encoding: Encoding::LinearFloat, full_scale, layer: None, input, conversion };
        decoded.into_working(Path::new("t")).unwrap()
    }

    #[test]
    fn the_space_of_the_file_takes_precedence() {
        let p3 = DeclaredSpace::primaries(&ColourSpace::DisplayP3.primaries(), SpaceSource::Icc, "");
        let (_, input) = p3.clone().settle(Some(ColourSpace::AcesCg));
        assert_eq!((input.name.as_str(), input.overridden), ("display-p3", Some(ColourSpace::AcesCg)));
        let (_, input) = p3.settle(Some(ColourSpace::DisplayP3));
        assert_eq!((input.source, input.overridden), (SpaceSource::Icc, None));
        let (conversion, input) = DeclaredSpace::default().settle(Some(ColourSpace::Rec2020));
        assert_eq!((input.name.as_str(), input.source), ("rec2020", SpaceSource::Given));
        assert_eq!(conversion, Conversion::Matrix(ColourSpace::Rec2020.to_rec709()));
        let (conversion, input) = DeclaredSpace::default().settle(None);
        assert_eq!((input.name.as_str(), input.source, conversion), ("rec709", SpaceSource::Assumed, Conversion::None));
    }

    #[test]
    fn colours_outside_the_gamut_are_clamped_and_invalid_values_kept() {
        let green = Vec3::new(0.0, 1.0, 0.0);
        let got = decoded(ColourSpace::Rec2020, vec![green, Vec3::ONE, -Vec3::ONE, Vec3::NAN], None);
        let rgb = got.picture.rgb.as_slice();
        // Rec. ITU-R BT.2087-0: (-0.5876, 1.1329, -0.1006).
        assert!((rgb[0] - Vec3::new(0.0, 1.1329, 0.0)).length() < 1e-4, "{}", rgb[0]);
        assert!((rgb[1] - Vec3::ONE).length() < 1e-6);
        assert!((rgb[2] + Vec3::ONE).length() < 1e-6 && rgb[3].is_nan());
        assert_eq!(got.input.clamped, 1);
    }

    #[test]
    fn clipped_pixels_stay_the_brightest() {
        let (white, red, orange) = (Vec3::ONE, Vec3::new(1.0, 0.1, 0.1), Vec3::new(0.99, 0.5, 0.0));
        let pixels = vec![white, red, orange, Vec3::splat(0.5)];
        let got = decoded(ColourSpace::DisplayP3, pixels, Some(1.0));
        let (level, rgb) = (got.full_scale.unwrap(), got.picture.rgb.as_slice());
        assert!(
            level >= 1.0
                && rgb[2].max_element() < level
                && rgb[0].max_element() == level
                && rgb[1].max_element() == level,
            "{rgb:?}"
        );
        assert!(rgb[3].max_element() < level && (rgb[3] - Vec3::splat(0.5)).length() < 1e-6);
        // Orange is brighter than white in red, and not clipped.
        let bright = decoded(ColourSpace::DisplayP3, vec![white, orange], Some(1.0));
        assert!(bright.picture.rgb[(0, 0)].max_element() >= bright.picture.rgb[(1, 0)].max_element());

        // Without clipped pixels, no pixel becomes one.
        let dim = decoded(ColourSpace::DisplayP3, vec![orange * 0.1], Some(1.0));
        assert!(dim.full_scale == Some(1.0) && dim.picture.rgb[(0, 0)].max_element() < 0.2);

        let mut pixels = vec![Vec3::splat(2.0); CLIPPED_PIXELS];
        pixels.extend([Vec3::new(2.0, 0.3, 0.1), Vec3::splat(1.9)]);
        let got = decoded(ColourSpace::AcesCg, pixels, None);
        let shared: Vec<f32> = got.picture.rgb.as_slice().iter().map(|v| v.max_element()).collect();
        assert!(shared[..=CLIPPED_PIXELS].iter().all(|v| *v == shared[0]), "{shared:?}");
        assert!(shared[CLIPPED_PIXELS + 1] < shared[0] && got.full_scale.is_none());
    }
}
