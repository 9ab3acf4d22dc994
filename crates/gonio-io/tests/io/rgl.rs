//! Materials of the RGL database.
//!
//! Analytic materials in its format, damaged files, and, if `GONIO_DATA` contains them, measured
//! materials.

use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, PI, TAU};
use std::path::{Path, PathBuf};

use glam::DVec3;
use gonio::reflectance::parametric::{Ggx, Parametric, directions};
use gonio::reflectance::{BivariateTable, THETA_D, theta_d_of, theta_h_of};
use gonio_io::rgl::{self, Rgl};
use gonio_io::{Error, Kind};

/// Incident directions.
const THETAS: usize = 24;
/// Samples along a side of the warped square.
const SIDE: usize = 64;
/// Samples along a side of a density.
const COARSE: usize = 6;
/// Factors of the channels of the encoded materials.
const COLOUR: [f64; 3] = [1.0, 0.5, 0.25];

/// A field: name, type, shape, values.
#[derive(Clone)]
struct Field(&'static str, u8, Vec<u64>, Vec<u8>);

fn floats(name: &'static str, shape: &[usize], value: impl FnMut(usize) -> f64) -> Field {
    let values = (0..shape.iter().product()).map(value).flat_map(|v: f64| (v as f32).to_le_bytes()).collect();
    Field(name, 10, shape.iter().map(|n| *n as u64).collect(), values)
}

/// Encodes fields in the layout of the database: header, then values at multiples of eight bytes.
fn encode(fields: &[Field]) -> Vec<u8> {
    let header: usize = 18 + fields.iter().map(|f| 13 + f.0.len() + 8 * f.2.len()).sum::<usize>();
    let mut bytes = b"tensor_file\0\x01\0".to_vec();
    bytes.extend((fields.len() as u32).to_le_bytes());
    let mut offset = header.next_multiple_of(8);
    for Field(name, kind, shape, values) in fields {
        bytes.extend((name.len() as u16).to_le_bytes());
        bytes.extend(name.bytes());
        bytes.extend((shape.len() as u16).to_le_bytes());
        bytes.push(*kind);
        bytes.extend((offset as u64).to_le_bytes());
        bytes.extend(shape.iter().flat_map(|n| n.to_le_bytes()));
        offset = (offset + values.len()).next_multiple_of(8);
    }
    for field in fields {
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes.extend(&field.3);
    }
    bytes
}

/// A file of two incident directions and two by two samples, small enough to fuzz.
pub(crate) fn small() -> Vec<u8> {
    encode(&[
        Field("description", 1, vec![5], b"paint".to_vec()),
        floats("phi_i", &[1], |_| 0.0),
        floats("theta_i", &[2], |at| at as f64),
        floats("sigma", &[2, 2], |_| 0.9),
        floats("ndf", &[2, 2], |_| 0.5),
        floats("vndf", &[1, 2, 2, 2], |at| 1.0 + at as f64),
        floats("rgb", &[1, 2, 3, 2, 2], |at| at as f64 / 24.0),
        Field("jacobian", 1, vec![1], vec![1]),
    ])
}

/// Returns the position of sample `i` of `n` in the unit interval.
fn unit(i: usize, n: usize) -> f64 {
    i as f64 / (n - 1) as f64
}

fn theta_i(slice: usize) -> f64 {
    unit(slice, THETAS) * FRAC_PI_2
}

/// Returns the coefficient `a` of the density `1 + a (2x - 1) (2y - 1)`. The density is not
/// separable, but bilinear, so that samples represent it exactly.
fn tilt(slice: usize) -> f64 {
    0.8 * unit(slice, THETAS)
}

/// Returns the point that the density of a slice maps to `(u, v)`. The marginal density of `y` is
/// uniform; given `y`, the integral up to `x` is `x + b (x^2 - x)` with `b = a (2y - 1)`.
fn spread(slice: usize, u: f64, v: f64) -> [f64; 2] {
    let b = tilt(slice) * (2.0 * v - 1.0);
    [2.0 * u / (1.0 - b + ((1.0 - b).powi(2) + 4.0 * b * u).sqrt()), v]
}

/// An arbitrary microfacet density: encoding divides by it and evaluation multiplies by it.
fn ndf(theta: f64) -> f64 {
    0.16 * FRAC_1_PI / (1.0 - 0.84 * theta.cos().powi(2)).powi(2)
}

fn sigma(theta: f64) -> f64 {
    1.0 - 0.3 * (theta / FRAC_PI_2).sqrt()
}

/// Encodes `f(wi, wo) cos_o`, which must also be defined for `wo` below the horizon.
fn material(cosine_weighted: &dyn Fn(DVec3, DVec3) -> f64, jacobian: bool) -> Vec<Field> {
    let angle = |x: f64| x * x * FRAC_PI_2;
    let rgb = |at: usize| {
        let (slice, channel, v, u) = (at / (3 * SIDE * SIDE), at / (SIDE * SIDE) % 3, at / SIDE % SIDE, at % SIDE);
        let [x, y] = spread(slice, unit(u, SIDE), unit(v, SIDE));
        let (theta_m, phi_m, theta) = (angle(x), TAU * y - PI, theta_i(slice));
        let wi = DVec3::new(theta.sin(), 0.0, theta.cos());
        let m = DVec3::new(theta_m.sin() * phi_m.cos(), theta_m.sin() * phi_m.sin(), theta_m.cos());
        let facets = if jacobian { ndf(theta_m) / (4.0 * sigma(theta)) } else { 1.0 };
        COLOUR[channel] * cosine_weighted(wi, 2.0 * wi.dot(m) * m - wi) / facets
    };
    let density = |at: usize| {
        let (slice, y, x) = (at / (COARSE * COARSE), at / COARSE % COARSE, at % COARSE);
        // Densities may have any scale.
        7.0 * (1.0 + tilt(slice) * (2.0 * unit(x, COARSE) - 1.0) * (2.0 * unit(y, COARSE) - 1.0))
    };
    vec![
        Field("description", 1, vec![5], b"paint".to_vec()),
        floats("phi_i", &[1], |_| 0.0),
        floats("theta_i", &[THETAS], theta_i),
        floats("sigma", &[2, 256], |at| sigma(angle(unit(at % 256, 256)))),
        floats("ndf", &[2, 256], |at| ndf(angle(unit(at % 256, 256)))),
        floats("vndf", &[1, THETAS, COARSE, COARSE], density),
        floats("rgb", &[1, THETAS, 3, SIDE, SIDE], rgb),
        Field("jacobian", 1, vec![1], vec![u8::from(jacobian)]),
    ]
}

fn lambertian() -> Vec<Field> {
    material(&|_, wo| 0.5 * FRAC_1_PI * wo.z, true)
}

fn decode(bytes: &[u8]) -> Result<Rgl, Error> {
    rgl::decode(Path::new("a.bsdf"), bytes)
}

/// A fixed set of `n` directions over the part of the hemisphere with cosines above `lowest`.
fn scattered(n: usize, lowest: f64) -> impl Iterator<Item = DVec3> {
    (0..n).map(move |i| {
        let z = lowest + (1.0 - lowest) * (0.5 + i as f64) / n as f64;
        let (s, c) = (i as f64 * 2.399_963).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * c, r * s, z)
    })
}

#[track_caller]
fn check_eval(material: &Rgl, tolerance: f64, want: impl Fn(DVec3, DVec3) -> f64) {
    for wi in scattered(31, 0.25) {
        for wo in scattered(37, 0.25) {
            let (got, want) = (material.eval(wi, wo), want(wi, wo));
            for (got, share) in got.into_iter().zip(COLOUR) {
                assert!((got / (share * want) - 1.0).abs() < tolerance, "{wi} {wo}: {got}, expected {}", share * want);
            }
        }
    }
}

#[test]
fn a_lambertian_surface_is_lambertian() {
    for jacobian in [true, false] {
        let material = decode(&encode(&material(&|_, wo| 0.5 * FRAC_1_PI * wo.z, jacobian))).unwrap();
        assert_eq!(material.description, "paint");
        check_eval(&material, 0.02, |_, _| 0.5 * FRAC_1_PI);
        assert_eq!(material.eval(DVec3::Z, -DVec3::Z), [0.0; 3]);
        assert_eq!(material.eval(DVec3::new(0.8, 0.0, -0.6), DVec3::Z), [0.0; 3]);
    }
}

#[test]
fn an_encoded_lobe_is_reproduced() {
    // GGX times the outgoing cosine, continued smoothly below the horizon.
    let model = Ggx { diffuse: 0.05, f0: 0.3, alpha: 0.3 };
    let weighted = |wi: DVec3, wo: DVec3| {
        let above = DVec3::new(wo.x, wo.y, wo.z.max(1e-3)).normalize();
        model.eval(DVec3::new(wi.x, wi.y, wi.z.max(1e-3)).normalize(), above) * wo.z
    };
    let material = decode(&encode(&material(&weighted, true))).unwrap();
    check_eval(&material, 0.03, |wi, wo| model.eval(wi, wo));
    let table = material.to_merl();
    for (h, d, phi) in [(0, 0, 0), (20, 30, 0), (45, 10, 77), (30, 50, 120), (60, 20, 179)] {
        let (wi, wo) = directions(theta_h_of(h), theta_d_of(d), (phi as f64).to_radians());
        let got = f64::from(table.channel(1)[(h * THETA_D + d) * 180 + phi]);
        let want = COLOUR[1] * model.eval(wi, wo);
        assert!((got / want - 1.0).abs() < 0.02, "{h} {d} {phi}: {got} {want}");
    }
    // Half and difference angle of 88 and 60 degrees in one plane: below the horizon.
    assert_eq!(table.channel(0)[(89 * THETA_D + 60) * 180], -1.0);
}

#[test]
fn damage_is_described() {
    let fields = lambertian();
    let good = encode(&fields);
    // Replaces or removes a field.
    let with = |name: &'static str, field: Option<Field>| {
        let mut fields: Vec<Field> = fields.iter().filter(|f| f.0 != name).cloned().collect();
        fields.extend(field);
        encode(&fields)
    };
    let one = |name, shape: &[usize], value: f64| with(name, Some(floats(name, shape, |_| value)));
    let (huge, wraps) = (vec![1 << 40, 1 << 10], vec![1 << 32, 1 << 33]);
    let short = Field("ndf", 10, vec![2, 256], vec![0; 2044]);
    let mut twice = fields.clone();
    twice.push(fields[1].clone());
    for (bytes, kind, message) in [
        (b"tensor_fill\0".to_vec(), Kind::Damaged, "does not have the header of"),
        (good[..400].to_vec(), Kind::Damaged, "is truncated"),
        (good[..30].to_vec(), Kind::Damaged, "is truncated in its header"),
        ([&good[..12], &[2, 0], &good[14..]].concat(), Kind::Unsupported, "version 2.0"),
        (with("ndf", Some(Field("ndf", 10, huge, vec![]))), Kind::Damaged, "exceeds its"),
        (with("ndf", Some(Field("ndf", 10, wraps, vec![]))), Kind::Damaged, "exceeds its"),
        (with("ndf", Some(Field("ndf", 10, vec![0, u64::MAX], vec![]))), Kind::Damaged, "instead of 2 non-empty axes"),
        (with("ndf", Some(short)), Kind::Damaged, "exceeds its"),
        (with("ndf", Some(Field("ndf", 12, vec![1], vec![0]))), Kind::Damaged, "unknown type 12 in ndf"),
        (with("ndf", Some(Field("ndf", 11, vec![1, 1], vec![0; 8]))), Kind::Unsupported, "single precision"),
        (with("rgb", None), Kind::Invalid, "contains no field rgb"),
        (with("jacobian", None), Kind::Damaged, "one-byte field for the Jacobian"),
        (encode(&twice), Kind::Damaged, "contains the field phi_i twice"),
        (one("phi_i", &[3], 0.0), Kind::Unsupported, "is an anisotropic material"),
        (one("theta_i", &[THETAS], 1.0), Kind::Damaged, "are not increasing"),
        (one("theta_i", &[THETAS - 1], 1.0), Kind::Damaged, "but 1 x 23 incident directions"),
        (one("theta_i", &[0], 1.0), Kind::Damaged, "instead of 1 non-empty axes"),
        (one("sigma", &[256], 1.0), Kind::Damaged, "instead of 2 non-empty axes"),
        (one("sigma", &[1, 256], 1.0), Kind::Damaged, "at least 2 x 2"),
        (one("sigma", &[2, 256], -1.0), Kind::Damaged, "a negative value at index 0 of sigma"),
        (one("sigma", &[2, 256], f64::NAN), Kind::Damaged, "not finite at index 0 of sigma"),
        (one("vndf", &[1, THETAS, 4, 4], 0.0), Kind::Damaged, "only zeros in slice 0 of vndf"),
        (one("rgb", &[1, THETAS, 4, 4, 4], 0.0), Kind::Damaged, "with the first axes [1, 24, 4]"),
    ] {
        let error = decode(&bytes).unwrap_err();
        assert!(error.to_string().contains(message), "{error} does not contain {message}");
        assert_eq!(error.kind(), kind, "{error}");
    }
    // Functions that are zero in places are valid; the BRDF is zero there.
    assert_eq!(decode(&one("sigma", &[2, 2], 0.0)).unwrap().eval(DVec3::Z, DVec3::Z), [0.0; 3]);
    let mut half = floats("vndf", &[1, THETAS, 4, 4], |at| if at / 4 % 4 < 2 { 1.0 } else { 0.0 });
    half.0 = "vndf";
    let dark = decode(&with("vndf", Some(half))).unwrap();
    for wo in scattered(50, 0.01) {
        assert!(dark.eval(DVec3::new(0.6, 0.0, 0.8), wo).iter().all(|v| v.is_finite()));
    }
}

#[test]
fn corrupt_files_do_not_panic() {
    // Few samples, so that most of the file is header.
    let tiny = [
        Field("description", 1, vec![5], b"paint".to_vec()),
        floats("phi_i", &[2], |at| at as f64),
        floats("theta_i", &[3], |at| at as f64 / 2.0),
        floats("sigma", &[2, 2], |_| 1.0),
        floats("ndf", &[2, 2], |_| 1.0),
        floats("vndf", &[2, 3, 2, 2], |at| 1.0 + (at % 3) as f64),
        floats("rgb", &[2, 3, 3, 2, 2], |at| at as f64),
        Field("jacobian", 1, vec![1], vec![1]),
    ];
    let evaluate = |path: &Path, bytes: &[u8]| {
        let material = rgl::decode(path, bytes)?;
        for wo in scattered(9, 0.0) {
            material.eval(DVec3::new(0.0, 0.6, 0.8), wo);
        }
        Ok(material)
    };
    super::damage::check("a.bsdf", &encode(&tiny), 0, evaluate);
    super::damage::check("a.bsdf", &encode(&lambertian()), 0, rgl::decode);
}

fn real() -> Vec<PathBuf> {
    let folder = std::env::var_os("GONIO_DATA").map(|data| PathBuf::from(data).join("rgl"));
    let entries = folder.and_then(|f| std::fs::read_dir(f).ok()).into_iter().flatten().flatten();
    let files: Vec<PathBuf> =
        entries.map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "bsdf")).collect();
    if files.is_empty() {
        eprintln!("skipped: GONIO_DATA does not contain rgl/*.bsdf");
    }
    files
}

#[test]
fn measured_materials_are_plausible() {
    for file in real() {
        let material = rgl::read(&file).unwrap();
        let name = file.display();
        // Green albedo by angle of incidence. The bounds are wide because the directions do not
        // follow the highlight.
        for degrees in [30.0_f64, 45.0, 60.0] {
            let wi = DVec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
            let n = 100_000;
            let sum: f64 = scattered(n, 0.0).map(|wo| material.eval(wi, wo)[1] * wo.z).sum();
            let albedo = TAU * sum / n as f64;
            assert!((0.02..1.0).contains(&albedo), "{name}: albedo {albedo} at {degrees} degrees");
        }
        // Reciprocity: compares pairs of directions with exchanged pairs.
        let (mut difference, mut total) = (0.0, 0.0);
        for wi in scattered(60, 0.3) {
            for wo in scattered(61, 0.3) {
                let (there, back) = (material.eval(wi, wo), material.eval(wo, wi));
                assert!(there.iter().all(|v| v.is_finite() && *v >= 0.0), "{name}: {there:?}");
                difference += (there[1] - back[1]).abs();
                total += 0.5 * (there[1] + back[1]);
            }
        }
        eprintln!("{name}: relative deviation from reciprocity {:.3}", difference / total);
        assert!(difference < 0.5 * total, "{name}: {}", difference / total);
        let table = material.to_merl();
        assert!((0..3).all(|c| table.channel(c).iter().all(|v| v.is_finite() && (*v >= 0.0 || *v == -1.0))));
        assert!((0.02..1.0).contains(&table.bivariate(1).normal_albedo()), "{name}");
    }
}

/// A red body under a coat with a lobe of width `width` and Fresnel reflection.
fn tables(width: f64) -> [BivariateTable; 3] {
    [1.0, 0.4, 0.2].map(|body| {
        BivariateTable::from_fn(|h, d| {
            let fresnel = 0.04 + 0.96 * (1.0 - d.cos()).powi(5);
            0.2 * body + fresnel / (width * width * (1.0 + (h / width).powi(2)).powi(2))
        })
    })
}

#[test]
fn encoded_tables_are_reproduced() {
    for width in [0.4, 0.05, 0.005] {
        let want = tables(width);
        let got = rgl::decode(Path::new("x.bsdf"), &rgl::encode(&want, "a coat", rgl::Channels::Rgb)).unwrap();
        assert_eq!(got.description, "a coat");
        // Relative errors over directions spread over the hemisphere.
        let (mut worst, mut sum, mut all, mut count) = (0.0_f64, 0.0, 0.0, 0.0);
        for at in 0..20_000 {
            let part = |base: f64| (f64::from(at) * base).fract();
            let theta_h = FRAC_PI_2 * part(0.754_877_67).powi(2);
            let theta_d = 1.4 * part(0.569_840_29);
            let (wi, wo) = directions(theta_h, theta_d, TAU * part(0.618_033_99));
            if wi.z < 0.1 || wo.z < 0.1 {
                continue;
            }
            let want = want[1].eval(theta_h, theta_d);
            let error = (got.eval(wi, wo)[1] - want) / want;
            worst = worst.max(error.abs());
            sum += error.abs();
            all += error;
            count += 1.0;
        }
        let (mean, bias) = (sum / count, all / count);
        println!("width {width}: mean {mean:.5} bias {bias:.5} worst {worst:.4}");
        assert!(mean < 0.01 && bias.abs() < 0.005 && worst < 0.2, "width {width}: {mean} {bias} {worst}");
    }
}

#[test]
fn spectral_files_have_no_rgb_field() {
    let bytes = rgl::encode(&tables(0.1), "", rgl::Channels::Spectral);
    let error = rgl::decode(Path::new("x_spec.bsdf"), &bytes).unwrap_err();
    assert!(error.to_string().contains("contains no field rgb"), "{error}");
}
