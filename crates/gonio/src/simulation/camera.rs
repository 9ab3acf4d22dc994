//! What stands between a scene and its photograph: camera, texture, shadows, and shapes that are not quite known.
//!
//! Each effect has a strength of its own, down to none. They act on the disk of normals, where every shape is alike.

use rand::{Rng, RngExt};
use rand_distr::{Distribution, Poisson, StandardNormal};

use crate::appearance::disk::{self, DiskImage, SIDE, on_disk};
use crate::appearance::{Sample, scatter};

/// Strengths of all effects on one photograph; zero is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Radius in pixels of a ball with as many pixels as the object. Photographs of a hundred to a thousand pixels across are common.
    pub radius: f32,
    /// Standard deviation of the logarithm of how many pixels show a normal: even for a ball, one or more for a figure with flat parts.
    pub uneven: f32,
    /// Share of the normals that are not seen at all: what faces a pedestal, holes of a scan, a cropped picture.
    pub missing: f32,
    /// Noise that does not depend on brightness, relative to the mean of the picture: read noise, at most a few percent in the dark parts of one exposure
    /// (EMVA 1288).
    pub read: f32,
    /// Noise of a pixel of mean brightness that grows with the root of the brightness: photons (EMVA 1288).
    pub shot: f32,
    /// Levels between black and the largest value, 2^8 for 8 bits; zero for floats.
    pub levels: f32,
    /// Share of the pixels that is clipped.
    pub clipped: f32,
    /// Standard deviation of the lens's blur, in cells of the disk.
    pub blur: f32,
    /// Share of the light that the lens scatters over the whole picture: veiling glare, one to five percent of ordinary lenses (ISO 9358).
    pub glare: f32,
    /// Relative standard deviation of the albedo from pixel to pixel: grain, flakes, weave. The three photographed objects beside this data have 6 to 23 %.
    pub speckle: f32,
    /// Standard deviation of the logarithm of the albedo over regions: stains, wear.
    pub stains: f32,
    /// How much of the light the darkest regions lack: shadows that nobody modelled, 0..=1.
    pub shadow: f32,
    /// Light that the object throws onto itself, relative to the mean of the picture.
    pub bounce: f32,
    /// Share of the pixels that are of another material.
    pub foreign: f32,
    /// Error of the normals from pixel to pixel, radians: the noise of a scan.
    pub rough_normals: f32,
    /// Error of the normals over regions, radians: a scan that was smoothed or is a pixel beside the picture.
    pub wrong_normals: f32,
    /// Error of the outline: its radius and centre, relative to the radius.
    pub outline: f32,
    /// Whether pixels of one normal come from several places, so that their scatter shows what differs between regions.
    pub figure: bool,
}

impl Camera {
    /// A photograph without any fault, of a ball of 128 pixels.
    pub const CLEAN: Self = Self {
        radius: 64.0,
        uneven: 0.0,
        missing: 0.0,
        read: 0.0,
        shot: 0.0,
        levels: 0.0,
        clipped: 0.0,
        blur: 0.0,
        glare: 0.0,
        speckle: 0.0,
        stains: 0.0,
        shadow: 0.0,
        bounce: 0.0,
        foreign: 0.0,
        rough_normals: 0.0,
        wrong_normals: 0.0,
        outline: 0.0,
        figure: false,
    };

    /// A camera, an object and its shape as they come. A quarter are renderings, clean but for a little noise; the others have each effect with a probability
    /// of its own.
    pub fn draw(rng: &mut impl Rng) -> Self {
        let log = |rng: &mut _, low: f32, high: f32| between(rng, low.ln(), high.ln()).exp();
        let clean = rng.random_range(0.0..1.0) < 0.25;
        let radius = log(rng, 40.0, 600.0);
        if clean {
            return Self { radius, read: between(rng, 0.0, 0.01), ..Self::CLEAN };
        }
        let mut maybe = |share: f64, value: &dyn Fn(&mut _) -> f32| {
            if rng.random_range(0.0..1.0) < share { value(&mut *rng) } else { 0.0 }
        };
        let figure = maybe(0.6, &|_| 1.0) > 0.0;
        Self {
            radius: if figure { maybe(1.0, &|r| log(r, 60.0, 400.0)) } else { radius },
            uneven: if figure { maybe(1.0, &|r| between(r, 0.0, 1.2)) } else { 0.0 },
            missing: maybe(0.3, &|r| log(r, 0.01, 0.4)),
            read: maybe(0.7, &|r| log(r, 5e-4, 0.03)),
            shot: maybe(0.7, &|r| log(r, 1e-3, 0.05)),
            levels: maybe(0.4, &|r| [256.0, 256.0, 1024.0, 4096.0][r.random_range(0..4)]),
            clipped: maybe(0.15, &|r| log(r, 5e-4, 0.05)),
            blur: maybe(0.5, &|r| log(r, 0.2, 2.0)),
            glare: maybe(0.4, &|r| log(r, 0.002, 0.05)),
            speckle: maybe(0.7, &|r| log(r, 0.003, 0.35)),
            stains: maybe(0.5, &|r| log(r, 0.01, 0.3)),
            shadow: if figure { maybe(0.5, &|r| between(r, 0.0, 0.7)) } else { 0.0 },
            bounce: if figure { maybe(0.4, &|r| log(r, 0.005, 0.15)) } else { 0.0 },
            foreign: maybe(0.12, &|r| log(r, 0.003, 0.12)),
            rough_normals: maybe(0.4, &|r| log(r, 0.003, 0.08)),
            wrong_normals: maybe(0.4, &|r| log(r, 0.003, 0.05)),
            outline: maybe(0.4, &|r| log(r, 0.002, 0.03)),
            figure,
        }
    }

    /// The photograph of a scene: `scene` is the luminance at the middle of each cell of the disk, `other` that of another material in the same light.
    ///
    /// # Panics
    /// If a picture has not `SIDE * SIDE` cells.
    pub fn photograph(&self, scene: &[f32], other: &[f32], rng: &mut impl Rng) -> DiskImage {
        assert!(scene.len() == SIDE * SIDE && other.len() == scene.len());
        let mut image = scene.to_vec();
        if self.foreign > 0.0 {
            let patches = field(6, rng);
            let edge = quantile(&patches, 1.0 - self.foreign);
            image.iter_mut().zip(other).zip(&patches).for_each(|((v, o), p)| *v = if *p > edge { *o } else { *v });
        }
        if self.wrong_normals > 0.0 || self.outline > 0.0 {
            image = self.displaced(&image, rng);
        }
        // What a cell's own pixels vary by because their normals do.
        let slope = if self.rough_normals > 0.0 { slopes(&image) } else { Vec::new() };
        let rough = self.rough_normals * 0.5 * SIDE as f32;
        let width = self.blur.hypot(rough);
        if width > 0.15 {
            image = blurred(&image, width);
        }
        let mean = disk::mean(&image);
        if self.glare > 0.0 {
            image.iter_mut().for_each(|v| *v = (1.0 - self.glare) * *v + self.glare * mean);
        }
        self.over_regions(&mut image, mean, rng);
        let clip = if self.clipped > 0.0 { quantile(&image, 1.0 - self.clipped) } else { f32::INFINITY };
        let (counts, fine) = self.counts(rng);
        let top = image.iter().copied().fold(0.0, f32::max).min(clip);
        let step = if self.levels > 0.0 { top / self.levels } else { 0.0 };
        let mut seen = vec![0.0; SIDE * SIDE];
        let mut kept = vec![0.0; SIDE * SIDE];
        for cell in (0..SIDE * SIDE).filter(|&c| on_disk(c) && counts[c] > 0.0) {
            let value = image[cell];
            if value > clip {
                continue;
            }
            let tilt = slope.get(cell).map_or(0.0, |s| s * rough);
            let variance = (self.speckle * value).powi(2)
                + self.shot.powi(2) * mean * value
                + (self.read * mean).powi(2)
                + tilt * tilt
                + step * step / 12.0;
            let z: f32 = StandardNormal.sample(rng);
            let noisy = value + z * (variance / counts[cell]).sqrt();
            // Rounding shows where few pixels are averaged.
            let rounded = if step > 0.0 && counts[cell] < 3.0 { (noisy / step).round() * step } else { noisy };
            seen[cell] = rounded.max(0.0);
            kept[cell] = counts[cell];
        }
        let told = if fine { self.told(&image, &slope, (mean, rough, step), rng) } else { told_of_cells(&seen, &kept) };
        DiskImage::of_cells(seen, kept, told)
    }

    /// Stains, shadows and light from elsewhere on the object.
    fn over_regions(&self, image: &mut [f32], mean: f32, rng: &mut impl Rng) {
        if self.stains > 0.0 {
            let (coarse, fine) = (field(6, rng), field(16, rng));
            let each = image.iter_mut().zip(coarse.iter().zip(&fine));
            each.for_each(|(v, (a, b))| *v *= (self.stains * (0.8 * a + 0.6 * b)).exp());
        }
        if self.shadow > 0.0 {
            let dark = field(5, rng);
            image.iter_mut().zip(&dark).for_each(|(v, d)| *v *= 1.0 - self.shadow * (0.7 * d).clamp(0.0, 1.0));
        }
        if self.bounce > 0.0 {
            let lit = field(4, rng);
            image.iter_mut().zip(&lit).for_each(|(v, l)| *v += self.bounce * mean * l.max(0.0));
        }
    }

    /// Pixels of each cell, and whether single pixels can be told apart in them.
    fn counts(&self, rng: &mut impl Rng) -> (Vec<f32>, bool) {
        let each = (self.radius / (0.5 * SIDE as f32)).powi(2);
        let mut counts = vec![each; SIDE * SIDE];
        if self.uneven > 0.0 {
            let density = field(10, rng);
            let mut poisson =
                |mean: f32| Poisson::new(f64::from(mean.clamp(1e-4, 1e4))).map_or(0.0, |p| p.sample(rng) as f32);
            counts.iter_mut().zip(&density).for_each(|(c, d)| *c = poisson(*c * (self.uneven * d).exp()));
        } else if each < 1.0 {
            // A grid of pixels coarser than the cells.
            let stride = 1.0 / each.sqrt();
            let line = |i: usize| ((i + 1) as f32 / stride).floor() > (i as f32 / stride).floor();
            for (cell, count) in counts.iter_mut().enumerate() {
                *count = f32::from(u8::from(line(cell % SIDE) && line(cell / SIDE)));
            }
        }
        if self.missing > 0.0 {
            let gaps = field(5, rng);
            let edge = quantile(&gaps, 1.0 - self.missing);
            counts.iter_mut().zip(&gaps).for_each(|(c, g)| *c = if *g > edge { 0.0 } else { *c });
        }
        (counts, each >= 3.0)
    }

    /// The image at normals that are a little off, by a smooth field of shifts, a shift of all, and another radius.
    fn displaced(&self, image: &[f32], rng: &mut impl Rng) -> Vec<f32> {
        let cells = 0.5 * SIDE as f32;
        let (right, down) = (field(7, rng), field(7, rng));
        let mut off = || self.outline * cells * gauss(rng);
        let (dx, dy, stretch) = (off(), off(), off() / cells);
        let regional = self.wrong_normals * cells;
        let at = |cell: usize| {
            let (x, y) = ((cell % SIDE) as f32 + 0.5 - cells, (cell / SIDE) as f32 + 0.5 - cells);
            let x = x * (1.0 + stretch) + dx + regional * right[cell];
            let y = y * (1.0 + stretch) + dy + regional * down[cell];
            // Beyond the rim there is no object.
            let shrink = (0.975 * cells / x.hypot(y).max(1e-6)).min(1.0);
            bilinear(image, x * shrink + cells - 0.5, y * shrink + cells - 0.5)
        };
        (0..SIDE * SIDE).map(|c| if on_disk(c) { at(c) } else { 0.0 }).collect()
    }

    /// The scatter as it would be estimated from pixels that share a normal, not quite right.
    fn told(&self, image: &[f32], slope: &[f32], (mean, rough, step): (f32, f32, f32), rng: &mut impl Rng) -> f32 {
        let mut relative: Vec<f32> = (0..SIDE * SIDE)
            .filter(|&c| on_disk(c) && image[c] > 0.0)
            .step_by(7)
            .map(|c| {
                let value = image[c];
                let tilt = slope.get(c).map_or(0.0, |s| s * rough);
                let rest =
                    self.shot.powi(2) * mean * value + (self.read * mean).powi(2) + tilt * tilt + step * step / 12.0;
                rest / (value * value)
            })
            .collect();
        let middle = relative.len() / 2;
        let rest = if relative.is_empty() { 0.0 } else { *relative.select_nth_unstable_by(middle, f32::total_cmp).1 };
        let regional = if self.figure { self.stains.powi(2) + 0.06 * self.shadow.powi(2) } else { 0.0 };
        // Sharp reflections vary within a cell, and count as scatter in part.
        let detail = between(rng, 0.0, 0.5) * detail_of(image);
        let told = (self.speckle.powi(2) + rest + regional + detail * detail).sqrt() * (0.15 * gauss(rng)).exp();
        told.max(0.001)
    }
}

fn between(rng: &mut impl Rng, low: f32, high: f32) -> f32 {
    rng.random_range(low..high)
}

fn gauss(rng: &mut impl Rng) -> f32 {
    StandardNormal.sample(rng)
}

/// The scatter of an image whose cells are its pixels.
fn told_of_cells(values: &[f32], counts: &[f32]) -> f32 {
    let samples: Vec<Sample> = (0..SIDE * SIDE)
        .filter(|&c| counts[c] > 0.0)
        .map(|c| {
            let (x, y) = disk::centre(c);
            Sample { x, y, value: values[c], weight: 1.0 }
        })
        .collect();
    scatter(&samples).unwrap_or(0.0)
}

/// Value below which a share of the disk lies.
fn quantile(values: &[f32], share: f32) -> f32 {
    let mut on: Vec<f32> = (0..SIDE * SIDE).filter(|&c| on_disk(c)).map(|c| values[c]).collect();
    let at = (share.clamp(0.0, 1.0) * (on.len() - 1) as f32) as usize;
    *on.select_nth_unstable_by(at, f32::total_cmp).1
}

/// The median over the disk of how far a cell is from the plane through its neighbours, relative to its value.
fn detail_of(image: &[f32]) -> f32 {
    let inside = |&c: &usize| {
        let (x, y) = disk::centre(c);
        x * x + y * y < 0.9 && image[c] > 0.0
    };
    let mut all: Vec<f32> = (0..SIDE * SIDE)
        .filter(inside)
        .step_by(5)
        .map(|c| {
            let around = image[c - 1] + image[c + 1] + image[c - SIDE] + image[c + SIDE];
            (image[c] - 0.25 * around).abs() / image[c]
        })
        .collect();
    let middle = all.len() / 2;
    if all.is_empty() { 0.0 } else { *all.select_nth_unstable_by(middle, f32::total_cmp).1 }
}

/// Change from cell to cell.
fn slopes(image: &[f32]) -> Vec<f32> {
    let slope = |c: usize| {
        if !on_disk(c) || c < SIDE || c + SIDE >= SIDE * SIDE {
            return 0.0;
        }
        let along = |a: usize, b: usize| {
            if on_disk(a) && on_disk(b) { 0.5 * (image[b] - image[a]) } else { 0.0 }
        };
        along(c - 1, c + 1).hypot(along(c - SIDE, c + SIDE))
    };
    (0..SIDE * SIDE).map(slope).collect()
}

/// A Gaussian mean over the disk, of standard deviation `width` in cells.
fn blurred(image: &[f32], width: f32) -> Vec<f32> {
    let reach = (2.5 * width).ceil() as isize;
    let kernel: Vec<f32> = (-reach..=reach).map(|i| (-0.5 * (i as f32 / width).powi(2)).exp()).collect();
    let pass = |from: &[[f32; 2]], stride: isize| -> Vec<[f32; 2]> {
        let mut to = vec![[0.0_f32; 2]; from.len()];
        for (i, weight) in (-reach..=reach).zip(&kernel) {
            for y in 0..SIDE as isize {
                let (rows, columns) = if stride == 1 { (y, i) } else { (y + i, 0) };
                if !(0..SIDE as isize).contains(&rows) {
                    continue;
                }
                let (low, high) = ((-columns).max(0), (SIDE as isize - columns).min(SIDE as isize));
                let source = &from[(rows * SIDE as isize + low + columns) as usize..][..(high - low) as usize];
                let target = &mut to[(y * SIDE as isize + low) as usize..][..(high - low) as usize];
                target.iter_mut().zip(source).for_each(|(t, s)| {
                    t[0] += weight * s[0];
                    t[1] += weight * s[1];
                });
            }
        }
        to
    };
    let start: Vec<[f32; 2]> = (0..SIDE * SIDE).map(|c| if on_disk(c) { [image[c], 1.0] } else { [0.0; 2] }).collect();
    let done = pass(&pass(&start, 1), SIDE as isize);
    (0..SIDE * SIDE).map(|c| if on_disk(c) { done[c][0] / done[c][1] } else { 0.0 }).collect()
}

fn bilinear(image: &[f32], x: f32, y: f32) -> f32 {
    let last = (SIDE - 2) as f32;
    let (x, y) = (x.clamp(0.0, last), y.clamp(0.0, last));
    let (column, row) = (x as usize, y as usize);
    let (s, t) = (x - column as f32, y - row as f32);
    let at = |c: usize, r: usize| image[r * SIDE + c];
    (1.0 - t) * ((1.0 - s) * at(column, row) + s * at(column + 1, row))
        + t * ((1.0 - s) * at(column, row + 1) + s * at(column + 1, row + 1))
}

/// A smooth random field of mean zero and variance one: Gaussian values on a grid of so many squares across, cubic splines between them.
fn field(across: usize, rng: &mut impl Rng) -> Vec<f32> {
    let side = across + 3;
    let nodes: Vec<f32> = (0..side * side).map(|_| gauss(rng)).collect();
    let shift = (between(rng, 0.0, 1.0), between(rng, 0.0, 1.0));
    let basis = |t: f32| {
        let u = 1.0 - t;
        [
            u * u * u / 6.0,
            (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
            (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0,
            t * t * t / 6.0,
        ]
    };
    let line = |shift: f32| -> Vec<(usize, [f32; 4])> {
        (0..SIDE)
            .map(|i| {
                let at = (i as f32 + 0.5) / SIDE as f32 * (across as f32 - 1.0) + shift;
                (at as usize, basis(at.fract()))
            })
            .collect()
    };
    let (columns, rows) = (line(shift.0), line(shift.1));
    let mut out = Vec::with_capacity(SIDE * SIDE);
    // The variance of a mean with these weights, by averaging over places, is 0.48^2.
    const SCALE: f32 = 1.0 / 0.479;
    for (row, v) in &rows {
        let across_rows: Vec<f32> =
            (0..side).map(|c| (0..4).map(|k| v[k] * nodes[(row + k) * side + c]).sum::<f32>()).collect();
        out.extend(
            columns.iter().map(|(column, u)| SCALE * (0..4).map(|k| u[k] * across_rows[column + k]).sum::<f32>()),
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;

    /// Gives a camera an effect of a strength.
    type Set<'a> = &'a dyn Fn(&mut Camera, f32);

    fn scene() -> Vec<f32> {
        (0..SIDE * SIDE)
            .map(|c| {
                let (x, y) = disk::centre(c);
                if on_disk(c) { 1.0 + 0.3 * y + 4.0 * (-60.0 * ((x - 0.2).powi(2) + y * y)).exp() } else { 0.0 }
            })
            .collect()
    }

    fn taken(camera: &Camera, seed: u64) -> DiskImage {
        let grey = vec![1.0; SIDE * SIDE];
        camera.photograph(&scene(), &grey, &mut Pcg64::seed_from_u64(seed))
    }

    /// Root mean square of the relative difference to the scene over observed cells.
    fn error(image: &DiskImage) -> f32 {
        let scene = scene();
        let seen: Vec<usize> = (0..SIDE * SIDE).filter(|&c| image.counts[c] > 0.0).collect();
        let sum: f32 = seen.iter().map(|&c| (image.values[c] / scene[c] - 1.0).powi(2)).sum();
        (sum / seen.len() as f32).sqrt()
    }

    #[test]
    fn a_clean_camera_shows_the_scene() {
        let image = taken(&Camera::CLEAN, 1);
        assert!(error(&image) < 1e-6 && image.observed() > 0.999);
        assert_eq!(
            taken(&Camera::draw(&mut Pcg64::seed_from_u64(5)), 2),
            taken(&Camera::draw(&mut Pcg64::seed_from_u64(5)), 2)
        );
    }

    #[test]
    fn speckle_averages_out_over_pixels_and_is_told() {
        let few = Camera { speckle: 0.2, ..Camera::CLEAN };
        let many = Camera { radius: 256.0, ..few };
        assert!((error(&taken(&few, 3)) / 0.2 - 1.0).abs() < 0.1);
        let image = taken(&many, 3);
        assert!((error(&image) / 0.05 - 1.0).abs() < 0.1);
        assert!((image.scatter / 0.2).ln().abs() < 0.6, "{}", image.scatter);
        assert!((taken(&few, 3).scatter / 0.2).ln().abs() < 0.3);
    }

    #[test]
    fn each_effect_changes_something_and_more_of_it_more() {
        let with = |set: Set<'_>, strength: f32| {
            let mut camera = Camera { radius: 128.0, ..Camera::CLEAN };
            set(&mut camera, strength);
            error(&taken(&camera, 7))
        };
        let effects: [(&str, Set<'_>, f32); 10] = [
            ("read", &|c, s| c.read = s, 0.1),
            ("shot", &|c, s| c.shot = s, 0.1),
            ("blur", &|c, s| c.blur = s, 2.0),
            ("glare", &|c, s| c.glare = s, 0.1),
            ("stains", &|c, s| c.stains = s, 0.3),
            ("shadow", &|c, s| c.shadow = s, 0.5),
            ("bounce", &|c, s| c.bounce = s, 0.2),
            ("foreign", &|c, s| c.foreign = s, 0.2),
            ("rough normals", &|c, s| c.rough_normals = s, 0.05),
            ("wrong normals", &|c, s| c.wrong_normals = s, 0.05),
        ];
        for (name, set, strength) in effects {
            let (less, more) = (with(set, 0.5 * strength), with(set, strength));
            assert!(less > 1e-4 && more > 1.2 * less, "{name}: {less} {more}");
        }
    }

    #[test]
    fn what_is_missing_or_clipped_is_not_observed() {
        let gaps = taken(&Camera { missing: 0.3, ..Camera::CLEAN }, 1);
        assert!((gaps.observed() - 0.7).abs() < 0.02);
        let clipped = taken(&Camera { clipped: 0.05, ..Camera::CLEAN }, 1);
        assert!((clipped.observed() - 0.95).abs() < 0.02);
        let coarse = taken(&Camera { radius: 40.0, ..Camera::CLEAN }, 1);
        assert!((coarse.observed() - 0.39).abs() < 0.05, "{}", coarse.observed());
    }

    #[test]
    fn fields_have_variance_one() {
        let mut rng = Pcg64::seed_from_u64(8);
        for across in [4, 7, 16] {
            let values: Vec<f32> = (0..40).flat_map(|_| field(across, &mut rng)).collect();
            let square = values.iter().map(|v| f64::from(v * v)).sum::<f64>() / values.len() as f64;
            assert!((square - 1.0).abs() < 0.15, "{across}: {square}");
        }
    }
}
