//! OpenEXR: any flat layer, any channels, as float planes in the frame of the display window.

use std::collections::HashSet;
use std::io::Cursor;
use std::path::Path;

use exr::block::UncompressedBlock;
use exr::block::reader::ChunksReader;
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::{AttributeValue, Chromaticities, SampleType};
use exr::meta::header::Header;
use exr::prelude::f16;
use glam::{DVec2, Vec3};
use gonio::picture::{Picture, Plane};
use rayon::prelude::*;

use super::layers::{Chosen, Colours, Selection, choose};
use super::space::{Conversion, DeclaredSpace, InputSpace, SpaceSource};
use super::subsampled::{Subsampled, at_full_resolution};
use super::{Decoded, Encoding, LayerChoice, ReadOptions};
use crate::colour_space::{ColourSpace, Primaries};
use crate::{Error, guard};

/// Number of compressed blocks decoded at a time: enough to occupy all cores with little memory.
const BATCH: usize = 64;

/// Attribute with the radiance at or above which a channel is clipped.
pub(super) const CLIP_LEVEL: &str = "clipLevel";

pub(super) fn decode(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Decoded, Error> {
    let (mut chosen, mut clip, mut chromaticities) = (None, None, None);
    let (width, height, planes) = read_channels(path, bytes, options, |headers| {
        let found = choose(path, headers, options)?;
        let header = &headers[found.selection.layer];
        clip = clip_level(path, header)?;
        chromaticities = header.shared_attributes.chromaticities;
        let selection = found.selection.clone();
        chosen = Some(found);
        Ok(selection)
    })?;
    let no_channels = || Error::damaged(path, "has no channels");
    let Chosen { colours, name, others, .. } = chosen.ok_or_else(no_channels)?;
    let (rgb, alpha): (Vec<Vec3>, _) = match (colours, planes.as_slice()) {
        (Colours::Grey, [y, alpha @ ..]) => (y.iter().map(|&y| Vec3::splat(y)).collect(), alpha),
        (Colours::Rgb, [r, g, b, alpha @ ..]) => {
            (r.iter().zip(g).zip(b).map(|((&r, &g), &b)| Vec3::new(r, g, b)).collect(), alpha)
        }
        (Colours::Chroma, [y, ry, by, alpha @ ..]) => {
            let weights = luminance_weights(chromaticities, options.colour_space);
            let colour = |((&y, &ry), &by): ((&f32, &f32), &f32)| {
                let (r, b) = ((ry + 1.0) * y, (by + 1.0) * y);
                Vec3::new(r, (y - r * weights.x - b * weights.z) / weights.y, b)
            };
            (y.iter().zip(ry).zip(by).map(colour).collect(), alpha)
        }
        _ => return Err(no_channels()),
    };
    let alpha = alpha.first().map(|a| Plane::from_vec(width, height, a.clone()));
    let picture = Picture { rgb: Plane::from_vec(width, height, rgb), alpha };
    let layer = (!others.is_empty()).then_some(LayerChoice { name, others });
    let (conversion, input) = match colours {
        Colours::Grey => (Conversion::None, InputSpace::unconverted("grey", SpaceSource::Grey)),
        Colours::Rgb | Colours::Chroma => {
            let stated = |c| DeclaredSpace::primaries(&primaries(c), SpaceSource::Chromaticities, "the chromaticities");
            chromaticities.map(stated).unwrap_or_default().settle(options.colour_space)
        }
    };
    Ok(Decoded { picture, encoding: Encoding::LinearFloat, full_scale: clip, layer, input, conversion })
}

/// Returns the clip level, if the file has one.
fn clip_level(path: &Path, header: &Header) -> Result<Option<f32>, Error> {
    let name = exr::meta::attribute::Text::from(CLIP_LEVEL);
    match header.own_attributes.other.get(&name).or_else(|| header.shared_attributes.other.get(&name)) {
        None => Ok(None),
        Some(&AttributeValue::F32(level)) if level > 0.0 && level.is_finite() => Ok(Some(level)),
        Some(_) => Err(Error::damaged(path, format!("has an invalid attribute {CLIP_LEVEL}: not a positive number"))),
    }
}

fn primaries(chromaticities: Chromaticities) -> Primaries {
    let Chromaticities { red, green, blue, white } = chromaticities;
    let point = |Vec2(x, y): Vec2<f32>| DVec2::new(f64::from(x), f64::from(y));
    Primaries { red: point(red), green: point(green), blue: point(blue), white: point(white) }
}

/// Returns the luminance weights of red, green and blue. They are those of the file's primaries,
/// else of the given space, else of Rec. 709.
fn luminance_weights(chromaticities: Option<Chromaticities>, given: Option<ColourSpace>) -> Vec3 {
    const REC_709: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);
    let given = given.filter(|space| *space != ColourSpace::Rec709).map(ColourSpace::primaries);
    let weights = chromaticities.map(primaries).or(given).and_then(|primaries| primaries.to_xyz());
    let weights = weights.map(|to_xyz| to_xyz.row(1).as_vec3()).filter(|weights| weights.y.abs() > 1e-3);
    weights.unwrap_or(REC_709)
}

/// Reads the channels that `select` returns for the headers, at full resolution.
///
/// Returns the width and height of the display window and one plane for each channel, zero outside
/// the data window.
pub(crate) fn read_channels(
    path: &Path,
    bytes: &[u8],
    options: &ReadOptions,
    select: impl FnOnce(&[Header]) -> Result<Selection, Error>,
) -> Result<(usize, usize, Vec<Vec<f32>>), Error> {
    let failed = |e| explain(path, e);
    let full = at_full_resolution(bytes);
    let (bytes, sampling) = full.as_ref().map_or((bytes, None), |(bytes, sampling)| (bytes.as_slice(), Some(sampling)));
    guard::catching(path, "OpenEXR", || {
        let reader = exr::block::read(Cursor::new(bytes), false).map_err(failed)?;
        let selection = select(reader.headers())?;
        let sampling = sampling.and_then(|layers| layers.get(selection.layer)).map(Vec::as_slice);
        let mut canvas = Canvas::new(path, &reader.headers()[selection.layer], &selection.channels, sampling, options)?;
        // Pedantic, because an incomplete or damaged offset table would leave holes.
        let mut chunks = reader
            .filter_chunks(true, |_, tile, block| block.layer == selection.layer && tile.level_index == Vec2(0, 0))
            .map_err(failed)?;
        let meta = chunks.meta_data().clone();
        let expected = chunks.expected_chunk_count();
        let mut seen = HashSet::new();
        loop {
            let batch: Vec<_> = chunks.by_ref().take(BATCH).collect::<Result<_, _>>().map_err(failed)?;
            if batch.is_empty() {
                break;
            }
            let blocks: Vec<_> = batch
                .into_par_iter()
                .map(|chunk| match &canvas.subsampled {
                    Some(subsampled) => subsampled.decompress(chunk, &meta),
                    None => UncompressedBlock::decompress_chunk(chunk, &meta, false),
                })
                .collect::<Result<_, _>>()
                .map_err(failed)?;
            for block in blocks {
                seen.insert((block.index.layer, block.index.level, block.index.pixel_position));
                canvas.paint(path, &block, &meta, selection.layer)?;
            }
        }
        // Every block states its position, so two blocks may have the same one.
        if seen.len() != expected {
            return Err(Error::damaged(path, format!("has only {} of {expected} pixel blocks", seen.len())));
        }
        canvas.fill_subsampled();
        Ok((canvas.width, canvas.height, canvas.planes))
    })
}

/// Planes that are filled block by block.
struct Canvas {
    width: usize,
    height: usize,
    /// Position of the data window in the display window.
    offset: (i64, i64),
    /// Destination plane of each channel of the layer.
    plane_of: Vec<Vec<usize>>,
    planes: Vec<Vec<f32>>,
    /// The samples, if the layer has subsampled channels.
    subsampled: Option<Subsampled>,
}

impl Canvas {
    fn new(
        path: &Path,
        header: &Header,
        channels: &[usize],
        sampling: Option<&[Vec2<usize>]>,
        options: &ReadOptions,
    ) -> Result<Self, Error> {
        let size = |v: Vec2<usize>| options.check_size(path, v.x() as u64, v.y() as u64);
        size(header.layer_size)?;
        let display = header.shared_attributes.display_window;
        let (width, height) = size(display.size)?;
        let sampling = sampling.filter(|factors| factors.iter().any(|factors| *factors != Vec2(1, 1)));
        let subsampled = |factors| Subsampled::new(path, header, factors, |channel| channels.contains(&channel));
        let subsampled = sampling.map(subsampled).transpose()?;
        let origin = header.own_attributes.layer_position;
        let offset = |data: i32, display: i32| i64::from(data) - i64::from(display);
        let mut plane_of = vec![Vec::new(); header.channels.list.len()];
        for (plane, &channel) in channels.iter().enumerate() {
            plane_of[channel].push(plane);
        }
        Ok(Self {
            width,
            height,
            offset: (offset(origin.x(), display.position.x()), offset(origin.y(), display.position.y())),
            plane_of,
            planes: vec![vec![0.0; width * height]; channels.len()],
            subsampled,
        })
    }

    /// Interpolates subsampled channels at the pixels.
    fn fill_subsampled(&mut self) {
        let Some(subsampled) = &self.subsampled else { return };
        for (channel, planes) in self.plane_of.iter().enumerate() {
            for &plane in planes {
                subsampled.fill(channel, &mut self.planes[plane], self.width, self.offset);
            }
        }
    }

    fn paint(&mut self, path: &Path, block: &UncompressedBlock, meta: &MetaData, layer: usize) -> Result<(), Error> {
        let header = &meta.headers[layer];
        let channels = &header.channels;
        if let Some(subsampled) = &mut self.subsampled {
            let painted = subsampled.paint(block, channels).filter(|()| block.index.layer == layer);
            return painted.ok_or_else(|| Error::damaged(path, "has a pixel block of the wrong size"));
        }
        let pixels = block.index.pixel_size.area();
        if block.index.layer != layer || block.data.len() != pixels * channels.bytes_per_pixel {
            return Err(Error::damaged(path, "has a pixel block of the wrong size"));
        }
        for line in block.lines(channels) {
            let at = line.location;
            let row = at.position.y() as i64 + self.offset.1;
            if self.plane_of[at.channel].is_empty() || row < 0 || row >= self.height as i64 {
                continue;
            }
            let samples: Vec<f32> = match channels.list[at.channel].sample_type {
                SampleType::F32 => line.read_samples::<f32>().collect::<Result<_, _>>(),
                SampleType::F16 => line.read_samples::<f16>().map(|s| s.map(f16::to_f32)).collect(),
                SampleType::U32 => line.read_samples::<u32>().map(|s| s.map(|s| s as f32)).collect(),
            }
            .map_err(|e| explain(path, e))?;
            // The part of the line inside the display window.
            let left = at.position.x() as i64 + self.offset.0;
            let from = (-left).clamp(0, samples.len() as i64) as usize;
            let to = (self.width as i64 - left).clamp(from as i64, samples.len() as i64) as usize;
            if from == to {
                continue;
            }
            let start = row as usize * self.width + (left + from as i64) as usize;
            for &plane in &self.plane_of[at.channel] {
                self.planes[plane][start..][..to - from].copy_from_slice(&samples[from..to]);
            }
        }
        Ok(())
    }
}

fn explain(path: &Path, error: exr::error::Error) -> Error {
    use exr::error::Error as E;
    match error {
        E::NotSupported(what) => {
            let advice = "write a flat EXR with the channels R, G and B at full resolution";
            Error::unsupported(path, format!("requires {what}, which is not supported"), advice)
        }
        E::Invalid(what) => Error::damaged(path, format!("is a truncated or damaged OpenEXR file ({what})")),
        E::Io(e) => Error::damaged(path, format!("is a truncated or damaged OpenEXR file ({e})")),
        E::Aborted => Error::damaged(path, "was not read completely"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::*;

    fn encode(size: (usize, usize), channels: AnyChannels<FlatSamples>) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        Image::from_channels(size, channels).write().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    }

    fn any(names: &[&str]) -> Vec<u8> {
        let list = names
            .iter()
            .enumerate()
            .map(|(i, &n)| AnyChannel::new(n, FlatSamples::F32(vec![i as f32 + 1.0; 6])))
            .collect();
        encode((3, 2), AnyChannels::sort(list))
    }

    fn first(bytes: &[u8]) -> (glam::Vec3, Option<f32>) {
        let got = super::decode(Path::new("t.exr"), bytes, &ReadOptions::default()).unwrap().picture;
        assert_eq!(got.rgb.size(), (3, 2));
        (got.rgb[(2, 1)], got.alpha.map(|a| a[(2, 1)]))
    }

    #[test]
    fn selects_colour_channels_in_preference_to_others() {
        let rgb = glam::Vec3::new(1.0, 2.0, 3.0);
        assert_eq!(first(&any(&["R", "G", "B"])), (rgb, None));
        assert_eq!(first(&any(&["R", "G", "B", "A", "Z"])), (rgb, Some(4.0)));
        assert_eq!(first(&any(&["View.R", "View.G", "View.B", "View.A"])), (rgb, Some(4.0)));
        assert_eq!(first(&any(&["L.Combined.R", "L.Combined.G", "L.Combined.B", "L.AO.R", "L.AO.G", "L.AO.B"])).0, rgb);
        assert_eq!(first(&any(&["Y", "A"])), (glam::Vec3::ONE, Some(2.0)));
        assert_eq!(first(&any(&["r", "g", "b"])).0, rgb);
    }

    #[test]
    fn errors_list_the_channels_of_files_without_colour() {
        for (names, message) in [(&["Z", "W"][..], "W, Z"), (&["P.X", "P.Y", "P.Z"], "P.Y")] {
            let error = super::decode(Path::new("t.exr"), &any(names), &ReadOptions::default()).unwrap_err();
            assert_eq!(error.kind(), crate::Kind::Unsupported);
            assert!(error.to_string().contains(message), "{error}");
        }
    }

    #[test]
    fn accepts_the_channel_names_of_various_programs() {
        let rgb = glam::Vec3::new(1.0, 2.0, 3.0);
        assert_eq!(first(&any(&["red", "green", "blue", "alpha"])), (rgb, Some(4.0)));
        assert_eq!(first(&any(&["Image.Red", "Image.Green", "Image.Blue"])), (rgb, None));
        assert_eq!(first(&any(&["ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B"])).0, rgb);
        assert_eq!(first(&any(&["beauty_R", "beauty_G", "beauty_B", "Z"])).0, rgb);
        assert_eq!(first(&any(&["cam 1/red", "cam 1/green", "cam 1/blue"])).0, rgb);
        assert_eq!(first(&any(&["luminance"])).0, glam::Vec3::ONE);
        assert_eq!(first(&any(&["P.X", "P.Y", "P.Z", "C.R", "C.G", "C.B"])).0, glam::Vec3::new(4.0, 5.0, 6.0));
    }

    #[test]
    fn luminance_and_chroma_become_colour() {
        let channel = |name: &str, v: f32| AnyChannel::new(name, FlatSamples::F32(vec![v; 6]));
        let colour = glam::Vec3::new(0.9, 0.4, 0.2);
        let y = colour.dot(glam::Vec3::new(0.2126, 0.7152, 0.0722));
        let list = sorted([channel("Y", y), channel("RY", colour.x / y - 1.0), channel("BY", colour.z / y - 1.0)]);
        assert!((first(&encode((3, 2), list)).0 - colour).length() < 1e-6);
    }

    #[test]
    fn layers_are_selected_by_name_and_reported() {
        let names = ["V.Combined.R", "V.Combined.G", "V.Combined.B", "V.Diffuse.R", "V.Diffuse.G", "V.Diffuse.B"];
        let read = |layer: Option<&str>| {
            let options = ReadOptions { layer: layer.map(str::to_owned), ..ReadOptions::default() };
            super::decode(Path::new("t.exr"), &any(&names), &options)
        };
        let got = read(None).unwrap();
        let layer = got.layer.unwrap();
        assert_eq!((layer.name.as_str(), layer.others.as_slice()), ("v.combined", &["v.diffuse".to_owned()][..]));
        for name in ["diffuse", "V.Diffuse"] {
            assert_eq!(read(Some(name)).unwrap().picture.rgb[(0, 0)], glam::Vec3::new(4.0, 5.0, 6.0));
        }
        let error = read(Some("gloss")).unwrap_err().to_string();
        assert_eq!(error, "t.exr: has no image layer gloss; use one of v.combined, v.diffuse");
        assert_eq!(decode_alone(&["R", "G", "B"]).layer, None);
    }

    fn decode_alone(names: &[&str]) -> Decoded {
        super::decode(Path::new("t.exr"), &any(names), &ReadOptions::default()).unwrap()
    }

    #[test]
    fn half_and_integer_samples_become_floats() {
        let list = sorted([
            AnyChannel::new("R", FlatSamples::F16(vec![f16::from_f32(0.5); 6])),
            AnyChannel::new("G", FlatSamples::U32(vec![70_000; 6])),
            AnyChannel::new("B", FlatSamples::F32(vec![-1.0; 6])),
        ]);
        assert_eq!(first(&encode((3, 2), list)).0, glam::Vec3::new(0.5, 70_000.0, -1.0));
    }

    fn sorted(channels: [AnyChannel<FlatSamples>; 3]) -> AnyChannels<FlatSamples> {
        AnyChannels::sort(channels.into_iter().collect())
    }

    #[test]
    fn the_data_window_is_placed_in_the_display_window() {
        let channels = SpecificChannels::rgb(|p: Vec2<usize>| (p.x() as f32 + 1.0, p.y() as f32 + 1.0, 0.0_f32));
        let layer = Layer::new(
            (4, 3),
            LayerAttributes::default().with_position(Vec2(-1, 1)),
            exr::prelude::Encoding::SMALL_LOSSLESS,
            channels,
        );
        let window = IntegerBounds::new((0, 0), (5, 3));
        let mut bytes = Cursor::new(Vec::new());
        Image::new(ImageAttributes::new(window), layer).write().to_buffered(&mut bytes).unwrap();
        let got = super::decode(Path::new("t.exr"), &bytes.into_inner(), &ReadOptions::default()).unwrap().picture.rgb;
        assert_eq!(got.size(), (5, 3));
        assert_eq!(got[(0, 0)], glam::Vec3::ZERO);
        assert_eq!(got[(0, 1)], glam::Vec3::new(2.0, 1.0, 0.0));
        assert_eq!(got[(2, 2)], glam::Vec3::new(4.0, 2.0, 0.0));
        assert_eq!(got[(3, 2)], glam::Vec3::ZERO);
    }

    #[test]
    fn reads_tiled_files_at_full_resolution() {
        let blocks = Blocks::Tiles(Vec2(2, 2));
        let encoding =
            exr::prelude::Encoding { compression: Compression::PIZ, blocks, line_order: LineOrder::Unspecified };
        let channels = SpecificChannels::rgb(|p: Vec2<usize>| (p.x() as f32, p.y() as f32, 7.0_f32));
        let mut bytes = Cursor::new(Vec::new());
        Image::from_encoded_channels((5, 3), encoding, channels).write().to_buffered(&mut bytes).unwrap();
        let got = super::decode(Path::new("t.exr"), &bytes.into_inner(), &ReadOptions::default()).unwrap().picture.rgb;
        assert_eq!(got, Plane::from_fn(5, 3, |x, y| glam::Vec3::new(x as f32, y as f32, 7.0)));
    }
}
