//! Camera raw files, by `rawler`. Colours are linear camera RGB without white balance, colour
//! matrix or tone curve.
//!
//! The black level is subtracted and the result divided by the white level, both according to the
//! file or the table of cameras. The mosaic is binned: every 2 x 2 pixels (3 x 3 for X-Trans)
//! become one pixel with the means of their colours, so that no colour is interpolated. The unknown
//! colour of the light absorbs the white balance. Vignetting is corrected if a DNG file describes
//! it (`OpcodeList3`, `FixVignetteRadial`); other lens corrections are not applied.

use std::path::Path;

use glam::Vec3;
use gonio::bracket::Codes;
use gonio::picture::{Picture, Plane};
use rawler::decoders::{Orientation, RawDecodeParams, WellKnownIFD};
use rawler::formats::tiff::{IFD, Value};
use rawler::rawimage::{RawImage, RawPhotometricInterpretation};
use rawler::rawsource::RawSource;
use rawler::tags::{DngTag, TiffCommonTag};

use super::space::{Conversion, InputSpace, SpaceSource};
use super::{Decoded, Encoding, ExposureSettings, ReadOptions};
use crate::{Error, guard};

/// Largest number of pixels per byte of a compressed raw file.
const PIXELS_PER_BYTE: u64 = 64;

/// A developed raw file.
pub(super) struct Raw {
    /// Linear colours, 1 at the white level before the vignetting correction.
    rgb: Plane<Vec3>,
    /// Value of clipped channels; all others are below it.
    level: f32,
    pub(super) shot: ExposureSettings,
}

impl Raw {
    /// Returns 16-bit codes; the largest code means clipped.
    pub(super) fn codes(&self) -> Codes {
        Codes::Sixteen(self.rgb.map(|v| (65535.0 * *v / self.level).to_array().map(|v| v.round() as u16)))
    }

    pub(super) fn into_decoded(self) -> Decoded {
        let picture = Picture { rgb: self.rgb, alpha: None };
        let input = InputSpace::unconverted("camera", SpaceSource::Camera);
        let (encoding, full_scale) = (Encoding::LinearFloat, Some(self.level));
        Decoded { picture, encoding, full_scale, layer: None, input, conversion: Conversion::None }
    }
}

/// Returns whether files of this extension (lower case) are raw files.
pub(super) fn is_raw(extension: &str) -> bool {
    rawler::decoders::supported_extensions().iter().any(|e| e.eq_ignore_ascii_case(extension))
}

/// Decodes and develops a raw file.
pub(super) fn develop(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Raw, Error> {
    guard::catching(path, "a camera's raw file", || {
        let failed = |e: rawler::RawlerError| explain(path, &e);
        let source = RawSource::new_from_slice(bytes).with_path(path);
        let decoder = rawler::get_decoder(&source).map_err(failed)?;
        // The decoder allocates memory for the size in the header, so check that size first.
        if let Ok(Some(ifd)) = decoder.ifd(WellKnownIFD::Raw) {
            check_header(path, &ifd, bytes.len() as u64, options)?;
        }
        let parameters = RawDecodeParams::default();
        let dummy = decoder.raw_image(&source, &parameters, true).map_err(failed)?;
        check_size(path, dummy.width, dummy.height, bytes.len() as u64, options)?;
        let image = decoder.raw_image(&source, &parameters, false).map_err(failed)?;
        let shot = decoder.raw_metadata(&source, &parameters).map(|m| shot(&m.exif)).unwrap_or_default();
        let tags = decoder.ifd(WellKnownIFD::VirtualDngRawTags).ok().flatten();
        let radial = tags.as_deref().and_then(vignetting);
        let mut raw = Raw { rgb: demosaic(path, &image)?, level: 1.0, shot };
        if let Some(radial) = radial {
            raw.brighten(&radial);
        }
        raw.rgb = turned(&raw.rgb, image.orientation);
        Ok(raw)
    })
}

fn check_size(path: &Path, width: usize, height: usize, bytes: u64, options: &ReadOptions) -> Result<(), Error> {
    let (width, height) = (width as u64, height as u64);
    options.check_size(path, width, height)?;
    if width * height > bytes.saturating_mul(PIXELS_PER_BYTE) {
        return Err(Error::damaged(path, format!("has {bytes} bytes, too few for {width}x{height} pixels")));
    }
    Ok(())
}

fn check_header(path: &Path, ifd: &IFD, bytes: u64, options: &ReadOptions) -> Result<(), Error> {
    let number = |tag: TiffCommonTag| ifd.get_entry(tag).filter(|e| e.count() > 0).map(|e| e.force_usize(0));
    for (width, height) in
        [(TiffCommonTag::ImageWidth, TiffCommonTag::ImageLength), (TiffCommonTag::TileWidth, TiffCommonTag::TileLength)]
    {
        if let (Some(width), Some(height)) = (number(width), number(height)) {
            check_size(path, width, height, bytes, options)?;
        }
    }
    if number(TiffCommonTag::SamplesPerPixel).is_some_and(|n| !(1..=4).contains(&n)) {
        return Err(Error::damaged(path, "does not have 1 to 4 samples per pixel"));
    }
    Ok(())
}

fn explain(path: &Path, error: &rawler::RawlerError) -> Error {
    let advice = "convert it without a tone curve to linear EXR or 16-bit TIFF";
    Error::unsupported(path, format!("cannot be decoded as a raw file ({error})"), advice)
}

fn shot(exif: &rawler::exif::Exif) -> ExposureSettings {
    let positive = |v: f64| (v.is_finite() && v > 0.0).then_some(v);
    let ratio = |r: &rawler::formats::tiff::Rational| positive(f64::from(r.n) / f64::from(r.d));
    let iso = exif.iso_speed_ratings.map(u32::from).or(exif.iso_speed);
    ExposureSettings {
        seconds: exif.exposure_time.as_ref().and_then(ratio),
        f_number: exif.fnumber.as_ref().and_then(ratio),
        iso: iso.and_then(|iso| positive(iso.into())),
    }
}

/// Function that returns the colour of the binned pixel whose first sample is at a column and row;
/// `None` for a mosaic that is not RGB.
type Develop<'a> = Box<dyn Fn(usize, usize) -> Option<Vec3> + 'a>;

/// Computes linear colours of binned pixels, 1 in channels with a sample at the white level.
fn demosaic(path: &Path, image: &RawImage) -> Result<Plane<Vec3>, Error> {
    let data = image.data.as_f32();
    let (width, height, samples) = (image.width, image.height, image.cpp);
    // Some decoders report the width in samples, others in pixels.
    let width = if data.len() == width * height { width / samples.max(1) } else { width };
    if samples == 0 || width == 0 || data.len() < width * height * samples {
        return Err(Error::damaged(path, "has fewer samples than its size requires"));
    }
    let (left, top, right, bottom) = match image.active_area.or(image.crop_area) {
        Some(area) => (area.p.x, area.p.y, area.p.x.saturating_add(area.d.w), area.p.y.saturating_add(area.d.h)),
        None => (0, 0, width, height),
    };
    let (right, bottom) = (right.min(width), bottom.min(height));
    let black = &image.blacklevel;
    let blacks = black.as_vec();
    let value = |x: usize, y: usize, sample: usize| {
        let at = if blacks.len() == black.width * black.height * black.cpp && !blacks.is_empty() {
            ((y % black.height) * black.width + x % black.width) * black.cpp + sample.min(black.cpp - 1)
        } else {
            0
        };
        let black = blacks.get(at).copied().unwrap_or(0.0);
        let white = image.whitelevel.0.get(sample).or(image.whitelevel.0.first()).map_or(65535.0, |w| *w as f32);
        ((data[(y * width + x) * samples + sample] - black) / (white - black)).clamp(0.0, 1.0)
    };
    let unsupported = || Error::unsupported(path, "has an unknown mosaic pattern", "convert it to linear EXR");
    let (step, colour): (usize, Develop<'_>) = match &image.photometric {
        RawPhotometricInterpretation::Cfa(config) => {
            let cfa = &config.cfa;
            let step = match (cfa.width, cfa.height) {
                (2, 2) => 2,
                (6, 6) => 3,
                _ => return Err(unsupported()),
            };
            let block = move |x: usize, y: usize| {
                let (mut sum, mut count, mut largest) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
                for (x, y) in (y..y + step).flat_map(|y| (x..x + step).map(move |x| (x, y))) {
                    let channel = cfa.color_at(y, x);
                    if channel > 2 {
                        return None;
                    }
                    let v = value(x, y, 0);
                    largest[channel] = v.max(largest[channel]);
                    sum[channel] += v;
                    count[channel] += 1.0;
                }
                // A colour with one clipped sample counts as clipped.
                (count.min_element() > 0.0).then(|| Vec3::select(largest.cmpge(Vec3::ONE), Vec3::ONE, sum / count))
            };
            (step, Box::new(block))
        }
        RawPhotometricInterpretation::BlackIsZero => (1, Box::new(|x, y| Some(Vec3::splat(value(x, y, 0))))),
        RawPhotometricInterpretation::LinearRaw if samples >= 3 => {
            let pixel = |x: usize, y: usize| Some(Vec3::new(value(x, y, 0), value(x, y, 1), value(x, y, 2)));
            (1, Box::new(pixel))
        }
        RawPhotometricInterpretation::LinearRaw => (1, Box::new(|x, y| Some(Vec3::splat(value(x, y, 0))))),
    };
    let (columns, rows) = (right.saturating_sub(left) / step, bottom.saturating_sub(top) / step);
    if columns == 0 || rows == 0 {
        return Err(Error::damaged(path, "has no pixels within its active area"));
    }
    let pixels: Option<Vec<Vec3>> =
        (0..columns * rows).map(|i| colour(left + step * (i % columns), top + step * (i / columns))).collect();
    Ok(Plane::from_vec(columns, rows, pixels.ok_or_else(unsupported)?))
}

/// Vignetting correction of a lens. The gain at distance `r` from the centre is `1 + k0 r^2 + k1
/// r^4 + ...`, where the farthest corner is at `r = 1`.
struct Radial {
    k: [f64; 5],
    /// Centre, as a fraction of the width and height.
    centre: [f64; 2],
}

/// Returns `FixVignetteRadial` (opcode 3) among the corrections after demosaicing.
fn vignetting(tags: &IFD) -> Option<Radial> {
    let bytes: Vec<u8> = match &tags.get_entry(DngTag::OpcodeList3)?.value {
        Value::Byte(bytes) | Value::Undefined(bytes) => bytes.clone(),
        _ => return None,
    };
    let word = |at: usize| bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_be_bytes);
    let number = |at: usize| bytes.get(at..at + 8).and_then(|b| b.try_into().ok()).map(f64::from_be_bytes);
    let mut at = 4;
    for _ in 0..word(0)?.min(64) {
        let (code, length) = (word(at)?, word(at + 12)? as usize);
        let data = at + 16;
        if code == 3 && length >= 56 {
            let mut numbers = [0.0; 7];
            for (i, slot) in numbers.iter_mut().enumerate() {
                *slot = number(data + 8 * i).filter(|v| v.is_finite() && v.abs() < 100.0)?;
            }
            let [k0, k1, k2, k3, k4, x, y] = numbers;
            return Some(Radial { k: [k0, k1, k2, k3, k4], centre: [x, y] });
        }
        at = data.checked_add(length)?;
    }
    None
}

impl Raw {
    fn brighten(&mut self, radial: &Radial) {
        let (width, height) = (self.rgb.width() as f64, self.rgb.height() as f64);
        let [cx, cy] = [radial.centre[0] * width, radial.centre[1] * height];
        let far = cx.max(width - cx).hypot(cy.max(height - cy)).max(1.0);
        let gain = |x: usize, y: usize| {
            let r2 = ((x as f64 + 0.5 - cx).hypot(y as f64 + 0.5 - cy) / far).powi(2);
            (1.0 + radial.k.iter().rev().fold(0.0, |sum, k| (sum + k) * r2)).clamp(1e-3, 1e3) as f32
        };
        let gains = Plane::from_fn(self.rgb.width(), self.rgb.height(), gain);
        self.level = gains.as_slice().iter().copied().fold(1.0, f32::max);
        for (colour, gain) in self.rgb.as_mut_slice().iter_mut().zip(gains.as_slice()) {
            *colour = Vec3::select(colour.cmpge(Vec3::ONE), Vec3::splat(self.level), *colour * *gain);
        }
    }
}

/// Rotates the picture upright.
fn turned(picture: &Plane<Vec3>, orientation: Orientation) -> Plane<Vec3> {
    let (swap, flip_x, flip_y) = orientation.to_flips();
    let (width, height) = picture.size();
    let (columns, rows) = if swap { (height, width) } else { (width, height) };
    Plane::from_fn(columns, rows, |x, y| {
        // Flipped first, then transposed.
        let (x, y) = if swap { (y, x) } else { (x, y) };
        picture[(if flip_x { width - 1 - x } else { x }, if flip_y { height - 1 - y } else { y })]
    })
}
