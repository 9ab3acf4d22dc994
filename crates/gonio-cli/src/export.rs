//! `gonio export`: a BRDF in the files and parameters of renderers.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use gonio::reflectance::shading::{
    ColourCookTorrance, ColourWard, Fitted, Fitter, Layered, MetallicRoughness, Principled, Shading,
};
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio_io::atomic::StagedFolder;
use gonio_io::material::{blender_script, glb_sphere, materialx, mitsuba_measured, mitsuba_principled};
use gonio_io::{merl, rgl};
use serde_json::{Value, json};

use crate::convert::grey;
use crate::input;
use crate::outcome::Outcome;
use crate::progress::Stage;

/// Options of `gonio export`.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// Folder of results of `gonio infer`, or a BRDF (.binary, .bsdf)
    input: PathBuf,
    /// What to write; everything if not given
    #[arg(long, value_enum, value_delimiter = ',')]
    to: Vec<Target>,
    /// Folder to write to; `export` within the folder of results if not given
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Name of the material
    #[arg(long)]
    name: Option<String>,
    /// Scale the BRDF to this albedo of its luminance along the normal: a photograph under unknown light does not tell it
    #[arg(long, value_name = "ALBEDO", value_parser = parse_albedo, allow_negative_numbers = true)]
    albedo: Option<f64>,
    /// Write the table of each fitted model too (.binary), to be rendered beside the BRDF
    #[arg(long)]
    tables: bool,
}

/// What can be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Target {
    /// MERL table, three channels
    Merl,
    /// MERL table of the luminance
    MerlGrey,
    /// RGL tensors: _rgb.bsdf for Mitsuba 3, _spec.bsdf for its spectral variants and pbrt-v4
    Bsdf,
    /// Mitsuba 3 `principled`
    Mitsuba,
    /// Blender 4 Principled BSDF, as a script
    Blender,
    /// glTF 2.0 metallic-roughness, as a sphere (.glb)
    Gltf,
    /// MaterialX document with an OpenPBR surface (.mtlx)
    Mtlx,
    /// Cook-Torrance parameters (Beckmann, Schlick, V-grooves)
    CookTorrance,
    /// Ward parameters
    Ward,
}

fn parse_albedo(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|a: &f64| *a > 0.0 && *a <= 1.0).ok_or_else(|| "give a number above 0, at most 1".into())
}

pub(crate) fn run(options: &Options) -> Result<Outcome> {
    let is_folder = options.input.is_dir();
    let file = if is_folder { options.input.join("brdf.binary") } else { options.input.clone() };
    if is_folder && !file.is_file() {
        bail!("{}: holds no brdf.binary; give a folder of results of gonio infer, or a BRDF", options.input.display());
    }
    let output = match &options.output {
        Some(output) => output.clone(),
        None if is_folder => options.input.join("export"),
        None => bail!("give -o DIR: a single file has no folder of results to write to"),
    };
    let named = options.name.clone().or_else(|| {
        let of = if is_folder { options.input.file_name() } else { file.file_stem() };
        of.map(|name| name.to_string_lossy().into_owned())
    });
    let name = named.filter(|n| !n.is_empty()).unwrap_or_else(|| "gonio".to_owned());
    let table = input::brdf(&file)?;
    let mut tables = [0, 1, 2].map(|c| table.bivariate(c));
    let measured = BivariateTable::luminance(&tables).normal_albedo();
    if !(measured > 0.0 && measured.is_finite()) {
        bail!("{}: reflects nothing along the normal", file.display());
    }
    let scale = options.albedo.map_or(1.0, |albedo| albedo / measured);
    if scale != 1.0 {
        tables = tables.map(|table| table.scaled(scale));
    }
    let folder = StagedFolder::create(&output)?;
    let targets: Vec<Target> =
        if options.to.is_empty() { Target::value_variants().to_vec() } else { options.to.clone() };
    let stage = Stage::new("fitting models");
    let mut writer = Writer {
        folder,
        name,
        fitter: Fitter::new(&tables),
        layered: None,
        tables,
        // With its dependence on the third angle, if it is taken as it is.
        whole: (scale == 1.0).then_some(table),
        with_tables: options.tables,
        entries: serde_json::Map::new(),
    };
    for (i, target) in targets.iter().enumerate() {
        stage.at(i as f64 / targets.len() as f64);
        writer.write(*target)?;
    }
    stage.finish();
    let summary = json!({
        "format": "gonio-export",
        "version": 1,
        "gonio": env!("CARGO_PKG_VERSION"),
        "input": options.input.display().to_string(),
        "name": writer.name,
        "albedo": measured * scale,
        "exports": writer.entries,
        "note": "relight: root mean square difference of a sphere of the export in a studio light from one of the BRDF, relative; log_relight: the same of \
                 logarithms, above 1 % of the mean; colours are linear Rec. 709",
    });
    let text = serde_json::to_string_pretty(&summary).context("the summary cannot be written as JSON")?;
    writer.folder.write("export.json", text.as_bytes())?;
    writer.folder.commit()?;
    let line = |(target, entry): (&String, &Value)| {
        let files: Vec<&str> = entry["files"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let percent = 100.0 * entry["relight"].as_f64().unwrap_or(0.0);
        format!("{target:15} {:40} off by {percent:.1} %\n", files.join(", "))
    };
    let lines: String = writer.entries.iter().map(line).collect();
    let output = output.display().to_string();
    let mut outcome = Outcome::new(format!("{lines}{output}"), summary);
    outcome.fields.insert("output".into(), json!(output));
    Ok(outcome)
}

/// Writes one target after the other.
struct Writer {
    folder: StagedFolder,
    name: String,
    fitter: Fitter,
    /// The fit that more than one target is written from, once it is there.
    layered: Option<Fitted<Layered>>,
    tables: [BivariateTable; 3],
    whole: Option<MerlTable>,
    with_tables: bool,
    entries: serde_json::Map<String, Value>,
}

impl Writer {
    fn write(&mut self, target: Target) -> Result<()> {
        match target {
            Target::Merl => {
                let table = match &self.whole {
                    Some(table) => merl::encode(table),
                    None => merl::encode(&MerlTable::from_bivariate(self.tables.each_ref())),
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
                let rgb = rgl::encode(&self.tables, &self.name, rgl::Channels::Rgb);
                let spectral = rgl::encode(&self.tables, &self.name, rgl::Channels::Spectral);
                let back = rgl::decode("brdf_rgb.bsdf".as_ref(), &rgb)?.to_merl();
                self.folder.write("brdf_spec.bsdf", &spectral)?;
                self.folder.write("brdf_measured.xml", mitsuba_measured(&self.name, "brdf_rgb.bsdf").as_bytes())?;
                let note = "RGL tensors, read as `measured`: brdf_rgb.bsdf by Mitsuba 3, brdf_spec.bsdf (smooth spectra of these colours under D65) by its \
                            spectral variants and pbrt-v4";
                self.table(target, "brdf_rgb.bsdf", &rgb, [0, 1, 2].map(|c| back.bivariate(c)), note)?;
                self.add_files(target, &["brdf_spec.bsdf", "brdf_measured.xml"]);
                Ok(())
            }
            Target::Mitsuba => {
                let fitted = self.fitter.fit::<Principled>();
                let text = mitsuba_principled(&self.name, &fitted.model);
                self.model(target, "principled.xml", text.as_bytes(), &fitted, "alpha = roughness^2")
            }
            Target::Blender => {
                let fitted = self.layered();
                let text = blender_script(&self.name, &fitted.model);
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
                let text = serde_json::to_string_pretty(&fitted.model)?;
                self.model(target, "cook_torrance.json", text.as_bytes(), &fitted, note)
            }
            Target::Ward => {
                let fitted = self.fitter.fit::<ColourWard>();
                let note = "f = diffuse/pi + specular exp(-tan^2/alpha^2) / (4 pi alpha^2 sqrt(cos_i cos_o)); alpha = roughness, not squared";
                let text = serde_json::to_string_pretty(&fitted.model)?;
                self.model(target, "ward.json", text.as_bytes(), &fitted, note)
            }
        }
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
    ) -> Result<()> {
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
    ) -> Result<()> {
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

    fn note(&mut self, target: Target, entry: Value) {
        self.entries.insert(name_of(target), entry);
    }

    fn add_files(&mut self, target: Target, more: &[&str]) {
        if let Some(Value::Array(files)) = self.entries.get_mut(&name_of(target)).map(|e| &mut e["files"]) {
            files.extend(more.iter().map(|f| Value::from(*f)));
        }
    }
}

/// The name of a target as the command line takes it.
fn name_of(target: Target) -> String {
    target.to_possible_value().map(|v| v.get_name().to_owned()).unwrap_or_default()
}
