//! Writes the files of the targets.

use std::collections::BTreeMap;

use gonio::lighting::EnvironmentMap;
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
use gonio_io::result::{self, ExportEntry};
use gonio_io::{Error, merl, rgl};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;

use super::{Target, grey};
use crate::results::LIGHT;
use crate::spaces::{from_rec709, merl_from_rec709, merl_to_rec709};

/// Mitsuba scene, in the same folder as [`LIGHT`].
const SCENE: &str = "scene.xml";

/// Files of Mitsuba's `measured` materials and their tensors, for RGB and for spectral variants.
const MEASURED: [(&str, &str); 2] =
    [("brdf_measured.xml", "brdf_rgb.bsdf"), ("brdf_measured_spectral.xml", "brdf_spec.bsdf")];

/// File of Mitsuba's `principled` material.
const PRINCIPLED: &str = "principled.xml";

/// Quantiles of the fits to draws that are the ends of an interval.
const INTERVAL: [f64; 2] = [0.05, 0.95];

/// Writer of the targets.
pub(super) struct Writer<'a> {
    pub(super) folder: &'a StagedFolder,
    pub(super) name: String,
    pub(super) fitter: Fitter,
    /// Fitters of the draws from the posterior.
    pub(super) draws: Vec<Fitter>,
    pub(super) tables: [BivariateTable; 3],
    /// BRDF with its dependence on the third angle, if it is exported unscaled.
    pub(super) whole: Option<MerlTable>,
    /// Light of the exported scenes.
    pub(super) light: EnvironmentMap,
    pub(super) with_tables: bool,
    /// Colour space of the tables to write.
    pub(super) space: ColourSpace,
    pub(super) entries: BTreeMap<String, ExportEntry>,
    pub(super) warnings: Vec<String>,
}

impl Writer<'_> {
    pub(super) fn write(&mut self, target: Target) -> Result<(), Error> {
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
                self.table(target, "brdf_rgb.bsdf", &rgb, back.to_bivariate(), note)?;
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
                let text = result::encode(&fitted.0.model);
                self.model(target, "cook_torrance.json", text.as_bytes(), fitted, note)
            }
            Target::Ward => {
                let fitted = self.fit::<ColourWard>();
                let note = "f = diffuse/pi + specular exp(-tan^2/alpha^2) / (4 pi alpha^2 sqrt(cos_i cos_o)); alpha = roughness, not squared";
                let text = result::encode(&fitted.0.model);
                self.model(target, "ward.json", text.as_bytes(), fitted, note)
            }
        }
    }

    /// Writes the light of the scenes, and the Mitsuba scene with the more accurate material.
    pub(super) fn scene(&mut self, targets: &[Target]) -> Result<(), Error> {
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
