use std::io::Write;

use exr::math::Vec2;
use exr::meta::BlockDescription;
use exr::meta::attribute::{ChannelDescription, IntegerBounds};
use exr::meta::header::Header;
use exr::prelude::{Compression, LineOrder};
use glam::Vec3;

use super::*;
use crate::picture::{ReadOptions, decode};
use crate::{Error, Kind};

const SIZE: (usize, usize) = (24, 40);
const REC_709: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Name, sample type and sampling of a channel.
type Channel = (&'static str, SampleType, Vec2<usize>);

const LUMINANCE_CHROMA: [Channel; 3] =
    [("BY", SampleType::F16, Vec2(2, 2)), ("RY", SampleType::F16, Vec2(2, 2)), ("Y", SampleType::F16, Vec2(1, 1))];

/// Compressions that preserve the samples, and the number that denotes each in a file.
const LOSSLESS: [(u8, Compression); 6] = [
    (0, Compression::Uncompressed),
    (1, Compression::RLE),
    (2, Compression::ZIP1),
    (3, Compression::ZIP16),
    (4, Compression::PIZ),
    (5, Compression::PXR24),
];

/// Encodes a file of scan lines of [`SIZE`]; `sample` returns a sample from channel, x and y. `top`
/// is the y coordinate of the data window in a display window that begins at 0.
fn file(
    (code, compression): (u8, Compression),
    channels: &[Channel],
    top: i32,
    sample: impl Fn(usize, usize, usize) -> f32,
) -> Vec<u8> {
    let list: Vec<_> = channels.iter().map(|(name, kind, _)| ChannelDescription::named(*name, *kind)).collect();
    let mut header = Header::new("".into(), Vec2(SIZE.0, SIZE.1), list.into()).with_encoding(
        compression,
        BlockDescription::ScanLines,
        LineOrder::Increasing,
    );
    for (channel, (_, _, factors)) in header.channels.list.iter_mut().zip(channels) {
        channel.sampling = *factors;
    }
    let rows = compression.scan_lines_per_block();
    let mut blocks = Vec::new();
    for first in (0..SIZE.1).step_by(rows) {
        let rows = rows.min(SIZE.1 - first);
        let mut data = Vec::new();
        for y in first..first + rows {
            for (index, (_, kind, factors)) in channels.iter().enumerate().filter(|(_, c)| y.is_multiple_of(c.2.y())) {
                for value in (0..SIZE.0).step_by(factors.x()).map(|x| sample(index, x, y)) {
                    match kind {
                        SampleType::F16 => data.extend(f16::from_f32(value).to_ne_bytes()),
                        SampleType::F32 => data.extend(value.to_ne_bytes()),
                        SampleType::U32 => data.extend((value as u32).to_ne_bytes()),
                    }
                }
            }
        }
        header.channels.bytes_per_pixel = data.len() / (rows * SIZE.0);
        let place = IntegerBounds::new(Vec2(0, first as i32), Vec2(SIZE.0, rows));
        let packed = match compression {
            // These encoders of the crate do not support subsampling.
            Compression::PXR24 => transposed_differences(&data, first..first + rows, channels),
            Compression::B44A => data,
            _ => compression.compress_image_section_to_le(&header, data, place).unwrap(),
        };
        blocks.push([&(top + first as i32).to_le_bytes()[..], &(packed.len() as i32).to_le_bytes(), &packed].concat());
    }
    let text = |text: &str| [text.as_bytes(), b"\0"].concat();
    let numbers = |numbers: &[i32]| numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    let mut list = Vec::new();
    for (name, kind, Vec2(x, y)) in channels {
        let kind = [SampleType::U32, SampleType::F16, SampleType::F32].iter().position(|k| k == kind).unwrap();
        list.extend([text(name), numbers(&[kind as i32, 0, *x as i32, *y as i32])].concat());
    }
    list.push(0);
    let bottom = |first: i32| first + SIZE.1 as i32 - 1;
    let right = SIZE.0 as i32 - 1;
    let mut bytes = numbers(&[20_000_630, 2]);
    for (name, kind, data) in [
        ("channels", "chlist", list),
        ("compression", "compression", vec![code]),
        ("dataWindow", "box2i", numbers(&[0, top, right, bottom(top)])),
        ("displayWindow", "box2i", numbers(&[0, 0, right, bottom(0)])),
        ("lineOrder", "lineOrder", vec![0]),
        ("pixelAspectRatio", "float", 1_f32.to_le_bytes().to_vec()),
        ("screenWindowCenter", "v2f", vec![0; 8]),
        ("screenWindowWidth", "float", 1_f32.to_le_bytes().to_vec()),
    ] {
        bytes.extend([text(name), text(kind), numbers(&[data.len() as i32]), data].concat());
    }
    bytes.push(0);
    let mut at = (bytes.len() + 8 * blocks.len()) as u64;
    for block in &blocks {
        bytes.extend(at.to_le_bytes());
        at += block.len() as u64;
    }
    [bytes, blocks.concat()].concat()
}

/// Compresses rows of half floats by PXR24: the high bytes of the differences in a line, then the
/// low bytes.
fn transposed_differences(data: &[u8], rows: std::ops::Range<usize>, channels: &[Channel]) -> Vec<u8> {
    let mut halves = data.chunks_exact(2).map(|b| u16::from_ne_bytes([b[0], b[1]]));
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    for (_, _, factors) in rows.flat_map(|y| channels.iter().filter(move |c| y.is_multiple_of(c.2.y()))) {
        let line: Vec<u16> = halves.by_ref().take(SIZE.0 / factors.x()).collect();
        let before = std::iter::once(0).chain(line.iter().copied());
        let differences: Vec<[u8; 2]> = line.iter().zip(before).map(|(v, b)| v.wrapping_sub(b).to_be_bytes()).collect();
        for byte in [0, 1] {
            packed.write_all(&differences.iter().map(|d| d[byte]).collect::<Vec<u8>>()).unwrap();
        }
    }
    packed.finish().unwrap()
}

fn read(bytes: &[u8]) -> Result<gonio::picture::Picture, Error> {
    decode(Path::new("t.exr"), bytes, &ReadOptions::default()).map(|decoded| decoded.picture)
}

/// Luminance and linear chroma: the interpolation is exact.
fn luminance_chroma(channel: usize, x: usize, y: usize) -> f32 {
    let (x, y) = (x as f32, y as f32);
    match channel {
        0 => 0.25 - x / 64.0,
        1 => y / 128.0 - 0.125,
        _ => 1.0 + (x + y) % 4.0,
    }
}

/// Colour of luminance and chroma, by the definition of the channels.
fn colour(x: usize, y: usize) -> Vec3 {
    // The chroma of the last row and column is that of the last sample.
    let at = |channel| luminance_chroma(channel, x.min(SIZE.0 - 2), y.min(SIZE.1 - 2));
    let luminance = luminance_chroma(2, x, y);
    let (r, b) = ((at(1) + 1.0) * luminance, (at(0) + 1.0) * luminance);
    Vec3::new(r, (luminance - r * REC_709.x - b * REC_709.z) / REC_709.y, b)
}

#[test]
fn luminance_chroma_files_of_all_compressions_become_colours() {
    for compression in LOSSLESS {
        let rgb = read(&file(compression, &LUMINANCE_CHROMA, 0, luminance_chroma)).unwrap().rgb;
        assert_eq!(rgb.size(), SIZE);
        for (x, y) in [(0, 0), (1, 0), (0, 1), (7, 9), (8, 31), (9, 32), (23, 39)] {
            assert!((rgb[(x, y)] - colour(x, y)).length() < 1e-5, "{compression:?} {x},{y}: {}", rgb[(x, y)]);
        }
    }
    let error = read(&file((7, Compression::B44A), &LUMINANCE_CHROMA, 0, luminance_chroma)).unwrap_err();
    assert_eq!(error.kind(), Kind::Unsupported);
    assert!(error.to_string().contains("luminance-chroma") && error.to_string().contains("oiiotool"), "{error}");
}

#[test]
fn channels_may_have_any_sampling_and_type() {
    let channels = [
        ("A", SampleType::F32, Vec2(2, 1)),
        ("B", SampleType::U32, Vec2(1, 1)),
        ("G", SampleType::F32, Vec2(4, 4)),
        ("R", SampleType::F16, Vec2(1, 2)),
    ];
    let sample = |channel: usize, x: usize, y: usize| (channel * 100 + x + 2 * y) as f32;
    // The rows have different lengths, which only compressions of single rows allow here.
    for compression in &LOSSLESS[..3] {
        let Some(picture) = read(&file(*compression, &channels, 0, sample)).ok() else { continue };
        let want = Vec3::new(sample(3, 10, 13), sample(2, 10, 13), sample(1, 10, 13));
        assert_eq!((picture.rgb[(10, 13)], picture.alpha.unwrap()[(10, 13)]), (want, sample(0, 10, 13)));
    }
    let error = read(&file(LOSSLESS[3], &channels, 0, sample)).err();
    assert!(error.is_none_or(|error| error.kind() == Kind::Unsupported));
}

#[test]
fn the_display_window_defines_the_picture() {
    let rgb = read(&file(LOSSLESS[3], &LUMINANCE_CHROMA, 8, luminance_chroma)).unwrap().rgb;
    assert_eq!((rgb.size(), rgb[(5, 7)]), (SIZE, Vec3::ZERO));
    assert!((rgb[(5, 8 + 3)] - colour(5, 3)).length() < 1e-5);
}

#[test]
fn damaged_files_are_rejected() {
    let good = file(LOSSLESS[3], &LUMINANCE_CHROMA, 0, luminance_chroma);
    for cut in (8..good.len()).step_by(5) {
        assert_eq!(read(&good[..cut]).unwrap_err().kind(), Kind::Damaged, "{cut}");
    }
    for (at, value) in (0..good.len()).flat_map(|at| [(at, 0), (at, 1), (at, 0xff)]) {
        let mut bad = good.clone();
        bad[at] = value;
        let _ = read(&bad);
    }
    // The window begins between the samples.
    let error = read(&file(LOSSLESS[3], &LUMINANCE_CHROMA, 7, luminance_chroma)).unwrap_err();
    assert!(error.to_string().contains("no multiple of the subsampling"), "{error}");
}
