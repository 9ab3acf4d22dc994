//! The BRDF of a captured object as measured from its single lights, over half and difference
//! angle.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, bail};
use gonio::reflectance::TRUSTED;

/// Cells along each axis of the measurement, one degree each.
const DEGREES: usize = 90;

/// Estimates are compared only with cells that have more observations than this.
const OBSERVED: f64 = 50.0;

/// A BRDF measured over `(theta_h, theta_d)` in cells of one degree; unlike MERL's, both axes are
/// evenly spaced.
pub(crate) struct Slice {
    /// Relative reflectance, `theta_d` fastest.
    mean: Vec<f32>,
    /// Observations in each cell; cells without any have no value.
    count: Vec<f32>,
    /// `mean` with the cells that have no value filled in from their neighbours.
    filled: Vec<f64>,
}

/// A measured cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cell {
    /// Centre, radians.
    pub(crate) theta_h: f64,
    pub(crate) theta_d: f64,
    pub(crate) value: f64,
    /// Observations in the cell.
    pub(crate) count: f64,
}

impl Slice {
    /// Reads the arrays `mean` and `count` of an `.npz` file.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let file = File::open(path).with_context(|| path.display().to_string())?;
        let mut archive = zip::ZipArchive::new(file).with_context(|| path.display().to_string())?;
        let mut array = |name: &str| -> Result<Vec<f32>> {
            let context = || format!("{}, {name}.npy", path.display());
            let mut bytes = Vec::new();
            // Each array has 64 kB; bytes beyond 1 MiB are not read.
            archive
                .by_name(&format!("{name}.npy"))
                .with_context(context)?
                .take(1 << 20)
                .read_to_end(&mut bytes)
                .with_context(context)?;
            let array = gonio_io::npy::decode(path, &bytes).with_context(context)?;
            if array.shape != [DEGREES, DEGREES] {
                bail!("{}: the shape is {:?}, not 90 x 90", context(), array.shape);
            }
            Ok(array.values)
        };
        Ok(Self::new(array("mean")?, array("count")?))
    }

    /// Builds the slice. Cells without a value are filled in along `theta_h` within each column
    /// that has values, then between such columns: linearly between values, constant beyond them.
    pub(crate) fn new(mean: Vec<f32>, count: Vec<f32>) -> Self {
        let mut slice = Self { mean, count, filled: vec![0.0; DEGREES * DEGREES] };
        let rows = |d: usize| (0..DEGREES).filter(|&h| slice.value(h, d).is_some()).collect::<Vec<usize>>();
        let columns: Vec<(usize, Vec<usize>)> =
            (0..DEGREES).map(|d| (d, rows(d))).filter(|c| !c.1.is_empty()).collect();
        let at = |h: usize, d: usize| {
            let column = |rows: &Vec<usize>, d: usize| between(rows, h as f64, |h| slice.value(h, d).unwrap_or(0.0));
            let places: Vec<usize> = columns.iter().map(|c| c.0).collect();
            between(&places, d as f64, |d| columns.iter().find(|c| c.0 == d).map_or(0.0, |c| column(&c.1, d)))
        };
        slice.filled = (0..DEGREES * DEGREES).map(|c| at(c / DEGREES, c % DEGREES)).collect();
        slice
    }

    fn value(&self, h: usize, d: usize) -> Option<f64> {
        let at = h * DEGREES + d;
        (self.count[at] > 0.0 && self.mean[at].is_finite()).then(|| f64::from(self.mean[at]))
    }

    /// The measured cells.
    pub(crate) fn cells(&self) -> impl Iterator<Item = Cell> + '_ {
        let centre = |i: usize| (i as f64 + 0.5).to_radians();
        (0..DEGREES * DEGREES).filter_map(move |c| {
            let (h, d) = (c / DEGREES, c % DEGREES);
            let count = f64::from(self.count[c]);
            self.value(h, d).map(|value| Cell { theta_h: centre(h), theta_d: centre(d), value, count })
        })
    }

    /// The cells that estimates are compared with: those with more than 50 observations, `theta_h`
    /// below 80 degrees, and a value above zero.
    pub(crate) fn judged(&self) -> Vec<Cell> {
        let sound = |c: &Cell| c.count > OBSERVED && c.theta_h < TRUSTED && c.value > 0.0;
        self.cells().filter(sound).collect()
    }

    /// The best function of `theta_h` alone: the mean of the judged cells over `theta_d`, linear
    /// between rows and constant beyond them.
    pub(crate) fn profile(&self) -> impl Fn(f64) -> f64 + Sync + use<> {
        let mut rows = vec![(0.0, 0.0); DEGREES];
        for cell in self.judged() {
            let (sum, count) = &mut rows[cell.theta_h.to_degrees() as usize];
            *sum += cell.value;
            *count += 1.0;
        }
        let places: Vec<usize> = (0..DEGREES).filter(|&h| rows[h].1 > 0.0).collect();
        move |theta_h| between(&places, theta_h.to_degrees() - 0.5, |h| rows[h].0 / rows[h].1)
    }

    /// Returns the value at any angles, by bilinear interpolation of the measured and filled cells.
    pub(crate) fn eval(&self, theta_h: f64, theta_d: f64) -> f64 {
        let place = |angle: f64| {
            let x = (angle.to_degrees() - 0.5).clamp(0.0, (DEGREES - 1) as f64);
            let i = (x as usize).min(DEGREES - 2);
            (i, x - i as f64)
        };
        let ((h, s), (d, t)) = (place(theta_h), place(theta_d));
        let row = |h: usize| (1.0 - t) * self.filled[h * DEGREES + d] + t * self.filled[h * DEGREES + d + 1];
        (1.0 - s) * row(h) + s * row(h + 1)
    }
}

/// Interpolates linearly between the values at ascending positions, constant beyond them; zero if
/// there are no positions.
fn between(places: &[usize], x: f64, value: impl Fn(usize) -> f64) -> f64 {
    let after = places.partition_point(|p| *p as f64 <= x);
    match (after.checked_sub(1).map(|i| places[i]), places.get(after)) {
        (None, None) => 0.0,
        (Some(p), None) => value(p),
        (None, Some(&q)) => value(q),
        (Some(p), Some(&q)) => {
            let t = (x - p as f64) / (q - p) as f64;
            (1.0 - t) * value(p) + t * value(q)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn npz(path: &Path, mean: &[f64], shape: &str) {
        let mut zip = zip::ZipWriter::new(File::create(path).unwrap());
        let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
        for name in ["mean", "count"] {
            let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n");
            zip.start_file(format!("{name}.npy"), options).unwrap();
            zip.write_all(b"\x93NUMPY\x01\x00").unwrap();
            zip.write_all(&(header.len() as u16).to_le_bytes()).unwrap();
            zip.write_all(header.as_bytes()).unwrap();
            for value in mean {
                let value = if name == "count" { f64::from(*value > 0.0) } else { *value };
                zip.write_all(&value.to_le_bytes()).unwrap();
            }
        }
        zip.finish().unwrap();
    }

    #[test]
    fn measurements_are_read_and_interpolated() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("slice.npz");
        // F = 1 + h + 100 d in columns 2 and 6, from row 1 to row 50.
        let cell = |c: usize| match (c / DEGREES, c % DEGREES) {
            (h @ 1..=50, d @ (2 | 6)) => 1.0 + h as f64 + 100.0 * d as f64,
            _ => 0.0,
        };
        let mean: Vec<f64> = (0..DEGREES * DEGREES).map(cell).collect();
        npz(&path, &mean, "(90, 90)");
        let slice = Slice::read(&path).unwrap();
        assert_eq!(slice.cells().count(), 100);
        let at = |h: f64, d: f64| slice.eval((h + 0.5).to_radians(), (d + 0.5).to_radians());
        for (h, d, want) in
            [(10.0, 2.0, 211.0), (10.5, 4.0, 411.5), (0.0, 2.0, 202.0), (70.0, 0.0, 251.0), (3.0, 89.0, 604.0)]
        {
            assert!((at(h, d) - want).abs() < 1e-3, "{h} {d}: {}", at(h, d));
        }
        npz(&path, &mean, "(8100,)");
        assert!(Slice::read(&path).is_err());
        std::fs::write(&path, b"no zip").unwrap();
        assert!(format!("{:#}", Slice::read(&path).err().unwrap()).contains("slice.npz"));
    }

    #[test]
    fn the_profile_is_the_mean_over_difference_angles() {
        // Two columns have enough observations, a third does not.
        let value = |c: usize| (1 + c / DEGREES) as f32 * [1.0, 3.0, 100.0][c % DEGREES % 3];
        let count = |c: usize| [60.0, 51.0, 50.0].get(c % DEGREES).copied().unwrap_or(0.0);
        let cells = || 0..DEGREES * DEGREES;
        let slice = Slice::new(cells().map(value).collect(), cells().map(count).collect());
        assert_eq!(slice.judged().len(), 2 * 80);
        let profile = slice.profile();
        for (degrees, want) in [(0.5, 2.0), (0.0, 2.0), (10.5, 22.0), (11.0, 23.0), (89.0, 160.0)] {
            assert!((profile(f64::to_radians(degrees)) - want).abs() < 1e-9, "{degrees}");
        }
    }
}
