//! Strips and tiles of a TIFF file, joined to a picture.

use ::tiff::decoder::DecodingResult;
use image::{DynamicImage, ImageBuffer};

use crate::picture::integer::Samples;

/// Arrangement of the strips or tiles.
pub(super) struct Grid {
    /// Width and height of the picture.
    pub(super) size: (usize, usize),
    /// Width and height of a strip or tile.
    pub(super) chunk: (usize, usize),
    /// Number of channels to read, 1 to 4.
    pub(super) channels: usize,
    /// Whether every channel has its own strips or tiles.
    pub(super) is_planar: bool,
}

impl Grid {
    /// Returns the number of strips or tiles of the channels to read.
    pub(super) fn count(&self) -> u32 {
        let planes = if self.is_planar { self.channels } else { 1 };
        u32::try_from(self.per_plane() * planes).unwrap_or(u32::MAX)
    }

    fn across(&self) -> usize {
        self.size.0.div_ceil(self.chunk.0)
    }

    fn per_plane(&self) -> usize {
        self.across() * self.size.1.div_ceil(self.chunk.1)
    }
}

/// The picture as far as it is read. Channels are interleaved.
pub(super) enum Canvas {
    Eight(Vec<u8>),
    Sixteen(Vec<u16>),
    /// Codes of more bits, divided by the largest one.
    Codes(Vec<f32>, u8),
    Floats(Vec<f32>),
}

impl Canvas {
    /// Allocates the picture for samples of the type of its first strip or tile.
    pub(super) fn new(first: &DecodingResult, grid: &Grid) -> Self {
        use DecodingResult as D;
        let count = grid.size.0 * grid.size.1 * grid.channels;
        match first {
            D::U8(_) => Self::Eight(vec![0; count]),
            D::U16(_) => Self::Sixteen(vec![0; count]),
            D::U32(_) => Self::Codes(vec![0.0; count], 32),
            D::U64(_) => Self::Codes(vec![0.0; count], 64),
            _ => Self::Floats(vec![0.0; count]),
        }
    }

    /// Copies a strip or tile that is `columns` wide. Returns `None` if the samples are signed
    /// integers.
    pub(super) fn place(&mut self, chunk: DecodingResult, index: usize, columns: usize, grid: &Grid) -> Option<()> {
        use DecodingResult as D;
        let at = (index, columns);
        match (self, chunk) {
            (Self::Eight(to), D::U8(from)) => copy(to, &from, at, grid, |v| v),
            (Self::Sixteen(to), D::U16(from)) => copy(to, &from, at, grid, |v| v),
            (Self::Codes(to, _), D::U32(from)) => {
                copy(to, &from, at, grid, |v| (f64::from(v) / f64::from(u32::MAX)) as f32);
            }
            (Self::Codes(to, _), D::U64(from)) => copy(to, &from, at, grid, |v| (v as f64 / u64::MAX as f64) as f32),
            (Self::Floats(to), D::F16(from)) => copy(to, &from, at, grid, |v| v.to_f32()),
            (Self::Floats(to), D::F32(from)) => copy(to, &from, at, grid, |v| v),
            (Self::Floats(to), D::F64(from)) => copy(to, &from, at, grid, |v| v as f32),
            _ => return None,
        }
        Some(())
    }

    /// Returns the picture; `None` if it has no pixels. Grey floats become RGB, because `image` has
    /// no grey floats.
    pub(super) fn into_image(self, grid: &Grid) -> Option<(DynamicImage, Samples)> {
        use DynamicImage as I;
        let (channels, is_grey) = (grid.channels, grid.channels < 3);
        let (width, height) = (u32::try_from(grid.size.0).ok()?, u32::try_from(grid.size.1).ok()?);
        let samples = |bits, is_float| Samples { bits, is_float, is_grey };
        let (values, samples) = match self {
            Self::Eight(v) => {
                let image = match channels {
                    1 => ImageBuffer::from_vec(width, height, v).map(I::ImageLuma8),
                    2 => ImageBuffer::from_vec(width, height, v).map(I::ImageLumaA8),
                    3 => ImageBuffer::from_vec(width, height, v).map(I::ImageRgb8),
                    _ => ImageBuffer::from_vec(width, height, v).map(I::ImageRgba8),
                };
                return Some((image?, samples(8, false)));
            }
            Self::Sixteen(v) => {
                let image = match channels {
                    1 => ImageBuffer::from_vec(width, height, v).map(I::ImageLuma16),
                    2 => ImageBuffer::from_vec(width, height, v).map(I::ImageLumaA16),
                    3 => ImageBuffer::from_vec(width, height, v).map(I::ImageRgb16),
                    _ => ImageBuffer::from_vec(width, height, v).map(I::ImageRgba16),
                };
                return Some((image?, samples(16, false)));
            }
            Self::Codes(v, bits) => (v, samples(bits, false)),
            Self::Floats(v) => (v, samples(32, true)),
        };
        let values = match channels {
            1 => values.into_iter().flat_map(|y| [y; 3]).collect(),
            2 => values.chunks_exact(2).flat_map(|p| [p[0], p[0], p[0], p[1]]).collect(),
            _ => values,
        };
        let image = match channels {
            1 | 3 => ImageBuffer::from_vec(width, height, values).map(I::ImageRgb32F),
            _ => ImageBuffer::from_vec(width, height, values).map(I::ImageRgba32F),
        };
        Some((image?, samples))
    }
}

/// Copies the part of a strip or tile that lies in the picture. `columns` is its width without
/// padding.
fn copy<S: Copy, T>(to: &mut [T], from: &[S], (index, columns): (usize, usize), grid: &Grid, convert: impl Fn(S) -> T) {
    let Grid { size: (width, height), chunk, channels, is_planar } = *grid;
    let (plane, place) = (index / grid.per_plane(), index % grid.per_plane());
    let (left, top) = (place % grid.across() * chunk.0, place / grid.across() * chunk.1);
    let (depth, first) = if is_planar { (1, plane) } else { (channels, 0) };
    let rows = from.chunks_exact((columns * depth).max(1)).take(chunk.1).zip(top..height);
    for (line, y) in rows {
        for (pixel, x) in line.chunks_exact(depth).zip(left..width) {
            let at = (y * width + x) * channels + first;
            for (value, sample) in to[at..].iter_mut().zip(pixel) {
                *value = convert(*sample);
            }
        }
    }
}
