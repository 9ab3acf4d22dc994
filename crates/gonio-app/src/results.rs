//! Contents of the folder of results.

use std::path::{Path, PathBuf};

use glam::Vec3;
use gonio::estimate::QUANTILE_LEVELS;
use gonio::lighting::LightGrid;
use gonio::picture::{Plane, srgb_decode};
use gonio::reflectance::BivariateTable;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::{encode_exr_in, encode_png};
use gonio_io::posterior::SavedPosterior;
use gonio_io::result::{self, ResultDocument, ResultFile};
use gonio_io::result_brdf::{self, BrdfQuantiles, ResultBrdf};
use gonio_io::{Error, Kind};
use gonio_report::panels::used::with_legend;
use gonio_report::{summary, uncertainty};
use rayon::prelude::*;

use crate::InferenceResult;
use crate::folder::is_plain;
use crate::spaces::from_rec709;

/// The BRDF with its quantiles ([`gonio_io::result_brdf`]).
pub const BRDF: &str = "brdf.npz";
/// The light, as a lat-long map.
pub const LIGHT: &str = "light.exr";
/// Reflectance of each pixel relative to that of the estimated paint.
pub const ALBEDO: &str = "albedo.exr";
/// JSON file of all numbers.
pub const RESULT: &str = "result.json";
/// HTML report.
pub const REPORT: &str = "report.html";
/// Names of the pictures, `NAME.png`.
pub const PICTURES: [&str; 6] = ["relit", "used", "summary", "uncertainty", "combined", "normals"];
/// Picture of the regions and a sphere of each material, beside the folders of the regions.
pub const MATERIALS: &str = "materials.png";
/// Rows of [`LIGHT`].
pub const LIGHT_ROWS: usize = 128;

/// Lists the names of all files in a folder of results, without the folders of regions and exports.
pub(crate) fn names() -> impl Iterator<Item = String> {
    let plain = [BRDF, LIGHT, ALBEDO, RESULT, REPORT, MATERIALS, gonio_io::posterior::FILE];
    plain.into_iter().map(str::to_owned).chain(PICTURES.iter().map(|name| format!("{name}.png")))
}

/// Returns the file of the BRDF in a folder of results, if there is one.
pub fn brdf_in(dir: &Path) -> Option<PathBuf> {
    Some(dir.join(BRDF)).filter(|file| file.is_file())
}

/// Reads `result.json` in a folder of results for one material; `None` if the file is missing or
/// was not written by gonio.
///
/// # Errors
/// If the file cannot be read, or is a damaged result of gonio.
pub fn document_in(dir: &Path) -> Result<Option<ResultDocument>, Error> {
    let file = dir.join(RESULT);
    if !file.is_file() {
        return Ok(None);
    }
    match result::read(&file) {
        Ok(ResultFile::Material(document)) => Ok(Some(*document)),
        Ok(ResultFile::Regions(_)) => Ok(None),
        Err(error) if error.kind() == Kind::Invalid => Ok(None),
        Err(error) => Err(error),
    }
}

/// Returns the folders of the regions in a folder of results, with the names of the regions. Empty
/// if the folder holds no result of several regions.
///
/// # Errors
/// If `result.json` is damaged.
pub fn regions_in(dir: &Path) -> Result<Vec<(String, PathBuf)>, Error> {
    let file = dir.join(RESULT);
    match file.is_file().then(|| result::read(&file)).transpose()? {
        Some(ResultFile::Regions(document)) => {
            // Names from the file must not lead out of the folder.
            let inside = document.regions.into_iter().filter(|r| is_plain(&r.folder) && is_plain(&r.name));
            Ok(inside.map(|region| (region.name, dir.join(region.folder))).collect())
        }
        _ => Ok(Vec::new()),
    }
}

/// Contents of a folder of results. Parts that a method does not estimate are `None`.
pub struct Files {
    /// The BRDF in colour, 1/sr, in linear Rec. 709.
    pub tables: [BivariateTable; 3],
    /// Quantiles of the BRDF, in linear Rec. 709.
    pub quantiles: Option<BrdfQuantiles>,
    /// `posterior.json`, to combine with other photographs.
    pub posterior: Option<Vec<u8>>,
    /// The light, lat-long, in linear Rec. 709.
    pub light: Option<Plane<Vec3>>,
    /// Reflectance of each pixel relative to that of the estimated paint, in linear Rec. 709, if
    /// the object has two paints. Zero off the object and where it is unknown.
    pub albedo_map: Option<Plane<Vec3>>,
    /// Pictures by their names in [`PICTURES`], as PNG.
    pub pictures: Vec<(&'static str, Vec<u8>)>,
    /// `result.json`.
    pub document: String,
    /// `report.html`.
    pub page: Option<String>,
    /// Colour space of the BRDF and the light in the folder.
    pub space: ColourSpace,
}

/// Returns the levels of the quantiles of a material.
pub fn levels() -> Vec<f32> {
    QUANTILE_LEVELS.map(|share| share as f32).to_vec()
}

impl Files {
    /// Returns names and contents of the files.
    pub fn encode(self) -> Vec<(String, Vec<u8>)> {
        let Self { tables, quantiles, posterior, light, albedo_map, pictures, document, page, space } = self;
        let (tables, _) = from_rec709(&tables, space);
        let mut files = vec![(BRDF.to_owned(), result_brdf::encode(&ResultBrdf { tables, quantiles }))];
        files.extend(posterior.map(|posterior| (gonio_io::posterior::FILE.to_owned(), posterior)));
        files.extend(light.map(|light| (LIGHT.to_owned(), encode_exr_in(&light, None, space))));
        files.extend(albedo_map.map(|albedo| {
            let known = albedo.map(|value| if *value == Vec3::ZERO { 0.0 } else { 1.0 });
            (ALBEDO.to_owned(), encode_exr_in(&albedo, Some(&known), ColourSpace::Rec709))
        }));
        files.extend(pictures.into_iter().map(|(name, png)| (format!("{name}.png"), png)));
        files.extend(page.map(|page| (REPORT.to_owned(), page.into_bytes())));
        files.push((RESULT.to_owned(), document.into_bytes()));
        files
    }
}

/// Returns the display value of a normal: its components from -1..=1 become codes from 0 to 255,
/// and a missing normal is black, as in a normal map.
fn coded_normal(normal: &Vec3) -> Vec3 {
    if *normal == Vec3::ZERO { Vec3::ZERO } else { (0.5 * *normal + 0.5).map(srgb_decode) }
}

impl InferenceResult {
    /// Returns the available pictures of [`PICTURES`], as linear display values.
    pub fn pictures(&self) -> Vec<(&'static str, Plane<Vec3>)> {
        let subject = self.subject();
        let mut pictures = Vec::new();
        if let Some(panels) = &self.panels {
            pictures.extend(panels.spheres.first().map(|(_, sphere)| (PICTURES[0], sphere.clone())));
            if let (Some(used), Some(statuses)) = (&panels.used, &self.scene.detection.observations.statuses) {
                pictures.push((PICTURES[1], with_legend(used, statuses)));
            }
            pictures.push((PICTURES[2], summary::compose(&subject, panels, &self.caption)));
            pictures.extend(self.material.as_ref().map(|material| (PICTURES[3], uncertainty::draw(material))));
            let detection = &self.scene.detection;
            let estimated = detection.normals.as_ref().filter(|_| detection.estimated_normals);
            pictures.extend(estimated.map(|normals| (PICTURES[5], normals.map(coded_normal))));
        }
        pictures
    }

    /// Converts an estimated light to a lat-long map, on the scale of the BRDF in the files.
    /// Negative radiance, which the methods of the paper allow, becomes zero, so that the map is an
    /// environment map.
    pub fn lat_long(&self, light: &LightGrid) -> Plane<Vec3> {
        let factor = self.scale.recip() as f32;
        light.to_lat_long(LIGHT_ROWS).map(|radiance| (factor * *radiance).max(Vec3::ZERO))
    }

    /// Returns the reflectance of each pixel relative to that of the estimated paint, if the object
    /// has two paints. Zero off the object and where it is unknown.
    pub fn albedo_map(&self) -> Option<Plane<Vec3>> {
        let detection = &self.scene.detection;
        let relative = detection.observations.albedo_map.as_ref()?;
        let (width, height) = relative.size();
        Some(Plane::from_fn(width, height, |x, y| if detection.contains(x, y) { relative[(x, y)] } else { Vec3::ZERO }))
    }

    /// Returns the contents of the folder of results.
    pub fn files(&self) -> Files {
        let scaled = |quantiles: Vec<Vec<f32>>| {
            let scale = |values: Vec<f32>| values.into_iter().map(|v| v * self.scale as f32).collect();
            quantiles.into_iter().map(scale).collect()
        };
        let quantiles = self.material.as_ref().map(|material| BrdfQuantiles {
            levels: levels(),
            luminance: scaled(material.quantiles.clone()),
            channels: Some(self.colouring.quantiles(material).map(scaled)),
        });
        let estimated = self.light.as_ref().map(|light| self.lat_long(light));
        Files {
            tables: self.colouring.field().tables(&self.table.scaled(self.scale)),
            quantiles,
            posterior: self.saved.as_ref().map(SavedPosterior::encode),
            light: estimated.or_else(|| self.known_light.as_ref().map(|known| known.radiance().clone())),
            albedo_map: self.albedo_map(),
            pictures: self.pictures().par_iter().map(|(name, picture)| (*name, encode_png(picture))).collect(),
            document: result::encode(&self.document),
            page: self.page.clone(),
            space: self.space,
        }
    }
}
