//! OpenEXR layers with subsampled channels, such as the chroma of luminance-chroma files.
//!
//! The crate `exr` rejects such files, although its decoders of compressed blocks read them. This
//! module therefore changes the header to full resolution and passes the true sampling to those
//! decoders.

use std::path::Path;

use exr::block::chunk::Chunk;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression as C;
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::{ChannelList, SampleType};
use exr::meta::header::Header;
use exr::prelude::f16;
use rayon::prelude::*;

use crate::Error;

/// Advice for files whose samples cannot be decompressed.
const ADVICE: &str = "convert it: oiiotool in.exr --compression zip -o out.exr";

/// Horizontal and vertical sampling of each channel of each layer: 1 is full resolution, 2 is every
/// second pixel.
type Sampling = Vec<Vec<Vec2<usize>>>;

/// Returns a copy of a file whose header declares full resolution for every channel, and the
/// sampling of the channels. Returns `None` for files without subsampled channels and for damaged
/// headers.
pub(super) fn at_full_resolution(bytes: &[u8]) -> Option<(Vec<u8>, Sampling)> {
    const MULTI_PART: u8 = 0x10;
    let is_multi_part = bytes.get(5)? & MULTI_PART != 0;
    let text = |at: usize| {
        let rest = bytes.get(at..)?;
        rest.iter().position(|b| *b == 0).map(|length| &rest[..length])
    };
    let number = |at: usize| Some(i32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?));
    let mut sampling: Sampling = Vec::new();
    let mut places = Vec::new();
    let mut at = 8;
    // An empty name ends a header, and in files of several parts an empty header ends the list.
    loop {
        let mut layer = Vec::new();
        if is_multi_part && text(at)?.is_empty() {
            break;
        }
        loop {
            let name = text(at)?;
            at += name.len() + 1;
            if name.is_empty() {
                break;
            }
            let kind = text(at)?;
            at += kind.len() + 1;
            let end = (at + 4).checked_add(usize::try_from(number(at)?).ok()?)?;
            if name == b"channels" && kind == b"chlist" && layer.is_empty() {
                let mut channel = at + 4;
                while !text(channel)?.is_empty() {
                    // After the name: type, linearity and three unused bytes.
                    let place = channel + text(channel)?.len() + 9;
                    // A list beyond its attribute is damaged.
                    if place + 8 > end {
                        return None;
                    }
                    let factor = |at| number(at).and_then(|n| usize::try_from(n).ok()).filter(|n| *n > 0);
                    layer.push(Vec2(factor(place)?, factor(place + 4)?));
                    places.push(place);
                    channel = place + 8;
                }
            }
            at = end;
        }
        sampling.push(layer);
        if !is_multi_part {
            break;
        }
    }
    if sampling.iter().flatten().all(|factors| *factors == Vec2(1, 1)) {
        return None;
    }
    let mut bytes = bytes.to_vec();
    for place in places {
        bytes[place..place + 8].copy_from_slice(&[1, 0, 0, 0, 1, 0, 0, 0]);
    }
    Some((bytes, sampling))
}

/// Channels of one layer, at their own resolution.
pub(super) struct Subsampled {
    sampling: Vec<Vec2<usize>>,
    /// Width and height of the data window.
    size: (usize, usize),
    /// Samples of each channel to read.
    planes: Vec<Option<Vec<f32>>>,
}

impl Subsampled {
    /// Allocates the planes of the channels that `is_read` selects.
    ///
    /// # Errors
    /// If the layer consists of tiles, the sampling does not divide the data window, or the
    /// compression supports only full resolution.
    pub(super) fn new(
        path: &Path,
        header: &Header,
        sampling: &[Vec2<usize>],
        is_read: impl Fn(usize) -> bool,
    ) -> Result<Self, Error> {
        // The decoders of these compressions assume full resolution.
        if !matches!(header.compression, C::Uncompressed | C::RLE | C::ZIP1 | C::ZIP16 | C::PIZ | C::PXR24) {
            let problem = format!("has subsampled channels (luminance-chroma) with {}", header.compression);
            return Err(Error::unsupported(path, problem, ADVICE));
        }
        if header.blocks.has_tiles() {
            return Err(Error::damaged(path, "has subsampled channels in tiles"));
        }
        let (Vec2(width, height), Vec2(left, top)) = (header.layer_size, header.own_attributes.layer_position);
        let divides = |size: usize, position: i32, factor: usize| {
            size.is_multiple_of(factor) && i64::from(position).rem_euclid(factor as i64) == 0
        };
        if !sampling.iter().all(|&Vec2(x, y)| divides(width, left, x) && divides(height, top, y)) {
            return Err(Error::damaged(path, "has a data window that is no multiple of the subsampling"));
        }
        let plane = |(channel, Vec2(x, y)): (usize, &Vec2<usize>)| {
            is_read(channel).then(|| vec![0.0; (width / x) * (height / y)])
        };
        let planes = sampling.iter().enumerate().map(plane).collect();
        Ok(Self { sampling: sampling.to_vec(), size: (width, height), planes })
    }

    /// Decompresses a block.
    ///
    /// # Errors
    /// If it is damaged.
    pub(super) fn decompress(&self, mut chunk: Chunk, meta: &MetaData) -> exr::error::Result<UncompressedBlock> {
        let invalid = || exr::error::Error::Invalid("layer of a pixel block".into());
        let mut header = meta.headers.get(chunk.layer_index).ok_or_else(invalid)?.clone();
        for (channel, sampling) in header.channels.list.iter_mut().zip(&self.sampling) {
            channel.sampling = *sampling;
        }
        let place =
            header.get_absolute_block_pixel_coordinates(header.get_block_data_indices(&chunk.compressed_block)?)?;
        let (top, area) = (place.position.y(), place.size.area());
        let rows = usize::try_from(top).map_err(|_| invalid())?..;
        let length: usize = rows.take(place.size.height()).map(|y| self.line_length(&header.channels, y)).sum();
        // The decoders compute the length of a block from this number.
        if area == 0 || !length.is_multiple_of(area) {
            return Err(exr::error::Error::NotSupported("this subsampling of channels".into()));
        }
        header.channels.bytes_per_pixel = length / area;
        // A single header, so that files of many parts are not copied for each block.
        let layer = std::mem::take(&mut chunk.layer_index);
        let meta = MetaData { requirements: meta.requirements, headers: std::iter::once(header).collect() };
        let mut block = UncompressedBlock::decompress_chunk(chunk, &meta, false)?;
        block.index.layer = layer;
        Ok(block)
    }

    /// Returns the number of bytes of a row. Rows between those of a channel lack the channel.
    fn line_length(&self, channels: &ChannelList, y: usize) -> usize {
        let present = channels.list.iter().zip(&self.sampling).filter(|(_, factors)| y.is_multiple_of(factors.y()));
        present.map(|(channel, factors)| self.size.0 / factors.x() * channel.sample_type.bytes_per_sample()).sum()
    }

    /// Copies the samples of a block of [`Self::decompress`]; `None` if it is too short.
    pub(super) fn paint(&mut self, block: &UncompressedBlock, channels: &ChannelList) -> Option<()> {
        let BlockIndex { pixel_position, pixel_size, .. } = block.index;
        let mut rest = block.data.as_slice();
        for y in pixel_position.y()..pixel_position.y() + pixel_size.height() {
            for ((channel, &Vec2(step_x, step_y)), plane) in
                channels.list.iter().zip(&self.sampling).zip(&mut self.planes)
            {
                if !y.is_multiple_of(step_y) {
                    continue;
                }
                let count = self.size.0 / step_x;
                let length = channel.sample_type.bytes_per_sample();
                let (line, after) = rest.split_at_checked(count * length)?;
                rest = after;
                let Some(plane) = plane else { continue };
                let target = plane.get_mut(y / step_y * count..)?.get_mut(..count)?;
                for (value, bytes) in target.iter_mut().zip(line.chunks_exact(length)) {
                    *value = match (channel.sample_type, bytes) {
                        (SampleType::F16, &[a, b]) => f16::from_ne_bytes([a, b]).to_f32(),
                        (SampleType::F32, &[a, b, c, d]) => f32::from_ne_bytes([a, b, c, d]),
                        (SampleType::U32, &[a, b, c, d]) => u32::from_ne_bytes([a, b, c, d]) as f32,
                        _ => return None,
                    };
                }
            }
        }
        Some(())
    }

    /// Writes a channel to a plane of `width` columns. `offset` is the position of the data window
    /// in the plane.
    pub(super) fn fill(&self, channel: usize, plane: &mut [f32], width: usize, offset: (i64, i64)) {
        let within =
            |at: usize, offset: i64, count: usize| usize::try_from(at as i64 - offset).ok().filter(|at| *at < count);
        plane.par_chunks_mut(width).enumerate().for_each(|(y, line)| {
            let Some(y) = within(y, offset.1, self.size.1) else { return };
            for (x, value) in line.iter_mut().enumerate() {
                let x = within(x, offset.0, self.size.0);
                *value = x.and_then(|x| self.value(channel, x, y)).unwrap_or(*value);
            }
        });
    }

    /// Returns the value of a channel at a pixel of the data window, linearly interpolated between
    /// its samples; `None` for channels that were not read. The first sample lies at the first
    /// pixel.
    fn value(&self, channel: usize, x: usize, y: usize) -> Option<f32> {
        let (plane, Vec2(step_x, step_y)) = (self.planes[channel].as_ref()?, self.sampling[channel]);
        let (columns, rows) = (self.size.0 / step_x, self.size.1 / step_y);
        let between = |at: usize, step: usize, count: usize| {
            let first = at / step;
            (first, (first + 1).min(count - 1), (at % step) as f32 / step as f32)
        };
        let ((left, right, across), (top, bottom, down)) = (between(x, step_x, columns), between(y, step_y, rows));
        let mix = |a: f32, b: f32, share: f32| if share == 0.0 { a } else { a + share * (b - a) };
        let row = |row: usize| mix(plane[row * columns + left], plane[row * columns + right], across);
        Some(mix(row(top), row(bottom), down))
    }
}

#[cfg(test)]
mod tests;
