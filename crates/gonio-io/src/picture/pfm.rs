//! Portable float maps (PFM).
//!
//! A text header of four tokens precedes 32-bit floats, bottom row first. In files of Photoshop,
//! the top row is first.

use std::path::Path;

use glam::Vec3;
use gonio::picture::Plane;

use super::space::{Conversion, DeclaredSpace, InputSpace, SpaceSource};
use super::{Decoded, ReadOptions, float_picture};
use crate::Error;

/// Largest number of bytes in which the header must end; anything longer is not a header.
const MAX_HEADER_BYTES: usize = 256;

pub(super) fn decode(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Decoded, Error> {
    let mut tokens = Tokens { bytes: &bytes[..bytes.len().min(MAX_HEADER_BYTES)], at: 0 };
    let channels = match tokens.next() {
        Some("PF") => 3,
        Some("Pf") => 1,
        _ => return Err(Error::damaged(path, "does not have the header of a PFM file")),
    };
    let bad = |what: &str| Error::damaged(path, format!("has no {what} in its PFM header"));
    let width: u64 = tokens.next().and_then(|t| t.parse().ok()).ok_or_else(|| bad("width"))?;
    // Photoshop writes width and height on separate lines, and the top row first.
    let is_photoshop = tokens.ends_line();
    let height: u64 = tokens.next().and_then(|t| t.parse().ok()).ok_or_else(|| bad("height"))?;
    let scale: f32 = tokens.next().and_then(|t| t.parse().ok()).ok_or_else(|| bad("scale"))?;
    if !scale.is_normal() {
        return Err(Error::damaged(path, format!("has an invalid scale {scale} in its PFM header")));
    }
    let (width, height) = options.check_size(path, width, height)?;
    // One byte of white space follows the header, or CR LF.
    let expected = width * height * channels * 4;
    let crlf = bytes[tokens.at..].starts_with(b"\r\n") && bytes.len() - tokens.at - 2 == expected;
    let start = tokens.at + if crlf { 2 } else { 1 };
    let found = bytes.len().saturating_sub(start);
    if found != expected {
        return Err(Error::damaged(
            path,
            format!("has {found} bytes of pixels, but {width}x{height} pixels require {expected}"),
        ));
    }
    let little = scale < 0.0;
    let samples = bytes[start..].chunks_exact(4).map(|b| {
        let b = [b[0], b[1], b[2], b[3]];
        scale.abs() * if little { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) }
    });
    let samples: Vec<f32> = samples.collect();
    let mut rows: Vec<&[f32]> = samples.chunks_exact(width * channels).collect();
    if !is_photoshop {
        rows.reverse();
    }
    let rows = rows.into_iter();
    let rgb = if channels == 3 {
        rows.flat_map(|row| row.chunks_exact(3).map(Vec3::from_slice)).collect()
    } else {
        rows.flat_map(|row| row.iter().map(|&y| Vec3::splat(y))).collect()
    };
    let space = match channels {
        1 => (Conversion::None, InputSpace::unconverted("grey", SpaceSource::Grey)),
        _ => DeclaredSpace::default().settle(options.colour_space),
    };
    Ok(float_picture((width, height), rgb, space))
}

pub(super) fn encode(rgb: &Plane<Vec3>) -> Vec<u8> {
    let (width, height) = rgb.size();
    let mut bytes = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
    bytes.reserve(width * height * 12);
    for row in rgb.as_slice().chunks_exact(width.max(1)).rev() {
        bytes.extend(row.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes));
    }
    bytes
}

/// Words between white space; `at` is the end of the last one.
struct Tokens<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Tokens<'_> {
    /// Returns whether a line ends after the last word.
    fn ends_line(&self) -> bool {
        let rest = &self.bytes[self.at..];
        let blank = rest.iter().take_while(|b| b.is_ascii_whitespace());
        blank.copied().any(|b| b == b'\n')
    }
}

impl<'a> Iterator for Tokens<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        let rest = &self.bytes[self.at..];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace())?;
        // White space must follow a word, otherwise the header is truncated.
        let length = rest[start..].iter().position(u8::is_ascii_whitespace)?;
        self.at += start + length;
        std::str::from_utf8(&rest[start..][..length]).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    fn read(bytes: &[u8]) -> Result<Plane<Vec3>, Error> {
        decode(Path::new("t.pfm"), bytes, &ReadOptions::default()).map(|d| d.picture.rgb)
    }

    #[test]
    fn round_trips_with_the_bottom_row_first() {
        let rgb = Plane::from_fn(3, 2, |x, y| Vec3::new(x as f32, y as f32, -0.5));
        let bytes = encode(&rgb);
        assert_eq!(read(&bytes).unwrap(), rgb);
        assert_eq!(bytes[bytes.len() - 8..][..4], 0.0_f32.to_le_bytes(), "the last row written is the top row");
    }

    #[test]
    fn reads_grey_big_endian_files_and_applies_the_scale() {
        let mut bytes = b"Pf\n1 2\n2.0\n".to_vec();
        bytes.extend(1.5_f32.to_be_bytes());
        bytes.extend(0.25_f32.to_be_bytes());
        assert_eq!(read(&bytes).unwrap().as_slice(), [Vec3::splat(0.5), Vec3::splat(3.0)]);
    }

    #[test]
    fn files_of_photoshop_have_the_top_row_first() {
        let mut bytes = b"Pf\n1\n2\n-1.0\n".to_vec();
        bytes.extend(1.5_f32.to_le_bytes());
        bytes.extend(0.25_f32.to_le_bytes());
        assert_eq!(read(&bytes).unwrap().as_slice(), [Vec3::splat(1.5), Vec3::splat(0.25)]);
    }

    #[test]
    fn headers_may_end_in_cr_lf() {
        let mut bytes = b"Pf\r\n1 2\r\n-1.0\r\n".to_vec();
        bytes.extend(1.5_f32.to_le_bytes());
        bytes.extend(0.25_f32.to_le_bytes());
        assert_eq!(read(&bytes).unwrap().as_slice(), [Vec3::splat(0.25), Vec3::splat(1.5)]);
    }

    #[test]
    fn inconsistent_headers_are_rejected_before_allocation() {
        for (bytes, kind) in [
            (&b"PF\n100000000 100000000\n-1\n"[..], Kind::Limits),
            (b"PF\n1000 1000\n-1\n0000", Kind::Damaged),
            (b"PF\n1 1\n-1\n0123456789abc", Kind::Damaged),
            (b"PF\n1 1\n0\n0123456789ab", Kind::Damaged),
            (b"PF\n1 -1\n1\n0123456789ab", Kind::Damaged),
            (b"PF\n1 1\nnan\n0123456789ab", Kind::Damaged),
            (b"PF\n1", Kind::Damaged),
        ] {
            assert_eq!(read(bytes).unwrap_err().kind(), kind);
        }
    }
}
