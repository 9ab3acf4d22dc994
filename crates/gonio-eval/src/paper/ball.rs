//! The real ball of `captured/ball`: photographs under three known lights, its normals, its BRDF as measured from 96 single lights.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, bail};
use glam::{DVec3, Vec3};
use gonio::picture::{Picture, Plane};
use gonio::sphere::half_difference;
use rayon::prelude::*;

/// The lights of the photographs.
pub(super) const LIGHTS: [&str; 3] = ["city", "interior", "sunset"];

/// Light from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Directional {
    /// Unit vector towards it.
    pub(super) direction: DVec3,
    /// RGB irradiance on a surface that faces it, up to a scale common to all.
    pub(super) weight: DVec3,
}

/// A ball and what was photographed of it. All planes have one size.
pub(super) struct Ball {
    /// Unit normals in camera space, zero where there is none.
    pub(super) normals: Plane<Vec3>,
    /// One on the ball.
    pub(super) mask: Plane<f32>,
    /// In the order of [`LIGHTS`].
    pub(super) photographs: Vec<Picture>,
    /// Likewise.
    pub(super) lights: Vec<Vec<Directional>>,
    pub(super) measured: Measured,
}

impl Ball {
    /// Reads `captured/ball` of the data.
    pub(super) fn read(data: &Path) -> Result<Self> {
        let folder = data.join("captured/ball");
        let normals = gonio_io::normals::read_normals(folder.join("normal.exr"))?;
        let mask = gonio_io::picture::read_mask(folder.join("mask.png"))?;
        let photograph = |name: &str| -> Result<Picture> {
            let path = folder.join(format!("{name}.exr"));
            let picture = gonio_io::picture::read(&path, &gonio_io::picture::ReadOptions::default())?.picture;
            if picture.rgb.size() != normals.size() || mask.size() != normals.size() {
                bail!("{}: photograph, mask.png and normal.exr differ in size", path.display());
            }
            Ok(picture)
        };
        Ok(Self {
            photographs: LIGHTS.iter().map(|name| photograph(name)).collect::<Result<_>>()?,
            lights: LIGHTS
                .iter()
                .map(|name| read_lights(&folder.join(format!("{name}_lights.txt"))))
                .collect::<Result<_>>()?,
            measured: Measured::read(&folder.join("measured_bivariate.npz"))?,
            normals,
            mask,
        })
    }

    /// The pixels of the ball whose normal is less than 80 degrees from the view, row-major.
    pub(super) fn pixels(&self) -> Vec<usize> {
        let least = 80.0_f32.to_radians().cos();
        let seen = |i: &usize| self.mask.as_slice()[*i] >= 0.99 && self.normals.as_slice()[*i].z > least;
        (0..self.mask.as_slice().len()).filter(seen).collect()
    }

    /// The largest angle (degrees) between a light and the view.
    pub(super) fn reach(&self) -> f64 {
        let angles = self.lights.iter().flatten().map(|l| l.direction.angle_between(DVec3::Z).to_degrees());
        angles.fold(0.0, f64::max)
    }

    /// The picture of the ball with reflectance `f(theta_h, theta_d)` (radians) under one of the lights.
    pub(super) fn render(&self, light: usize, f: impl Fn(f64, f64) -> f64 + Sync) -> Plane<DVec3> {
        let (width, height) = self.normals.size();
        let lights = &self.lights[light];
        let pixel = |(n, m): (&Vec3, &f32)| match n.as_dvec3().try_normalize() {
            Some(normal) if *m >= 0.5 => reflected(&f, normal, lights),
            _ => DVec3::ZERO,
        };
        let pixels = self.normals.as_slice().par_iter().zip(self.mask.as_slice()).map(pixel).collect();
        Plane::from_vec(width, height, pixels)
    }
}

/// What a surface seen from +z sends to the camera: the sum over the lights of `F(theta_h, theta_d) max(n . w, 0) weight`.
pub(super) fn reflected(f: &impl Fn(f64, f64) -> f64, normal: DVec3, lights: &[Directional]) -> DVec3 {
    let one = |light: &Directional| {
        let cosine = normal.dot(light.direction);
        if cosine <= 0.0 {
            return DVec3::ZERO;
        }
        let angles = half_difference(normal, light.direction, DVec3::Z);
        light.weight * (cosine * f(angles.theta_h, angles.theta_d))
    };
    lights.iter().map(one).sum()
}

/// Lines of direction and RGB weight.
fn read_lights(path: &Path) -> Result<Vec<Directional>> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let lines = text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#'));
    let lights =
        lines.map(|(i, line)| parse_light(line).with_context(|| format!("{}, line {}", path.display(), i + 1)));
    let lights = lights.collect::<Result<Vec<_>>>()?;
    if lights.is_empty() {
        bail!("{}: no lights", path.display());
    }
    Ok(lights)
}

fn parse_light(line: &str) -> Result<Directional> {
    let numbers = line.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>();
    let numbers = numbers.context("not numbers")?;
    let [x, y, z, r, g, b] = numbers[..] else {
        bail!("{} numbers instead of direction and RGB weight", numbers.len())
    };
    let direction = DVec3::new(x, y, z).try_normalize().context("a direction of no length")?;
    let weight = DVec3::new(r, g, b);
    if !(weight.is_finite() && weight.min_element() >= 0.0) {
        bail!("a weight is negative or not finite");
    }
    Ok(Directional { direction, weight })
}

/// Cells along each axis of the measurement, one degree each.
const DEGREES: usize = 90;

/// A BRDF measured over `(theta_h, theta_d)` in cells of one degree; unlike MERL's, both axes are even.
pub(super) struct Measured {
    /// Relative reflectance, `theta_d` fastest.
    mean: Vec<f32>,
    /// Observations in each cell; none, no value.
    count: Vec<f32>,
    /// `mean` with the cells that have no value filled in from their neighbours.
    filled: Vec<f64>,
}

/// A measured cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell {
    /// Centre, radians.
    pub(super) theta_h: f64,
    pub(super) theta_d: f64,
    pub(super) value: f64,
}

impl Measured {
    /// Reads the arrays `mean` and `count` of an `.npz`.
    fn read(path: &Path) -> Result<Self> {
        let file = File::open(path).with_context(|| path.display().to_string())?;
        let mut archive = zip::ZipArchive::new(file).with_context(|| path.display().to_string())?;
        let mut array = |name: &str| -> Result<Vec<f32>> {
            let context = || format!("{}, {name}.npy", path.display());
            let mut bytes = Vec::new();
            // The arrays have 64 kB; a file that claims more is none of these.
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

    /// Fills in along `theta_h` within each column that has values, then between such columns: linearly between values,
    /// constant beyond them.
    fn new(mean: Vec<f32>, count: Vec<f32>) -> Self {
        let mut measured = Self { mean, count, filled: vec![0.0; DEGREES * DEGREES] };
        let rows = |d: usize| (0..DEGREES).filter(|&h| measured.value(h, d).is_some()).collect::<Vec<usize>>();
        let columns: Vec<(usize, Vec<usize>)> =
            (0..DEGREES).map(|d| (d, rows(d))).filter(|c| !c.1.is_empty()).collect();
        let at = |h: usize, d: usize| {
            let column = |rows: &Vec<usize>, d: usize| between(rows, h as f64, |h| measured.value(h, d).unwrap_or(0.0));
            let places: Vec<usize> = columns.iter().map(|c| c.0).collect();
            between(&places, d as f64, |d| columns.iter().find(|c| c.0 == d).map_or(0.0, |c| column(&c.1, d)))
        };
        measured.filled = (0..DEGREES * DEGREES).map(|c| at(c / DEGREES, c % DEGREES)).collect();
        measured
    }

    fn value(&self, h: usize, d: usize) -> Option<f64> {
        let at = h * DEGREES + d;
        (self.count[at] > 0.0 && self.mean[at].is_finite()).then(|| f64::from(self.mean[at]))
    }

    /// The cells that were measured.
    pub(super) fn cells(&self) -> impl Iterator<Item = Cell> + '_ {
        let centre = |i: usize| (i as f64 + 0.5).to_radians();
        (0..DEGREES * DEGREES).filter_map(move |c| {
            let (h, d) = (c / DEGREES, c % DEGREES);
            self.value(h, d).map(|value| Cell { theta_h: centre(h), theta_d: centre(d), value })
        })
    }

    /// Value anywhere, by bilinear interpolation of what was measured and filled in.
    pub(super) fn eval(&self, theta_h: f64, theta_d: f64) -> f64 {
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

/// Linear interpolation between the values at ascending places, constant beyond them; zero without any.
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

    #[test]
    fn two_lights_on_a_lambertian_surface_add_up() {
        let light = |x: f64, z: f64, weight| Directional { direction: DVec3::new(x, 0.0, z).normalize(), weight };
        let lights = [
            light(0.0, 1.0, DVec3::new(1.0, 2.0, 3.0)),
            light(1.0, 1.0, DVec3::splat(4.0)),
            light(0.0, -1.0, DVec3::splat(1e9)),
        ];
        let got = reflected(&|_, _| 0.5, DVec3::Z, &lights);
        let want = 0.5 * (DVec3::new(1.0, 2.0, 3.0) + DVec3::splat(4.0 * 0.5_f64.sqrt()));
        assert!((got - want).length() < 1e-12, "{got}");
        // Half and difference angles of light at 45 degrees on a surface that faces the camera are both half of that.
        let angles = reflected(&|h, d| 10.0 * h + d, DVec3::Z, &lights[1..2]);
        let eighth = 22.5_f64.to_radians();
        assert!((angles.x - 4.0 * 0.5_f64.sqrt() * 11.0 * eighth).abs() < 1e-12);
    }

    #[test]
    fn lines_of_lights() {
        let light = parse_light(" 0 0 2  1 2 3 ").unwrap();
        assert_eq!(light, Directional { direction: DVec3::Z, weight: DVec3::new(1.0, 2.0, 3.0) });
        for bad in ["", "0 0 1 1 1", "0 0 0 1 1 1", "0 0 1 1 1 x", "0 0 1 1 -1 1", "0 0 1 1 nan 1"] {
            assert!(parse_light(bad).is_err(), "{bad}");
        }
    }

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
        let path = dir.path().join("measured.npz");
        // F = 1 + h + 100 d in columns 2 and 6, from row 1 to row 50.
        let cell = |c: usize| match (c / DEGREES, c % DEGREES) {
            (h @ 1..=50, d @ (2 | 6)) => 1.0 + h as f64 + 100.0 * d as f64,
            _ => 0.0,
        };
        let mean: Vec<f64> = (0..DEGREES * DEGREES).map(cell).collect();
        npz(&path, &mean, "(90, 90)");
        let measured = Measured::read(&path).unwrap();
        assert_eq!(measured.cells().count(), 100);
        let at = |h: f64, d: f64| measured.eval((h + 0.5).to_radians(), (d + 0.5).to_radians());
        for (h, d, want) in
            [(10.0, 2.0, 211.0), (10.5, 4.0, 411.5), (0.0, 2.0, 202.0), (70.0, 0.0, 251.0), (3.0, 89.0, 604.0)]
        {
            assert!((at(h, d) - want).abs() < 1e-3, "{h} {d}: {}", at(h, d));
        }
        npz(&path, &mean, "(8100,)");
        assert!(Measured::read(&path).is_err());
        std::fs::write(&path, b"no zip").unwrap();
        assert!(format!("{:#}", Measured::read(&path).err().unwrap()).contains("measured.npz"));
    }
}
