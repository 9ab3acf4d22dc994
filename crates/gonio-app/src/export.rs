//! A BRDF in the files and parameters of renderers, with how near each comes (`docs/exports.md`).

use std::path::Path;

use glam::Vec3;
use gonio::lighting::{EnvironmentMap, studio_light};
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio::render::{Exposure, LightTree, SphereSettings, render_sphere};
use gonio::shading::{ColourCookTorrance, ColourWard, Fitted, Fitter, Layered, MetallicRoughness, Principled, Shading};
use serde_json::{Map, Value, json};

use gonio_io::atomic::StagedFolder;
use gonio_io::colour_space::ColourSpace;
use gonio_io::material::{
    Place, blender_scene, glb_sphere, materialx, mitsuba_measured, mitsuba_principled, mitsuba_scene,
};
use gonio_io::picture::encode_exr_in;
use gonio_io::{Error, merl, notes, rgl};

use crate::results::{LIGHT, LIGHT_ROWS, RESULT};
use crate::spaces::{from_rec709, merl_from_rec709, merl_to_rec709};
use crate::{Problem, read_light};

/// Account of what was written, in the same folder.
pub const SUMMARY: &str = "export.json";

/// Scene of Mitsuba, in the same folder, with [`LIGHT`] beside it.
const SCENE: &str = "scene.xml";

/// Files of `measured` materials of Mitsuba and the tensors that they read: of its RGB variants and
/// of its spectral ones.
const MEASURED: [(&str, &str); 2] =
    [("brdf_measured.xml", "brdf_rgb.bsdf"), ("brdf_measured_spectral.xml", "brdf_spec.bsdf")];

/// File of the `principled` material of Mitsuba.
const PRINCIPLED: &str = "principled.xml";

/// Format that can be written.
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
    /// All of them.
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

    /// Returns its name for users, and its description.
    pub fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::Merl => ("merl", "MERL table, three channels"),
            Self::MerlGrey => ("merl-grey", "MERL table of the luminance"),
            Self::Bsdf => {
                ("bsdf", "RGL tensors: _rgb.bsdf for Mitsuba 3, _spec.bsdf for its spectral variants and pbrt-v4")
            }
            Self::Mitsuba => ("mitsuba", "Mitsuba 3 `principled`"),
            Self::Blender => ("blender", "Blender 4 Principled BSDF, as a script"),
            Self::Gltf => ("gltf", "glTF 2.0 metallic-roughness, as a sphere (.glb)"),
            Self::Mtlx => ("mtlx", "MaterialX document with an OpenPBR surface (.mtlx)"),
            Self::CookTorrance => ("cook-torrance", "Cook-Torrance parameters (Beckmann, Schlick, V-grooves)"),
            Self::Ward => ("ward", "Ward parameters"),
        }
    }

    /// The target of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|target| target.names().0 == name)
    }
}

/// BRDF to be exported, with settings.
#[derive(Clone, Debug)]
pub struct Export {
    /// Name of the material.
    pub name: String,
    /// The BRDF, by channel.
    pub tables: [BivariateTable; 3],
    /// BRDF with its dependence on the third angle, which MERL tables keep.
    pub whole: Option<MerlTable>,
    /// Light of the scenes, in which the photograph was taken; a studio if there is none.
    pub light: Option<EnvironmentMap>,
    /// Space of the tables that are written: of `merl`, and of `bsdf` for RGB. Everything else is
    /// in the space that its renderers assume, linear Rec. 709.
    pub space: ColourSpace,
    /// Scale the BRDF to this albedo of its luminance along the normal.
    pub albedo: Option<f64>,
    /// Write the table of each fitted model too, to be rendered beside the BRDF.
    pub with_tables: bool,
}

impl Export {
    /// Writes the targets and `export.json` into a folder, which the caller commits; gives what
    /// `export.json` says. `input` says where the BRDF is from, `progress` is told a fraction in
    /// 0..=1. `None` if the BRDF reflects nothing along the normal.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(
        self,
        folder: &StagedFolder,
        targets: &[Target],
        input: &str,
        progress: &dyn Fn(f64),
    ) -> Result<Option<Value>, Error> {
        let Self { name, mut tables, whole, light, space, albedo, with_tables } = self;
        let measured = BivariateTable::luminance(&tables).normal_albedo();
        if !(measured > 0.0 && measured.is_finite()) {
            return Ok(None);
        }
        let scale = albedo.map_or(1.0, |albedo| albedo / measured);
        if scale != 1.0 {
            tables = tables.map(|table| table.scaled(scale));
        }
        let found = light.is_some();
        let mut writer = Writer {
            folder,
            name,
            // The photograph tells the product of light and BRDF.
            light: light
                .map_or_else(|| studio_light(LIGHT_ROWS), |light| times(&light, Vec3::splat(1.0 / scale as f32))),
            fitter: Fitter::new(&tables),
            layered: None,
            tables,
            whole: whole.filter(|_| scale == 1.0),
            with_tables,
            space,
            entries: Map::new(),
        };
        for (i, target) in targets.iter().enumerate() {
            progress(i as f64 / targets.len() as f64);
            writer.write(*target)?;
        }
        writer.scene(targets)?;
        progress(1.0);
        let summary = json!({
            "format": "gonio-export",
            "version": 1,
            "gonio": env!("CARGO_PKG_VERSION"),
            "input": input,
            "name": writer.name,
            "albedo": measured * scale,
            "light": if found { "of the results" } else { "studio" },
            "exports": writer.entries,
            "note": "relight: root mean square difference of a sphere of the export in a studio light from one of the BRDF, relative; log_relight: the same of \
                     logarithms, above 1 % of the mean; colorspace: of the colours of each export, linear; light.exr is in rec709",
        });
        folder.write(SUMMARY, pretty(&summary).as_bytes())?;
        Ok(Some(summary))
    }
}

/// The light that a folder of results tells of, in colour, for [`Export::light`]; `None` without
/// one.
///
/// # Errors
/// If its file cannot be read.
pub fn light_of_results(dir: &Path) -> Result<Option<EnvironmentMap>, Problem> {
    let file = dir.join(LIGHT);
    if !file.is_file() {
        return Ok(None);
    }
    let light = read_light(&file, None)?;
    let colour: Option<[f32; 3]> = notes::read(&dir.join(RESULT))
        .ok()
        .and_then(|notes| serde_json::from_value(notes["colour"]["light"]["rgb"].clone()).ok());
    Ok(Some(colour.map_or_else(|| light.clone(), |colour| coloured(&light, Vec3::from(colour)))))
}

/// A light that was estimated, whose map is of its luminance, in its colour; one that was given has
/// its colours already.
pub fn coloured(light: &EnvironmentMap, colour: Vec3) -> EnvironmentMap {
    let is_grey = light.radiance().as_slice().iter().all(|p| p.max_element() == p.min_element());
    if is_grey { times(light, colour) } else { light.clone() }
}

/// The light times a colour; the light itself if that leaves the range of its numbers.
fn times(light: &EnvironmentMap, colour: Vec3) -> EnvironmentMap {
    EnvironmentMap::new(light.radiance().map(|p| *p * colour)).unwrap_or_else(|_| light.clone())
}

/// JSON for people.
fn pretty(value: &impl serde::Serialize) -> String {
    serde_json::to_string_pretty(value).expect("names and numbers are JSON")
}

/// Writes one target after the other.
struct Writer<'a> {
    folder: &'a StagedFolder,
    name: String,
    fitter: Fitter,
    /// The fit that more than one target is written from, once it is there.
    layered: Option<Fitted<Layered>>,
    tables: [BivariateTable; 3],
    /// BRDF with its dependence on the third angle, if it is exported unscaled.
    whole: Option<MerlTable>,
    /// Light of the scenes.
    light: EnvironmentMap,
    with_tables: bool,
    /// Space of the tables that are written.
    space: ColourSpace,
    entries: Map<String, Value>,
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
                let note = "RGL tensors, read as `measured`: brdf_rgb.bsdf by Mitsuba 3, brdf_spec.bsdf (smooth spectra of these colours under D65) by its \
                            spectral variants and pbrt-v4";
                self.table(target, "brdf_rgb.bsdf", &rgb, [0, 1, 2].map(|c| back.bivariate(c)), note)?;
                self.add_files(target, &["brdf_spec.bsdf", MEASURED[0].0, MEASURED[1].0]);
                Ok(())
            }
            Target::Mitsuba => {
                let fitted = self.fitter.fit::<Principled>();
                let text = mitsuba_principled(&self.name, &fitted.model, Place::File);
                self.model(target, PRINCIPLED, text.as_bytes(), &fitted, "alpha = roughness^2")
            }
            Target::Blender => {
                let fitted = self.layered();
                let text = blender_scene(&self.name, &fitted.model, LIGHT, self.stops());
                let note = "Blender 4.0 or later; alpha = Roughness^2; the same fit as mtlx";
                self.model(target, "blender.py", text.as_bytes(), &fitted, note)
            }
            Target::Gltf => {
                let fitted = self.fitter.fit::<MetallicRoughness>();
                let bytes = glb_sphere(&self.name, &fitted.model);
                self.model(
                    target,
                    "sphere.glb",
                    &bytes,
                    &fitted,
                    "alpha = roughnessFactor^2; index in KHR_materials_ior",
                )
            }
            Target::Mtlx => {
                let fitted = self.layered();
                let text = materialx(&self.name, &fitted.model);
                self.model(target, "openpbr.mtlx", text.as_bytes(), &fitted, "OpenPBR; alpha = specular_roughness^2")
            }
            Target::CookTorrance => {
                let fitted = self.fitter.fit::<ColourCookTorrance>();
                let note = "f = diffuse/pi + specular D F G / (pi cos_i cos_o); Beckmann of slope m = roughness, not squared; Schlick's F; V-grooves";
                let text = pretty(&fitted.model);
                self.model(target, "cook_torrance.json", text.as_bytes(), &fitted, note)
            }
            Target::Ward => {
                let fitted = self.fitter.fit::<ColourWard>();
                let note = "f = diffuse/pi + specular exp(-tan^2/alpha^2) / (4 pi alpha^2 sqrt(cos_i cos_o)); alpha = roughness, not squared";
                let text = pretty(&fitted.model);
                self.model(target, "ward.json", text.as_bytes(), &fitted, note)
            }
        }
    }

    /// The light of the scenes, and the scene of Mitsuba, of the better one of its materials.
    fn scene(&mut self, targets: &[Target]) -> Result<(), Error> {
        let scenes = [(Target::Bsdf, MEASURED[0].0), (Target::Mitsuba, PRINCIPLED)];
        // The light of the scene is in Rec. 709: a tensor in another space does not go with it.
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

    /// By how much a picture under the light is brightened to be looked at, in stops: next to
    /// nothing of it shall be clipped.
    fn stops(&self) -> f64 {
        let settings = SphereSettings { size: 32, ..SphereSettings::default() };
        let sphere = render_sphere(&self.tables, &LightTree::of_map(&self.light), &settings, &|_| ());
        let covered = |i: usize| sphere.alpha.as_ref().is_some_and(|alpha| alpha.as_slice()[i] > 0.99);
        f64::from(Exposure::by_quantile(&sphere.rgb, covered, 0.97, 0.9).0.log2())
    }

    /// The fit of OpenPBR, at the first call.
    fn layered(&mut self) -> Fitted<Layered> {
        self.layered.get_or_insert_with(|| self.fitter.fit()).clone()
    }

    /// A file of a table that reads back as `tables`.
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
        self.note(
            target,
            json!({ "files": [file], "relight": relight, "log_relight": log_relight, "conventions": note }),
        );
        Ok(())
    }

    /// A file of parameters.
    fn model<S: Shading + serde::Serialize>(
        &mut self,
        target: Target,
        file: &str,
        bytes: &[u8],
        fitted: &Fitted<S>,
        note: &str,
    ) -> Result<(), Error> {
        self.folder.write(file, bytes)?;
        self.note(
            target,
            json!({
                "files": [file], "parameters": fitted.model, "relight": fitted.relight, "log_relight": fitted.log_relight,
                "conventions": note,
            }),
        );
        if self.with_tables {
            let table = format!("{}.binary", file.split('.').next().unwrap_or(file));
            let tables = fitted.model.to_bivariate(2);
            self.folder.write(&table, &merl::encode(&MerlTable::from_bivariate(tables.each_ref())))?;
            self.add_files(target, &[&table]);
        }
        Ok(())
    }

    fn note(&mut self, target: Target, mut entry: Value) {
        let space = if matches!(target, Target::Merl | Target::Bsdf) { self.space } else { ColourSpace::Rec709 };
        entry["colorspace"] = json!(space.name());
        self.entries.insert(target.names().0.to_owned(), entry);
    }

    fn add_files(&mut self, target: Target, more: &[&str]) {
        if let Some(Value::Array(files)) = self.entries.get_mut(target.names().0).map(|e| &mut e["files"]) {
            files.extend(more.iter().map(|f| Value::from(*f)));
        }
    }
}

/// The luminance in all channels.
pub fn grey(tables: &[BivariateTable; 3]) -> [BivariateTable; 3] {
    let luminance = BivariateTable::luminance(tables);
    [luminance.clone(), luminance.clone(), luminance]
}
