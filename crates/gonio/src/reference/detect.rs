//! Detection of a colour chart.
//!
//! Candidates are uniform regions with the shape of a parallelogram ([`squares`]) that lie on a
//! lattice ([`lattices`]). Every part of a lattice of 6 by 4 cells is measured at full resolution,
//! and is a chart only if its 24 colours match those of the chart.

use glam::{DVec2, Vec3};

use super::ReferenceError;
use super::chart::{ChartReading, Corners, Tolerance};
use super::colours::{COLUMNS, PATCHES, ROWS};
use super::homography::{apply, fit};
use super::lattice::{Lattice, lattices};
use super::patch::Clipping;
use super::squares::squares;
use crate::picture::{Plane, luminance};

/// Longest sides, in pixels, of the reduced pictures that are searched.
///
/// Noise hides the patches in a fine picture; in a coarse one, they are too small.
const SIDES: [usize; 4] = [1600, 800, 400, 200];
/// Differences of logarithms below which a pixel is uniform.
const THRESHOLDS: [f32; 3] = [0.05, 0.12, 0.25];
/// Smallest number of patches that must be detected as squares.
const MIN_SEEN: usize = 11;
/// Largest root mean square distance of these squares from their positions, relative to the pitch.
const MAX_OFF: f64 = 0.12;
/// Largest number of positions on a lattice that are measured, those with the most squares.
const MAX_PLACES: usize = 16;
/// Radiance below which logarithms level off, relative to the upper quartile of the luminance.
///
/// Without this floor, noise in dark regions would form edges.
const LOG_FLOOR: f32 = 0.003;

/// Detects a 24-patch ColorChecker Classic in a photograph and measures it.
///
/// `clip` is the radiance at or above which a channel is clipped; without it, the level is detected
/// in the photograph.
///
/// # Errors
/// [`ReferenceError::NoChart`] if no chart is detected with certainty,
/// [`ReferenceError::SeveralCharts`] if several are.
pub fn find_chart(rgb: &Plane<Vec3>, clip: Option<f32>) -> Result<ChartReading, ReferenceError> {
    let clipping = Clipping::of(rgb, clip);
    let longest = rgb.width().max(rgb.height());
    let mut steps: Vec<usize> = SIDES.iter().map(|side| longest.div_ceil(*side).max(1)).collect();
    steps.dedup();
    for step in steps {
        let log = reduced(rgb, step);
        for threshold in THRESHOLDS {
            let mut found: Vec<ChartReading> = Vec::new();
            for lattice in lattices(&squares(&log, threshold), MIN_SEEN) {
                let read = places(&lattice, step as f64)
                    .iter()
                    .filter_map(|corners| ChartReading::at(rgb, corners, clipping, Tolerance::DETECTED).ok())
                    .max_by(|a, b| a.chroma_correlation.total_cmp(&b.chroma_correlation));
                found.extend(read);
            }
            match found.len() {
                0 => (),
                1 => return Ok(found.swap_remove(0)),
                _ => return Err(ReferenceError::SeveralCharts),
            }
        }
    }
    Err(ReferenceError::NoChart)
}

/// Returns the logarithms of a picture that is reduced by a whole factor.
fn reduced(rgb: &Plane<Vec3>, step: usize) -> Plane<Vec3> {
    let sound = |pixel: Vec3| if pixel.is_finite() { pixel.max(Vec3::ZERO) } else { Vec3::ZERO };
    let mean = Plane::from_fn(rgb.width() / step, rgb.height() / step, |x, y| {
        let cells = (0..step * step).map(|i| sound(rgb[(x * step + i % step, y * step + i / step)]));
        cells.sum::<Vec3>() / (step * step) as f32
    });
    // A quartile is robust: a lamp in the photograph does not raise it.
    let mut values: Vec<f32> = mean.as_slice().iter().map(|pixel| luminance(*pixel)).collect();
    values.sort_unstable_by(f32::total_cmp);
    let upper = values.get(values.len() * 3 / 4).copied().unwrap_or_default();
    let floor = (LOG_FLOOR * upper).max(f32::MIN_POSITIVE);
    mean.map(|pixel| Vec3::from_array(pixel.max(Vec3::splat(floor)).to_array().map(f32::ln)))
}

/// Returns the corners of all 6 by 4 parts of a lattice that have enough squares.
///
/// Corners are in pixels of the photograph; a pixel of the lattice spans `step` of them.
fn places(lattice: &Lattice, step: f64) -> Vec<Corners> {
    let range = |pick: fn(&(i32, i32)) -> i32| {
        let low = lattice.keys().map(pick).min().unwrap_or_default();
        (low, lattice.keys().map(pick).max().unwrap_or_default())
    };
    let (columns, rows) = (range(|cell| cell.0), range(|cell| cell.1));
    let mut found = Vec::new();
    for (across, down) in [(COLUMNS as i32, ROWS as i32), (ROWS as i32, COLUMNS as i32)] {
        for top in rows.0 - 1..=(rows.1 + 2 - down).max(rows.0 - 1) {
            for left in columns.0 - 1..=(columns.1 + 2 - across).max(columns.0 - 1) {
                let pairs: Vec<(DVec2, DVec2)> = (0..PATCHES as i32)
                    .filter_map(|i| {
                        let (u, v) = (i % across, i / across);
                        let centre = lattice.get(&(left + u, top + v))?;
                        Some((DVec2::new(f64::from(u), f64::from(v)), step * *centre))
                    })
                    .collect();
                found.extend(corners(&pairs, (across - 1, down - 1)).map(|corners| (pairs.len(), corners)));
            }
        }
    }
    found.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    found.into_iter().take(MAX_PLACES).map(|(_, corners)| corners).collect()
}

/// Returns the corners of a grid of cells, given the centres of some cells.
fn corners(pairs: &[(DVec2, DVec2)], (right, bottom): (i32, i32)) -> Option<Corners> {
    if pairs.len() < MIN_SEEN {
        return None;
    }
    let pose = fit(pairs)?;
    let off = pairs.iter().map(|(from, to)| apply(&pose, *from).distance_squared(*to)).sum::<f64>();
    let (right, bottom) = (f64::from(right), f64::from(bottom));
    let corners =
        [(0.0, 0.0), (right, 0.0), (right, bottom), (0.0, bottom)].map(|(u, v)| apply(&pose, DVec2::new(u, v)));
    let pitch = corners[0].distance(corners[1]) / right;
    let fits = (off / pairs.len() as f64).sqrt() < MAX_OFF * pitch;
    (fits && corners.iter().all(|corner| corner.is_finite())).then(|| corners.map(|corner| (corner.x, corner.y)))
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::reference::testing::{chart_picture, noise, pose};

    const LIGHT: DVec3 = DVec3::new(1.7, 1.0, 0.45);
    const SIZE: (usize, usize) = (720, 540);

    /// Bricks, a gradient, stripes and coloured tiles.
    fn clutter(x: f64, y: f64) -> Vec3 {
        let (column, row) = ((x / 23.0).floor(), (y / 23.0).floor());
        if y < 150.0 {
            let code = (column * 7.0 + row * 13.0).rem_euclid(5.0) as f32;
            let joint = x.rem_euclid(23.0).min(y.rem_euclid(23.0)) < 3.0;
            return if joint { Vec3::splat(0.05) } else { Vec3::new(0.2 + 0.1 * code, 0.3, 0.6 - 0.1 * code) };
        }
        if x < 120.0 {
            return Vec3::new(0.4, 0.3, 0.2) * (1.0 + (0.4 * y).sin() as f32 * 0.5);
        }
        let grain = noise((x / 3.0) as usize, (y / 3.0) as usize);
        Vec3::new(0.25, 0.3, 0.15) * (1.0 + 0.2 * grain).max(0.1) * (0.5 + x as f32 / 720.0)
    }

    fn finds(picture: &Plane<Vec3>, pose: &DMat3, light: DVec3) {
        let read = find_chart(picture, None).unwrap_or_else(|error| panic!("{error}"));
        let dark_skin = apply(pose, DVec2::ZERO);
        let pitch = apply(pose, DVec2::X).distance(dark_skin);
        let off = (read.corners[0].0 - dark_skin.x).hypot(read.corners[0].1 - dark_skin.y);
        assert!(off < 0.15 * pitch, "{off} of {pitch}");
        assert!((read.light.white / light - 1.0).abs().max_element() < 0.02, "{}", read.light.white);
    }

    #[test]
    fn detects_charts_in_clutter_in_any_orientation() {
        for (x, y, pitch, angle, perspective) in [
            (250.0, 220.0, 45.0, 0.1, (0.02, 0.03)),
            (600.0, 480.0, 40.0, 3.3, (0.0, -0.02)),
            (480.0, 200.0, 30.0, 1.7, (0.01, 0.0)),
            (300.0, 250.0, 14.0, -0.4, (0.0, 0.0)),
        ] {
            let pose = pose(x, y, pitch, angle, perspective);
            finds(&chart_picture(SIZE, pose, LIGHT, 0.04, clutter), &pose, LIGHT);
        }
    }

    #[test]
    fn detects_noisy_dim_and_mirrored_charts() {
        let upright = pose(250.0, 220.0, 45.0, 0.1, (0.02, 0.0));
        finds(&chart_picture(SIZE, upright, 1e-3 * LIGHT, 0.15, |x, y| 1e-3 * clutter(x, y)), &upright, 1e-3 * LIGHT);
        let mirror = DMat3::from_cols(DVec3::NEG_X, DVec3::Y, DVec3::new(720.0, 0.0, 1.0));
        let mirrored = mirror * upright;
        finds(&chart_picture(SIZE, mirrored, LIGHT, 0.04, clutter), &mirrored, LIGHT);
    }

    #[test]
    fn rejects_pictures_without_a_chart() {
        let cluttered = Plane::from_fn(SIZE.0, SIZE.1, |x, y| clutter(x as f64, y as f64));
        // A chart of other colours: the channels exchanged.
        let pose = pose(250.0, 220.0, 45.0, 0.1, (0.02, 0.0));
        let other = chart_picture(SIZE, pose, DVec3::ONE, 0.04, clutter).map(|c| Vec3::new(c.y, c.z, c.x));
        let grey = chart_picture(SIZE, pose, DVec3::ONE, 0.04, clutter).map(|c| Vec3::splat(c.y));
        // A chart with two covered columns.
        let mut hidden = chart_picture(SIZE, pose, DVec3::ONE, 0.04, clutter);
        for y in 0..SIZE.1 {
            for x in 370..SIZE.0 {
                hidden[(x, y)] = clutter(x as f64, y as f64);
            }
        }
        for picture in [cluttered, other, grey, hidden, Plane::from_vec(1, 1, vec![Vec3::ONE])] {
            assert_eq!(find_chart(&picture, None), Err(ReferenceError::NoChart));
        }
        let empty = Plane::from_vec(0, 0, Vec::new());
        assert_eq!(find_chart(&empty, None), Err(ReferenceError::NoChart));
    }

    #[test]
    fn rejects_two_charts() {
        let (one, other) = (pose(150.0, 220.0, 25.0, 0.1, (0.0, 0.0)), pose(450.0, 250.0, 25.0, 0.3, (0.0, 0.0)));
        let first = chart_picture(SIZE, one, LIGHT, 0.0, clutter);
        let both = chart_picture(SIZE, other, LIGHT, 0.02, |x, y| first[(x as usize, y as usize)]);
        assert_eq!(find_chart(&both, None), Err(ReferenceError::SeveralCharts));
    }
}
