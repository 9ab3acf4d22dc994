//! Measured isotropic BSDFs of NVIDIA's Material Definition Language: `NAME.mbsdf`.
//!
//! A file begins with the line `NVIDIA ARC MBSDF V1` and lines of metadata, `NAME="VALUE"`. The
//! line `MBSDF_DATA=` or `MBSDF_DATA_REFLECTION=` precedes the BRDF. All its numbers are
//! little-endian and have 32 bits:
//!
//! * three integers: 0 for one channel or 1 for RGB, number of polar angles, number of azimuths;
//! * floats in 1/sr over four axes: polar angle of the light, polar angle of the viewer, azimuth
//!   between both, and channel, which varies fastest.
//!
//! The polar angles divide 0 to 90 degrees and the azimuths 0 to 180 degrees into equal cells. A
//! value belongs to the middle of its cell. Transmission can follow; this module ignores it.
//!
//! Source: the MDL specification, appendix on the format of measured BSDFs.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

use glam::DVec3;
use gonio::reflectance::MerlTable;
use gonio::reflectance::parametric::full_table;
use gonio::sphere::half_difference;

use crate::{Error, guard, little_endian};

/// First bytes of such a file.
pub(crate) const MAGIC: &[u8] = b"NVIDIA ARC MBSDF V1\n";
/// Lines that precede the BRDF.
const REFLECTION: [&[u8]; 2] = [b"MBSDF_DATA=", b"MBSDF_DATA_REFLECTION="];
/// Line that precedes the transmission.
const TRANSMISSION: &[u8] = b"MBSDF_DATA_TRANSMISSION=";
/// Longest file read, 1 GiB.
const MAX_BYTES: u64 = 1 << 30;
/// Numbers of polar angles and azimuths of a file that gonio writes: cells of one degree.
const WRITTEN_GRID: [usize; 2] = [90, 180];

/// A measured isotropic BRDF over polar angles and azimuth.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredBsdf {
    /// Number of polar angles.
    thetas: usize,
    /// Number of azimuths.
    phis: usize,
    /// 1 or 3.
    channels: usize,
    /// BRDF in 1/sr, `[theta_in][theta_out][phi][channel]`.
    values: Vec<f32>,
}

/// Reads a material.
///
/// # Errors
/// If the file cannot be read, is damaged, has values that are not finite, or has no reflection.
pub fn read(path: impl AsRef<Path>) -> Result<MeasuredBsdf, Error> {
    let path = path.as_ref();
    decode(path, &guard::read_whole(path, MAX_BYTES)?)
}

/// Decodes a material held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read`].
pub fn decode(path: &Path, bytes: &[u8]) -> Result<MeasuredBsdf, Error> {
    let damaged = |problem: String| Error::damaged(path, problem);
    let mut rest = bytes.strip_prefix(MAGIC).ok_or_else(|| damaged("does not begin like an MBSDF file".into()))?;
    loop {
        let end = rest.iter().position(|&b| b == b'\n').ok_or_else(|| damaged("has no data".into()))?;
        let line;
        (line, rest) = (&rest[..end], &rest[end + 1..]);
        if REFLECTION.contains(&line) {
            break;
        }
        if line == TRANSMISSION {
            return Err(Error::unsupported(path, "contains only transmission", "use a file with reflection"));
        }
    }
    let (header, data) = rest.split_at_checked(12).ok_or_else(|| damaged("is truncated in its header".into()))?;
    let number = |i: usize| u32::from_le_bytes([header[i], header[i + 1], header[i + 2], header[i + 3]]);
    let (kind, thetas, phis) = (number(0), number(4), number(8));
    let channels = match kind {
        0 => 1,
        1 => 3,
        _ => return Err(damaged(format!("has values of the type {kind}, but the format has the types 0 and 1"))),
    };
    let count =
        [u64::from(thetas), u64::from(phis), channels].iter().try_fold(u64::from(thetas), |n, &m| n.checked_mul(m));
    let bytes_needed = count.and_then(|n| n.checked_mul(4)).filter(|&n| n > 0 && n <= data.len() as u64);
    let Some(length) = bytes_needed else {
        let problem = format!("has {} bytes of data, too few for {thetas} x {thetas} x {phis} values", data.len());
        return Err(damaged(problem));
    };
    let values = little_endian::f32s(&data[..length as usize]);
    if let Some(at) = values.iter().position(|v| !v.is_finite()) {
        return Err(damaged(format!("has a value that is not finite at index {at}")));
    }
    Ok(MeasuredBsdf { thetas: thetas as usize, phis: phis as usize, channels: channels as usize, values })
}

impl MeasuredBsdf {
    /// Interpolates the BRDF in 1/sr, by channel; negative values become 0.
    ///
    /// `wi` and `wo` are unit vectors towards the light and the viewer; the normal is `+z`.
    pub fn eval(&self, wi: DVec3, wo: DVec3) -> [f64; 3] {
        let theta = |w: DVec3| neighbours(w.x.hypot(w.y).atan2(w.z) / FRAC_PI_2, self.thetas);
        let azimuth = (wi.x * wo.y - wi.y * wo.x).abs().atan2(wi.x * wo.x + wi.y * wo.y);
        let (theta_in, theta_out, phi) = (theta(wi), theta(wo), neighbours(azimuth / PI, self.phis));
        let mut sum = [0.0; 3];
        for (i, by_light) in theta_in {
            for (o, by_view) in theta_out {
                for (p, by_azimuth) in phi {
                    let at = self.channels * ((i * self.thetas + o) * self.phis + p);
                    let value = |c: usize| f64::from(self.values[at + c.min(self.channels - 1)]).max(0.0);
                    (0..3).for_each(|c| sum[c] += by_light * by_view * by_azimuth * value(c));
                }
            }
        }
        sum
    }

    /// Resamples the material to a table of the MERL database, missing (-1) below the horizon.
    ///
    /// A cell holds the mean over both orders of light and viewer, because the table is reciprocal.
    pub fn to_merl(&self) -> MerlTable {
        full_table(|wi, wo| {
            let (there, back) = (self.eval(wi, wo), self.eval(wo, wi));
            [0, 1, 2].map(|c| (there[c] + back[c]) / 2.0)
        })
    }
}

/// Returns the two cells around a coordinate in 0..1, and their weights in linear interpolation.
fn neighbours(at: f64, cells: usize) -> [(usize, f64); 2] {
    let at = (at * cells as f64 - 0.5).clamp(0.0, (cells - 1) as f64);
    let low = at as usize;
    [(low, 1.0 - at.fract()), ((low + 1).min(cells - 1), at.fract())]
}

/// Encodes a material in cells of one degree (17.5 MB). A highlight narrower than a cell is lost.
pub fn encode(table: &MerlTable) -> Vec<u8> {
    let [thetas, phis] = WRITTEN_GRID;
    let mut bytes = [MAGIC, REFLECTION[0], b"\n"].concat();
    bytes.reserve(12 + 4 * 3 * thetas * thetas * phis);
    bytes.extend([1, thetas as u32, phis as u32].iter().flat_map(|n| n.to_le_bytes()));
    let direction = |theta: f64, phi: f64| DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
    let theta = |i: usize| (i as f64 + 0.5) / thetas as f64 * FRAC_PI_2;
    for i in 0..thetas {
        let wi = direction(theta(i), 0.0);
        for o in 0..thetas {
            for p in 0..phis {
                let wo = direction(theta(o), (p as f64 + 0.5) / phis as f64 * PI);
                let at = half_difference(DVec3::Z, wi, wo);
                let rgb = table.eval(at.theta_h, at.theta_d, at.phi_d);
                bytes.extend(rgb.iter().flat_map(|&v| (v as f32).to_le_bytes()));
            }
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use gonio::reflectance::BivariateTable;

    fn decoded(bytes: &[u8]) -> Result<MeasuredBsdf, Error> {
        decode(Path::new("a.mbsdf"), bytes)
    }

    /// Encodes a file of two polar angles and three azimuths, with `channels` values per direction.
    fn small(channels: u32, line: &str, value: impl Fn(usize) -> f32) -> Vec<u8> {
        let mut bytes = format!("NVIDIA ARC MBSDF V1\ncreator=\"a\"\n{line}\n").into_bytes();
        bytes.extend([u32::from(channels == 3), 2, 3].iter().flat_map(|n| n.to_le_bytes()));
        bytes.extend((0..12 * channels as usize).flat_map(|at| value(at).to_le_bytes()));
        bytes
    }

    fn direction(theta: f64, phi: f64) -> DVec3 {
        let (theta, phi) = (theta.to_radians(), phi.to_radians());
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }

    #[test]
    fn values_belong_to_the_middles_of_cells() {
        let grey = decoded(&small(1, "MBSDF_DATA=", |at| at as f32)).unwrap();
        // The light at 67.5 degrees is row 1, the view at 22.5 degrees row 0.
        for (phi, index) in [(150.0, 2.0), (-150.0, 2.0), (180.0, 2.0), (90.0, 1.0), (0.0, 0.0), (120.0, 1.5)] {
            let got = grey.eval(direction(67.5, 0.0), direction(22.5, phi));
            assert!(got.iter().all(|v| (v - (6.0 + index)).abs() < 1e-9), "{phi}: {got:?}");
        }
        let rgb = decoded(&small(3, "MBSDF_DATA_REFLECTION=", |at| at as f32)).unwrap();
        let got = rgb.eval(direction(45.0, 20.0), direction(22.5, 50.0));
        // Half way between rows 0 and 1 of the light, at the first azimuth.
        assert!((0..3).all(|c| (got[c] - (9.0 + c as f64)).abs() < 1e-9), "{got:?}");
    }

    #[test]
    fn encoding_and_decoding_preserve_a_glossy_material() {
        let lobe = |h: f64, d: f64| 0.1 + 8.0 * (-(h.tan() / 0.2).powi(2)).exp() * (1.0 + (d / FRAC_PI_2).powi(5));
        let tables = [1.0, 0.5, 0.2].map(|by| BivariateTable::from_fn(|h, d| by * lobe(h.min(1.5), d)));
        let table = MerlTable::from_bivariate(tables.each_ref());
        let back = decoded(&encode(&table)).unwrap().to_merl();
        for (i, j) in [(0, 0), (0, 60), (20, 10), (40, 30), (60, 5), (70, 70)] {
            let [before, after] = [&tables[1], &back.bivariate(1)].map(|t| f64::from(t.cell(i, j)));
            assert!((after / before - 1.0).abs() < 0.01, "{i} {j}: {before} {after}");
        }
    }

    #[test]
    fn damage_is_described() {
        let good = small(1, "MBSDF_DATA=", |_| 1.0);
        let nan = small(1, "MBSDF_DATA=", |at| if at == 7 { f32::NAN } else { 1.0 });
        let mut huge = good.clone();
        let at = good.len() - 48 - 8;
        huge[at..at + 8].fill(0xff);
        for (bytes, message) in [
            (&good[1..], "does not begin like an MBSDF file"),
            (&good[..30], "has no data"),
            (&good[..good.len() - 49], "truncated in its header"),
            (&good[..good.len() - 1], "47 bytes of data, too few for 2 x 2 x 3"),
            (&huge, "too few"),
            (&nan, "not finite at index 7"),
            (&small(1, "MBSDF_DATA_TRANSMISSION=", |_| 1.0), "contains only transmission"),
        ] {
            let error = decoded(bytes).unwrap_err().to_string();
            assert!(error.starts_with("a.mbsdf: ") && error.contains(message), "{error}");
        }
    }
}
