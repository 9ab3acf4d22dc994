//! Pictures on disk: photographs, light maps, masks.
//!
//! The format is recognised by content, never by the name. Conventions:
//! * OpenEXR: channels `R G B [A]`, `Y [A]` (grey) or `Y RY BY [A]` (not subsampled), under these
//!   or other usual names, also with a layer's prefix; 16/32-bit float or 32-bit integer. The
//!   picture has the size of the display window; pixels outside the data window are zero. Colour
//!   stays multiplied by alpha, as the format defines it.
//! * Radiance HDR: values as stored; `EXPOSURE` and `COLORCORR` are ignored, as the scale is
//!   arbitrary anyway.
//! * PFM: values times the absolute value of the header's scale.
//! * PNG, JPEG (8 and 16 bit) and TIFF (8, 16 bit, 32-bit float RGB): sRGB-coded unless
//!   [`ReadOptions::linear`] says otherwise; embedded colour profiles are ignored; an EXIF
//!   orientation is applied; colour is not multiplied by alpha.
//! * A camera's raw files, with the feature `raw`: linear camera RGB, binned; see the module of
//!   that name.
//!
//! Not-a-number, infinite and negative values are passed on: whether they matter depends on the
//! mask, which only the caller knows.

mod bracket;
mod exr;
mod flat;
mod integer;
mod jpeg;
mod layers;
mod mask;
mod pfm;
mod radiance;
#[cfg(feature = "raw")]
mod raw;
mod response;
mod shot;
mod write;

use std::io::Read;
use std::path::Path;

use gonio::picture::Picture;

use crate::{Error, guard};

pub use bracket::{Bracket, BracketOptions, decode_bracket, read_bracket};
pub(crate) use exr::read_channels;
pub use flat::{divide_by_flat, subtract_black};
pub(crate) use layers::{Selection, groups};
pub use mask::read_mask;
pub use response::{decode_response, encode_response, read_response, write_response};
pub use shot::Shot;
pub use write::{
    encode_exr, encode_exr_clipped, encode_hdr, encode_pfm, encode_png, encode_png_signed, encode_png_srgb8, is_signed,
    write_exr, write_hdr, write_pfm, write_png, write_png_srgb8,
};

/// Options for reading a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadOptions {
    /// Whether the samples of integer files are linear instead of sRGB-coded. No effect on float
    /// files.
    pub linear: bool,
    /// Largest number of pixels, checked on the header before memory is taken; each takes about 16
    /// bytes.
    pub max_pixels: u64,
    /// Layer of an OpenEXR file to read, by its name or the last part of it, in any case; `rgb`
    /// stands for channels without a layer. `None` takes the finished picture. Other files have no
    /// layers: with a name they are not read.
    pub layer: Option<String>,
}

impl Default for ReadOptions {
    /// sRGB-coded integers, at most 2^27 (134 million) pixels.
    fn default() -> Self {
        Self { linear: false, max_pixels: 1 << 27, layer: None }
    }
}

impl ReadOptions {
    /// Returns the longest file worth reading into memory: 32 bytes a pixel leave room for unused
    /// layers.
    pub(crate) fn max_bytes(&self) -> u64 {
        self.max_pixels.saturating_mul(32).saturating_add(1 << 24)
    }

    /// Checks the dimensions in a header and returns them, if they are within the limits.
    pub(crate) fn check_size(&self, path: &Path, width: u64, height: u64) -> Result<(usize, usize), Error> {
        if width == 0 || height == 0 {
            return Err(Error::damaged(path, format!("has no pixels ({width}x{height})")));
        }
        if width.checked_mul(height).is_none_or(|n| n > self.max_pixels || n > usize::MAX as u64 / 32) {
            let problem = format!("has {width}x{height} pixels, more than the limit of {}", self.max_pixels);
            return Err(Error::limits(path, problem, "scale it down"));
        }
        Ok((width as usize, height as usize))
    }
}

/// Encoding of the samples of a file, relative to the linear values returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Linear floating-point numbers.
    LinearFloat,
    /// Integers coded with the sRGB curve, decoded to 0..=1. Such photographs are rarely
    /// proportional to radiance: worth a warning.
    Srgb {
        /// Bits per sample, 8 or 16.
        bits: u8,
    },
    /// Integers taken as linear because the caller asked for it, divided by the largest code.
    Linear {
        /// Bits per sample, 8 or 16.
        bits: u8,
    },
}

/// A picture with its encoding and origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// Linear radiance; see the [module](self) for what alpha means.
    pub picture: Picture,
    /// Encoding in the file.
    pub encoding: Encoding,
    /// Value of a saturated sample, 1.0 for integer files. Float files give it in the OpenEXR
    /// attribute `clipLevel`, if at all.
    pub full_scale: Option<f32>,
    /// Picture chosen from an OpenEXR file that holds several.
    pub layer: Option<LayerChoice>,
}

/// Choice of one of several pictures in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LayerChoice {
    /// Name of the chosen one, in lower case.
    pub name: String,
    /// Names of the others, at least one.
    pub others: Vec<String>,
}

/// Formats read here, recognised by their first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Exr,
    Radiance,
    Pfm,
    Png,
    Jpeg,
    Tiff,
    #[cfg(feature = "raw")]
    Raw,
}

impl Format {
    pub(crate) fn of(path: &Path, bytes: &[u8]) -> Result<Self, Error> {
        const READABLE: &str = "give EXR, HDR, PFM, PNG, JPEG or TIFF";
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        #[cfg(feature = "raw")]
        if raw::is_raw(&extension) && !matches!(extension.as_str(), "tif" | "tiff") {
            return Ok(Self::Raw);
        }
        match bytes {
            [0x76, 0x2f, 0x31, 0x01, ..] => Ok(Self::Exr),
            [b'#', b'?', ..] => Ok(Self::Radiance),
            [b'P', b'F' | b'f', white, ..] if white.is_ascii_whitespace() => Ok(Self::Pfm),
            [0x89, b'P', b'N', b'G', ..] => Ok(Self::Png),
            [0xff, 0xd8, 0xff, ..] => Ok(Self::Jpeg),
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => match extension.as_str() {
                // Raw files are TIFF containers, but a TIFF reader finds only the preview in them.
                "dng" | "cr2" | "nef" | "arw" | "orf" | "pef" | "rw2" => Err(Error::unsupported(
                    path,
                    "is a camera's raw file",
                    "develop it without a tone curve to a linear EXR or 16-bit TIFF, or build gonio with the feature raw",
                )),
                _ => Ok(Self::Tiff),
            },
            _ => Err(match extension.as_str() {
                "exr" | "hdr" | "pic" | "pfm" | "png" | "jpg" | "jpeg" | "tif" | "tiff" => {
                    Error::damaged(path, format!("does not begin like a .{extension} file"))
                }
                "" => Error::unsupported(path, "is in no known picture format", READABLE),
                other => Error::unsupported(path, format!("is a .{other} file, which cannot be read"), READABLE),
            }),
        }
    }
}

/// Reads a picture of any supported format.
///
/// # Errors
/// If the file cannot be read, is of another format, is damaged (files cut short included), or has
/// more pixels than the options allow.
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Decoded, Error> {
    let path = path.as_ref();
    decode(path, &guard::read_whole(path, options.max_bytes())?, options)
}

/// Reads the bytes of a picture from a stream, which messages call `name`.
///
/// # Errors
/// If it cannot be read, is empty, or is longer than a picture that the options allow.
pub fn read_stream(name: &Path, stream: impl Read, options: &ReadOptions) -> Result<Vec<u8>, Error> {
    guard::read_stream(name, stream, options.max_bytes())
}

/// Decodes a picture held in memory; `path` serves the messages only. The rest is as in [`read`].
///
/// # Errors
/// Like [`read`].
pub fn decode(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Decoded, Error> {
    let format = Format::of(path, bytes)?;
    if options.layer.is_some() && format != Format::Exr {
        return Err(Error::unsupported(path, "has no layers, as OpenEXR files have", "read it without naming one"));
    }
    match format {
        Format::Exr => exr::decode(path, bytes, options),
        Format::Radiance => radiance::decode(path, bytes, options),
        Format::Pfm => pfm::decode(path, bytes, options),
        Format::Png => integer::decode(path, bytes, image::ImageFormat::Png, options),
        Format::Tiff => integer::decode(path, bytes, image::ImageFormat::Tiff, options),
        Format::Jpeg => integer::decode(path, bytes, image::ImageFormat::Jpeg, options),
        #[cfg(feature = "raw")]
        Format::Raw => Ok(raw::develop(path, bytes, options)?.into_decoded()),
    }
}

/// Builds the result for float formats without an alpha channel.
fn float_picture(width: usize, height: usize, rgb: Vec<glam::Vec3>) -> Decoded {
    let rgb = gonio::picture::Plane::from_vec(width, height, rgb);
    Decoded { picture: Picture { rgb, alpha: None }, encoding: Encoding::LinearFloat, full_scale: None, layer: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    #[track_caller]
    fn check(name: &str, bytes: &[u8], kind: Kind, says: &str) {
        let error = decode(Path::new(name), bytes, &ReadOptions::default()).unwrap_err();
        assert_eq!(error.kind(), kind, "{error}");
        assert!(error.to_string().contains(says), "{error}");
        assert!(error.to_string().starts_with(name), "{error}");
    }

    #[test]
    fn unknown_files_are_told_apart_from_broken_ones() {
        check("a.webp", b"RIFF....WEBP", Kind::Unsupported, "is a .webp file");
        check("a", b"what is this", Kind::Unsupported, "no known picture format");
        check("a.exr", b"what is this", Kind::Damaged, "does not begin like a .exr file");
        check("a.nef", b"MM\0\x2a rest", Kind::Unsupported, "raw");
    }

    #[test]
    fn layers_are_those_of_openexr() {
        let layer = ReadOptions { layer: Some("diffuse".into()), ..Default::default() };
        let error = decode(Path::new("a.pfm"), b"Pf\n1 1\n-1.0\n\0\0\0\0", &layer).unwrap_err();
        assert_eq!(error.kind(), Kind::Unsupported, "{error}");
        assert!(error.to_string().contains("a.pfm: has no layers"), "{error}");
    }

    #[test]
    fn sizes_are_limited() {
        let options = ReadOptions { max_pixels: 6, ..Default::default() };
        let path = Path::new("x");
        assert_eq!(options.check_size(path, 2, 3).unwrap(), (2, 3));
        assert_eq!(options.check_size(path, 7, 1).unwrap_err().kind(), Kind::Limits);
        assert_eq!(options.check_size(path, u64::MAX, u64::MAX).unwrap_err().kind(), Kind::Limits);
        assert_eq!(options.check_size(path, 0, 3).unwrap_err().kind(), Kind::Damaged);
    }
}
