//! TIFF: samples in strips and tiles, and the ICC profile.
//!
//! The decoder of `image` reads unsigned integers of 8 and 16 bits in strips. This module reads the
//! other files, strip by strip or tile by tile. They have floats of 16, 32 or 64 bits, unsigned
//! integers of 32 or 64 bits, grey with alpha, separate or further channels, or tiles.

mod chunks;

use std::io::Cursor;
use std::path::Path;

use ::tiff::decoder::{ChunkType, Decoder, Limits};
use ::tiff::tags::{ExtraSamples, PlanarConfiguration, Predictor, SampleFormat, Tag, Type, ValueBuffer};
use ::tiff::{ColorType, TiffError};
use image::DynamicImage;
use image::metadata::Orientation;

use self::chunks::{Canvas, Grid};

use super::ReadOptions;
use super::integer::Samples;
use crate::Error;

type Reader<'a> = Decoder<Cursor<&'a [u8]>>;

/// Returns the ICC profile of the first picture of a file, if there is one.
pub(super) fn icc_profile(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut limits = Limits::default();
    // The decoder of `image` rejects profiles that are long in relation to the picture.
    limits.ifd_value_size = bytes.len();
    let mut reader = Decoder::new(Cursor::new(bytes)).ok()?.with_limits(limits);
    let mut profile = ValueBuffer::empty(Type::BYTE);
    reader.image_ifd().find_tag_buf(Tag::IccProfile, &mut profile).ok()??;
    matches!(profile.data_type(), Type::BYTE | Type::UNDEFINED).then(|| profile.as_bytes().to_vec())
}

/// Reads the first picture of a file. Integers of more than 16 bits become floats, divided by the
/// largest code. Returns `None` for files that the decoder of `image` reads.
///
/// # Errors
/// If the file is damaged, has more pixels than the options allow, or has samples that are neither
/// unsigned integers nor floats.
pub(super) fn load(
    path: &Path,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<Option<(DynamicImage, Samples, Orientation)>, Error> {
    let failed = |e| explain(path, e);
    let mut reader = Decoder::new(Cursor::new(bytes)).map_err(failed)?;
    let (width, height) = reader.dimensions().map_err(failed)?;
    let size = options.check_size(path, width.into(), height.into())?;
    let room = usize::try_from(options.max_pixels.saturating_mul(32).saturating_add(1 << 24)).unwrap_or(usize::MAX);
    let is_tiled = reader.get_chunk_type() == ChunkType::Tile;
    let chunk = reader.chunk_dimensions();
    if is_tiled {
        // The decoder allocates a row of a tile without a limit.
        options.check_size(path, chunk.0.into(), chunk.1.into())?;
    }
    let colour = reader.colortype().map_err(failed)?;
    let layout = Layout::of(&mut reader, is_tiled);
    // The decoder allocates a row of a chunk with all its channels without a limit.
    let samples = if layout.is_planar { 1 } else { u64::from(layout.samples) };
    if u64::from(chunk.0).saturating_mul(samples).saturating_mul(8) > room as u64 {
        let problem = format!("has {} channels of {width} columns", layout.samples);
        return Err(Error::limits(path, problem, "write a grey or RGB image"));
    }
    layout.check_predictor(path, colour)?;
    if layout.is_read_by_image(colour) {
        return Ok(None);
    }
    let channels = layout.channels(path, colour)?;
    let mut limits = Limits::default();
    (limits.decoding_buffer_size, limits.intermediate_buffer_size) = (room, room);
    reader = reader.with_limits(limits);
    let grid = Grid {
        size,
        chunk: (chunk.0 as usize, (chunk.1 as usize).min(if is_tiled { usize::MAX } else { size.1 })),
        channels,
        is_planar: layout.is_planar,
    };
    let mut canvas: Option<Canvas> = None;
    for index in 0..grid.count() {
        let (columns, _) = reader.chunk_data_dimensions(index);
        let chunk = reader.read_chunk(index).map_err(failed)?;
        let canvas = canvas.get_or_insert_with(|| Canvas::new(&chunk, &grid));
        canvas.place(chunk, index as usize, columns as usize, &grid).ok_or_else(|| {
            let problem = "has signed integers as samples";
            Error::unsupported(path, problem, "write unsigned integers or floats")
        })?;
    }
    let (image, samples) =
        canvas.and_then(|canvas| canvas.into_image(&grid)).ok_or_else(|| Error::damaged(path, "has no pixels"))?;
    let orientation = reader.find_tag_unsigned::<u8>(Tag::Orientation).ok().flatten();
    Ok(Some((image, samples, orientation.and_then(Orientation::from_exif).unwrap_or(Orientation::NoTransforms))))
}

/// Tags that describe the order of the samples.
struct Layout {
    is_tiled: bool,
    is_planar: bool,
    /// Whether the samples are unsigned integers.
    has_codes: bool,
    has_predictor: bool,
    samples: u16,
    /// Whether the last channel is alpha.
    has_alpha: bool,
}

impl Layout {
    fn of(reader: &mut Reader<'_>, is_tiled: bool) -> Self {
        let mut list = |tag| reader.find_tag_unsigned_vec::<u16>(tag).ok().flatten().unwrap_or_default();
        let alpha = [ExtraSamples::AssociatedAlpha, ExtraSamples::UnassociatedAlpha].map(|kind| kind.to_u16());
        Self {
            is_tiled,
            is_planar: list(Tag::PlanarConfiguration) == [PlanarConfiguration::Planar.to_u16()],
            has_codes: list(Tag::SampleFormat).iter().all(|format| *format == SampleFormat::Uint.to_u16()),
            has_predictor: list(Tag::Predictor).iter().any(|kind| *kind != Predictor::None.to_u16()),
            samples: list(Tag::SamplesPerPixel).first().copied().unwrap_or(1),
            has_alpha: list(Tag::ExtraSamples).last().is_some_and(|kind| alpha.contains(kind)),
        }
    }

    /// Whether the decoder of `image` reads a file. It fails for tiles with separate or other
    /// channels.
    fn is_read_by_image(&self, colour: ColorType) -> bool {
        let is_plain = !self.is_tiled && !self.is_planar && self.samples == colour.num_samples();
        match colour {
            ColorType::Gray(8 | 16) | ColorType::RGB(8 | 16) | ColorType::RGBA(8 | 16) => self.has_codes && is_plain,
            ColorType::Gray(bits) | ColorType::RGB(bits) | ColorType::RGBA(bits) => !matches!(bits, 32 | 64),
            ColorType::Multiband { .. } => false,
            // CMYK, and colours that `image` rejects.
            _ => true,
        }
    }

    /// Checks that the file uses no predictor together with channels that the decoder leaves out.
    /// The decoder would add differences of the wrong channels.
    fn check_predictor(&self, path: &Path, colour: ColorType) -> Result<(), Error> {
        if !self.has_predictor || self.is_planar || self.samples <= colour.num_samples() {
            return Ok(());
        }
        let problem = "has a predictor and channels other than colour and alpha";
        Err(Error::unsupported(path, problem, "remove the other channels, or write the file without a predictor"))
    }

    /// Returns the number of channels to read: one or three of colour, and alpha.
    fn channels(&self, path: &Path, colour: ColorType) -> Result<usize, Error> {
        let unsuitable = |channels: u16| {
            let problem = format!("has {channels} channels that are neither grey nor RGB of 8 or more bits");
            Error::unsupported(path, problem, "write a grey or RGB image")
        };
        match colour {
            ColorType::Gray(8 | 16 | 32 | 64) => Ok(1),
            ColorType::RGB(_) => Ok(3),
            ColorType::RGBA(_) => Ok(4),
            ColorType::Multiband { bit_depth: 8 | 16 | 32 | 64, num_samples } => match (num_samples, self.has_alpha) {
                (2, true) | (3, false) | (4, true) => Ok(num_samples.into()),
                _ => Err(unsuitable(num_samples)),
            },
            other => Err(unsuitable(other.num_samples())),
        }
    }
}

/// Sorts the errors of the decoder by cause. It reads from memory only, so an I/O error means that
/// the file is truncated.
fn explain(path: &Path, error: TiffError) -> Error {
    match error {
        TiffError::UnsupportedError(e) => {
            Error::unsupported(path, format!("requires a feature that is not supported ({e})"), ADVICE)
        }
        TiffError::LimitsExceeded => Error::limits(path, "needs too much memory", "scale the image down"),
        e => Error::damaged(path, format!("is truncated or damaged ({e})")),
    }
}

const ADVICE: &str = "write uncompressed integers or floats in RGB, or EXR";

#[cfg(test)]
mod tests;
