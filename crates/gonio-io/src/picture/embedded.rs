//! Colour information in PNG, TIFF and JPEG files: curve and colour space.

use std::path::Path;

use image::{ImageDecoder, ImageFormat};

use super::curve::Curve;
use super::icc::{self, Profile, limited};
use super::png::{ColourChunks, colour_chunks};
use super::space::{Conversion, DeclaredSpace, SpaceSource};
use super::tiff;
use crate::Error;
use crate::colour_space::{ColourSpace, Primaries};

/// Colour information of a file with integer samples.
#[derive(Default)]
pub(super) struct Embedded {
    /// The curve, if the file states one.
    pub(super) curve: Option<Curve>,
    /// The colour space.
    pub(super) stated: DeclaredSpace,
    /// Whether codes use the narrow range of video, 16 to 235 of 8 bits.
    pub(super) narrow: bool,
}

impl Embedded {
    /// Reads the colour information of a file whose decoder has read the header.
    ///
    /// # Errors
    /// If an ICC profile is too long.
    pub(super) fn of(
        path: &Path,
        bytes: &[u8],
        format: ImageFormat,
        decoder: &mut impl ImageDecoder,
    ) -> Result<Self, Error> {
        if format == ImageFormat::Png {
            return Ok(Self::of_png(colour_chunks(path, bytes)?));
        }
        // Unreadable metadata must not prevent reading the picture.
        match format {
            ImageFormat::Tiff => Self::of_tiff(path, bytes),
            _ => Self::of_bytes(path, decoder.icc_profile().ok().flatten()),
        }
    }

    /// Reads the colour information of a TIFF file.
    ///
    /// # Errors
    /// Like [`of`](Self::of).
    pub(super) fn of_tiff(path: &Path, bytes: &[u8]) -> Result<Self, Error> {
        Self::of_bytes(path, tiff::icc_profile(bytes))
    }

    fn of_bytes(path: &Path, profile: Option<Vec<u8>>) -> Result<Self, Error> {
        let Some(profile) = profile.filter(|profile| !profile.is_empty()) else { return Ok(Self::default()) };
        Ok(Self::of_profile(limited(path, profile)?))
    }

    fn of_profile(bytes: Vec<u8>) -> Self {
        let unusable = |problem: &str| {
            let stated = DeclaredSpace { space: None, unusable: Some(format!("the ICC profile ({problem})")) };
            Self { stated, ..Self::default() }
        };
        let damaged = "damaged tone curves";
        match icc::parse(&bytes) {
            Ok(Profile::Matrix { curves, to_rec709, name }) => {
                let Some(curve) = Curve::of_icc(curves.each_ref()) else { return unusable(damaged) };
                let space = Some((Conversion::Matrix(to_rec709), Some(name), SpaceSource::Icc));
                Self { curve: Some(curve), stated: DeclaredSpace { space, unusable: None }, narrow: false }
            }
            Ok(Profile::Grey { curve }) => {
                let Some(curve) = Curve::of_icc([&curve; 3]) else { return unusable(damaged) };
                Self { curve: Some(curve), ..Self::default() }
            }
            Ok(Profile::Table { name }) => {
                let space = Some((Conversion::Table(bytes), Some(name), SpaceSource::Icc));
                Self { curve: Some(Curve::Linear), stated: DeclaredSpace { space, unusable: None }, narrow: false }
            }
            Err(problem) => unusable(&problem),
        }
    }

    fn of_png(chunks: ColourChunks) -> Self {
        let ColourChunks { cicp, icc, srgb, gamma, primaries } = chunks;
        if let Some(cicp) = cicp {
            return Self::of_cicp(cicp);
        }
        if let Some(profile) = icc {
            return Self::of_profile(profile);
        }
        if srgb {
            let space = (Conversion::Matrix(ColourSpace::Rec709.to_rec709()), None, SpaceSource::Chunks);
            let stated = DeclaredSpace { space: Some(space), unusable: None };
            return Self { curve: Some(Curve::Srgb), stated, narrow: false };
        }
        let stated = |primaries| DeclaredSpace::primaries(&primaries, SpaceSource::Chunks, "the numbers of cHRM");
        let curve = gamma.map(|gamma| Curve::power(1.0 / gamma));
        Self { curve, stated: primaries.map(stated).unwrap_or_default(), narrow: false }
    }

    /// Interprets the chunk `cICP` by ITU-T H.273, tables 2 and 3. The decoder rejects files whose
    /// matrix coefficients are not those of RGB.
    fn of_cicp([primaries, transfer, _, full_range]: [u8; 4]) -> Self {
        let mut stated = match of_h273(primaries) {
            Some(primaries) => DeclaredSpace::primaries(&primaries, SpaceSource::Cicp, "the primaries of cICP"),
            // Unspecified primaries: the file states only the curve.
            None if primaries == 2 => DeclaredSpace::default(),
            None => DeclaredSpace { space: None, unusable: Some(format!("the colour primaries {primaries} of cICP")) },
        };
        let curve = Curve::of_cicp(transfer);
        if curve.is_none() && transfer != 2 {
            stated.unusable = Some(format!("the transfer characteristics {transfer} of cICP"));
        }
        Self { curve, stated, narrow: full_range == 0 }
    }
}

/// Returns the primaries of ITU-T H.273, table 2.
fn of_h273(code: u8) -> Option<Primaries> {
    let (d65, c) = ((0.3127, 0.3290), (0.310, 0.316));
    let xy = |r: (f64, f64), g: (f64, f64), b: (f64, f64), w: (f64, f64)| {
        Some(Primaries::from_array([r.0, r.1, g.0, g.1, b.0, b.1, w.0, w.1]))
    };
    match code {
        1 => Some(ColourSpace::Rec709.primaries()),
        4 => xy((0.67, 0.33), (0.21, 0.71), (0.14, 0.08), c),
        5 => xy((0.64, 0.33), (0.29, 0.60), (0.15, 0.06), d65),
        6 | 7 => xy((0.63, 0.34), (0.31, 0.595), (0.155, 0.07), d65),
        8 => xy((0.681, 0.319), (0.243, 0.692), (0.145, 0.049), c),
        9 => Some(ColourSpace::Rec2020.primaries()),
        10 => Some(ColourSpace::Xyz.primaries()),
        11 => xy((0.68, 0.32), (0.265, 0.69), (0.15, 0.06), (0.314, 0.351)),
        12 => Some(ColourSpace::DisplayP3.primaries()),
        22 => xy((0.63, 0.34), (0.295, 0.605), (0.155, 0.077), d65),
        _ => None,
    }
}
