//! A captured object: photographs under known lights, its normals, and its BRDF as measured from
//! single lights.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use glam::{DVec3, Vec3};
use gonio::lighting::EnvironmentMap;
use gonio::picture::{Picture, Plane};
use gonio::sphere::half_difference;
use rayon::prelude::*;

use super::slice::Slice;

/// Suffix of the file of a photograph's lights, after the photograph's name.
const LIGHTS: &str = "_lights.txt";

/// Light from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Directional {
    /// Unit vector towards the light.
    pub(crate) direction: DVec3,
    /// RGB irradiance on a surface that faces the light, up to a scale common to all lights.
    pub(crate) weight: DVec3,
}

/// A photograph and the lights it was taken in.
pub(crate) struct Photograph {
    pub(crate) name: String,
    pub(crate) picture: Picture,
    pub(crate) lights: Vec<Directional>,
}

/// An object and its photographs. All planes have the same size.
pub(crate) struct Captured {
    /// Name of the object's folder.
    pub(crate) name: String,
    /// Unit normals in camera space; zero at pixels without a normal.
    pub(crate) normals: Plane<Vec3>,
    /// Mask, one on the object.
    pub(crate) mask: Plane<f32>,
    /// Photographs in order of name; at least one.
    pub(crate) photographs: Vec<Photograph>,
    pub(crate) slice: Slice,
}

/// Lists the folders of captured objects in a folder of data, in order of name.
pub(crate) fn folders(data: &Path) -> Result<Vec<PathBuf>> {
    let folder = data.join("captured");
    let context = || format!("{}: cannot list the objects; specify the data folder with --data", folder.display());
    let mut found = Vec::new();
    for entry in std::fs::read_dir(&folder).with_context(context)? {
        let path = entry.with_context(context)?.path();
        if path.is_dir() {
            found.push(path);
        }
    }
    if found.is_empty() {
        bail!("{}: no folders of objects here", folder.display());
    }
    found.sort();
    Ok(found)
}

impl Captured {
    /// Reads a folder of `normal.exr`, `mask.png`, `measured_bivariate.npz`, and `NAME.exr` with
    /// `NAME_lights.txt` for each photograph.
    pub(crate) fn read(folder: &Path) -> Result<Self> {
        let normals = gonio_io::normals::read_normals(folder.join("normal.exr"))?;
        let mask = gonio_io::picture::read_mask(folder.join("mask.png"))?;
        let photograph = |name: String| -> Result<Photograph> {
            let path = folder.join(format!("{name}.exr"));
            let picture = gonio_io::picture::read(&path, &gonio_io::picture::ReadOptions::default())?.picture;
            if picture.rgb.size() != normals.size() || mask.size() != normals.size() {
                bail!("{}: photograph, mask.png and normal.exr differ in size", path.display());
            }
            let lights = read_lights(&folder.join(format!("{name}{LIGHTS}")))?;
            Ok(Photograph { name, picture, lights })
        };
        Ok(Self {
            name: folder.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            photographs: names(folder)?.into_iter().map(photograph).collect::<Result<_>>()?,
            slice: Slice::read(&folder.join("measured_bivariate.npz"))?,
            normals,
            mask,
        })
    }

    /// Pixels of the object whose normal is less than `within` degrees from the view, row-major.
    pub(crate) fn pixels(&self, within: f32) -> Vec<usize> {
        let least = within.to_radians().cos();
        let is_visible = |i: &usize| self.mask.as_slice()[*i] >= 0.99 && self.normals.as_slice()[*i].z > least;
        (0..self.mask.as_slice().len()).filter(is_visible).collect()
    }

    /// Renders the object with reflectance `f(theta_h, theta_d)` (radians) under the lights of one
    /// of its photographs.
    pub(crate) fn render(&self, photograph: usize, f: impl Fn(f64, f64) -> f64 + Sync) -> Plane<DVec3> {
        let (width, height) = self.normals.size();
        let lights = &self.photographs[photograph].lights;
        let pixel = |(n, m): (&Vec3, &f32)| match n.as_dvec3().try_normalize() {
            Some(normal) if *m >= 0.5 => reflected(&f, normal, lights),
            _ => DVec3::ZERO,
        };
        let pixels = self.normals.as_slice().par_iter().zip(self.mask.as_slice()).map(pixel).collect();
        Plane::from_vec(width, height, pixels)
    }

    /// Crops a picture to the object, with the mask as alpha.
    pub(crate) fn cropped(&self, rgb: &Plane<Vec3>) -> Picture {
        let (width, height) = rgb.size();
        let on: Vec<(usize, usize)> =
            (0..width * height).filter(|&i| self.mask.as_slice()[i] > 0.5).map(|i| (i % width, i / width)).collect();
        let range = |values: &dyn Fn(&(usize, usize)) -> usize, limit: usize| {
            let low = on.iter().map(values).min().unwrap_or(0).saturating_sub(3);
            let high = (on.iter().map(values).max().unwrap_or(0) + 4).min(limit);
            (low, high)
        };
        let ((x0, x1), (y0, y1)) = (range(&|p| p.0, width), range(&|p| p.1, height));
        let size = (x1 - x0, y1 - y0);
        let alpha = Plane::from_fn(size.0, size.1, |x, y| self.mask[(x0 + x, y0 + y)].clamp(0.0, 1.0));
        let rgb = Plane::from_fn(size.0, size.1, |x, y| rgb[(x0 + x, y0 + y)].max(Vec3::ZERO) * alpha[(x, y)]);
        Picture { rgb, alpha: Some(alpha) }
    }
}

/// Names of the photographs in a folder, those with a file of lights.
fn names(folder: &Path) -> Result<Vec<String>> {
    let context = || folder.display().to_string();
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(context)? {
        let file = entry.with_context(context)?.file_name();
        names.extend(file.to_str().and_then(|name| name.strip_suffix(LIGHTS)).map(str::to_owned));
    }
    if names.is_empty() {
        bail!("{}: no photographs here: each needs a file NAME{LIGHTS}", folder.display());
    }
    names.sort();
    Ok(names)
}

/// Radiance that a surface reflects to the camera at +z: the sum over the lights of
/// `F(theta_h, theta_d) max(n . w, 0) weight`.
pub(crate) fn reflected(f: &impl Fn(f64, f64) -> f64, normal: DVec3, lights: &[Directional]) -> DVec3 {
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

/// Map of directional lights.
pub(crate) fn map_of(lights: &[Directional]) -> Result<EnvironmentMap> {
    let lights: Vec<_> = lights.iter().map(|light| (light.direction, light.weight.as_vec3())).collect();
    Ok(EnvironmentMap::of_directions(&lights, 1024)?)
}

/// Reads lines of direction and RGB weight.
fn read_lights(path: &Path) -> Result<Vec<Directional>> {
    let lights = gonio_io::lights::read_lights(path)?;
    Ok(lights.into_iter().map(|(direction, weight)| Directional { direction, weight: weight.as_dvec3() }).collect())
}

#[cfg(test)]
mod tests {
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
        // For light at 45 degrees on a surface that faces the camera, half and difference angle are
        // both 22.5 degrees.
        let angles = reflected(&|h, d| 10.0 * h + d, DVec3::Z, &lights[1..2]);
        let eighth = 22.5_f64.to_radians();
        assert!((angles.x - 4.0 * 0.5_f64.sqrt() * 11.0 * eighth).abs() < 1e-12);
    }

    #[test]
    fn errors_name_the_file() {
        let data = tempfile::tempdir().unwrap();
        let said = |result: Result<Vec<String>>| format!("{:#}", result.err().unwrap());
        assert!(format!("{:#}", folders(data.path()).err().unwrap()).contains("captured"));
        let folder = data.path().join("captured/vase");
        std::fs::create_dir_all(&folder).unwrap();
        assert_eq!(folders(data.path()).unwrap(), [folder.as_path()]);
        assert!(said(names(&folder)).contains("vase: no photographs"));
        let file = folder.join("dusk_lights.txt");
        std::fs::write(&file, "# lamps\n0 0 1 1 1 1\n0 0 1 1 1\n").unwrap();
        assert_eq!(names(&folder).unwrap(), ["dusk"]);
        let error = format!("{:#}", read_lights(&file).unwrap_err());
        assert!(error.contains("dusk_lights.txt: line 3"), "{error}");
        assert!(format!("{:#}", Captured::read(&folder).err().unwrap()).contains("normal.exr"));
    }
}
