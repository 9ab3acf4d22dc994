//! Colour information in the chunks of a PNG file before its pixels.

use std::io::Read;
use std::path::Path;

use flate2::read::ZlibDecoder;

use super::icc::MAX_PROFILE;
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
/// If the unpacked ICC profile is longer than [`MAX_PROFILE`].
pub(super) fn colour_chunks(path: &Path, bytes: &[u8]) -> Result<ColourChunks, Error> {
    let mut chunks = ColourChunks::default();
    let mut at = 8;
    while let Some((kind, data)) = chunk(bytes, at) {
        match kind {
            b"IDAT" | b"IEND" => break,
            b"cICP" => chunks.cicp = data.try_into().ok(),
            b"iCCP" => chunks.icc = profile(path, data)?,
            b"sRGB" => chunks.srgb = true,
            b"gAMA" => chunks.gamma = numbers(data).and_then(|[gamma]: [f64; 1]| (gamma > 0.0).then_some(gamma)),
            b"cHRM" => {
                let white_first = numbers(data);
                chunks.primaries = white_first.map(|[wx, wy, rx, ry, gx, gy, bx, by]: [f64; 8]| {
                    Primaries::from_array([rx, ry, gx, gy, bx, by, wx, wy])
                });
            }
            _ => {}
        }
        at += 12 + data.len();
    }
    Ok(chunks)
}

/// Returns the name and the data of the chunk at a position, if it lies within the file.
fn chunk(bytes: &[u8], at: usize) -> Option<(&[u8; 4], &[u8])> {
    let length = u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?) as usize;
    let kind = bytes.get(at + 4..at + 8)?.try_into().ok()?;
    let end = at.checked_add(8)?.checked_add(length)?;
    Some((kind, bytes.get(at + 8..end)?))
}

/// Returns the `N` fixed-point numbers of a chunk, in units of 1e-5. `None` if the chunk has
/// another length.
fn numbers<const N: usize>(data: &[u8]) -> Option<[f64; N]> {
    if data.len() != 4 * N {
        return None;
    }
    let mut numbers = [0.0; N];
    for (number, bytes) in numbers.iter_mut().zip(data.chunks_exact(4)) {
        *number = f64::from(u32::from_be_bytes(bytes.try_into().ok()?)) / 1e5;
    }
    Some(numbers)
}

/// Unpacks the profile of a chunk: a name, a zero byte, the method of compression, and the data.
fn profile(path: &Path, data: &[u8]) -> Result<Option<Vec<u8>>, Error> {
    let Some(end) = data.iter().take(80).position(|byte| *byte == 0) else { return Ok(None) };
    let Some((0, packed)) = data[end + 1..].split_first() else { return Ok(None) };
    let mut profile = Vec::new();
    let unpacked = ZlibDecoder::new(packed).take(MAX_PROFILE as u64 + 1).read_to_end(&mut profile);
    if profile.len() > MAX_PROFILE {
        let problem = format!("has an ICC profile of more than {MAX_PROFILE} bytes");
        return Err(Error::limits(path, problem, "remove the ICC profile"));
    }
    Ok(unpacked.ok().map(|_| profile))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::{Compression, Crc, write::ZlibEncoder};

    use super::*;

    /// Inserts chunks after the header of a PNG file.
    fn with_chunks(png: &[u8], chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
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
        out.extend(&png[33..]);
        out
    }

    /// Returns the data of an `iCCP` chunk.
    fn packed(profile: &[u8]) -> Vec<u8> {
        let mut zlib = ZlibEncoder::new(b"profile\0\0".to_vec(), Compression::fast());
        zlib.write_all(profile).unwrap();
        zlib.finish().unwrap()
    }

    /// Signature and `IHDR`; only their length matters in these tests.
    const HEADER: [u8; 33] = {
        let mut header = [0; 33];
        header[11] = 13;
        header
    };

    #[test]
    fn numbers_are_hundred_thousandths() {
        let white_first = [31270_u32, 32900, 64000, 33000, 30000, 60000, 15000, 6000];
        let chrm: Vec<u8> = white_first.iter().flat_map(|n| n.to_be_bytes()).collect();
        let png =
            with_chunks(&HEADER, &[(b"gAMA", &100_000_u32.to_be_bytes()), (b"cHRM", &chrm), (b"cICP", &[9, 16, 0, 1])]);
        let got = colour_chunks(Path::new("t"), &png).unwrap();
        let rec709 = Primaries::from_array([0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329]);
        assert_eq!((got.gamma, got.primaries, got.cicp), (Some(1.0), Some(rec709), Some([9, 16, 0, 1])));
        let short = with_chunks(&HEADER, &[(b"gAMA", &[0, 1]), (b"cICP", &[1])]);
        assert_eq!(colour_chunks(Path::new("t"), &short).unwrap(), ColourChunks::default());
    }

    #[test]
    fn profile_sizes_are_limited() {
        let png = |profile: &[u8]| with_chunks(&HEADER, &[(b"iCCP", &packed(profile))]);
        assert_eq!(colour_chunks(Path::new("t"), &png(b"abc")).unwrap().icc.unwrap(), b"abc");
        let bomb = png(&vec![0; MAX_PROFILE + 1]);
        assert!(bomb.len() < 100_000);
        let error = colour_chunks(Path::new("t.png"), &bomb).unwrap_err();
        assert_eq!(error.kind(), crate::Kind::Limits);
        assert!(error.to_string().contains("t.png: has an ICC profile of more than"), "{error}");
        let cut = with_chunks(&HEADER, &[(b"iCCP", b"profile\0\0x")]);
        assert_eq!(colour_chunks(Path::new("t"), &cut).unwrap().icc, None);
    }
}
