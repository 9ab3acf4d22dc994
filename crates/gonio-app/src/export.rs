//! Exports a BRDF as files and parameters for renderers, with the error of each
//! (`docs/exports.md`).

mod writer;

use std::collections::BTreeMap;
use std::path::Path;

use glam::Vec3;
use gonio::lighting::{EnvironmentMap, studio_light};
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio::shading::Fitter;
use gonio_io::atomic::StagedFolder;
use gonio_io::colour_space::ColourSpace;
use gonio_io::result::{self, ExportDocument};
use rayon::prelude::*;

use self::writer::Writer;
use crate::results::{LIGHT, LIGHT_ROWS, document_in};
use crate::{AppError, read_light};

/// Summary of the exports, in the same folder.
pub const SUMMARY: &str = "export.json";

/// Export format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// MERL table, three channels.
    Merl,
    /// MERL table of the luminance.
    MerlGrey,
    /// RGL tensors: `_rgb.bsdf` for Mitsuba 3, `_spec.bsdf` for its spectral variants and pbrt-v4.
    Bsdf,
    /// Mitsuba 3 `principled`.
    Mitsuba,
    /// Blender 4 Principled BSDF, as a script.
    Blender,
    /// glTF 2.0 metallic-roughness, as a sphere.
    Gltf,
    /// MaterialX document with an OpenPBR surface.
    Mtlx,
    /// Cook-Torrance parameters (Beckmann, Schlick, V-grooves).
    CookTorrance,
    /// Ward parameters.
    Ward,
}

impl Target {
    /// All targets.
    pub const ALL: [Self; 9] = [
        Self::Merl,
        Self::MerlGrey,
        Self::Bsdf,
        Self::Mitsuba,
        Self::Blender,
        Self::Gltf,
        Self::Mtlx,
        Self::CookTorrance,
        Self::Ward,
    ];

    /// The targets of an export that names none: all but the MERL tables, whose files have 35 MB.
    pub const DEFAULT: [Self; 7] =
        [Self::Bsdf, Self::Mitsuba, Self::Blender, Self::Gltf, Self::Mtlx, Self::CookTorrance, Self::Ward];

    /// Returns the name and the description of the target.
    pub fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::Merl => ("merl", "MERL table, three channels"),
            Self::MerlGrey => ("merl-grey", "MERL table of the luminance"),
            Self::Bsdf => {
                ("bsdf", "RGL tensors: _rgb.bsdf for Mitsuba 3, _spec.bsdf for spectral Mitsuba 3 and pbrt-v4")
            }
            Self::Mitsuba => ("mitsuba", "Mitsuba 3 principled BSDF"),
            Self::Blender => ("blender", "Script that creates a Principled BSDF in Blender 4"),
            Self::Gltf => ("gltf", "glTF 2.0 sphere with a metallic-roughness material (.glb)"),
            Self::Mtlx => ("mtlx", "MaterialX document with an OpenPBR surface (.mtlx)"),
            Self::CookTorrance => ("cook-torrance", "Cook-Torrance parameters (Beckmann, Schlick, V-grooves)"),
            Self::Ward => ("ward", "Ward parameters"),
        }
    }

    /// Whether the model has a limited range of albedo and reflectance.
    fn limits_scale(self) -> bool {
        matches!(self, Self::Mitsuba | Self::Blender | Self::Gltf | Self::Mtlx)
    }

    /// Whether the target is a model that is fitted to the BRDF.
    pub fn is_fitted(self) -> bool {
        !matches!(self, Self::Merl | Self::MerlGrey | Self::Bsdf)
    }

    /// Returns the target with a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|target| target.names().0 == name)
    }
}

/// BRDF to export, with settings.
#[derive(Clone, Debug)]
pub struct Export {
    /// Name of the material.
    pub name: String,
    /// The BRDF, by channel.
    pub tables: [BivariateTable; 3],
    /// BRDF over all three angles, for MERL tables.
    pub full_table: Option<MerlTable>,
    /// Light of the exported scenes: that of the photograph, or a studio if `None`.
    pub light: Option<EnvironmentMap>,
    /// Colour space of the targets `merl` and `bsdf` (RGB). All other targets are in linear
    /// Rec. 709, which their renderers assume.
    pub space: ColourSpace,
    /// Luminance albedo at normal incidence to scale the BRDF to.
    pub albedo: Option<f64>,
    /// Whether the scale of the BRDF is known. Otherwise, without `albedo`, the BRDF is scaled to
    /// the albedo at which [`Layered`](gonio::shading::Layered) fits best, if a target is the model
    /// of a renderer.
    pub absolute: bool,
    /// 90 % interval of the roughness of the highlight, if the BRDF is from a photograph
    /// ([`ResultProperties`]).
    pub roughness: Option<[f64; 2]>,
    /// Also write the table of each fitted model, to compare it with the BRDF.
    pub with_tables: bool,
    /// Draws from the posterior of the BRDF, from which the intervals of fitted parameters are
    /// computed; without draws, there are no intervals.
    pub draws: Vec<[BivariateTable; 3]>,
}

/// Default number of [`Export::draws`].
pub const DRAWS: usize = 16;

impl Export {
    /// Writes the targets and `export.json` into a folder, which the caller commits, and returns
    /// the contents of `export.json`. `input` is the source of the BRDF; `progress` receives a
    /// fraction in 0..=1.
    ///
    /// # Errors
    /// If the BRDF is zero at normal incidence, or if a file cannot be written.
    pub fn write(
        self,
        folder: &StagedFolder,
        targets: &[Target],
        input: &str,
        progress: &dyn Fn(f64),
    ) -> Result<ExportDocument, AppError> {
        let Self { name, mut tables, full_table: whole, light, space, albedo, absolute, roughness, with_tables, draws } =
            self;
        let measured = BivariateTable::luminance(&tables).normal_albedo();
        if !(measured > 0.0 && measured.is_finite()) {
            return Err(AppError::of(
                input,
                "cannot be exported, because the BRDF is zero at normal incidence; use another BRDF",
            ));
        }
        let mut fitter = Fitter::new(&tables);
        if let Some(interval) = roughness {
            fitter = fitter.with_roughness(interval);
        }
        let (scale, source) = match albedo {
            Some(albedo) => (albedo / measured, "option"),
            None if absolute || !targets.iter().any(|target| target.limits_scale()) => (1.0, "input"),
            None => (fitter.plausible_scale(), "fit"),
        };
        if scale != 1.0 {
            tables = tables.map(|table| table.scaled(scale));
            fitter = fitter.scaled(scale);
        }
        let draws = if targets.iter().any(|target| target.is_fitted()) { draws } else { Vec::new() };
        let draws = draws.into_par_iter().map(|draw| fitter.of_draw(&draw.map(|table| table.scaled(scale)))).collect();
        let found = light.is_some();
        let mut writer = Writer {
            folder,
            name,
            // The photograph determines only the product of light and BRDF.
            light: light
                .map_or_else(|| studio_light(LIGHT_ROWS), |light| times(&light, Vec3::splat(1.0 / scale as f32))),
            fitter,
            draws,
            tables,
            whole: whole.filter(|_| scale == 1.0),
            with_tables,
            space,
            entries: BTreeMap::new(),
            warnings: Vec::new(),
        };
        for (i, target) in targets.iter().enumerate() {
            progress(i as f64 / targets.len() as f64);
            writer.write(*target)?;
        }
        writer.scene(targets)?;
        progress(1.0);
        let summary = ExportDocument {
            format: ExportDocument::FORMAT.to_owned(),
            version: ExportDocument::VERSION,
            gonio: env!("CARGO_PKG_VERSION").to_owned(),
            input: input.to_owned(),
            name: writer.name,
            albedo: measured * scale,
            albedo_source: source.to_owned(),
            light: if found { "of the results" } else { "studio" }.to_owned(),
            exports: writer.entries,
            warnings: writer.warnings,
        };
        folder.write(SUMMARY, result::encode(&summary).as_bytes())?;
        Ok(summary)
    }
}

/// Properties of a result: the values of the fields of [`Export`] with the same names.
#[derive(Clone, Debug)]
pub struct ResultProperties {
    /// The light in colour; `None` if the folder has no light.
    pub light: Option<EnvironmentMap>,
    /// Whether the scale of the BRDF is known.
    pub absolute: bool,
    /// 90 % interval of the roughness of the highlight; `None` if the method computes no intervals.
    pub roughness: Option<[f64; 2]>,
}

impl ResultProperties {
    /// Reads the properties from a folder of results.
    ///
    /// # Errors
    /// If the light cannot be read, or `result.json` is damaged.
    pub fn of(dir: &Path) -> Result<Self, AppError> {
        let file = dir.join(LIGHT);
        let light = file.is_file().then(|| read_light(&file, None)).transpose()?;
        let Some(document) = document_in(dir)? else { return Ok(Self { light, absolute: false, roughness: None }) };
        let colour = document.colour.light.map(|light| Vec3::from(light.rgb.map(|x| x as f32)));
        let roughness = document.posterior.and_then(|posterior| posterior.highlight.roughness);
        let ends = roughness.map(|roughness| [roughness.low, roughness.high]);
        Ok(Self {
            light: match (light, colour) {
                (Some(light), Some(colour)) => Some(coloured(&light, colour)),
                (light, _) => light,
            },
            absolute: document.reflectance.absolute,
            roughness: ends.filter(|ends| ends.iter().all(|end| end.is_finite())),
        })
    }
}

/// Colours an estimated light, whose map is grey. A map with colours is returned unchanged.
pub fn coloured(light: &EnvironmentMap, colour: Vec3) -> EnvironmentMap {
    let is_grey = light.radiance().as_slice().iter().all(|p| p.max_element() == p.min_element());
    if is_grey { times(light, colour) } else { light.clone() }
}

/// Multiplies a light by a colour; returns the light itself if the product overflows.
fn times(light: &EnvironmentMap, colour: Vec3) -> EnvironmentMap {
    EnvironmentMap::new(light.radiance().map(|p| *p * colour)).unwrap_or_else(|_| light.clone())
}

/// Returns the luminance in all channels.
pub fn grey(tables: &[BivariateTable; 3]) -> [BivariateTable; 3] {
    let luminance = BivariateTable::luminance(tables);
    [luminance.clone(), luminance.clone(), luminance]
}
