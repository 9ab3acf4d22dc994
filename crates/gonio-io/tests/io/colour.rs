//! Colour information in files: each kind must convert a known colour to its published linear Rec.
//! 709 value.

use std::io::{Cursor, Write};
use std::path::Path;

use exr::prelude::{
    Encoding as ExrEncoding, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes, SpecificChannels, Vec2,
    WritableImage,
};
use flate2::{Compression, Crc, write::ZlibEncoder};
use glam::Vec3;
use gonio_io::colour_space::ColourSpace;
use gonio_io::picture::{Decoded, Encoding, ReadOptions, SpaceSource, decode};
use image::codecs::{jpeg::JpegEncoder, png::PngEncoder, tiff::TiffEncoder};
use image::{ExtendedColorType, ImageEncoder};
use moxcms::{ColorProfile, ToneReprCurve};

const SIDE: usize = 32;

fn read(bytes: &[u8], options: &ReadOptions) -> Decoded {
    decode(Path::new("t"), bytes, options).unwrap()
}

fn as_it_is(bytes: &[u8]) -> Decoded {
    read(bytes, &ReadOptions::default())
}

fn given(space: ColourSpace) -> ReadOptions {
    ReadOptions { colour_space: Some(space), ..ReadOptions::default() }
}

#[track_caller]
fn assert_colour(decoded: &Decoded, want: [f32; 3], tolerance: f32) {
    let got = decoded.picture.rgb[(1, 1)];
    assert!((got - Vec3::from(want)).abs().max_element() < tolerance, "{got}, not {want:?} ({:?})", decoded.input);
}

#[track_caller]
fn assert_space(decoded: &Decoded, name: &str, source: SpaceSource) {
    assert_eq!((decoded.input.name.as_str(), decoded.input.source), (name, source));
}

/// An OpenEXR file of one colour with chromaticities.
fn exr(colour: [f32; 3], xy: Option<[f32; 8]>) -> Vec<u8> {
    let channels = SpecificChannels::rgb(|_: Vec2<usize>| (colour[0], colour[1], colour[2]));
    let layer = Layer::new((SIDE, SIDE), LayerAttributes::default(), ExrEncoding::FAST_LOSSLESS, channels);
    let mut attributes = ImageAttributes::new(IntegerBounds::new((0, 0), (SIDE, SIDE)));
    attributes.chromaticities = xy.map(|[rx, ry, gx, gy, bx, by, wx, wy]| exr::meta::attribute::Chromaticities {
        red: Vec2(rx, ry),
        green: Vec2(gx, gy),
        blue: Vec2(bx, by),
        white: Vec2(wx, wy),
    });
    let mut bytes = Cursor::new(Vec::new());
    Image::new(attributes, layer).write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

const ACES_CG: [f32; 8] = [0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767];

#[test]
fn openexr_chromaticities_are_applied() {
    // The ACES matrix from AP1 to Rec. 709 times (0.5, 0.4, 0.3).
    let want = [0.578_83, 0.388_03, 0.282_30];
    let got = as_it_is(&exr([0.5, 0.4, 0.3], Some(ACES_CG)));
    assert_colour(&got, want, 1e-4);
    assert_space(&got, "acescg", SpaceSource::Chromaticities);

    let plain = exr([0.5, 0.4, 0.3], None);
    assert_colour(&as_it_is(&plain), [0.5, 0.4, 0.3], 0.0_f32.next_up());
    assert_space(&as_it_is(&plain), "rec709", SpaceSource::Assumed);
    let got = read(&plain, &given(ColourSpace::AcesCg));
    assert_colour(&got, want, 1e-4);
    assert_space(&got, "acescg", SpaceSource::Given);

    // CIE XYZ of D65 is white.
    let xyz = exr([0.950_47, 1.0, 1.088_83], Some([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0 / 3.0, 1.0 / 3.0]));
    assert_colour(&as_it_is(&xyz), [1.0; 3], 1e-3);
    assert_space(&as_it_is(&xyz), "xyz", SpaceSource::Chromaticities);

    let got = read(&exr([0.5, 0.4, 0.3], Some(ACES_CG)), &given(ColourSpace::Rec2020));
    assert_eq!(got.input.overridden, Some(ColourSpace::Rec2020));
    let zeros = as_it_is(&exr([0.5, 0.4, 0.3], Some([0.0; 8])));
    assert_colour(&zeros, [0.5, 0.4, 0.3], 1e-6);
    assert!(zeros.input.unusable.is_some());
}

#[test]
fn radiance_primaries_are_applied() {
    let file = |line: &str| {
        let mut bytes = format!("#?RADIANCE\n{line}FORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 2\n").into_bytes();
        // (64, 128, 32) / 256 times 2^1.
        bytes.extend([64, 128, 32, 129].repeat(4));
        bytes
    };
    let (r, g, b) = (0.5_f32, 1.0, 0.25);
    let plain = as_it_is(&file(""));
    assert_colour(&plain, [r, g, b], 0.01);
    assert_space(&plain, "rec709", SpaceSource::Assumed);
    let got = as_it_is(&file("PRIMARIES=0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290\n"));
    let [r, g, b] = plain.picture.rgb[(1, 1)].to_array();
    // Rec. ITU-R BT.2087-0.
    let want = [
        1.6605 * r - 0.5876 * g - 0.0728 * b,
        -0.1246 * r + 1.1329 * g - 0.0083 * b,
        -0.0182 * r - 0.1006 * g + 1.1187 * b,
    ];
    assert_colour(&got, want, 3e-4);
    assert_space(&got, "rec2020", SpaceSource::Primaries);
    let bad = as_it_is(&file("PRIMARIES=0.708 0.292\n"));
    assert_colour(&bad, [r, g, b], 1e-6);
    assert!(bad.input.unusable.unwrap().contains("PRIMARIES"));
}

/// A PNG file of one 8-bit colour with chunks before the pixels.
fn png(colour: [u8; 3], chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let side = SIDE as u32;
    PngEncoder::new(&mut bytes).write_image(&colour.repeat(SIDE * SIDE), side, side, ExtendedColorType::Rgb8).unwrap();
    let mut out = bytes[..33].to_vec();
    for (kind, data) in chunks {
        let mut crc = Crc::new();
        crc.update(&kind[..]);
        crc.update(data);
        out.extend((data.len() as u32).to_be_bytes());
        out.extend([&kind[..], data].concat());
        out.extend(crc.sum().to_be_bytes());
    }
    out.extend(&bytes[33..]);
    out
}

/// Byte range of the date in the header of a profile.
const DATE: std::ops::Range<usize> = 24..36;

/// Encodes a profile with a fixed date. The library writes the time of encoding, but the seeds of
/// the fuzzer are compared byte by byte.
fn encoded(profile: &ColorProfile) -> Vec<u8> {
    let mut bytes = profile.encode().unwrap();
    // The first of January 2026, six numbers of 16 bits.
    let date = [2026_u16, 1, 1, 0, 0, 0];
    bytes[DATE].copy_from_slice(&date.map(u16::to_be_bytes).concat());
    bytes
}

/// Returns the data of an `iCCP` chunk.
fn packed(profile: &ColorProfile) -> Vec<u8> {
    let mut zlib = ZlibEncoder::new(b"profile\0\0".to_vec(), Compression::fast());
    zlib.write_all(&encoded(profile)).unwrap();
    zlib.finish().unwrap()
}

/// Returns integer files with each kind of colour information. The number is that of the bytes that
/// may be missing at the end.
pub(crate) fn tagged() -> Vec<(&'static str, Vec<u8>, usize)> {
    let (p3, colour) = (ColorProfile::new_display_p3(), [200, 100, 50]);
    vec![
        ("p3.png", png(colour, &[(b"iCCP", &packed(&p3))]), 16),
        ("pq.png", png(colour, &[(b"cICP", &[9, 16, 0, 1])]), 16),
        ("gamma.png", png(colour, &[(b"gAMA", &55_556_u32.to_be_bytes())]), 16),
        ("p3.tif", tiff(&p3), 4),
        ("p3.jpg", jpeg(&p3), 0),
    ]
}

/// A TIFF file of the codes 200, 100, 50 with a profile.
fn tiff(profile: &ColorProfile) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes);
    encoder.set_icc_profile(encoded(profile)).unwrap();
    let side = SIDE as u32;
    encoder.write_image(&[200, 100, 50].repeat(SIDE * SIDE), side, side, ExtendedColorType::Rgb8).unwrap();
    bytes.into_inner()
}

/// A JPEG file of the codes 200, 100, 50 with a profile.
fn jpeg(profile: &ColorProfile) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 100);
    encoder.set_icc_profile(encoded(profile)).unwrap();
    let side = SIDE as u32;
    encoder.write_image(&[200, 100, 50].repeat(SIDE * SIDE), side, side, ExtendedColorType::Rgb8).unwrap();
    bytes
}

/// The codes 200, 100, 50 of Display P3 in linear Rec. 709: by the curve of sRGB, then the matrix
/// of CSS Color 4.
const P3: [f32; 3] = [0.678_84, 0.108_51, 0.013_67];

#[test]
fn png_profiles_and_cicp_are_applied() {
    let colour = [200, 100, 50];
    let got = as_it_is(&png(colour, &[(b"iCCP", &packed(&ColorProfile::new_display_p3()))]));
    assert_colour(&got, P3, 2e-3);
    assert_space(&got, "display-p3", SpaceSource::Icc);
    assert_eq!(got.encoding, Encoding::Srgb { bits: 8 });

    let got = as_it_is(&png(colour, &[(b"cICP", &[12, 13, 0, 1])]));
    assert_colour(&got, P3, 1e-4);
    assert_space(&got, "display-p3", SpaceSource::Cicp);

    // PQ: code 153 of grey is 0.6, 244 cd/m2 (SMPTE ST 2084), for all primaries.
    let got = as_it_is(&png([153; 3], &[(b"cICP", &[9, 16, 0, 1])]));
    assert_colour(&got, [0.024_4; 3], 2e-4);
    assert_space(&got, "rec2020", SpaceSource::Cicp);
    assert_eq!((got.encoding, got.full_scale), (Encoding::Coded { bits: 8 }, Some(1.0)));

    // The narrow range: 16 is black, 235 is white.
    let narrow = |code| as_it_is(&png([code; 3], &[(b"cICP", &[1, 8, 0, 0])]));
    assert_colour(&narrow(16), [0.0; 3], 1e-6);
    assert_colour(&narrow(235), [1.0; 3], 1e-6);

    // cICP takes precedence over a profile.
    let both = png(colour, &[(b"cICP", &[1, 13, 0, 1]), (b"iCCP", &packed(&ColorProfile::new_display_p3()))]);
    assert_space(&as_it_is(&both), "rec709", SpaceSource::Cicp);
}

#[test]
fn png_gamma_and_chromaticities_are_applied() {
    let (linear, gamma) = (100_000_u32.to_be_bytes(), 55_556_u32.to_be_bytes());
    let got = as_it_is(&png([51, 102, 255], &[(b"gAMA", &linear)]));
    assert_colour(&got, [0.2, 0.4, 1.0], 1e-6);
    assert_eq!(got.encoding, Encoding::Linear { bits: 8 });
    let got = as_it_is(&png([51, 102, 255], &[(b"gAMA", &gamma)]));
    assert_colour(&got, [0.2_f32.powf(1.8), 0.4_f32.powf(1.8), 1.0], 1e-4);

    let white_first = [31270_u32, 32900, 68000, 32000, 26500, 69000, 15000, 6000];
    let chrm: Vec<u8> = white_first.iter().flat_map(|n| n.to_be_bytes()).collect();
    let got = as_it_is(&png([200, 100, 50], &[(b"cHRM", &chrm)]));
    assert_colour(&got, P3, 1e-4);
    assert_space(&got, "display-p3", SpaceSource::Chunks);
    // sRGB takes precedence over both.
    let got = as_it_is(&png([51; 3], &[(b"gAMA", &linear), (b"cHRM", &chrm), (b"sRGB", &[0])]));
    assert_colour(&got, [0.033_105; 3], 1e-5);
    assert_space(&got, "rec709", SpaceSource::Chunks);
}

#[test]
fn options_apply_to_files_without_colour_information() {
    let plain = png([200, 100, 50], &[]);
    assert_colour(&read(&plain, &given(ColourSpace::DisplayP3)), P3, 1e-4);
    // ACEScg has no curve.
    let got = read(&png([128; 3], &[]), &given(ColourSpace::AcesCg));
    assert_colour(&got, [128.0 / 255.0; 3], 1e-5);
    // The primaries of the file apply even if the caller specifies linear values.
    let tagged = png([200, 100, 50], &[(b"iCCP", &packed(&ColorProfile::new_display_p3()))]);
    let got = read(&tagged, &ReadOptions { linear: true, ..ReadOptions::default() });
    let [r, g, b] = [200.0, 100.0, 50.0_f32].map(|v| v / 255.0);
    assert_colour(
        &got,
        [1.224_94 * r - 0.224_94 * g, -0.042_06 * r + 1.042_06 * g, -0.019_64 * r - 0.078_64 * g + 1.098_27 * b],
        2e-3,
    );
    assert_eq!(got.encoding, Encoding::Linear { bits: 8 });
}

#[test]
fn tiff_and_jpeg_profiles_are_applied() {
    let (p3, side) = (ColorProfile::new_display_p3(), SIDE as u32);
    let got = as_it_is(&tiff(&p3));
    assert_colour(&got, P3, 2e-3);
    assert_space(&got, "display-p3", SpaceSource::Icc);
    let got = as_it_is(&jpeg(&p3));
    assert_colour(&got, P3, 0.02);
    assert_space(&got, "display-p3", SpaceSource::Icc);

    // A linear float file in ACEScg.
    let mut tiff = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut tiff);
    encoder.set_icc_profile(ColorProfile::new_aces_cg_linear().encode().unwrap()).unwrap();
    let floats: Vec<u8> = [5.0_f32, 4.0, 3.0].repeat(SIDE * SIDE).iter().flat_map(|v| v.to_ne_bytes()).collect();
    encoder.write_image(&floats, side, side, ExtendedColorType::Rgb32F).unwrap();
    let got = as_it_is(&tiff.into_inner());
    assert_colour(&got, [5.788_3, 3.880_3, 2.823_0], 0.01);
    assert_eq!((got.encoding, got.full_scale), (Encoding::LinearFloat, None));
}

#[test]
fn grey_profiles_are_applied_and_damaged_ones_ignored() {
    let side = SIDE as u32;
    let mut tiff = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut tiff);
    encoder.set_icc_profile(ColorProfile::new_gray_with_gamma(1.8).encode().unwrap()).unwrap();
    encoder.write_image(&vec![102; SIDE * SIDE], side, side, ExtendedColorType::L8).unwrap();
    let got = as_it_is(&tiff.into_inner());
    assert_colour(&got, [0.4_f32.powf(1.8); 3], 3e-3);
    assert_space(&got, "grey", SpaceSource::Grey);

    let mut curve = ColorProfile::new_display_p3();
    curve.green_trc = Some(ToneReprCurve::Lut(vec![0, 65535]));
    curve.red_trc = curve.green_trc.clone();
    curve.blue_trc = curve.green_trc.clone();
    let linear = as_it_is(&png([51, 51, 51], &[(b"iCCP", &packed(&curve))]));
    assert_colour(&linear, [0.2; 3], 1e-3);
    assert_eq!(linear.encoding, Encoding::Linear { bits: 8 });

    let broken = as_it_is(&png([200, 100, 50], &[(b"iCCP", b"name\0\0no profile at all")]));
    assert_space(&broken, "rec709", SpaceSource::Assumed);
}
