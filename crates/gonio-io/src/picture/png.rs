//! Colour information in the chunks of a PNG file before its pixels.

use std::io::Cursor;
use std::path::Path;

use png::ScaledFloat;

use super::icc::limited;
use crate::Error;
use crate::colour_space::Primaries;

/// Colour information of a PNG file, in order of precedence (PNG, third edition, 4.3).
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ColourChunks {
    /// `cICP`: primaries, transfer characteristics, matrix coefficients and full-range flag. Source
    /// of the codes: ITU-T H.273.
    pub(super) cicp: Option<[u8; 4]>,
    /// `iCCP`: an ICC profile.
    pub(super) icc: Option<Vec<u8>>,
    /// `sRGB`.
    pub(super) srgb: bool,
    /// `gAMA`: the exponent from radiance to codes.
    pub(super) gamma: Option<f64>,
    /// `cHRM`.
    pub(super) primaries: Option<Primaries>,
}

/// Reads the chunks before the pixels. Damaged chunks count as missing; the decoder of the picture
/// detects damaged files.
///
/// # Errors
/// If the unpacked ICC profile is longer than [`MAX_PROFILE`](super::icc::MAX_PROFILE).
pub(super) fn colour_chunks(path: &Path, bytes: &[u8]) -> Result<ColourChunks, Error> {
    let Ok(reader) = png::Decoder::new(Cursor::new(bytes)).read_info() else { return Ok(ColourChunks::default()) };
    let info = reader.info();
    let icc = info.icc_profile.as_ref().map(|profile| limited(path, profile.to_vec())).transpose()?;
    let cicp = info.coding_independent_code_points.map(|code| {
        let full_range = u8::from(code.is_video_full_range_image);
        [code.color_primaries, code.transfer_function, code.matrix_coefficients, full_range]
    });
    let primaries = info.chrm_chunk.map(|chroma| {
        let all = [chroma.red, chroma.green, chroma.blue, chroma.white];
        Primaries::from_array(std::array::from_fn(|i| {
            let (x, y) = all[i / 2];
            fixed_point(if i % 2 == 0 { x } else { y })
        }))
    });
    Ok(ColourChunks { cicp, icc, srgb: info.srgb.is_some(), gamma: info.gama_chunk.map(fixed_point), primaries })
}

/// Returns a number, which PNG stores in units of 1e-5.
fn fixed_point(number: ScaledFloat) -> f64 {
    f64::from(number.into_scaled()) / 1e5
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::{Compression, Crc, write::ZlibEncoder};
    use glam::Vec3;
    use gonio::picture::Plane;

    use super::*;
    use crate::picture::encode_png;
    use crate::picture::icc::MAX_PROFILE;

    /// Returns a small PNG file with these chunks after its header.
    fn with_chunks(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let png = encode_png(&Plane::from_fn(2, 2, |_, _| Vec3::ONE));
        // The signature and `IHDR` have 33 bytes.
        let mut out = png[..33].to_vec();
        for (kind, data) in chunks {
            let mut crc = Crc::new();
            crc.update(&kind[..]);
            crc.update(data);
            out.extend((data.len() as u32).to_be_bytes());
            out.extend(&kind[..]);
            out.extend(*data);
            out.extend(crc.sum().to_be_bytes());
        }
        let pixels = png.windows(4).position(|bytes| bytes == b"IDAT").unwrap();
        out.extend(&png[pixels - 4..]);
        out
    }

    /// Returns the data of an `iCCP` chunk.
    fn packed(profile: &[u8]) -> Vec<u8> {
        let mut zlib = ZlibEncoder::new(b"profile\0\0".to_vec(), Compression::fast());
        zlib.write_all(profile).unwrap();
        zlib.finish().unwrap()
    }

    #[test]
    fn numbers_are_hundred_thousandths() {
        let white_first = [31270_u32, 32900, 64000, 33000, 30000, 60000, 15000, 6000];
        let chrm: Vec<u8> = white_first.iter().flat_map(|n| n.to_be_bytes()).collect();
        let png = with_chunks(&[(b"gAMA", &100_000_u32.to_be_bytes()), (b"cHRM", &chrm), (b"cICP", &[9, 16, 0, 1])]);
        let got = colour_chunks(Path::new("t"), &png).unwrap();
        let rec709 = Primaries::from_array([0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329]);
        assert_eq!((got.gamma, got.primaries, got.cicp), (Some(1.0), Some(rec709), Some([9, 16, 0, 1])));
        let short = with_chunks(&[(b"gAMA", &[0, 1]), (b"cICP", &[1])]);
        assert_eq!(colour_chunks(Path::new("t"), &short).unwrap(), ColourChunks::default());
    }

    #[test]
    fn profile_sizes_are_limited() {
        let png = |profile: &[u8]| with_chunks(&[(b"iCCP", &packed(profile))]);
        assert_eq!(colour_chunks(Path::new("t"), &png(b"abc")).unwrap().icc.unwrap(), b"abc");
        let bomb = png(&vec![0; MAX_PROFILE + 1]);
        assert!(bomb.len() < 100_000);
        let error = colour_chunks(Path::new("t.png"), &bomb).unwrap_err();
        assert_eq!(error.kind(), crate::Kind::Limits);
        assert!(error.to_string().contains("t.png: has an ICC profile of more than"), "{error}");
        let cut = with_chunks(&[(b"iCCP", b"profile\0\0x")]);
        assert_eq!(colour_chunks(Path::new("t"), &cut).unwrap().icc, None);
    }
}
