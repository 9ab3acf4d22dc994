//! BRDFs as CSV tables with the columns `theta_h`, `theta_d`, `red`, `green` and `blue`.
//!
//! Angles are the half angle and the difference angle in degrees; values are in 1/sr. The rows, in
//! any order, are a complete grid of both angles. Instead of three channels, a table can have one
//! column, `brdf`.

use std::path::Path;

use gonio::reflectance::{BivariateTable, CELLS, angles_of};

use crate::table::Table;
use crate::{Error, guard};

/// Names of the columns of a file that gonio writes.
const COLUMNS: [&str; 5] = ["theta_h", "theta_d", "red", "green", "blue"];
/// Name of the only channel of a grey BRDF.
const GREY: &str = "brdf";
const ADVICE: &str =
    "use a complete grid with the columns theta_h and theta_d in degrees, and red, green and blue, or brdf, in 1/sr";
/// Longest file read.
const MAX_BYTES: u64 = 1 << 26;

/// Reads a BRDF and resamples it to the cells of a [`BivariateTable`], by channel.
///
/// The interpolation is bilinear in both angles; beyond the grid, the outermost values apply.
///
/// # Errors
/// If the file cannot be read or has other columns. If the rows are not a complete grid, a cell is
/// not a finite number, or an angle is not in 0..=90 degrees.
pub fn read(path: impl AsRef<Path>) -> Result<[BivariateTable; 3], Error> {
    let path = path.as_ref();
    decode(path, &guard::read_whole(path, MAX_BYTES)?)
}

/// Decodes a BRDF held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read`].
pub fn decode(path: &Path, bytes: &[u8]) -> Result<[BivariateTable; 3], Error> {
    let table = Table::decode(path, bytes)?;
    let invalid = |problem: String| Error::invalid(path, problem, ADVICE);
    let column = |name: &str| table.columns.iter().position(|c| c.eq_ignore_ascii_case(name));
    let names = match column(GREY) {
        Some(_) => [COLUMNS[0], COLUMNS[1], GREY, GREY, GREY],
        None => COLUMNS,
    };
    let mut numbers = [const { Vec::new() }; 5];
    for (name, numbers) in names.iter().zip(&mut numbers) {
        let column = column(name).ok_or_else(|| invalid(format!("has no column {name}")))?;
        for (row, cells) in table.rows.iter().enumerate() {
            let number: Option<f64> = cells[column].parse().ok().filter(|v: &f64| v.is_finite());
            let problem =
                || invalid(format!("has \"{}\" in row {} of column {name}, not a number", cells[column], row + 1));
            // Adding zero turns -0 into 0, which sorts apart from it.
            numbers.push(number.ok_or_else(problem)? + 0.0);
        }
    }
    let [theta_h, theta_d, channels @ ..] = numbers;
    for (name, angles) in COLUMNS.iter().zip([&theta_h, &theta_d]) {
        if let Some(angle) = angles.iter().find(|angle| !(0.0..=90.0).contains(*angle)) {
            return Err(invalid(format!("has an angle {name} of {angle} degrees, which is not in 0..90")));
        }
    }
    let [half, difference] = [&theta_h, &theta_d].map(|angles| distinct(angles));
    if half.len() * difference.len() != theta_h.len() {
        let (rows, h, d) = (theta_h.len(), half.len(), difference.len());
        return Err(invalid(format!("has {rows} rows, but {h} half angles and {d} difference angles")));
    }
    // Without a repeated pair of angles, this number of rows is the complete grid.
    let mut rows: Vec<usize> = (0..theta_h.len()).collect();
    rows.sort_by(|&a, &b| theta_h[a].total_cmp(&theta_h[b]).then(theta_d[a].total_cmp(&theta_d[b])));
    let angles = |row: usize| (theta_h[row], theta_d[row]);
    if let Some(pair) = rows.windows(2).find(|pair| angles(pair[0]) == angles(pair[1])) {
        return Err(invalid(format!("has the same angles in rows {} and {}", pair[0] + 1, pair[1] + 1)));
    }
    let cell = |values: &[f64], at: usize| {
        let (h, d) = angles_of(at);
        let mut sum = 0.0;
        for (i, by_half) in neighbours(&half, h.to_degrees()) {
            for (j, by_difference) in neighbours(&difference, d.to_degrees()) {
                sum += by_half * by_difference * values[rows[i * difference.len() + j]];
            }
        }
        sum.max(0.0) as f32
    };
    Ok(channels.each_ref().map(|values| BivariateTable::from_vec((0..CELLS).map(|at| cell(values, at)).collect())))
}

/// Returns the distinct values in ascending order.
fn distinct(values: &[f64]) -> Vec<f64> {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}

/// Returns the two values of `axis` around `at`, and their weights in linear interpolation.
fn neighbours(axis: &[f64], at: f64) -> [(usize, f64); 2] {
    let high = axis.partition_point(|v| *v < at).clamp(0, axis.len() - 1);
    let low = high.saturating_sub(1);
    let share = if high == low { 1.0 } else { ((at - axis[low]) / (axis[high] - axis[low])).clamp(0.0, 1.0) };
    [(low, 1.0 - share), (high, share)]
}

/// Encodes a BRDF at the cells of its tables (8,100 rows, 0.6 MB).
pub fn encode(rgb: &[BivariateTable; 3]) -> Vec<u8> {
    let row = |at: usize| {
        let (h, d) = angles_of(at);
        let angles = [h, d].map(|angle| angle.to_degrees().to_string());
        angles.into_iter().chain(rgb.iter().map(|table| table.as_slice()[at].to_string())).collect()
    };
    Table { columns: COLUMNS.map(str::to_owned).to_vec(), rows: (0..CELLS).map(row).collect() }.encode()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(text: &str) -> Result<[BivariateTable; 3], Error> {
        decode(Path::new("a.csv"), text.as_bytes())
    }

    #[test]
    fn encoding_and_decoding_are_inverse() {
        let rgb = [1.0, 0.5, 1e-4]
            .map(|by| BivariateTable::from_fn(|h, d| by * (0.1 + (1.0 / (0.001 + h)).min(900.0) * d.cos())));
        let back = decode(Path::new("a.csv"), &encode(&rgb)).unwrap();
        for (before, after) in rgb.iter().zip(&back) {
            for (a, b) in before.as_slice().iter().zip(after.as_slice()) {
                assert!((a - b).abs() <= 1e-6 * a, "{a} {b}");
            }
        }
    }

    #[test]
    fn interpolates_a_coarse_grid_of_one_channel() {
        let [red, green, blue] = decoded("theta_d,brdf,theta_h\n0,1,0\n0,3,90\n90,5,0\n90,7,90\n").unwrap();
        assert!(red == green && green == blue);
        for (i, j) in [(0, 0), (45, 12), (80, 89)] {
            let (h, d) = angles_of(i * 90 + j);
            let expected = 1.0 + 2.0 * h.to_degrees() / 90.0 + 4.0 * d.to_degrees() / 90.0;
            assert!((f64::from(red.cell(i, j)) - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn negative_zero_is_zero() {
        let zero = decoded("theta_d,brdf,theta_h\n0,1,0\n0,3,90\n90,5,0\n90,7,90\n").unwrap();
        assert_eq!(decoded("theta_d,brdf,theta_h\n0,1,-0\n-0,3,90\n90,5,0\n90,7,90\n").unwrap(), zero);
    }

    #[test]
    fn rejects_other_tables() {
        for (text, message) in [
            ("theta_i,brdf\n0,1\n", "has no column theta_h"),
            ("theta_h,theta_d,red,green\n0,0,1,1\n", "has no column blue"),
            ("theta_h,theta_d,brdf\n0,0,x\n", "\"x\" in row 1 of column brdf, not a number"),
            ("theta_h,theta_d,brdf\n0,0,inf\n", "not a number"),
            ("theta_h,theta_d,brdf\n0,91,1\n", "theta_d of 91 degrees"),
            ("theta_h,theta_d,brdf\n0,0,1\n10,0,1\n0,10,1\n", "3 rows, but 2 half angles and 2 difference angles"),
            ("theta_h,theta_d,brdf\n0,0,1\n10,0,1\n0,10,1\n0,10,1\n", "the same angles in rows 3 and 4"),
        ] {
            let error = decoded(text).unwrap_err().to_string();
            assert!(error.starts_with("a.csv: ") && error.contains(message), "{error}");
        }
    }
}
