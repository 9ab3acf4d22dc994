//! Tests of model files: round trips and rejected files.

use std::sync::LazyLock;

use gonio::appearance::disk::{CHANNELS, GLOBALS};
use gonio::colour::{ColourModel, LightComponent};
use gonio::inference::learnt::{Candidates, Encoder, EncoderShape};
use gonio::lighting::{CoefficientPrior, PriorGroup, RectifiedGaussian, ScaleMixture};
use gonio::reflectance::{CELLS, Dictionary, DictionarySettings, LogBasis};
use gonio::sphere::OctahedralMap;

use super::*;
use crate::Kind;

/// A model with numbers that need full precision and names that need escapes.
fn toy(k: usize, materials: usize) -> Model {
    let number = |i: usize| 1.0 / (3.0 + i as f64 + 1e-9 * (i * i) as f64);
    let groups = (0..PriorGroup::all(5).len()).map(|i| match i {
        1 => CoefficientPrior::Rectified(RectifiedGaussian { location: 0.1 / 3.0, variance: 0.02, threshold: -0.1 }),
        i => {
            let w = number(i);
            CoefficientPrior::Mixture(ScaleMixture {
                weights: vec![w, 1.0 - w],
                variances: vec![w * 1e-300, number(i)],
            })
        }
    });
    let groups = groups.collect();
    let light = LightPrior { map: OctahedralMap::PraunHoppe, scales: 5, groups, lights: 72 };
    let function = |k: usize| BivariateTable::from_fn(move |h, d| (-h * (k + 1) as f64).exp() * (1.0 + d) / 3.0);
    let material = |m: usize| TrainingMaterial {
        name: format!("m\"{m}\" \u{e9}\n"),
        scale: number(m),
        coefficients: (0..k).map(|k| number(m * 31 + k)).collect(),
    };
    let reflectance = ReflectanceBasis {
        functions: (0..k).map(function).collect(),
        rates: (0..k).map(number).collect(),
        materials: (0..materials).map(material).collect(),
    };
    Model { light, reflectance, learnt: None, provenance: "seed 1; \"blake3\":\"0000\"\nlights: a, b".into() }
}

static SMALL: LazyLock<Vec<u8>> = LazyLock::new(|| encode_model(&toy(1, 2)));

fn decode(bytes: &[u8]) -> Result<Model, Error> {
    decode_model(Path::new("a.gonio"), bytes)
}

/// Checks that the error is one line that names the file and contains all of `messages`.
fn refused<T: std::fmt::Debug>(got: Result<T, Error>, kind: Kind, messages: &[&str]) {
    let error = got.unwrap_err();
    let text = error.to_string();
    assert!(error.kind() == kind && text.starts_with("a.gonio: ") && text.lines().count() == 1, "{text}");
    assert!(messages.iter().all(|s| text.contains(s)), "{text}");
}

/// A file with a replaced header, unchanged tensors, and a matching checksum.
fn forged(bytes: &[u8], old: &str, new: &str) -> Vec<u8> {
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let header = std::str::from_utf8(&bytes[8..8 + length]).unwrap();
    assert!(header.contains(old), "{header}");
    let header = header.replace(old, new);
    let digits = header.find("\"blake3\":\"").unwrap() + 10;
    let mut file = (header.len() as u64).to_le_bytes().to_vec();
    file.extend(header.bytes());
    file.extend(&bytes[8 + length..]);
    file[8 + digits..][..64].fill(b'0');
    let hash = blake3::hash(&file).to_hex();
    file[8 + digits..][..64].copy_from_slice(hash.as_bytes());
    file
}

#[test]
fn models_and_parts_round_trip() {
    for model in [toy(10, 100), toy(1, 0)] {
        assert_eq!(decode(&encode_model(&model)).unwrap(), model);
        let path = Path::new("a.gonio");
        let lighting = encode_lighting(&model.light, "from lights");
        assert_eq!(decode_lighting(path, &lighting).unwrap(), (model.light, "from lights".into()));
        let reflectance = encode_reflectance(&model.reflectance, "");
        assert_eq!(decode_reflectance(path, &reflectance).unwrap(), (model.reflectance, String::new()));
    }
}

#[test]
fn files_are_small_aligned_and_equal_for_equal_models() {
    let bytes = encode_model(&toy(10, 100));
    assert_eq!(bytes, encode_model(&toy(10, 100)));
    assert!(bytes.len() < 400_000, "{}", bytes.len());
    // Other programs read the file by `safetensors`.
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    assert_eq!(file.tensor("functions").unwrap().shape(), [10, 90, 90]);
    for (name, tensor) in file.iter() {
        let offset = tensor.data().as_ptr().addr() - bytes.as_ptr().addr();
        assert_eq!(offset % 8, 0, "{name}");
    }
}

#[test]
fn the_prior_of_the_paper_separates_horizontal_and_vertical() {
    use gonio::lighting::PriorGroup;
    use gonio::sphere::{OctahedralMap, Orientation};
    let prior = crate::model::lighting_of_paper().unwrap();
    assert_eq!((prior.map, prior.scales, prior.lights), (OctahedralMap::PraunHoppe, 5, 72));
    let groups = PriorGroup::all(5);
    let of = |orientation| {
        let group = PriorGroup::Middle { scale: 3, orientation, above: true };
        &prior.groups[groups.iter().position(|g| *g == group).unwrap()]
    };
    assert_ne!(of(Orientation::Horizontal), of(Orientation::Vertical));
}

#[test]
fn files_on_disk_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("toy.gonio");
    crate::atomic::write_file(&path, &SMALL).unwrap();
    assert_eq!(read_model(&path).unwrap(), toy(1, 2));
    assert_eq!(read_lighting(&path).unwrap_err().kind(), Kind::Invalid);
    assert_eq!(read_reflectance(dir.path().join("none")).unwrap_err().kind(), Kind::Io);
}

#[test]
fn other_files_versions_and_kinds_are_rejected() {
    refused(decode(b"\x89PNG\r\n\x1a\nxxxxxxxxxxxx"), Kind::Unsupported, &["not a model", "gonio train"]);
    refused(decode(b""), Kind::Unsupported, &["not a model"]);
    let foreign = b"\x14\0\0\0\0\0\0\0{\"__metadata__\":{} }";
    refused(decode(foreign), Kind::Invalid, &["was not written by gonio", "gonio train model"]);
    let newer = forged(&SMALL, "\"version\":\"1\"", "\"version\":\"2\"");
    refused(decode(&newer), Kind::Unsupported, &["version 2", "version 1 is required", "write it again"]);
    let path = Path::new("a.gonio");
    let half = encode_lighting(&toy(1, 0).light, "");
    refused(decode(&half), Kind::Invalid, &["a light prior alone instead of a whole model", "`gonio train model`"]);
    refused(decode_reflectance(path, &half), Kind::Invalid, &["instead of a reflectance basis alone"]);
    refused(decode_lighting(path, &SMALL), Kind::Invalid, &["contains a whole model", "`gonio train lighting`"]);
    let odd = forged(&SMALL, "\"kind\":\"model\"", "\"kind\":\"camera\"");
    refused(decode(&odd), Kind::Invalid, &["unknown content"]);
}

#[test]
fn errors_name_missing_and_misshapen_parts() {
    let check =
        |old: &str, new: &str, messages: &[&str]| refused(decode(&forged(&SMALL, old, new)), Kind::Invalid, messages);
    check("\"rates\":{", "\"ratios\":{", &["no tensor \"rates\"", "`gonio train model`"]);
    check("\"provenance\":", "\"provenience\":", &["no metadata \"provenance\""]);
    check("\"light\":", "\"shade\":", &["no metadata \"light\""]);
    check("\"light\":\"{", "\"light\":\"[", &["invalid metadata \"light\""]);
    check("[1,90,90]", "[90,90,1]", &["F32 of shape [90, 90, 1] instead of F32 of shape [any, 90, 90]"]);
    check("\"shape\":[2,1]", "\"shape\":[1,2]", &["\"coefficients\"", "instead of F64 of shape [2, 1]"]);
    check("\\\"scales\\\":5", "\\\"scales\\\":4", &["17 groups, but 4 scales require 16"]);
    check("\\\"lights\\\":72", "\\\"lights\\\":-7", &["invalid metadata \"light\""]);
}

#[test]
fn inconsistent_models_are_rejected() {
    let mut model = toy(2, 3);
    model.reflectance.functions[1].as_mut_slice()[7] = f32::NAN;
    refused(decode(&encode_model(&model)), Kind::Invalid, &["contains an invalid model", "basis function 1 is NaN"]);
    let mut model = toy(2, 3);
    model.light.groups[4] = CoefficientPrior::Mixture(ScaleMixture { weights: vec![0.5], variances: vec![1.0] });
    refused(decode(&encode_model(&model)), Kind::Invalid, &["contains an invalid model", "sum to one"]);
    let mut model = toy(2, 3);
    model.reflectance.rates.pop();
    refused(decode(&encode_model(&model)), Kind::Invalid, &["\"rates\"", "[1]", "[2]"]);
    let mut model = toy(2, 3);
    model.reflectance.functions.clear();
    assert!(decode(&encode_model(&model)).is_err());
}

#[test]
fn every_truncation_is_an_error() {
    for cut in 0..SMALL.len() {
        let kind = decode(&SMALL[..cut]).unwrap_err().kind();
        assert!(kind == Kind::Damaged || (cut < 9 && kind == Kind::Unsupported), "{cut} {kind:?}");
    }
    refused(decode(&SMALL[..2000]), Kind::Damaged, &["truncated"]);
    refused(decode(&[&SMALL[..], b"x"].concat()), Kind::Damaged, &["length"]);
}

#[test]
fn every_flipped_bit_is_detected() {
    // A linear congruential generator gives positions in the file and in its header; in addition,
    // the loop covers each of the first 300 bytes.
    let mut state = 7_u64;
    let mut next = |n: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % n
    };
    let length = SMALL.len();
    let header = u64::from_le_bytes(SMALL[..8].try_into().unwrap()) as usize;
    for i in 0..900 {
        let at = [i / 3, next(header), next(length)][i % 3];
        let mut bytes = SMALL.clone();
        bytes[at] ^= 1 << next(8);
        assert!(decode(&bytes).is_err(), "byte {at}");
    }
    let mut data = SMALL.clone();
    data[length - 5] ^= 1;
    refused(decode(&data), Kind::Damaged, &["checksum", "download or export it again"]);
}

/// A model with a posterior of two materials and an untrained encoder.
static KNOWING: LazyLock<Model> = LazyLock::new(|| {
    let lobe = |w: f64| BivariateTable::from_fn(move |h, _| 0.1 + (-(h / w).powi(2)).exp());
    let basis = LogBasis::fit(&[0.1, 0.5].map(|w| (format!("lobe {w}"), lobe(w))), 3);
    let settings = DictionarySettings { draws: 4, dimensions: 2, seed: 1, ..Default::default() };
    let dictionary = Dictionary::new(basis, &settings);
    let shape = EncoderShape { widths: vec![1, 2], hidden: vec![3], ..EncoderShape::new(CHANNELS, GLOBALS, 5) };
    let candidates = |count: usize| {
        let coordinates = (0..count).map(|at| vec![at as f32, 0.5]).collect();
        Candidates::of_prior(coordinates, (0..count).map(|at| vec![1.0 / (1.0 + at as f32); 5]).collect())
    };
    let layers: Vec<_> = shape.convolutions().into_iter().chain(shape.dense_layers()).collect();
    let find = |name: &str| {
        let (layer, part) = name.rsplit_once('.')?;
        let layer = layers.iter().find(|l| l.name == layer)?;
        let dimensions = if part == "bias" { vec![layer.geometry.outputs] } else { layer.dimensions() };
        let count = dimensions.iter().product();
        Some((dimensions, (0..count).map(|i: usize| 1.0 / (3.0 + i as f32)).collect()))
    };
    let posterior = LearntPosterior {
        names: dictionary.measured.names.clone(),
        measured: candidates(2),
        prior: Candidates { log_importance: (0..7).map(|at| -0.1 * at as f32).collect(), ..candidates(7) },
        latent_space: dictionary.latent_space.clone(),
        widths: vec![0.1; CELLS],
        encoder: Encoder::from_tensors(shape, find).unwrap(),
        ranges: vec![(-1.0, 1.0 / 3.0); 3],
        colours: Some(colours(2)),
    };
    Model { learnt: Some(posterior), ..toy(1, 2) }
});

/// A model of colours with `dimensions` coordinates.
fn colours(dimensions: usize) -> ColourModel {
    let size = dimensions + 1;
    let round = |variance: f64| -> Vec<Vec<f64>> {
        (0..size).map(|i| (0..size).map(|j| if i == j { variance } else { 1.0 / 3.0 }).collect()).collect()
    };
    ColourModel {
        differences: round(1.0),
        mean_log_differences: round(2.0),
        errors: [round(0.5), round(0.6), round(0.7)],
        lights: vec![LightComponent { weight: 1.0, covariance: [[0.1, 0.05], [0.05, 0.2]] }],
    }
}

#[test]
fn posteriors_round_trip() {
    let model = &*KNOWING;
    assert_eq!(&decode(&encode_model(model)).unwrap(), model);
    let alone = encode_posterior(model.learnt.as_ref().unwrap(), "from both");
    let (posterior, origin) = decode_posterior(Path::new("a.gonio"), &alone).unwrap();
    assert_eq!((Some(posterior), origin.as_str()), (model.learnt.clone(), "from both"));
    refused(decode(&alone), Kind::Invalid, &["a posterior of materials alone", "a whole model"]);
}

#[test]
fn inconsistent_encoders_are_rejected() {
    let bytes = encode_model(&KNOWING);
    for (old, new, message) in [
        ("encoder.outputs.bias", "encoder.outputs.bies", "outputs.bias"),
        (r#"\"side\":128"#, r#"\"side\":120"#, "encoder"),
        (r#"\"hidden\":[3]"#, r#"\"hidden\":[4]"#, "hidden1.weight"),
    ] {
        refused(decode(&forged(&bytes, old, new)), Kind::Invalid, &[message]);
    }
}

#[test]
fn inconsistent_posteriors_are_rejected() {
    let spoilt = |spoil: fn(&mut LearntPosterior), message: &str| {
        let mut model = KNOWING.clone();
        spoil(model.learnt.as_mut().unwrap());
        assert!(model.check().is_err(), "{message}");
        refused(decode(&encode_model(&model)), Kind::Invalid, &[message]);
    };
    spoilt(|p| p.latent_space.mean[5] = f32::NAN, "a table has values that are not finite");
    spoilt(|p| p.widths[7] = f32::INFINITY, "a table has values that are not finite");
    spoilt(|p| p.measured.coordinates[1][0] = f32::NAN, "a list of coordinates has values that are not finite");
    spoilt(|p| p.prior.embeddings[6][4] = f32::NAN, "an embedding has values that are not finite");
    spoilt(|p| p.prior.log_importance[6] = f32::NAN, "the list of importance weights has values that are not finite");
    spoilt(|p| p.prior.log_importance.truncate(3), "the list of importance weights has 3 values instead of 7");
    spoilt(|p| p.names.truncate(1), "the list of material coordinates has 2 values instead of 1");
    spoilt(|p| p.prior = Candidates::of_prior(vec![], vec![]), "no materials of the prior");
    spoilt(|p| p.ranges.truncate(2), "the list of feature ranges has 2 values instead of 3");
    spoilt(|p| p.ranges[1] = (1.0, 0.0), "feature 1 has an invalid range");
    spoilt(|p| p.colours.as_mut().unwrap().errors[1][2][2] = 0.0, "variances that are not positive");
}

#[test]
fn a_rounded_model_is_close_to_the_original() {
    let learnt = |model: Model| model.learnt.unwrap();
    let (whole, bytes) = (learnt(embedded().unwrap()), embedded_rounded(14).unwrap());
    let rounded = learnt(decode(&bytes).unwrap());
    let (mut most, mut changed) = (0.0_f32, 0);
    for (a, b) in whole.prior.coordinates.concat().iter().zip(rounded.prior.coordinates.concat()) {
        most = most.max((a - b).abs() / a.abs().max(1e-6));
        changed += usize::from(*a != b);
    }
    assert!(changed > 1000 && most <= 0.5_f32.powi(14), "{changed} {most}");
    assert_eq!(learnt(decode(&embedded_rounded(24).unwrap()).unwrap()).prior.coordinates, whole.prior.coordinates);
}

#[test]
fn the_listed_sources_match_the_model() {
    let lines = || super::EMBEDDED_SOURCES.lines().filter(|line| !line.starts_with(' '));
    let number = |line: &str| line.split(' ').next().unwrap().parse::<usize>().unwrap();
    let count = |what: &str| lines().filter(|line| line.contains(what)).map(number).sum::<usize>();
    let model = embedded().unwrap();
    assert_eq!(count("captured lights"), model.light.lights);
    assert_eq!(count("materials"), model.reflectance.materials.len());
    assert_eq!(super::lighting_of_paper().unwrap().lights, model.light.lights);

    // The counts agree with the provenance document.
    let text = include_str!("../../model/PROVENANCE.md");
    for (heading, whose) in [("Poly Haven", "Poly Haven"), ("sIBL Archive", "sIBL"), ("Others", "others")] {
        let line = lines().find(|line| line.contains(whose)).unwrap();
        let section = text.lines().find(|l| l.starts_with(&format!("**{heading}"))).unwrap();
        assert!(section.contains(&format!(": {} maps", number(line))), "{line} is not {section}");
        for terms in ["CC0", "CC BY-NC-SA 3.0 US"] {
            assert_eq!(line.contains(terms), section.contains(terms), "{line} is not {section}");
        }
    }
}
