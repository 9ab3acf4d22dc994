//! Exports a BRDF as files and parameters for renderers, with the error of each
//! (`docs/exports.md`).

use std::collections::BTreeMap;
use std::path::Path;

use glam::Vec3;
use gonio::lighting::{EnvironmentMap, studio_light};
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio::render::{Exposure, LightTree, SphereSettings, render_sphere};
use gonio::shading::{
    BlenderPrincipled, ColourCookTorrance, ColourWard, Fitted, Fitter, Layered, MetallicRoughness, Principled, Shading,
};
use gonio_io::atomic::StagedFolder;
use gonio_io::colour_space::ColourSpace;
use gonio_io::material::{
    Place, blender_scene, fit_note, glb_sphere, materialx, mitsuba_measured, mitsuba_principled, mitsuba_scene,
    poor_fit,
};
use gonio_io::picture::encode_exr_in;
use gonio_io::result::{self, ExportDocument, ExportEntry};
use gonio_io::{Error, merl, rgl};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;

use crate::results::{LIGHT, LIGHT_ROWS, document_in};
use crate::spaces::{from_rec709, merl_from_rec709, merl_to_rec709};
use crate::{AppError, read_light};

/// Summary of the exports, in the same folder.
pub const SUMMARY: &str = "export.json";

/// Mitsuba scene, in the same folder as [`LIGHT`].
const SCENE: &str = "scene.xml";

/// Files of Mitsuba's `measured` materials and their tensors, for RGB and for spectral variants.
const MEASURED: [(&str, &str); 2] =
    [("brdf_measured.xml", "brdf_rgb.bsdf"), ("brdf_measured_spectral.xml", "brdf_spec.bsdf")];

/// File of Mitsuba's `principled` material.
const PRINCIPLED: &str = "principled.xml";

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
    /// the albedo at which [`Layered`] fits best, if a target is the model of a renderer.
    pub absolute: bool,
    /// 90 % interval of the roughness of the highlight, if the BRDF is from a photograph
    /// ([`roughness_of_results`]).
    pub roughness: Option<[f64; 2]>,
    /// Also write the table of each fitted model, to compare it with the BRDF.
    pub with_tables: bool,
    /// Draws from the posterior of the BRDF, from which the intervals of fitted parameters are
    /// computed; without draws, there are no intervals.
    pub draws: Vec<[BivariateTable; 3]>,
}

/// Default number of [`Export::draws`].
pub const DRAWS: usize = 16;

/// Quantiles of the fits to draws that are the ends of an interval.
const INTERVAL: [f64; 2] = [0.05, 0.95];

impl Export {
    /// Writes the targets and `export.json` into a folder, which the caller commits, and returns
    /// the contents of `export.json`. `input` is the source of the BRDF; `progress` receives a
    /// fraction in 0..=1. Returns `None` if the BRDF is zero at normal incidence.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(
        self,
        folder: &StagedFolder,
        targets: &[Target],
        input: &str,
        progress: &dyn Fn(f64),
    ) -> Result<Option<ExportDocument>, Error> {
        let Self { name, mut tables, full_table: whole, light, space, albedo, absolute, roughness, with_tables, draws } =
            self;
        let measured = BivariateTable::luminance(&tables).normal_albedo();
        if !(measured > 0.0 && measured.is_finite()) {
            return Ok(None);
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
        Ok(Some(summary))
    }
}

/// Whether the scale of the BRDF in a folder of results is known.
///
/// # Errors
/// If `result.json` is damaged.
pub fn is_absolute(dir: &Path) -> Result<bool, Error> {
    Ok(document_in(dir)?.is_some_and(|document| document.reflectance.absolute))
}

/// Returns the 90 % interval of the roughness of the highlight in a folder of results, for
/// [`Export::roughness`]; `None` if the method computes no intervals.
///
/// # Errors
/// If `result.json` is damaged.
pub fn roughness_of_results(dir: &Path) -> Result<Option<[f64; 2]>, Error> {
    let roughness = document_in(dir)?.and_then(|document| document.posterior?.highlight.roughness);
    Ok(roughness.map(|roughness| [roughness.low, roughness.high]).filter(|ends| ends.iter().all(|end| end.is_finite())))
}

/// Reads the light of a folder of results in colour, for [`Export::light`]; `None` if the folder
/// has no light.
///
/// # Errors
/// If the file cannot be read.
pub fn light_of_results(dir: &Path) -> Result<Option<EnvironmentMap>, AppError> {
    let file = dir.join(LIGHT);
    if !file.is_file() {
        return Ok(None);
    }
    let light = read_light(&file, None)?;
    let colour = document_in(dir)?.and_then(|document| Some(document.colour.light?.rgb.map(|x| x as f32)));
    Ok(Some(colour.map_or_else(|| light.clone(), |colour| coloured(&light, Vec3::from(colour)))))
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

/// Encodes indented JSON.
fn pretty(value: &impl serde::Serialize) -> String {
    serde_json::to_string_pretty(value).expect("names and numbers are JSON")
}

/// Names of weight and roughness of the coat in the models that have both.
const COATS: [(&str, &str); 2] = [("coat_weight", "coat_roughness"), ("clearcoat", "clearcoat_roughness")];

/// Returns the 90 % interval of each number in equally structured documents; null without
/// documents.
fn intervals(drawn: &[Value]) -> Value {
    match drawn.iter().find(|value| !value.is_null()) {
        Some(Value::Object(first)) => {
            let of = |name: &String| drawn.iter().map(|document| document[name].clone()).collect::<Vec<_>>();
            Value::Object(first.keys().map(|name| (name.clone(), intervals(&of(name)))).collect())
        }
        Some(Value::Array(first)) => {
            let of = |at: usize| drawn.iter().map(|document| document[at].clone()).collect::<Vec<_>>();
            Value::Array((0..first.len()).map(|at| intervals(&of(at))).collect())
        }
        Some(Value::Number(_)) => {
            let mut numbers: Vec<f64> = drawn.iter().filter_map(Value::as_f64).collect();
            numbers.sort_by(f64::total_cmp);
            serde_json::json!(INTERVAL.map(|share| quantile(&numbers, share)))
        }
        _ => Value::Null,
    }
}

/// Returns a quantile of sorted numbers, linear between them.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = share * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + at.fract() * (high - low)
}

/// Returns the comment of a fit: its error, and the interval of the roughness.
fn note_of<S>((fitted, intervals): &(Fitted<S>, Value)) -> String {
    let roughness = &intervals["roughness"];
    let note = fit_note(fitted.relight);
    match (roughness[0].as_f64(), roughness[1].as_f64()) {
        (Some(low), Some(high)) => format!("{note}; 90 % interval of the roughness: {low:.2} to {high:.2}"),
        _ => note,
    }
}

/// Writer of the targets.
struct Writer<'a> {
    folder: &'a StagedFolder,
    name: String,
    fitter: Fitter,
    /// Fitters of the draws from the posterior.
    draws: Vec<Fitter>,
    tables: [BivariateTable; 3],
    /// BRDF with its dependence on the third angle, if it is exported unscaled.
    whole: Option<MerlTable>,
    /// Light of the exported scenes.
    light: EnvironmentMap,
    with_tables: bool,
    /// Colour space of the tables to write.
    space: ColourSpace,
    entries: BTreeMap<String, ExportEntry>,
    warnings: Vec<String>,
}

impl Writer<'_> {
    fn write(&mut self, target: Target) -> Result<(), Error> {
        match target {
            Target::Merl => {
                let table = match &self.whole {
                    Some(table) => merl::encode(&merl_from_rec709(table, self.space).0),
                    None => {
                        let tables = from_rec709(&self.tables, self.space).0;
                        merl::encode(&MerlTable::from_bivariate(tables.each_ref()))
                    }
                };
                self.table(
                    target,
                    "brdf.binary",
                    &table,
                    self.tables.clone(),
                    "MERL: 1/sr times 1500, 1500/1.15, 1500/1.66",
                )
            }
            Target::MerlGrey => {
                let grey = grey(&self.tables);
                let bytes = merl::encode(&MerlTable::from_bivariate(grey.each_ref()));
                self.table(target, "brdf_grey.binary", &bytes, grey, "MERL: the luminance in all channels")
            }
            Target::Bsdf => {
                let space = self.space;
                let rgb = rgl::encode(&from_rec709(&self.tables, space).0, &self.name, rgl::Channels::Rgb);
                let spectral = rgl::encode(&self.tables, &self.name, rgl::Channels::Spectral);
                let back = rgl::decode("brdf_rgb.bsdf".as_ref(), &rgb)?.to_merl();
                let back = merl_to_rec709(&back, space);
                self.folder.write("brdf_spec.bsdf", &spectral)?;
                for ((file, tensor), colours) in MEASURED.into_iter().zip([space.name(), "spectral"]) {
                    self.folder.write(file, mitsuba_measured(&self.name, tensor, colours).as_bytes())?;
                }
                let note = "RGL tensors for the plugin `measured`: brdf_rgb.bsdf for Mitsuba 3, brdf_spec.bsdf (smooth spectra with these colours under D65) for \
                            its spectral variants and pbrt-v4";
                self.table(target, "brdf_rgb.bsdf", &rgb, [0, 1, 2].map(|c| back.bivariate(c)), note)?;
                self.add_files(target, &["brdf_spec.bsdf", MEASURED[0].0, MEASURED[1].0]);
                Ok(())
            }
            Target::Mitsuba => {
                let fitted = self.fit::<Principled>();
                let text = mitsuba_principled(&self.name, &fitted.0.model, Place::File, &note_of(&fitted));
                self.model(target, PRINCIPLED, text.as_bytes(), fitted, "alpha = roughness^2")
            }
            Target::Blender => {
                let fitted = self.fit::<BlenderPrincipled>();
                let text = blender_scene(&self.name, &fitted.0.model, LIGHT, self.stops(), &note_of(&fitted));
                let note = "Blender 4.0 or later; alpha = Roughness^2; specular_color is the Specular Tint";
                self.model(target, "blender.py", text.as_bytes(), fitted, note)
            }
            Target::Gltf => {
                let fitted = self.fit::<MetallicRoughness>();
                let bytes = glb_sphere(&self.name, &fitted.0.model, &note_of(&fitted));
                self.model(
                    target,
                    "sphere.glb",
                    &bytes,
                    fitted,
                    "alpha = roughnessFactor^2; index, tint and coat in the extensions KHR_materials_ior, _specular and _clearcoat",
                )
            }
            Target::Mtlx => {
                let fitted = self.fit::<Layered>();
                let text = materialx(&self.name, &fitted.0.model, &note_of(&fitted));
                self.model(target, "openpbr.mtlx", text.as_bytes(), fitted, "OpenPBR; alpha = specular_roughness^2")
            }
            Target::CookTorrance => {
                let fitted = self.fit::<ColourCookTorrance>();
                let note = "f = diffuse/pi + specular D F G / (pi cos_i cos_o); Beckmann of slope m = roughness, not squared; Schlick's F; V-grooves";
                let text = pretty(&fitted.0.model);
                self.model(target, "cook_torrance.json", text.as_bytes(), fitted, note)
            }
            Target::Ward => {
                let fitted = self.fit::<ColourWard>();
                let note = "f = diffuse/pi + specular exp(-tan^2/alpha^2) / (4 pi alpha^2 sqrt(cos_i cos_o)); alpha = roughness, not squared";
                let text = pretty(&fitted.0.model);
                self.model(target, "ward.json", text.as_bytes(), fitted, note)
            }
        }
    }

    /// Writes the light of the scenes, and the Mitsuba scene with the more accurate material.
    fn scene(&mut self, targets: &[Target]) -> Result<(), Error> {
        let scenes = [(Target::Bsdf, MEASURED[0].0), (Target::Mitsuba, PRINCIPLED)];
        // The light of the scene is in Rec. 709, so a tensor in another space does not match it.
        let fits = |target: &Target| *target != Target::Bsdf || self.space == ColourSpace::Rec709;
        let scenes: Vec<_> =
            scenes.into_iter().filter(|(target, _)| targets.contains(target) && fits(target)).collect();
        if let Some((_, material)) = scenes.first() {
            self.folder.write(SCENE, mitsuba_scene(material, LIGHT).as_bytes())?;
        }
        for (target, _) in &scenes {
            self.add_files(*target, &[SCENE, LIGHT]);
        }
        let blender = targets.contains(&Target::Blender);
        if blender {
            self.add_files(Target::Blender, &[LIGHT]);
        }
        if blender || !scenes.is_empty() {
            self.folder.write(LIGHT, &encode_exr_in(self.light.radiance(), None, ColourSpace::Rec709))?;
        }
        Ok(())
    }

    /// Returns the exposure in stops at which almost no pixel under the light is clipped.
    fn stops(&self) -> f64 {
        let settings = SphereSettings { size: 32, ..SphereSettings::default() };
        let sphere = render_sphere(&self.tables, &LightTree::of_map(&self.light), &settings, &|_| ());
        let covered = |i: usize| sphere.alpha.as_ref().is_some_and(|alpha| alpha.as_slice()[i] > 0.99);
        f64::from(Exposure::by_quantile(&sphere.rgb, covered, 0.97, 0.9).0.log2())
    }

    /// Fits a model; also returns the intervals of its parameters, in the structure of the
    /// parameters, or null without draws.
    fn fit<S: Shading + Serialize>(&self) -> (Fitted<S>, Value) {
        let fitted = self.fitter.fit::<S>();
        let refit = |draw: &Fitter| {
            let mut parameters = serde_json::json!(draw.refit(&fitted));
            // A coat without weight has no roughness.
            for (weight, roughness) in COATS {
                if parameters[weight] == 0.0 {
                    parameters[roughness] = Value::Null;
                }
            }
            parameters
        };
        let drawn: Vec<Value> = self.draws.par_iter().map(refit).collect();
        let intervals = intervals(&drawn);
        (fitted, intervals)
    }

    /// Writes a table whose contents decode to `tables`.
    fn table(
        &mut self,
        target: Target,
        file: &str,
        bytes: &[u8],
        tables: [BivariateTable; 3],
        note: &str,
    ) -> Result<(), Error> {
        self.folder.write(file, bytes)?;
        let (relight, log_relight) = self.fitter.compare(&tables);
        let files = vec![file.to_owned()];
        self.add(
            target,
            ExportEntry { files, relight, log_relight, conventions: note.to_owned(), ..ExportEntry::default() },
        );
        Ok(())
    }

    /// Writes the parameters of a fitted model.
    fn model<S: Shading + Serialize>(
        &mut self,
        target: Target,
        file: &str,
        bytes: &[u8],
        (fitted, intervals): (Fitted<S>, Value),
        note: &str,
    ) -> Result<(), Error> {
        self.folder.write(file, bytes)?;
        self.warnings.extend(poor_fit(fitted.relight).map(|problem| format!("{file}: {problem}")));
        let entry = ExportEntry {
            files: vec![file.to_owned()],
            parameters: serde_json::json!(fitted.model),
            intervals,
            relight: fitted.relight,
            log_relight: fitted.log_relight,
            conventions: note.to_owned(),
            colorspace: String::new(),
        };
        self.add(target, entry);
        if self.with_tables {
            let table = format!("{}.binary", file.split('.').next().unwrap_or(file));
            let tables = fitted.model.to_bivariate(2);
            self.folder.write(&table, &merl::encode(&MerlTable::from_bivariate(tables.each_ref())))?;
            self.add_files(target, &[&table]);
        }
        Ok(())
    }

    fn add(&mut self, target: Target, entry: ExportEntry) {
        let space = if matches!(target, Target::Merl | Target::Bsdf) { self.space } else { ColourSpace::Rec709 };
        self.entries.insert(target.names().0.to_owned(), ExportEntry { colorspace: space.name().to_owned(), ..entry });
    }

    fn add_files(&mut self, target: Target, more: &[&str]) {
        if let Some(entry) = self.entries.get_mut(target.names().0) {
            entry.files.extend(more.iter().map(|&file| file.to_owned()));
        }
    }
}

/// Returns the luminance in all channels.
pub fn grey(tables: &[BivariateTable; 3]) -> [BivariateTable; 3] {
    let luminance = BivariateTable::luminance(tables);
    [luminance.clone(), luminance.clone(), luminance]
}
