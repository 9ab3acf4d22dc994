//! Converts BRDF tables between colour spaces, and builds the section `colorspace` of
//! `result.json`.
//!
//! All numbers in memory are linear Rec. 709. Images are converted on reading.

use std::path::Path;

use glam::{DMat3, DVec3};
use gonio::reflectance::{BivariateTable, MerlTable};
use gonio_io::Error;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::InputSpace;
use gonio_io::result::{ColourSpaces, ExportDocument};
use serde_json::{Value, json};

use crate::Warning;
use crate::export::SUMMARY;
use crate::results::{BRDF, document_in};

/// Share of a photograph's pixels outside the gamut of Rec. 709 above which a warning reports them.
const OUTSIDE_GAMUT: f64 = 0.01;

/// Colour spaces of an inference's files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spaces {
    /// Colour space of environment maps that state none; `None` is Rec. 709.
    /// [`Reading`](crate::Reading) has the colour space of photographs.
    pub input: Option<ColourSpace>,
    /// Colour space of the BRDF and light files. Pictures for display are always sRGB.
    pub output: ColourSpace,
}

impl Spaces {
    /// Returns the section `colorspace` of `result.json`; `input` is `None` for a picture in
    /// memory.
    pub fn section(self, input: Option<&InputSpace>) -> ColourSpaces {
        ColourSpaces {
            input: Some(input.map_or(ColourSpace::Rec709.name(), |input| input.name.as_str()).to_owned()),
            source: Some(input.map_or("given", |input| input.source.words()).to_owned()),
            clamped_pixels: Some(input.map_or(0, |input| input.clamped)),
            output: self.output.name().to_owned(),
        }
    }

    /// Warns if colours of the BRDF of the input `name` lie outside the gamut of the output space.
    pub fn warning(self, name: &str, tables: &[BivariateTable; 3]) -> Option<Warning> {
        let (_, clamped) = from_rec709(tables, self.output);
        let (space, cells) = (self.output.name(), tables[0].as_slice().len());
        (clamped > 0).then(|| {
            let text = format!(
                "the BRDF has colours outside the gamut of {space}: {clamped} of {cells} cells have negative channels, \
                 which are set to zero"
            );
            Warning::of(name, text)
        })
    }
}

/// Returns the colour space of a picture, its origin, and the number of clamped pixels, by name.
pub(crate) fn input_document(input: &InputSpace) -> Value {
    json!({ "input": input.name, "source": input.source.words(), "clamped_pixels": input.clamped })
}

/// Returns warnings about the colour space of a picture of `pixels` pixels.
pub(crate) fn warnings(name: &str, input: &InputSpace, pixels: usize) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if let Some(given) = input.overridden {
        let (stated, given) = (&input.name, given.name());
        let source = input.source.words();
        warnings.push(
            format!("{name}: states the colour space {stated} ({source}); the specified space {given} has no effect")
                .into(),
        );
    }
    if let Some(unusable) = &input.unusable {
        let used = &input.name;
        warnings.push(format!("{name}: cannot use {unusable}; gonio interprets the colours as {used}").into());
    }
    if input.clamped as f64 > OUTSIDE_GAMUT * pixels as f64 {
        let (clamped, percent) = (input.clamped, 100.0 * input.clamped as f64 / pixels.max(1) as f64);
        warnings.push(
            format!(
                "{name}: {clamped} pixels ({percent:.1} %) have colours outside the gamut of Rec. 709; their negative \
                 channels are set to zero"
            )
            .into(),
        );
    }
    warnings
}

/// Converts linear Rec. 709 tables to a space; negative values become zero and are counted by cell.
pub fn from_rec709(tables: &[BivariateTable; 3], space: ColourSpace) -> ([BivariateTable; 3], usize) {
    if space == ColourSpace::Rec709 {
        return (tables.clone(), 0);
    }
    let (channels, clamped) = converted(tables.each_ref().map(BivariateTable::as_slice), space.from_rec709());
    (channels.map(BivariateTable::from_vec), clamped)
}

/// Converts a linear Rec. 709 table over three angles to a space, as [`from_rec709`] does. Missing
/// values stay missing.
pub fn merl_from_rec709(table: &MerlTable, space: ColourSpace) -> (MerlTable, usize) {
    merl_by(table, space, space.from_rec709())
}

/// Converts a table in a space to linear Rec. 709.
pub fn merl_to_rec709(table: &MerlTable, space: ColourSpace) -> MerlTable {
    merl_by(table, space, space.to_rec709()).0
}

fn merl_by(table: &MerlTable, space: ColourSpace, matrix: DMat3) -> (MerlTable, usize) {
    if space == ColourSpace::Rec709 {
        return (table.clone(), 0);
    }
    let (channels, clamped) = converted([0, 1, 2].map(|channel| table.channel(channel)), matrix);
    (MerlTable::from_channels(channels), clamped)
}

/// Converts channels by a matrix, except where a channel is negative, which marks missing values.
fn converted([red, green, blue]: [&[f32]; 3], matrix: DMat3) -> ([Vec<f32>; 3], usize) {
    let mut out = [red, green, blue].map(|channel| Vec::with_capacity(channel.len()));
    let mut clamped = 0;
    for ((r, g), b) in red.iter().zip(green).zip(blue) {
        let old = DVec3::new(f64::from(*r), f64::from(*g), f64::from(*b));
        let missing = old.min_element() < 0.0;
        let new = if missing { old } else { matrix * old };
        // Smaller negative values are rounding errors.
        clamped += usize::from(!missing && new.min_element() < -1e-6 * new.max_element().abs());
        let new = if missing { new } else { new.max(DVec3::ZERO) };
        out.iter_mut().zip(new.to_array()).for_each(|(channel, value)| channel.push(value as f32));
    }
    (out, clamped)
}

/// Reads a BRDF in any format of [`gonio_io::brdf`] and converts it to linear Rec. 709. Such files
/// do not state their colour space; `result.json` or `export.json` beside them does if gonio wrote
/// them. The default is Rec. 709.
///
/// # Errors
/// See [`gonio_io::brdf::read`]; also if the JSON file is damaged.
pub fn read_brdf(path: &Path) -> Result<MerlTable, Error> {
    let table = gonio_io::brdf::read(path)?;
    Ok(match space_of_brdf(path)? {
        ColourSpace::Rec709 => table,
        space => merl_to_rec709(&table, space),
    })
}

/// Returns the colour space of a BRDF from the JSON file beside it.
fn space_of_brdf(path: &Path) -> Result<ColourSpace, Error> {
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    if let Some(folder) = path.parent().filter(|_| file == BRDF)
        && let Some(document) = document_in(folder)?
    {
        return Ok(ColourSpace::named(&document.colorspace.output).unwrap_or_default());
    }
    let summary = path.with_file_name(SUMMARY);
    if !summary.is_file() {
        return Ok(ColourSpace::default());
    }
    let summary: ExportDocument = gonio_io::json::read(&summary)?;
    let entry = summary.exports.values().find(|entry| entry.files.iter().any(|name| *name == file));
    Ok(entry.and_then(|entry| ColourSpace::named(&entry.colorspace)).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::RESULT;

    fn tables(rgb: [f32; 3]) -> [BivariateTable; 3] {
        rgb.map(|value| BivariateTable::from_fn(|_, _| f64::from(value)))
    }

    #[test]
    fn conversion_to_a_space_is_invertible() {
        let (there, clamped) = from_rec709(&tables([0.5, 0.4, 0.3]), ColourSpace::AcesCg);
        // The inverse of the ACES matrix from AP1 to Rec. 709.
        let want = [0.456_6, 0.405_5, 0.315_0];
        for (channel, want) in there.iter().zip(want) {
            assert!((channel.cell(3, 4) - want).abs() < 5e-4, "{} {want}", channel.cell(3, 4));
        }
        assert_eq!(clamped, 0);
        let back = merl_to_rec709(&MerlTable::from_bivariate(there.each_ref()), ColourSpace::AcesCg);
        assert!((back.eval(0.1, 0.1, 1.0)[2] - 0.3).abs() < 1e-4);
    }

    #[test]
    fn colours_outside_the_gamut_are_counted() {
        // Rec. 709 lies within all other spaces, so a table in Rec. 2020 is needed.
        let wide = MerlTable::from_bivariate(tables([0.0, 1.0, 0.0]).each_ref());
        let (narrow, clamped) = merl_by(&wide, ColourSpace::Rec2020, ColourSpace::Rec2020.to_rec709());
        assert!(clamped > 0 && narrow.channel(0).iter().all(|v| *v <= 0.0));
        let missing = MerlTable::from_channels([0, 1, 2].map(|_| vec![-1.0; MerlTable::CHANNEL]));
        let (kept, clamped) = merl_from_rec709(&missing, ColourSpace::AcesCg);
        assert!(clamped == 0 && kept.channel(1).iter().all(|v| *v == -1.0));
    }

    #[test]
    fn reads_the_space_from_json_beside_the_brdf() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, value: Value| std::fs::write(dir.path().join(name), value.to_string()).unwrap();
        let space = |name: &str| space_of_brdf(&dir.path().join(name)).unwrap();
        assert_eq!(space("brdf.npz"), ColourSpace::Rec709);
        write(RESULT, json!({ "format": "gonio-result", "colorspace": { "output": "acescg" } }));
        assert_eq!((space("brdf.npz"), space("other.npz")), (ColourSpace::AcesCg, ColourSpace::Rec709));
        write(SUMMARY, json!({ "exports": { "bsdf": { "files": ["brdf_rgb.bsdf"], "colorspace": "rec2020" } } }));
        assert_eq!(space("brdf_rgb.bsdf"), ColourSpace::Rec2020);
        write(RESULT, json!({ "colorspace": 3 }));
        assert_eq!(space("brdf.npz"), ColourSpace::Rec709);
        // A damaged result is an error: its colours would be wrong.
        write(RESULT, json!({ "format": "gonio-result", "version": 2, "colorspace": 3 }));
        assert!(space_of_brdf(&dir.path().join("brdf.npz")).is_err());
    }
}
