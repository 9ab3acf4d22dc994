//! Image on the disk of normals: a photograph of any shape, mapped to a distant ball.

use glam::{DVec3, Vec3};

use super::detail::details;
use super::scatter;
use super::statistics::{STATISTICS, observed, statistics};

/// Cells along each side of the square around the disk.
pub const DISK_SIDE: usize = 128;

/// Number of channels of [`DiskImage::write`].
pub const CHANNELS: usize = 6;

/// Number of global values of [`DiskImage::write`].
pub const GLOBALS: usize = 5 + STATISTICS;

/// Sine of the largest angle between normal and view, 80 degrees as in the paper.
pub(super) const RIM: f32 = 0.984_807_8;

/// Luminance relative to the mean below which a value counts as black.
pub(super) const BLACK: f32 = 0.003;

/// Smallest relative detail that can be distinguished from none.
const MIN_DETAIL: f32 = 0.003;

/// One observation: its position on the disk, and its brightness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Horizontal component, to the right, of the normal in the frame of its view; in -1..=1.
    pub x: f32,
    /// Vertical component, upwards; in -1..=1.
    pub y: f32,
    /// Luminance, not negative.
    pub value: f32,
    /// Linear RGB, not negative; the luminance in all channels if only the luminance is known.
    pub rgb: [f32; 3],
    /// Weight of the observation, in 0..=1.
    pub weight: f32,
}

impl Sample {
    /// Builds a sample from a unit normal in the frame of its view. Negative values count as zero.
    pub fn of(normal: DVec3, value: f64, weight: f64) -> Self {
        let value = value.max(0.0) as f32;
        Self { x: normal.x as f32, y: normal.y as f32, value, rgb: [value; 3], weight: weight as f32 }
    }

    /// Returns the sample with this linear RGB value. Negative channels count as zero.
    #[must_use]
    pub fn coloured(self, rgb: Vec3) -> Self {
        Self { rgb: rgb.max(Vec3::ZERO).to_array(), ..self }
    }
}

/// Image over the normals `(x, y, z)` of a ball on the disk `x^2 + y^2 <= sin^2 80 degrees`.
///
/// Row 0 is the top, with `y` near 1.
#[derive(Clone, Debug, PartialEq)]
pub struct DiskImage {
    /// Mean luminance of each cell, row by row, zero off the disk. Cells without observations are
    /// interpolated from others.
    pub values: Vec<f32>,
    /// Sum of the weights of the observations of each cell; zero for interpolated cells.
    pub counts: Vec<f32>,
    /// Detail finer than the cells, in units of `values`: the root mean square distance of the
    /// quarters of a cell from the plane through the neighbouring cells. `None` if a quarter has no
    /// observation.
    pub details: Vec<Option<f32>>,
    /// Standard deviation of single observations of one normal, relative to their mean, due to
    /// noise, texture, shadows and errors of normals.
    pub scatter: f32,
}

/// Whether each cell is on the disk. The simulation of a photograph looks up every cell dozens of
/// times.
static ON_DISK: [bool; DISK_SIDE * DISK_SIDE] = {
    let mut on = [false; DISK_SIDE * DISK_SIDE];
    let mut cell = 0;
    while cell < on.len() {
        let (x, y) = centre(cell);
        on[cell] = x * x + y * y <= RIM * RIM;
        cell += 1;
    }
    on
};

/// Whether a cell is on the disk.
pub fn on_disk(cell: usize) -> bool {
    ON_DISK[cell]
}

/// Returns the coordinate of the middle of a column.
const fn place(column: usize) -> f32 {
    (column as f32 + 0.5) * (2.0 / DISK_SIDE as f32) - 1.0
}

/// Returns the centre `(x, y)` of a cell.
pub const fn centre(cell: usize) -> (f32, f32) {
    (place(cell % DISK_SIDE), -place(cell / DISK_SIDE))
}

/// Returns the normal at the centre of a cell of the disk.
pub fn normal(cell: usize) -> Vec3 {
    let (x, y) = centre(cell);
    Vec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt())
}

/// Returns the centres `(x, y)` of the quarters of a cell.
///
/// The order is upper left, upper right, lower left, lower right.
pub fn quarters(cell: usize) -> [(f32, f32); 4] {
    let ((x, y), off) = (centre(cell), 0.5 / DISK_SIDE as f32);
    [(x - off, y + off), (x + off, y + off), (x - off, y - off), (x + off, y - off)]
}

/// Returns the cell at a position and the quarter within the cell, if they are on the disk.
fn quarter_of(x: f32, y: f32) -> Option<(usize, usize)> {
    let place = |v: f32| (((v + 1.0) * DISK_SIDE as f32) as usize).min(2 * DISK_SIDE - 1);
    let (column, row) = (place(x), place(-y));
    let cell = row / 2 * DISK_SIDE + column / 2;
    (x * x + y * y <= RIM * RIM && on_disk(cell)).then_some((cell, row % 2 * 2 + column % 2))
}

impl DiskImage {
    /// Builds the image from observations.
    ///
    /// Returns `None` if no observation with a weight is on the disk, or if all are black.
    pub fn gather(samples: &[Sample]) -> Option<Self> {
        let image = Self::gathered(samples, |sample| sample.value)?;
        Some(Self { scatter: scatter(samples).unwrap_or(0.0), ..image })
    }

    /// Builds the image of a channel (0 red, 1 green, 2 blue).
    ///
    /// `luminance` is the luminance image of the same observations; its scatter is used. Returns
    /// `None` if the channel is black.
    pub fn gather_channel(samples: &[Sample], channel: usize, luminance: &Self) -> Option<Self> {
        let image = Self::gathered(samples, |sample| sample.rgb[channel])?;
        Some(Self { scatter: luminance.scatter, ..image })
    }

    /// Builds the image of one value of each observation, without its scatter.
    fn gathered(samples: &[Sample], value: impl Fn(&Sample) -> f32) -> Option<Self> {
        let mut quarters = vec![[[0.0_f64; 2]; 4]; DISK_SIDE * DISK_SIDE];
        for sample in samples {
            if let Some((cell, quarter)) = quarter_of(sample.x, sample.y).filter(|_| sample.weight > 0.0) {
                let (weight, sums) = (f64::from(sample.weight), &mut quarters[cell][quarter]);
                sums[0] += weight;
                sums[1] += weight * f64::from(value(sample).max(0.0));
            }
        }
        let total = |cell: usize, k: usize| quarters[cell].iter().map(|q| q[k]).sum::<f64>();
        let counts: Vec<f32> = (0..DISK_SIDE * DISK_SIDE).map(|c| total(c, 0) as f32).collect();
        let mean = |c: usize| if counts[c] > 0.0 { (total(c, 1) / total(c, 0)) as f32 } else { 0.0 };
        let values: Vec<f32> = (0..DISK_SIDE * DISK_SIDE).map(mean).collect();
        if values.iter().all(|v| *v <= 0.0) {
            return None;
        }
        let details = details(&values, &counts, |cell| {
            let all = quarters[cell].iter().all(|q| q[0] > 0.0);
            all.then(|| quarters[cell].map(|q| (q[1] / q[0]) as f32))
        });
        Some(Self { values: filled(values, &counts), counts, details, scatter: 0.0 })
    }

    /// Returns the mean of the values over the disk, that is, over the pixels of a distant ball.
    pub fn mean(&self) -> f64 {
        let cells = (0..DISK_SIDE * DISK_SIDE).filter(|&cell| on_disk(cell));
        let (sum, count) = cells.fold((0.0, 0), |(sum, count), cell| (sum + f64::from(self.values[cell]), count + 1));
        sum / f64::from(count.max(1))
    }

    /// Builds an image from the values, counts, details and scatter of its cells.
    ///
    /// The values of cells of count zero are interpolated.
    ///
    /// # Panics
    /// If the number of values, counts or details is not `DISK_SIDE * DISK_SIDE`.
    pub fn of_cells(values: Vec<f32>, counts: Vec<f32>, details: Vec<Option<f32>>, scatter: f32) -> Self {
        assert!(values.len() == DISK_SIDE * DISK_SIDE && counts.len() == values.len() && details.len() == values.len());
        Self { values: filled(values, &counts), counts, details, scatter }
    }

    /// Returns the number of cells of the disk.
    pub fn cells() -> usize {
        (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)).count()
    }

    /// Returns the share of the disk's cells that are observed, in 0..=1.
    pub fn observed(&self) -> f32 {
        Self::share_of_cells(|cell| self.counts[cell] > 0.0)
    }

    /// Returns the share of the disk's cells that are observed or next to an observed one, in
    /// 0..=1.
    ///
    /// The observations of shapes with shadows or in perspective are sparser than the cells.
    pub fn covered(&self) -> f32 {
        Self::share_of_cells(|cell| {
            let (column, row) = (cell % DISK_SIDE, cell / DISK_SIDE);
            let around = |at: usize| at.saturating_sub(1)..=(at + 1).min(DISK_SIDE - 1);
            around(row).any(|row| around(column).any(|column| self.counts[row * DISK_SIDE + column] > 0.0))
        })
    }

    fn share_of_cells(is_counted: impl Fn(usize) -> bool) -> f32 {
        let (mut counted, mut all) = (0, 0);
        for cell in (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)) {
            all += 1;
            counted += usize::from(is_counted(cell));
        }
        counted as f32 / all as f32
    }

    /// Writes the input of an encoder, `[row][column][channel]`, and returns the [`GLOBALS`].
    ///
    /// Channels are zero off the disk. All values are of the order of one.
    ///
    /// The channels are:
    ///
    /// * the value over the mean on a perceptual scale: its cube root, less one;
    /// * half the logarithm of the value over the mean;
    /// * `n_z`;
    /// * whether the cell was observed;
    /// * the logarithm of the relative standard error, a third of it plus one;
    /// * the logarithm of the relative detail, a third of it plus one; zero without a known detail.
    ///
    /// The globals are:
    ///
    /// * the logarithm of the scatter;
    /// * the share of cells observed;
    /// * the logarithm of the observations per cell;
    /// * the logarithm of the largest value over the mean;
    /// * the share of cells of known detail;
    /// * statistics of brightness and of contrast at several scales (`appearance/statistics.rs`).
    ///
    /// # Panics
    /// If `channels` does not have `DISK_SIDE * DISK_SIDE * CHANNELS` values.
    pub fn write(&self, channels: &mut [f32]) -> [f32; GLOBALS] {
        assert_eq!(channels.len(), DISK_SIDE * DISK_SIDE * CHANNELS);
        let mean = mean(&self.values).max(1e-30);
        let (mut total, mut seen, mut largest, mut cells, mut fine) = (0.0, 0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32);
        channels.fill(0.0);
        for cell in (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)) {
            let (value, count) = (self.values[cell], self.counts[cell]);
            let relative = (value / mean).max(0.0);
            let observed = f32::from(u8::from(count > 0.0));
            let error = if count > 0.0 { (self.scatter.powi(2) / count + 1e-6).sqrt().min(1.0) } else { 1.0 };
            let detail = self.details[cell].map(|d| d / value.max(BLACK * mean) + MIN_DETAIL);
            channels[cell * CHANNELS..][..CHANNELS].copy_from_slice(&[
                relative.cbrt() - 1.0,
                0.5 * (relative + BLACK).ln(),
                normal(cell).z,
                observed,
                error.ln() / 3.0 + 1.0,
                detail.map_or(0.0, |d| d.ln() / 3.0 + 1.0),
            ]);
            total += count;
            seen += observed;
            largest = largest.max(value);
            cells += 1.0;
            fine += f32::from(u8::from(detail.is_some()));
        }
        let mut globals = [0.0; GLOBALS];
        let (whole, rest) = globals.split_at_mut(GLOBALS - STATISTICS);
        whole.copy_from_slice(&[
            (self.scatter + 0.003).ln() / 3.0 + 1.0,
            2.0 * seen / cells - 1.0,
            (total / seen.max(1.0)).ln() / 2.0,
            (largest / mean).ln() / 3.0 - 0.5,
            2.0 * fine / cells - 1.0,
        ]);
        let relative: Vec<f32> = self.values.iter().map(|v| (v / mean).max(0.0)).collect();
        let fine: Vec<Option<f32>> = self.details.iter().map(|d| d.map(|d| d / mean)).collect();
        statistics(&relative, &fine, &observed(&self.counts), rest);
        globals
    }
}

/// Returns the mean of an image over the disk.
pub(crate) fn mean(values: &[f32]) -> f32 {
    let (sum, count) = (0..DISK_SIDE * DISK_SIDE)
        .filter(|&c| on_disk(c))
        .fold((0.0_f64, 0.0_f64), |(sum, count), c| (sum + f64::from(values[c]), count + 1.0));
    (sum / count) as f32
}

/// Fills cells of count zero by push-pull (Gortler et al. 1996).
///
/// Their values come from increasingly large squares around them. Cells off the disk remain zero.
fn filled(mut values: Vec<f32>, counts: &[f32]) -> Vec<f32> {
    let mut levels: Vec<Vec<[f32; 2]>> = Vec::new();
    let mut current: Vec<[f32; 2]> =
        values.iter().zip(counts).map(|(v, c)| if *c > 0.0 { [*v, 1.0] } else { [0.0, 0.0] }).collect();
    let mut side = DISK_SIDE;
    while side > 1 {
        let half = side / 2;
        let mut next = vec![[0.0_f32; 2]; half * half];
        for (at, next) in next.iter_mut().enumerate() {
            let (x, y) = (2 * (at % half), 2 * (at / half));
            let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| current[y * side + x]);
            let weight: f32 = four.iter().map(|f| f[1]).sum();
            let sum: f32 = four.iter().map(|f| f[0] * f[1]).sum();
            *next = if weight > 0.0 { [sum / weight, weight.min(1.0)] } else { [0.0, 0.0] };
        }
        levels.push(current);
        current = next;
        side = half;
    }
    let mut coarse: Vec<f32> = current.iter().map(|c| c[0]).collect();
    let mut side = 1;
    for level in levels.iter().rev() {
        let wide = 2 * side;
        // Interpolates between the centres of the coarser squares.
        let at = |x: isize, y: isize| {
            let clamp = |i: isize| i.clamp(0, side as isize - 1) as usize;
            coarse[clamp(y) * side + clamp(x)]
        };
        let fine = |cell: usize| {
            let (x, y) = ((cell % wide) as isize, (cell / wide) as isize);
            let (ox, oy) = (x / 2, y / 2);
            let (nx, ny) = (ox + if x % 2 == 0 { -1 } else { 1 }, oy + if y % 2 == 0 { -1 } else { 1 });
            let up = 0.5625 * at(ox, oy) + 0.1875 * (at(nx, oy) + at(ox, ny)) + 0.0625 * at(nx, ny);
            let [own, weight] = level[cell];
            weight * own + (1.0 - weight) * up
        };
        coarse = (0..wide * wide).map(fine).collect();
        side = wide;
    }
    for (cell, value) in values.iter_mut().enumerate() {
        *value = if !on_disk(cell) {
            0.0
        } else if counts[cell] > 0.0 {
            *value
        } else {
            coarse[cell]
        };
    }
    values
}

#[cfg(test)]
pub(super) mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    /// `count` observations of a smooth ball at random positions, with relative noise.
    pub(in crate::appearance) fn ball(count: usize, noise: f32) -> Vec<Sample> {
        let mut rng = Pcg64::seed_from_u64(3);
        let mut draw = || {
            let (x, y) = (rng.random_range(-1.0..1.0_f32), rng.random_range(-1.0..1.0_f32));
            let z: f32 = StandardNormal.sample(&mut rng);
            Sample::of(
                DVec3::new(f64::from(x), f64::from(y), 0.0),
                f64::from((1.0 + 0.5 * x - 0.3 * y) * (1.0 + noise * z)),
                1.0,
            )
        };
        (0..count).map(|_| draw()).collect()
    }

    #[test]
    fn cells_contain_the_mean_of_their_observations() {
        let image = DiskImage::gather(&ball(200_000, 0.0)).unwrap();
        assert!(image.observed() > 0.99);
        for cell in (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)) {
            let (x, y) = centre(cell);
            assert!((image.values[cell] - (1.0 + 0.5 * x - 0.3 * y)).abs() < 0.02);
        }
        assert_eq!(centre(0).1, 1.0 - 1.0 / DISK_SIDE as f32);
    }

    #[test]
    fn fills_gaps_from_their_surroundings() {
        let hole = |s: &Sample| (s.x - 0.2).hypot(s.y + 0.1) > 0.2;
        let image = DiskImage::gather(&ball(100_000, 0.0).into_iter().filter(hole).collect::<Vec<_>>()).unwrap();
        for cell in (0..DISK_SIDE * DISK_SIDE).filter(|&c| on_disk(c)) {
            let (x, y) = centre(cell);
            let tolerance = if image.counts[cell] > 0.0 { 0.02 } else { 0.1 };
            assert!((image.values[cell] - (1.0 + 0.5 * x - 0.3 * y)).abs() < tolerance, "{x} {y}");
        }
        assert!((image.observed() - (1.0 - 0.04 / 0.97)).abs() < 0.01);
        // A sparse image covers the disk without its hole.
        let sparse = DiskImage::gather(&ball(8_000, 0.0).into_iter().filter(hole).collect::<Vec<_>>()).unwrap();
        assert!(sparse.observed() < 0.55 && (sparse.covered() - image.covered()).abs() < 0.02, "{}", sparse.covered());
    }

    #[test]
    fn images_do_not_depend_on_scale_and_require_light() {
        let (mut one, mut two) =
            (vec![0.0; DISK_SIDE * DISK_SIDE * CHANNELS], vec![0.0; DISK_SIDE * DISK_SIDE * CHANNELS]);
        let samples = ball(50_000, 0.1);
        let bright: Vec<Sample> = samples.iter().map(|s| Sample { value: 70.0 * s.value, ..*s }).collect();
        let (a, b) = (DiskImage::gather(&samples).unwrap(), DiskImage::gather(&bright).unwrap());
        let globals = (a.write(&mut one), b.write(&mut two));
        assert!(one.iter().zip(&two).all(|(a, b)| (a - b).abs() < 1e-4 && a.is_finite()));
        assert!(globals.0.iter().zip(globals.1).all(|(a, b)| (a - b).abs() < 1e-4));
        assert_eq!(DiskImage::gather(&[]), None);
        let black = [Sample::of(DVec3::Z, 0.0, 1.0)];
        assert_eq!(DiskImage::gather(&black), None);
    }
}
