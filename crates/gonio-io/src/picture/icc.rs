//! ICC profiles, by `moxcms`: tone curves with primaries, or tables.
//!
//! Primaries and tone curves are preferred to tables, because they are exact for any radiance.
//! Tables are evaluated by the relative colorimetric intent, or else by the perceptual one.

use std::panic::catch_unwind;
use std::path::Path;

use glam::{DMat3, DVec2, DVec3, Vec3};
use moxcms::{
    ColorProfile, DataColorSpace, Layout, ParsingOptions, ProfileText, RenderingIntent, ToneReprCurve, TransformOptions,
};

use crate::Error;
use crate::colour_space::{ColourSpace, D65, bradford};

/// Longest profile that is read, in bytes. Profiles of cameras with tables have about one MiB.
pub(super) const MAX_PROFILE: usize = 4 << 20;

/// Longest name of a profile that is kept, in characters.
const MAX_NAME: usize = 60;

/// Chromaticity of D50, the white of the profile connection space (ICC.1:2022, 7.2.16).
const D50: DVec2 = DVec2::new(0.345_7, 0.358_5);

/// A usable profile.
#[derive(Clone, Debug)]
pub(super) enum Profile {
    /// Tone curves of red, green and blue, and the matrix from linear values to linear Rec. 709.
    Matrix { curves: Box<[ToneReprCurve; 3]>, to_rec709: DMat3, name: String },
    /// Tone curve of a grey picture.
    Grey { curve: ToneReprCurve },
    /// A table from codes to colours.
    Table { name: String },
}

/// Returns a profile of a file.
///
/// # Errors
/// If it is longer than [`MAX_PROFILE`].
pub(super) fn limited(path: &Path, profile: Vec<u8>) -> Result<Vec<u8>, Error> {
    if profile.len() > MAX_PROFILE {
        let problem = format!("has an ICC profile of more than {MAX_PROFILE} bytes");
        return Err(Error::limits(path, problem, "remove the ICC profile"));
    }
    Ok(profile)
}

/// Parses a profile of at most [`MAX_PROFILE`] bytes.
///
/// # Errors
/// If it is damaged, or is not a profile for RGB or grey values.
pub(super) fn parse(bytes: &[u8]) -> Result<Profile, String> {
    let profile = load(bytes)?;
    let name = profile.description.as_ref().map(text).filter(|name| !name.is_empty());
    let name = name.map_or_else(|| "unnamed ICC profile".to_owned(), |name| format!("ICC profile {name}"));
    match profile.color_space {
        DataColorSpace::Gray => {
            let curve = profile.gray_trc.ok_or("a grey profile without a tone curve")?;
            Ok(Profile::Grey { curve })
        }
        DataColorSpace::Rgb => match (&profile.red_trc, &profile.green_trc, &profile.blue_trc) {
            (Some(r), Some(g), Some(b)) if profile.is_matrix_shaper() => {
                let curves = Box::new([r.clone(), g.clone(), b.clone()]);
                let to_rec709 = from_colorants(&profile).ok_or("primaries that lie on a line")?;
                Ok(Profile::Matrix { curves, to_rec709, name })
            }
            _ if profile.lut_a_to_b_colorimetric.is_some() || profile.lut_a_to_b_perceptual.is_some() => {
                Ok(Profile::Table { name })
            }
            _ => Err("neither primaries with tone curves nor a table".to_owned()),
        },
        other => Err(format!("a profile for {other:?} instead of RGB")),
    }
}

fn load(bytes: &[u8]) -> Result<ColorProfile, String> {
    if bytes.len() > MAX_PROFILE {
        return Err(format!("longer than {MAX_PROFILE} bytes"));
    }
    let options = ParsingOptions {
        max_profile_size: MAX_PROFILE + 1,
        max_allowed_clut_size: MAX_PROFILE,
        ..ParsingOptions::default()
    };
    // A panic of the third-party parser must not end the program.
    let parsed = catch_unwind(|| ColorProfile::new_from_slice_with_options(bytes, options));
    parsed.map_err(|_| "a damaged profile".to_owned())?.map_err(|error| error.to_string())
}

/// Returns the matrix to linear Rec. 709 from the colorants, which profiles adapt to D50.
fn from_colorants(profile: &ColorProfile) -> Option<DMat3> {
    let rows = profile.colorant_matrix().v.map(DVec3::from);
    let to_xyz = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
    let from_xyz = ColourSpace::Xyz.to_rec709();
    let matrix = from_xyz * bradford(D50, DVec2::from(D65)) * to_xyz;
    (matrix.is_finite() && to_xyz.determinant().abs() > 1e-4).then_some(matrix)
}

/// Returns the first text of a description, without control characters and truncated.
fn text(text: &ProfileText) -> String {
    let text = match text {
        ProfileText::PlainString(text) => text.as_str(),
        ProfileText::Localizable(all) => all.first().map_or("", |one| one.value.as_str()),
        ProfileText::Description(description) => description.ascii_string.as_str(),
    };
    text.trim_matches('\0').trim().chars().filter(|c| !c.is_control()).take(MAX_NAME).collect()
}

/// Converts codes in 0..=1 to linear Rec. 709 by the table of a profile.
///
/// # Errors
/// If the profile is damaged or its table has an unsupported kind.
pub(super) fn apply_table(profile: &[u8], codes: &[Vec3]) -> Result<Vec<Vec3>, String> {
    let profile = load(profile)?;
    let rendering_intent = if profile.lut_a_to_b_colorimetric.is_some() {
        RenderingIntent::RelativeColorimetric
    } else {
        RenderingIntent::Perceptual
    };
    let options = TransformOptions { rendering_intent, prefer_fixed_point: false, ..TransformOptions::default() };
    // A space with a wide gamut, in which no colour of a camera or display is clipped.
    let wide = ColorProfile::new_aces_cg_linear();
    let to_rec709 = ColourSpace::AcesCg.to_rec709().as_mat3();
    let convert = || -> Result<Vec<Vec3>, String> {
        let transform =
            profile.create_transform_f32(Layout::Rgb, &wide, Layout::Rgb, options).map_err(|e| e.to_string())?;
        let mut out = Vec::with_capacity(codes.len());
        for part in codes.chunks(1 << 16) {
            let from: Vec<f32> = part.iter().flat_map(|v| v.to_array()).map(|v| v.clamp(0.0, 1.0)).collect();
            let mut to = vec![0.0; from.len()];
            transform.transform(&from, &mut to).map_err(|e| e.to_string())?;
            out.extend(to.chunks_exact(3).map(|v| to_rec709 * Vec3::from_slice(v)));
        }
        Ok(out)
    };
    catch_unwind(std::panic::AssertUnwindSafe(convert)).unwrap_or_else(|_| Err("a damaged table".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn display_p3_has_its_matrix_and_the_curve_of_srgb() {
        let bytes = ColorProfile::new_display_p3().encode().unwrap();
        let Profile::Matrix { to_rec709, name, curves } = parse(&bytes).unwrap() else { panic!("a matrix profile") };
        assert_eq!(ColourSpace::of_matrix(to_rec709), Some(ColourSpace::DisplayP3), "{to_rec709}");
        assert_eq!(name, "ICC profile Display P3");
        let half = curves[1].make_linear_evaluator().unwrap().evaluate_value(0.5);
        assert!((half - 0.214_041).abs() < 1e-4, "{half}");
    }

    #[test]
    fn damaged_profiles_are_rejected() {
        let good = ColorProfile::new_display_p3().encode().unwrap();
        for cut in 0..good.len() {
            let _ = parse(&good[..cut]);
        }
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 0xff;
            if let Ok(Profile::Table { .. }) = parse(&bad) {
                let _ = apply_table(&bad, &[Vec3::splat(0.5)]);
            }
        }
        assert!(parse(&[]).is_err());
        assert!(parse(&vec![0; MAX_PROFILE + 1]).unwrap_err().contains("longer than"));
    }
}
