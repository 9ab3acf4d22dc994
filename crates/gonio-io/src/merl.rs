//! Files of the MERL BRDF database (Matusik et al. 2003): `NAME.binary`, one material each.
//!
//! A file holds three little-endian 32-bit integers, 90 90 180, then three channels of 90 x 90 x
//! 180 doubles with `theta_h` slowest and `phi_d` fastest. A value times 1, 1.15 or 1.66 (red,
//! green, blue) over 1500 is in 1/sr. A negative value marks a missing value: below the horizon
//! and, in the original files, in a few other cells.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use gonio::reflectance::{MerlTable, PHI_D, THETA_D, THETA_H};

use crate::{Error, atomic, guard};

/// 1/sr per unit of the file, by channel.
const SCALE: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];
/// Lengths of the axes in the file.
pub(crate) const DIMENSIONS: [i32; 3] = [THETA_H as i32, THETA_D as i32, PHI_D as i32];

/// First bytes of an analytic BRDF of the BRDF Explorer.
pub(crate) const ANALYTIC: &[u8] = b"analytic";
/// Bytes before the values.
const HEADER: usize = 12;
/// Length of every such file in bytes.
pub const FILE_BYTES: u64 = (HEADER + 3 * MerlTable::CHANNEL * 8) as u64;
/// Bytes of one run of `phi_d`.
const RUN: usize = PHI_D * 8;

/// Reads a material. Values become 32-bit floats in 1/sr, missing ones -1.
///
/// # Errors
/// If the file cannot be read, has dimensions other than 90 x 90 x 180 or a wrong length, or
/// contains values that are not finite.
pub fn read(path: impl AsRef<Path>) -> Result<MerlTable, Error> {
    let path = path.as_ref();
    let (file, length) = guard::open(path)?;
    decode(path, BufReader::with_capacity(1 << 18, file), length)
}

/// Reads a material from a stream of `length` bytes; `path` is only used in error messages.
///
/// # Errors
/// Like [`read`].
pub fn decode(path: &Path, mut from: impl Read, length: u64) -> Result<MerlTable, Error> {
    let mut header = [0; HEADER];
    from.read_exact(&mut header).map_err(|e| short(path, length, e))?;
    let axis = |i: usize| i32::from_le_bytes([header[i], header[i + 1], header[i + 2], header[i + 3]]);
    let dimensions = [axis(0), axis(4), axis(8)];
    if header.starts_with(ANALYTIC) {
        let advice = "evaluate it on a grid of angles, and write a CSV table (docs/exports.md#file-formats)";
        return Err(Error::unsupported(path, "is an analytic BRDF of Disney's BRDF Explorer, not a table", advice));
    }
    if dimensions != DIMENSIONS {
        let [a, b, c] = dimensions;
        return Err(Error::damaged(path, format!("has the dimensions {a} {b} {c}, but a MERL file has 90 90 180")));
    }
    if length != FILE_BYTES {
        let what = if length < FILE_BYTES { "is truncated" } else { "has extra data at its end" };
        return Err(Error::damaged(path, format!("{what}: {length} bytes, but a MERL file has {FILE_BYTES}")));
    }
    let mut bad = Bad::default();
    let mut channels = [Vec::new(), Vec::new(), Vec::new()];
    let mut run = [0; RUN];
    for (c, channel) in channels.iter_mut().enumerate() {
        channel.reserve_exact(MerlTable::CHANNEL);
        for _ in 0..MerlTable::CHANNEL / PHI_D {
            from.read_exact(&mut run).map_err(|e| short(path, length, e))?;
            for b in run.chunks_exact(8) {
                let raw = f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]);
                let value = (raw * SCALE[c]) as f32;
                if !value.is_finite() {
                    bad.note(c, channel.len());
                }
                channel.push(if value < 0.0 { -1.0 } else { value });
            }
        }
    }
    bad.into_result(path)?;
    Ok(MerlTable::from_channels(channels))
}

/// Number of values that are not finite, and the channel and index of the first one.
#[derive(Default)]
struct Bad {
    count: usize,
    first: Option<(usize, usize)>,
}

impl Bad {
    fn note(&mut self, channel: usize, at: usize) {
        self.count += 1;
        self.first.get_or_insert((channel, at));
    }

    fn into_result(self, path: &Path) -> Result<(), Error> {
        let Some((channel, at)) = self.first else { return Ok(()) };
        let (h, d, p) = (at / (THETA_D * PHI_D), at / PHI_D % THETA_D, at % PHI_D);
        let name = ["red", "green", "blue"][channel];
        let problem = format!(
            "has {} values that are not finite, the first at index {} ({name}, theta_h {h}, theta_d {d}, phi_d {p})",
            self.count,
            channel * MerlTable::CHANNEL + at,
        );
        Err(Error::damaged(path, problem))
    }
}

fn short(path: &Path, length: u64, error: std::io::Error) -> Error {
    match error.kind() {
        std::io::ErrorKind::UnexpectedEof => {
            Error::damaged(path, format!("is truncated: {length} bytes, but a MERL file has {FILE_BYTES}"))
        }
        _ => Error::io(path, "read", error),
    }
}

/// Encodes a `.binary` file (35 MB). Reading it gives the table back exactly.
pub fn encode(table: &MerlTable) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(FILE_BYTES as usize);
    bytes.extend(DIMENSIONS.iter().flat_map(|d| d.to_le_bytes()));
    for (c, scale) in SCALE.iter().enumerate() {
        let raw = |v: f32| if v < 0.0 { -1.0 } else { f64::from(v) / scale };
        bytes.extend(table.channel(c).iter().flat_map(|&v| raw(v).to_le_bytes()));
    }
    bytes
}

/// Writes a material.
///
/// # Errors
/// If the file cannot be written; no partial file is left then.
pub fn write(path: impl AsRef<Path>, table: &MerlTable) -> Result<(), Error> {
    atomic::write_file(path, &encode(table))
}

/// Lists the `.binary` files of a folder with material names, sorted by name.
///
/// # Errors
/// If the folder cannot be read or contains no such file.
pub fn list(dir: impl AsRef<Path>) -> Result<Vec<(String, PathBuf)>, Error> {
    crate::folder::materials(dir.as_ref(), &["binary"])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;
    use gonio::reflectance::BivariateTable;
    use std::fs;

    fn table() -> MerlTable {
        let t = |s: f64| BivariateTable::from_fn(|h, d| s * (0.1 + h.sin() * d.cos()));
        MerlTable::from_bivariate([&t(1.0), &t(0.5), &t(1e4)])
    }

    fn read(bytes: &[u8]) -> Result<MerlTable, Error> {
        decode(Path::new("m.binary"), bytes, bytes.len() as u64)
    }

    #[track_caller]
    fn check(bytes: &[u8], message: &str) {
        let error = read(bytes).unwrap_err();
        assert_eq!(error.kind(), Kind::Damaged);
        assert!(error.to_string().contains(message), "{error}");
        assert!(error.to_string().starts_with("m.binary: "), "{error}");
    }

    #[test]
    fn round_trips_exactly() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.binary");
        write(&path, &table()).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().len(), FILE_BYTES);
        assert_eq!(super::read(&path).unwrap(), table());
    }

    #[test]
    fn applies_scales_and_marks_missing_values() {
        let mut bytes = encode(&table());
        let mut put = |at: usize, v: f64| bytes[HEADER + 8 * at..][..8].copy_from_slice(&v.to_le_bytes());
        put(0, 1500.0);
        put(MerlTable::CHANNEL, 1500.0);
        put(2 * MerlTable::CHANNEL, 1500.0);
        put(1, -0.002);
        let got = read(&bytes).unwrap();
        assert_eq!([0, 1, 2].map(|c| got.channel(c)[0]), [1.0, 1.15, 1.66]);
        assert_eq!(got.channel(0)[1], -1.0);
    }

    #[test]
    fn damage_is_described() {
        let bytes = encode(&table());
        check(&bytes[..5], "truncated: 5 bytes");
        check(&bytes[..bytes.len() - 1], "truncated: 34992011 bytes, but a MERL file has 34992012");
        let longer = [&bytes[..], b"\n"].concat();
        check(&longer, "has extra data at its end");
        let mut other = bytes.clone();
        other[0] = 91;
        check(&other, "has the dimensions 91 90 180, but a MERL file has 90 90 180");
        let mut odd = bytes;
        let at = MerlTable::CHANNEL + 2 * THETA_D * PHI_D + 3 * PHI_D + 4;
        odd[HEADER + 8 * at..][..8].copy_from_slice(&f64::NAN.to_le_bytes());
        odd[HEADER + 8 * (at + 9)..][..8].copy_from_slice(&f64::INFINITY.to_le_bytes());
        check(
            &odd,
            &format!(
                "has 2 values that are not finite, the first at index {at} (green, theta_h 2, theta_d 3, phi_d 4)"
            ),
        );
    }

    #[test]
    fn folders_are_listed_by_name() {
        let dir = tempfile::tempdir().unwrap();
        assert!(super::read(dir.path()).unwrap_err().to_string().contains("folder"));
        assert_eq!(list(dir.path()).unwrap_err().kind(), Kind::Invalid);
        for name in ["b.binary", "a.binary", "c.txt"] {
            fs::write(dir.path().join(name), "").unwrap();
        }
        let names: Vec<_> = list(dir.path()).unwrap().into_iter().map(|m| m.0).collect();
        assert_eq!(names, ["a", "b"]);
        assert_eq!(list(dir.path().join("none")).unwrap_err().io_kind(), Some(std::io::ErrorKind::NotFound));
    }
}
