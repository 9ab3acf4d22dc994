//! `brdf.npz`: the BRDF of a result and its quantiles, as an archive of numpy arrays.
//!
//! All arrays have 32-bit floats:
//!
//! | array | shape | contents |
//! |---|---|---|
//! | `half_angle` | `[90]` | half angles in radians, denser at the highlight |
//! | `difference_angle` | `[90]` | difference angles in radians |
//! | `brdf` | `[90, 90, 3]` | BRDF in 1/sr over half angle, difference angle and channel (RGB) |
//! | `levels` | `[n]` | levels of the quantiles, in 0..1 |
//! | `luminance_quantiles` | `[n, 90, 90]` | quantiles of the luminance |
//! | `quantiles` | `[n, 90, 90, 3]` | quantiles of each channel, in linear Rec. 709 |
//!
//! The last three are missing if the method does not estimate them.

use std::io::{Cursor, Read, Write};
use std::path::Path;

use gonio::reflectance::{BivariateTable, CELLS, THETA_D, THETA_H, theta_d_of, theta_h_of};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use crate::npy::Array;
use crate::{Error, guard, npy};

/// First bytes of such a file.
pub(crate) const MAGIC: &[u8] = b"PK\x03\x04";

/// Longest file and longest array read.
const MAX_BYTES: u64 = 1 << 24;

/// A BRDF and its quantiles.
#[derive(Clone, Debug, PartialEq)]
pub struct ResultBrdf {
    /// The BRDF by channel, in 1/sr.
    pub tables: [BivariateTable; 3],
    /// The quantiles, if the method estimates them.
    pub quantiles: Option<BrdfQuantiles>,
}

/// Quantiles of a BRDF. The cells of a quantile are ordered as in a [`BivariateTable`].
#[derive(Clone, Debug, PartialEq)]
pub struct BrdfQuantiles {
    /// Levels, in 0..1.
    pub levels: Vec<f32>,
    /// Quantiles of the luminance, `[level][cell]`.
    pub luminance: Vec<Vec<f32>>,
    /// Quantiles of the channels, `[channel][level][cell]`.
    pub channels: Option<[Vec<Vec<f32>>; 3]>,
}

/// Returns the values of three channels, the channel varying fastest.
fn interleaved(channels: [&[f32]; 3]) -> Vec<f32> {
    (0..CELLS).flat_map(|cell| channels.map(|values| values[cell])).collect()
}

/// Encodes the file. The same BRDF gives the same bytes.
///
/// # Panics
/// If the number of quantiles differs from the number of levels.
pub fn encode(brdf: &ResultBrdf) -> Vec<u8> {
    let angles = |count: usize, of: fn(usize) -> f64| Array {
        shape: vec![count],
        values: (0..count).map(|i| of(i) as f32).collect(),
    };
    let tables = brdf.tables.each_ref().map(BivariateTable::as_slice);
    let mut arrays = vec![
        ("half_angle", angles(THETA_H, theta_h_of)),
        ("difference_angle", angles(THETA_D, theta_d_of)),
        ("brdf", Array { shape: vec![THETA_H, THETA_D, 3], values: interleaved(tables) }),
    ];
    if let Some(BrdfQuantiles { levels, luminance, channels }) = &brdf.quantiles {
        let count = levels.len();
        arrays.push(("levels", Array { shape: vec![count], values: levels.clone() }));
        let values = luminance.concat();
        arrays.push(("luminance_quantiles", Array { shape: vec![count, THETA_H, THETA_D], values }));
        if let Some(channels) = channels {
            let values = (0..count).flat_map(|k| interleaved(channels.each_ref().map(|levels| levels[k].as_slice())));
            let shape = vec![count, THETA_H, THETA_D, 3];
            arrays.push(("quantiles", Array { shape, values: values.collect() }));
        }
    }
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    // Archives of numpy are not compressed either; floats compress little.
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, array) in arrays {
        let written = archive.start_file(format!("{name}.npy"), options).map_err(std::io::Error::from);
        written.and_then(|()| archive.write_all(&npy::encode(&array))).expect("memory can be written");
    }
    archive.finish().expect("memory can be written").into_inner()
}

/// Reads the BRDF of such a file, without the quantiles.
///
/// # Errors
/// If the file cannot be read, is not an archive of numpy arrays, or has no valid array `brdf`.
pub fn read(path: impl AsRef<Path>) -> Result<[BivariateTable; 3], Error> {
    let path = path.as_ref();
    decode(path, &guard::read_whole(path, MAX_BYTES)?)
}

/// Decodes the BRDF of a file held in memory; `path` is only used in error messages.
///
/// # Errors
/// See [`read`].
pub fn decode(path: &Path, bytes: &[u8]) -> Result<[BivariateTable; 3], Error> {
    let advice = "specify brdf.npz of a result folder of gonio infer";
    let damaged = |error: &dyn std::fmt::Display| Error::damaged(path, format!("is not a readable archive ({error})"));
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| damaged(&error))?;
    let entry = match archive.by_name("brdf.npy") {
        Ok(entry) => entry,
        Err(zip::result::ZipError::FileNotFound) => {
            return Err(Error::invalid(path, "does not contain the array `brdf`", advice));
        }
        Err(error) => return Err(damaged(&error)),
    };
    let mut array = Vec::new();
    entry.take(MAX_BYTES).read_to_end(&mut array).map_err(|error| damaged(&error))?;
    let Array { shape, values } = npy::decode(path, &array)?;
    if shape != [THETA_H, THETA_D, 3] {
        let problem = format!("contains an array `brdf` of shape {shape:?} instead of [{THETA_H}, {THETA_D}, 3]");
        return Err(Error::invalid(path, problem, advice));
    }
    if values.iter().any(|v| !(*v >= 0.0 && v.is_finite())) {
        return Err(Error::damaged(path, "contains negative or non-finite values"));
    }
    Ok([0, 1, 2].map(|c| BivariateTable::from_vec(values.iter().skip(c).step_by(3).copied().collect())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn brdf() -> ResultBrdf {
        let table = |k: f64| BivariateTable::from_fn(move |h, d| k * (1.0 + h + 2.0 * d));
        let levels = |k: f64| [0.5, 2.0].map(|share| table(share * k).as_slice().to_vec()).to_vec();
        ResultBrdf {
            tables: [1.0, 2.0, 3.0].map(table),
            quantiles: Some(BrdfQuantiles {
                levels: vec![0.05, 0.95],
                luminance: levels(2.0),
                channels: Some([1.0, 2.0, 3.0].map(levels)),
            }),
        }
    }

    #[test]
    fn arrays_have_their_shapes_and_values() {
        let (brdf, path) = (brdf(), Path::new("brdf.npz"));
        let bytes = encode(&brdf);
        assert_eq!(decode(path, &bytes).unwrap(), brdf.tables);
        assert!(bytes.len() < 1 << 20 && bytes == encode(&brdf));
        let mut archive = ZipArchive::new(Cursor::new(&bytes[..])).unwrap();
        let mut array = |name: &str| {
            let mut bytes = Vec::new();
            archive.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
            npy::decode(path, &bytes).unwrap()
        };
        assert_eq!(array("half_angle.npy").values[45], (std::f64::consts::FRAC_PI_2 / 4.0) as f32);
        assert_eq!(array("difference_angle.npy").values[30], (std::f64::consts::PI / 6.0) as f32);
        assert_eq!(array("levels.npy").values, [0.05, 0.95]);
        assert_eq!(array("luminance_quantiles.npy").shape, [2, 90, 90]);
        let quantiles = array("quantiles.npy");
        assert_eq!(quantiles.shape, [2, 90, 90, 3]);
        // Second level, half angle 3, difference angle 5, blue.
        let cell = ((90 + 3) * 90 + 5) * 3 + 2;
        assert_eq!(quantiles.values[cell], 2.0 * brdf.tables[2].as_slice()[3 * 90 + 5]);
    }

    #[test]
    fn rejects_damaged_files() {
        let (bytes, path) = (encode(&brdf()), Path::new("brdf.npz"));
        for cut in [0, 10, 5000, bytes.len() - 10] {
            let error = decode(path, &bytes[..cut]).unwrap_err().to_string();
            assert!(error.starts_with("brdf.npz: is not a readable archive"), "{error}");
        }
        let mut negative = brdf();
        negative.tables[1] = BivariateTable::from_fn(|_, _| -1.0);
        assert!(decode(path, &encode(&negative)).unwrap_err().to_string().contains("negative or non-finite"));
        let mut other = ZipWriter::new(Cursor::new(Vec::new()));
        other.start_file("x.npy", SimpleFileOptions::default()).unwrap();
        let other = other.finish().unwrap().into_inner();
        assert!(decode(path, &other).unwrap_err().to_string().contains("does not contain the array `brdf`"));
    }
}
