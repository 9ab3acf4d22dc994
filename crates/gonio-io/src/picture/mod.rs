//! Pictures on disk: photographs, environment maps, masks.
//!
//! The format is recognised by content, never by the name. Conventions:
//! * OpenEXR: channels `R G B [A]`, `Y [A]` (grey) or `Y RY BY [A]` (luminance and chroma), under
//!   these or other usual names, with or without the prefix of a layer; 16/32-bit float or 32-bit
//!   integer. Subsampled channels are interpolated linearly. The picture has the size of the
//!   display window; pixels outside the data window are zero. Colour stays multiplied by alpha, as
//!   the format defines it.
//! * Radiance HDR: values divided by the products of the `EXPOSURE` and `COLORCORR` lines; pixels
//!   in any of the eight axis orders.
//! * PFM: values times the absolute value of the header's scale.
//! * PNG and JPEG (8 and 16 bits) and TIFF (unsigned integers of 8 to 64 bits, floats of 16 to 64
//!   bits; in strips or tiles, with interleaved or separate channels). Integers are coded by the
//!   curve that the file states, else by that of sRGB, unless [`ReadOptions::linear`] is set. An
//!   EXIF orientation is applied. Colour is not multiplied by alpha.
//! * Camera raw files, with the feature `raw`: linear camera RGB, binned; see the module `raw`.
//!
//! [`read`] and [`decode`] convert colours to linear Rec. 709 with white D65. The colour space is
//! the one that the file states (`chromaticities` of OpenEXR, `PRIMARIES` of Radiance, `cICP`, ICC
//! profile, `sRGB`, `cHRM` and `gAMA` of PNG, ICC profile of TIFF and JPEG), else
//! [`ReadOptions::colour_space`]. Pictures without colour are not converted.
//!
//! NaN, infinite and negative values are passed on, because their relevance depends on the mask,
//! which is not available here.

mod bracket;
mod curve;
mod embedded;
mod exr;
mod flat;
mod icc;
mod integer;
mod jpeg;
mod layers;
mod mask;
mod pfm;
mod png;
mod radiance;
#[cfg(feature = "raw")]
mod raw;
mod response;
mod shot;
mod space;
mod subsampled;
mod tiff;
mod write;

use std::io::Read;
use std::path::Path;

use gonio::picture::Picture;

use crate::colour_space::ColourSpace;
use crate::{Error, guard};
use space::Conversion;

pub use bracket::{Bracket, BracketOptions, decode_bracket, read_bracket};
pub(crate) use exr::read_channels;
pub use flat::{divide_by_flat, subtract_black};
pub(crate) use layers::{Group, Selection, groups, select_best};
pub use mask::read_mask;
pub use response::{decode_response, encode_response, read_response};
pub use shot::ExposureSettings;
pub use space::{InputSpace, SpaceSource, repeated_maximum};
pub use write::{
    ExrOptions, encode_exr, encode_exr_in, encode_exr_layers, encode_exr_with, encode_hdr, encode_pfm, encode_png,
    encode_png_signed, encode_png_srgb8, is_signed,
};

/// Options for reading a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadOptions {
    /// Whether the samples are linear. This overrides the curve that the file states or its format
    /// implies. The colour space of the file still applies, except that of a table in an ICC
    /// profile.
    pub linear: bool,
    /// Largest number of pixels, checked before allocation; each takes about 16 bytes.
    pub max_pixels: u64,
    /// Layer of an OpenEXR file to read, by its name or the last part of it, in any case; `rgb`
    /// means channels without a layer. `None` selects the finished picture. A name is an error for
    /// files of other formats, which have no layers.
    pub layer: Option<String>,
    /// Colour space of files that state none; `None` assumes [`ColourSpace::Rec709`], for integer
    /// files sRGB. It also gives the curve of integer files that state none: that of sRGB for Rec.
    /// 709 and Display P3, that of BT.2020 for Rec. 2020, linear for the others.
    pub colour_space: Option<ColourSpace>,
}

impl Default for ReadOptions {
    /// sRGB-coded integers, at most 2^27 (134 million) pixels.
    fn default() -> Self {
        Self { linear: false, max_pixels: 1 << 27, layer: None, colour_space: None }
    }
}

impl ReadOptions {
    /// Returns the largest file size to read: 32 bytes per pixel leave room for unused layers.
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
            return Err(Error::limits(path, problem, "scale the image down"));
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
    /// proportional to radiance.
    Srgb {
        /// Bits per sample: 8, 16, or in TIFF 32 or 64.
        bits: u8,
    },
    /// Linear integers, according to the file or the caller, divided by the largest code.
    Linear {
        /// Bits per sample: 8, 16, or in TIFF 32 or 64.
        bits: u8,
    },
    /// Samples coded by another curve, that of an ICC profile, `cICP` or `gAMA`.
    Coded {
        /// Bits per sample: 8, 16, in TIFF 32 or 64; 32 for floats.
        bits: u8,
    },
}

/// A picture with its encoding and origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// Linear radiance; the [module](self) documentation describes alpha. Its colours are linear
    /// Rec. 709 after [`into_working`](Self::into_working), which [`decode`] and [`read`] call.
    pub picture: Picture,
    /// Encoding in the file.
    pub encoding: Encoding,
    /// Value of a saturated sample, about 1.0 for integer files. Float files can state it only in
    /// the OpenEXR attribute `clipLevel`. Conversion to linear Rec. 709 changes it.
    pub full_scale: Option<f32>,
    /// Picture selected from an OpenEXR file with several pictures.
    pub layer: Option<LayerChoice>,
    /// Colour space of the values in the file.
    pub input: InputSpace,
    /// Conversion that [`into_working`](Self::into_working) applies.
    conversion: Conversion,
}

/// Selection of one of several pictures in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LayerChoice {
    /// Name of the selected picture, in lower case.
    pub name: String,
    /// Names of the other pictures, at least one.
    pub others: Vec<String>,
}

/// File name extensions of the supported formats, except camera raw files.
pub const EXTENSIONS: [&str; 9] = ["exr", "hdr", "pic", "pfm", "png", "jpg", "jpeg", "tif", "tiff"];

/// Supported formats, recognised by their first bytes.
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
        const READABLE: &str = "use EXR, HDR, PFM, PNG, JPEG or TIFF";
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
                // Raw files are TIFF containers, but a TIFF reader reads only their preview.
                "dng" | "cr2" | "nef" | "arw" | "orf" | "pef" | "rw2" => Err(Error::unsupported(
                    path,
                    "is a camera raw file",
                    "convert it without a tone curve to linear EXR or 16-bit TIFF, or build gonio with the feature \
                     raw",
                )),
                _ => Ok(Self::Tiff),
            },
            _ => Err(match extension.as_str() {
                known if EXTENSIONS.contains(&known) => {
                    Error::damaged(path, format!("does not have the header of a .{extension} file"))
                }
                "" => Error::unsupported(path, "has an unknown image format", READABLE),
                other => Error::unsupported(
                    path,
                    format!("is a .{other} file, which is not a supported image format"),
                    READABLE,
                ),
            }),
        }
    }
}

/// Reads a picture of any supported format and converts its colours to linear Rec. 709.
///
/// # Errors
/// If the file cannot be read, has another format, is damaged or truncated, or has more pixels than
/// the options allow.
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Decoded, Error> {
    let path = path.as_ref();
    read_unconverted(path, options)?.into_working(path)
}

/// Reads like [`read`], but keeps the primaries of the file. For values that are not colours, and
/// for corrections before [`Decoded::into_working`].
///
/// # Errors
/// Like [`read`].
pub fn read_unconverted(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Decoded, Error> {
    let path = path.as_ref();
    decode_unconverted(path, &guard::read_whole(path, options.max_bytes())?, options)
}

/// Reads the bytes of a picture from a stream; `name` is its name in error messages.
///
/// # Errors
/// If it cannot be read, is empty, or is longer than a picture that the options allow.
pub fn read_stream(name: &Path, stream: impl Read, options: &ReadOptions) -> Result<Vec<u8>, Error> {
    guard::read_stream(name, stream, options.max_bytes())
}

/// Decodes a picture held in memory; `path` is only used in error messages. Otherwise like
/// [`read`].
///
/// # Errors
/// Like [`read`].
pub fn decode(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Decoded, Error> {
    decode_unconverted(path, bytes, options)?.into_working(path)
}

/// Decodes like [`decode`], but keeps the primaries of the file, as [`read_unconverted`] does.
///
/// # Errors
/// Like [`read`].
pub fn decode_unconverted(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Decoded, Error> {
    let format = Format::of(path, bytes)?;
    if options.layer.is_some() && format != Format::Exr {
        return Err(Error::unsupported(
            path,
            "has no layers, because it is not an OpenEXR file",
            "remove the layer name",
        ));
    }
    match format {
        Format::Exr => exr::decode(path, bytes, options),
        Format::Radiance => radiance::decode(path, bytes, options),
        Format::Pfm => pfm::decode(path, bytes, options),
        Format::Png => integer::decode(path, bytes, image::ImageFormat::Png, options),
        Format::Tiff => integer::decode(path, bytes, image::ImageFormat::Tiff, options),
        Format::Jpeg => integer::decode(path, bytes, image::ImageFormat::Jpeg, options),
        #[cfg(feature = "raw")]
        Format::Raw => {
            let mut decoded = raw::develop(path, bytes, options)?.into_decoded();
            decoded.input.overridden = options.colour_space;
            Ok(decoded)
        }
    }
}

/// Builds the result for float formats without an alpha channel.
fn float_picture(
    (width, height): (usize, usize),
    rgb: Vec<glam::Vec3>,
    (conversion, input): (Conversion, InputSpace),
) -> Decoded {
    let rgb = gonio::picture::Plane::from_vec(width, height, rgb);
    let picture = Picture { rgb, alpha: None };
    Decoded { picture, encoding: Encoding::LinearFloat, full_scale: None, layer: None, input, conversion }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    #[track_caller]
    fn check(name: &str, bytes: &[u8], kind: Kind, message: &str) {
        let error = decode(Path::new(name), bytes, &ReadOptions::default()).unwrap_err();
        assert_eq!(error.kind(), kind, "{error}");
        assert!(error.to_string().contains(message), "{error}");
        assert!(error.to_string().starts_with(name), "{error}");
    }

    #[test]
    fn unknown_formats_are_distinguished_from_damaged_files() {
        check("a.webp", b"RIFF....WEBP", Kind::Unsupported, "is a .webp file");
        for name in ["a.mat", "a.npz", "a.bin", "a.npy"] {
            let message = "which is not a supported image format; use EXR, HDR, PFM, PNG, JPEG or TIFF";
            check(name, b"PK\x03\x04 or other", Kind::Unsupported, message);
        }
        check("a", b"what is this", Kind::Unsupported, "unknown image format");
        check("a.exr", b"what is this", Kind::Damaged, "does not have the header of a .exr file");
        check("a.nef", b"MM\0\x2a rest", Kind::Unsupported, "raw");
    }

    #[test]
    fn layers_require_openexr() {
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
