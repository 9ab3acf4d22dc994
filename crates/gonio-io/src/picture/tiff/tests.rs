use glam::Vec3;

use super::*;
use crate::geometry::{DepthOptions, decode_depth};
use crate::picture::{Decoded, Encoding, decode};
use crate::{Error, Kind};

const SIZE: (usize, usize) = (20, 18);

/// How a test file stores its samples.
#[derive(Clone, Debug)]
struct Layout {
    big_endian: bool,
    /// In tiles of 16 by 16, else in strips of 4 rows.
    tiled: bool,
    planar: bool,
    bits: u16,
    /// Value of SampleFormat, if there is one.
    format: Option<u16>,
    photometric: u16,
    channels: usize,
    /// Values of ExtraSamples.
    extra: Vec<u16>,
}

const RGB: Layout = Layout {
    big_endian: false,
    tiled: false,
    planar: false,
    bits: 32,
    format: None,
    photometric: 2,
    channels: 3,
    extra: Vec::new(),
};

/// Bytes of a number in the byte order of a file.
fn number(big_endian: bool, length: usize, value: u64) -> Vec<u8> {
    let bytes = &value.to_le_bytes()[..length];
    if big_endian { bytes.iter().rev().copied().collect() } else { bytes.to_vec() }
}

/// Encodes a picture of [`SIZE`]; `sample` returns the bits of a sample from x, y and channel.
fn file(layout: &Layout, sample: impl Fn(usize, usize, usize) -> u64) -> Vec<u8> {
    let Layout { big_endian, tiled, planar, bits, format, photometric, channels, ref extra } = *layout;
    let number = |length: usize, value: usize| number(big_endian, length, value as u64);
    let (width, height) = SIZE;
    let (cell_width, cell_height) = if tiled { (16, 16) } else { (width, 4) };
    let planes: Vec<Vec<usize>> =
        if planar { (0..channels).map(|c| vec![c]).collect() } else { vec![(0..channels).collect()] };
    let mut chunks: Vec<Vec<u8>> = Vec::new();
    for plane in &planes {
        for top in (0..height).step_by(cell_height) {
            for left in (0..width).step_by(cell_width) {
                // Tiles are padded, strips are not.
                let rows = if tiled { cell_height } else { cell_height.min(height - top) };
                let mut chunk = Vec::new();
                for (y, x) in (top..top + rows).flat_map(|y| (left..left + cell_width).map(move |x| (y, x))) {
                    for &channel in plane {
                        let value = if x < width && y < height { sample(x, y, channel) } else { 0 };
                        chunk.extend(super::tests::number(big_endian, usize::from(bits) / 8, value));
                    }
                }
                chunks.push(chunk);
            }
        }
    }
    let one = |tag: usize, value: usize| (tag, vec![value]);
    let mut offsets = Vec::new();
    let mut data = Vec::new();
    for chunk in &chunks {
        offsets.push(8 + data.len());
        data.extend(chunk);
    }
    let lengths: Vec<usize> = chunks.iter().map(Vec::len).collect();
    let mut tags = vec![one(256, width), one(257, height), one(258, bits.into()), one(259, 1)];
    tags.extend([one(262, photometric.into()), one(277, channels), one(284, if planar { 2 } else { 1 })]);
    if tiled {
        tags.extend([one(322, 16), one(323, 16), (324, offsets), (325, lengths)]);
    } else {
        tags.extend([(273, offsets), one(278, cell_height), (279, lengths)]);
    }
    if !extra.is_empty() {
        tags.push((338, extra.iter().map(|v| usize::from(*v)).collect()));
    }
    tags.extend(format.map(|format| one(339, format.into())));
    tags.sort();
    // Values of several numbers lie between the samples and the directory.
    let entries: Vec<Vec<u8>> = tags
        .iter()
        .map(|(tag, values)| {
            // Libraries write extra samples in 16 bits.
            if *tag == 338 {
                let mut inline = values.iter().flat_map(|v| number(2, *v)).collect::<Vec<u8>>();
                inline.resize(4, 0);
                return [number(2, *tag), number(2, 3), number(4, values.len()), inline].concat();
            }
            let at = 8 + data.len();
            let value = if let [value] = values[..] {
                value
            } else {
                values.iter().for_each(|value| data.extend(number(4, *value)));
                at
            };
            [number(2, *tag), number(2, 4), number(4, values.len()), number(4, value)].concat()
        })
        .collect();
    let magic = if big_endian { b"MM" } else { b"II" };
    let head = [magic.to_vec(), number(2, 42), number(4, 8 + data.len())].concat();
    [head, data, number(2, entries.len()), entries.concat(), number(4, 0)].concat()
}

fn read(bytes: &[u8]) -> Result<Decoded, Error> {
    decode(Path::new("t.tif"), bytes, &ReadOptions { linear: true, ..ReadOptions::default() })
}

fn code(x: usize, y: usize, channel: usize) -> u64 {
    (x * 8_000_000 + y * 200_000_000 + channel * 7) as u64
}

fn value(x: usize, y: usize, channel: usize) -> f32 {
    x as f32 - 0.5 * y as f32 + 100.0 * channel as f32
}

/// Bits of [`value`] as a float of 16, 32 or 64 bits.
fn float(bits: u16) -> impl Fn(usize, usize, usize) -> u64 {
    move |x, y, channel| match bits {
        16 => exr::prelude::f16::from_f32(value(x, y, channel)).to_bits().into(),
        32 => value(x, y, channel).to_bits().into(),
        _ => f64::from(value(x, y, channel)).to_bits(),
    }
}

/// All combinations of byte order, strips or tiles, and interleaved or separate channels.
fn variants(base: &Layout) -> impl Iterator<Item = Layout> {
    (0..8).map(|i| Layout { big_endian: i & 1 > 0, tiled: i & 2 > 0, planar: i & 4 > 0, ..base.clone() })
}

#[test]
fn reads_integers_of_32_and_64_bits_in_all_layouts() {
    for format in [None, Some(1)] {
        for layout in variants(&Layout { format, ..RGB }) {
            let got = read(&file(&layout, code)).unwrap();
            assert_eq!((got.encoding, got.full_scale), (Encoding::Linear { bits: 32 }, Some(1.0)), "{layout:?}");
            assert_eq!(got.picture.rgb.size(), SIZE);
            for (x, y) in [(0, 0), (19, 17), (3, 16), (17, 2)] {
                let want = [0, 1, 2].map(|c| (code(x, y, c) as f64 / 4_294_967_295.0) as f32);
                assert_eq!(got.picture.rgb[(x, y)].to_array(), want, "{layout:?}, pixel {x},{y}");
            }
        }
    }
    let bytes = file(&Layout { bits: 64, ..RGB }, |x, y, c| code(x, y, c) << 32);
    let (got, want) = (read(&bytes).unwrap().picture.rgb[(5, 9)].x, code(5, 9, 0) as f32 / 2_f32.powi(32));
    assert!((got - want).abs() < 1e-6, "{got} {want}");
}

#[test]
fn integers_of_32_bits_are_decoded_as_srgb_by_default() {
    let bytes = file(&RGB, |_, _, channel| [u64::from(u32::MAX), 1 << 31, 0][channel]);
    let got = decode(Path::new("t.tif"), &bytes, &ReadOptions::default()).unwrap();
    assert_eq!(got.encoding, Encoding::Srgb { bits: 32 });
    assert!((got.picture.rgb[(4, 4)] - Vec3::new(1.0, 0.2140411, 0.0)).length() < 1e-5);
}

#[test]
fn reads_floats_of_all_widths_in_all_layouts() {
    for bits in [16, 32, 64] {
        for layout in variants(&Layout { bits, format: Some(3), ..RGB }) {
            let got = read(&file(&layout, float(bits))).unwrap();
            assert_eq!((got.encoding, got.full_scale), (Encoding::LinearFloat, None), "{layout:?}");
            for (x, y) in [(0, 0), (19, 17), (3, 16), (17, 2)] {
                let want = [0, 1, 2].map(|c| value(x, y, c));
                assert_eq!(got.picture.rgb[(x, y)].to_array(), want, "{layout:?}, pixel {x},{y}");
            }
        }
    }
}

#[test]
fn reads_integers_of_8_and_16_bits_in_all_layouts() {
    for bits in [8, 16] {
        for layout in variants(&Layout { bits, ..RGB }) {
            let got = read(&file(&layout, |x, y, c| (x + 3 * y + 50 * c) as u64)).unwrap().picture.rgb;
            let largest = if bits == 8 { 255.0 } else { 65535.0 };
            for (x, y) in [(0, 0), (19, 17), (3, 16), (17, 2)] {
                let want = [0, 1, 2].map(|c| (x + 3 * y + 50 * c) as f32 / largest);
                assert_eq!(got[(x, y)].to_array(), want, "{layout:?}, pixel {x},{y}");
            }
        }
    }
}

#[test]
fn reads_grey_and_alpha() {
    let grey = Layout { photometric: 1, channels: 1, format: Some(3), ..RGB };
    for layout in variants(&grey) {
        let bytes = file(&layout, float(32));
        let got = read(&bytes).unwrap();
        assert_eq!((got.picture.rgb[(19, 17)], &got.picture.alpha), (Vec3::splat(value(19, 17, 0)), &None));
        assert_eq!(got.input.name, "grey");
        let depth = decode_depth(Path::new("t.tif"), &bytes, &DepthOptions::default()).unwrap();
        assert_eq!(depth[(19, 3)], Some(f64::from(value(19, 3, 0))));
    }
    let alpha = |base: &Layout| Layout { channels: base.channels + 1, extra: vec![2], ..base.clone() };
    for layout in variants(&alpha(&grey)).chain(variants(&alpha(&Layout { format: Some(3), ..RGB }))) {
        let got = read(&file(&layout, float(32))).unwrap().picture;
        let last = layout.channels - 1;
        assert_eq!(got.alpha.unwrap()[(7, 11)], value(7, 11, last), "{layout:?}");
        assert_eq!((got.rgb[(7, 11)].x, got.rgb[(7, 11)].y), (value(7, 11, 0), value(7, 11, last.min(3) / 3)));
    }
    // White is zero.
    let got = read(&file(&Layout { photometric: 0, ..grey }, float(32))).unwrap();
    assert_eq!(got.picture.rgb[(2, 0)].x, 1.0 - value(2, 0, 0));
}

#[test]
fn other_channels_are_ignored_and_three_bands_are_colours() {
    for layout in variants(&Layout { channels: 5, extra: vec![0, 0], format: Some(3), ..RGB }) {
        let got = read(&file(&layout, float(32))).unwrap().picture;
        let want = [0, 1, 2].map(|c| value(7, 11, c));
        assert_eq!((got.rgb[(7, 11)].to_array(), got.alpha), (want, None), "{layout:?}");
    }
    let bands = Layout { photometric: 1, extra: vec![0, 0], format: Some(3), ..RGB };
    let got = read(&file(&bands, float(32))).unwrap().picture;
    assert_eq!(got.rgb[(7, 11)].to_array(), [0, 1, 2].map(|c| value(7, 11, c)));
}

#[test]
fn unsupported_and_damaged_files_are_rejected() {
    for (layout, message) in [
        (Layout { format: Some(2), ..RGB }, "signed integers"),
        (Layout { photometric: 1, channels: 2, format: Some(3), ..RGB }, "2 channels that are neither grey nor RGB"),
    ] {
        let error = read(&file(&layout, code)).unwrap_err();
        assert!(error.kind() == Kind::Unsupported && error.to_string().contains(message), "{error}");
    }
    for layout in variants(&Layout { format: Some(3), ..RGB }) {
        let bytes = file(&layout, float(32));
        let options = ReadOptions { max_pixels: 359, ..ReadOptions::default() };
        assert_eq!(decode(Path::new("t"), &bytes, &options).unwrap_err().kind(), Kind::Limits);
        for cut in (4..bytes.len()).step_by(97) {
            assert_eq!(read(&bytes[..cut]).unwrap_err().kind(), Kind::Damaged, "{layout:?} {cut}");
        }
    }
}

/// Encodes a TIFF of one strip from its size, bits, photometric interpretation and ExtraSamples.
fn strip(size: (u32, u32), bits: u16, photometric: u16, samples: u16, extra: &[u16], data: &[u8]) -> Vec<u8> {
    let mut bytes = b"II\x2a\0\x08\0\0\0".to_vec();
    let after = 8 + 2 + 9 * 12 + 4;
    let extra_bytes: Vec<u8> = extra.iter().flat_map(|kind| kind.to_le_bytes()).collect();
    let inline = extra_bytes.len() <= 4;
    let start = after + if inline { 0 } else { extra_bytes.len() };
    let mut inlined = [0; 4];
    if inline {
        inlined[..extra_bytes.len()].copy_from_slice(&extra_bytes);
    } else {
        inlined = (after as u32).to_le_bytes();
    }
    let entries: [(u16, u16, u32, [u8; 4]); 9] = [
        (256, 4, 1, size.0.to_le_bytes()),
        (257, 4, 1, size.1.to_le_bytes()),
        (258, 3, 1, u32::from(bits).to_le_bytes()),
        (259, 3, 1, 1_u32.to_le_bytes()),
        (262, 3, 1, u32::from(photometric).to_le_bytes()),
        (273, 4, 1, (start as u32).to_le_bytes()),
        (277, 3, 1, u32::from(samples).to_le_bytes()),
        (279, 4, 1, (data.len() as u32).to_le_bytes()),
        (338, 3, extra.len() as u32, inlined),
    ];
    bytes.extend(9_u16.to_le_bytes());
    for (tag, kind, count, value) in entries {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        bytes.extend(value);
    }
    bytes.extend([0; 4]);
    if !inline {
        bytes.extend(&extra_bytes);
    }
    bytes.extend(data);
    bytes
}

#[test]
fn rejects_too_many_channels_and_fewer_than_eight_bits() {
    let read = |bytes: &[u8]| decode("a.tif".as_ref(), bytes, &ReadOptions::default()).unwrap_err().to_string();
    // A row of all channels has 137 GB.
    let wide = strip((1 << 21, 1), 8, 2, u16::MAX, &[0; 65_532], &[0; 64]);
    let error = read(&wide);
    assert!(error.contains("65535 channels of 2097152 columns"), "{error}");
    // Grey and alpha of four bits share a byte.
    let packed = strip((8, 8), 4, 1, 2, &[2], &[0x5a; 64]);
    let error = read(&packed);
    assert!(error.contains("8 or more bits"), "{error}");
}

/// A file of one pixel with a profile at the end; `big` is BigTIFF.
fn with_profile(big: bool, big_endian: bool) -> Vec<u8> {
    let number = |value: usize, length: usize| number(big_endian, length, value as u64);
    // Lengths in bytes of an offset and of the number of entries, and the type of an offset.
    let (offset, counter, kind) = if big { (8, 8, 16) } else { (4, 2, 4) };
    let profile = b"a profile";
    let header = if big { 16 } else { 8 };
    let tags = [(256, 1), (257, 1), (258, 8), (259, 1), (262, 1), (273, header), (277, 1), (278, 1), (279, 1)];
    // After the header and the pixel.
    let directory = header + 1;
    let end = directory + counter + (tags.len() + 1) * (4 + 2 * offset) + offset;
    let mut out = if big_endian { b"MM".to_vec() } else { b"II".to_vec() };
    out.extend(number(if big { 43 } else { 42 }, 2));
    if big {
        out.extend([number(8, 2), number(0, 2)].concat());
    }
    out.extend(number(directory, offset));
    out.push(100);
    out.extend(number(tags.len() + 1, counter));
    let entries = tags.map(|(tag, value)| (tag, kind, 1, value)).into_iter();
    for (tag, kind, length, value) in entries.chain([(34_675, 7, profile.len(), end)]) {
        out.extend([number(tag, 2), number(kind, 2), number(length, offset), number(value, offset)].concat());
    }
    out.extend(number(0, offset));
    out.extend(profile);
    out
}

#[test]
fn reads_profiles_of_all_file_variants() {
    for (big, big_endian) in [(false, false), (false, true), (true, false), (true, true)] {
        let bytes = with_profile(big, big_endian);
        assert_eq!(icc_profile(&bytes).as_deref(), Some(&b"a profile"[..]), "big {big}, big-endian {big_endian}");
        for cut in 0..bytes.len() {
            assert_eq!(icc_profile(&bytes[..cut]), None, "{cut}");
        }
        for at in 0..bytes.len() {
            let mut bad = bytes.clone();
            bad[at] = 0xff;
            let _ = icc_profile(&bad);
        }
    }
}
