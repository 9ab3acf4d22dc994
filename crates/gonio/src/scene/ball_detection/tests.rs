//! Balls in simulated photographs, on textures of many kinds.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use glam::{DVec2, DVec3, Vec3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::*;
use crate::lighting::{EnvironmentMap, lamp_light, sky_light, studio_light};
use crate::render::{LightTree, SphereSettings, render_sphere};
use crate::suggestion::Suggestion;
use crate::testing::{lobe, on_threads};

const WIDTH: usize = 480;
const HEIGHT: usize = 360;

/// A light, and a dull, a satin and a sharp ball in it.
struct Set {
    light: EnvironmentMap,
    balls: Vec<Picture>,
}

static SETS: LazyLock<Vec<Set>> = LazyLock::new(|| {
    let materials = [lobe(0.25, 0.0, 1.0), lobe(0.1, 2.0, 0.3), lobe(0.02, 30.0, 0.06)];
    let settings = SphereSettings { size: 144, ..SphereSettings::default() };
    let lights = [studio_light(64), lamp_light(64), sky_light(64)];
    let set = |light: EnvironmentMap| {
        let tree = LightTree::of_map(&light);
        Set { balls: materials.iter().map(|m| render_sphere(m, &tree, &settings, &|_| ())).collect(), light }
    };
    lights.into_iter().map(set).collect()
});

#[derive(Clone, Copy, Debug)]
enum Backdrop {
    /// Values interpolated between independent points of a lattice with this spacing, in pixels.
    Noise(f64),
    /// Mean of noise with spacings of 5, 20 and 80 pixels.
    Scales,
    Checkers,
    Gradient,
    /// The environment of the ball, which it also reflects.
    Surroundings,
}

const BACKDROPS: [Backdrop; 7] = [
    Backdrop::Noise(3.0),
    Backdrop::Noise(12.0),
    Backdrop::Noise(45.0),
    Backdrop::Scales,
    Backdrop::Checkers,
    Backdrop::Gradient,
    Backdrop::Surroundings,
];

/// Values of 0.3 to 3, interpolated between random points of a lattice.
fn noise(spacing: f64, rng: &mut Pcg64) -> impl Fn(f64, f64) -> Vec3 + use<> {
    let columns = (WIDTH as f64 / spacing) as usize + 3;
    let rows = (HEIGHT as f64 / spacing) as usize + 3;
    let tint = Vec3::new(rng.random_range(0.7..1.3), 1.0, rng.random_range(0.7..1.3));
    let values: Vec<Vec3> = (0..columns * rows).map(|_| tint * 10_f32.powf(rng.random_range(-0.5..0.5))).collect();
    move |x, y| {
        let (u, v) = (x / spacing, y / spacing);
        let at = |i: usize, j: usize| values[(v as usize + j) * columns + u as usize + i];
        let row = |j: usize| at(0, j).lerp(at(1, j), u.fract() as f32);
        row(0).lerp(row(1), v.fract() as f32)
    }
}

type Scenery = Box<dyn Fn(f64, f64) -> Vec3>;

fn scenery(backdrop: Backdrop, set: &'static Set, rng: &mut Pcg64) -> Scenery {
    match backdrop {
        Backdrop::Noise(spacing) => Box::new(noise(spacing, rng)),
        Backdrop::Scales => {
            let all = [5.0, 20.0, 80.0].map(|spacing| noise(spacing, rng));
            Box::new(move |x, y| all.iter().map(|one| one(x, y)).sum::<Vec3>() / 3.0)
        }
        Backdrop::Checkers => {
            let (side, turn) = (rng.random_range(15.0..45.0), DVec2::from_angle(rng.random_range(0.0..TAU)));
            let (dark, bright) = (rng.random_range(0.1..0.5), rng.random_range(0.8..2.0));
            Box::new(move |x, y| {
                let at = DVec2::new(x, y).rotate(turn) / side;
                Vec3::splat(if (at.x.floor() + at.y.floor()).rem_euclid(2.0) < 1.0 { dark } else { bright })
            })
        }
        Backdrop::Gradient => {
            let (turn, from) = (DVec2::from_angle(rng.random_range(0.0..TAU)), rng.random_range(0.3..1.0));
            let steep = rng.random_range(1.0..3.0);
            Box::new(move |x, y| Vec3::splat((from * (steep * turn.dot(DVec2::new(x, y)) / 480.0).exp()) as f32))
        }
        Backdrop::Surroundings => {
            let away = rng.random_range(0.0..TAU);
            Box::new(move |x, y| {
                let ray = DVec3::new(x - 240.0, 180.0 - y, -400.0).normalize();
                set.light.at(glam::DQuat::from_rotation_y(away) * ray)
            })
        }
    }
}

/// Composites a ball into `rgb`, with its radiance multiplied by `gain`.
fn put(rgb: &mut Plane<Vec3>, ball: &Picture, circle: &Circle, gain: f32) {
    let settings = SphereSettings { size: ball.rgb.width(), ..SphereSettings::default() };
    let scale = settings.radius() / circle.radius;
    let middle = 0.5 * ball.rgb.width() as f64;
    let width = rgb.width();
    for (i, pixel) in rgb.as_mut_slice().iter_mut().enumerate() {
        // Mean of 4 x 4 samples in the pixel.
        let (mut sum, mut covered) = (Vec3::ZERO, 0.0);
        for s in 0..16 {
            let at = |whole: usize, part: usize| whole as f64 + (part as f64 + 0.5) / 4.0;
            let u = (at(i % width, s % 4) - circle.x) * scale + middle;
            let v = (at(i / width, s / 4) - circle.y) * scale + middle;
            if u >= 0.0 && v >= 0.0 && (u as usize) < ball.rgb.width() && (v as usize) < ball.rgb.height() {
                sum += ball.rgb[(u as usize, v as usize)];
                covered += ball.alpha.as_ref().map_or(0.0, |alpha| alpha[(u as usize, v as usize)]);
            }
        }
        *pixel = *pixel * (1.0 - covered / 16.0) + gain * sum / 16.0;
    }
}

/// Simulates a photograph with sensor noise; returns it with the outline of its ball.
fn photograph(backdrop: Backdrop, seed: u64) -> (Picture, Circle) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let set = &SETS[rng.random_range(0..SETS.len())];
    let ball = &set.balls[rng.random_range(0..set.balls.len())];
    let behind = scenery(backdrop, set, &mut rng);
    let radius = rng.random_range(45.0..140.0);
    let circle = Circle {
        x: rng.random_range(radius + 6.0..WIDTH as f64 - radius - 6.0),
        y: rng.random_range(radius + 6.0..HEIGHT as f64 - radius - 6.0),
        radius,
    };
    let mut rgb = Plane::from_fn(WIDTH, HEIGHT, |x, y| behind(x as f64 + 0.5, y as f64 + 0.5));
    let mean = |plane: &Plane<Vec3>| plane.as_slice().iter().sum::<Vec3>().y / plane.as_slice().len() as f32;
    // Surroundings have the scale of the ball; other backdrops are about as bright as the ball.
    let gain = match backdrop {
        Backdrop::Surroundings => 1.0,
        _ => mean(&rgb) / (mean(&ball.rgb) / 0.75) * rng.random_range(0.5..2.0),
    };
    put(&mut rgb, ball, &circle, gain);
    for pixel in rgb.as_mut_slice() {
        let gauss: f32 = StandardNormal.sample(&mut rng);
        *pixel *= 1.0 + 0.01 * gauss;
    }
    (Picture { rgb, alpha: None }, circle)
}

fn is_near(found: &Circle, want: &Circle, share: f64) -> bool {
    let off = (found.x - want.x).hypot(found.y - want.y).max((found.radius - want.radius).abs());
    off <= share * want.radius
}

#[test]
fn detects_or_rejects_balls_on_textures() {
    const SEEDS: u64 = 4;
    let (mut right, mut wrong) = (0, Vec::new());
    for (kind, backdrop) in BACKDROPS.into_iter().enumerate() {
        for seed in 0..SEEDS {
            let (picture, want) = photograph(backdrop, 1000 * kind as u64 + seed);
            match detect_ball(&picture, None) {
                // A pixel and a half exceeds a hundredth of the radius of a small ball.
                Ok(spotted) if is_near(&spotted.circle, &want, f64::max(0.01, 1.5 / want.radius)) => right += 1,
                Ok(spotted) => wrong.push((backdrop, seed, want, spotted.circle, spotted.reliability)),
                Err(_) => {}
            }
        }
    }
    let all = SEEDS * BACKDROPS.len() as u64;
    assert!(100 * right >= 80 * all, "{right} of {all} were found");
    assert!(wrong.is_empty(), "{wrong:?}");
}

#[test]
fn corrects_given_outlines_that_are_off() {
    let (mut corrected_ones, mut all, mut false_alarms) = (0, 0, Vec::new());
    for (kind, backdrop) in BACKDROPS.into_iter().enumerate() {
        for seed in 0..4 {
            let (picture, true_circle) = photograph(backdrop, 1000 * kind as u64 + seed);
            false_alarms
                .extend(corrected(&picture.rgb, &true_circle).map(|found| (backdrop, seed, true_circle, found)));
            let off = |share: f64| share * true_circle.radius;
            let larger = Circle { radius: true_circle.radius + off(0.05), ..true_circle };
            let smaller = Circle { radius: true_circle.radius - off(0.05), ..true_circle };
            let shifted = Circle { x: true_circle.x + off(0.03), y: true_circle.y - off(0.03), ..true_circle };
            for given in [larger, smaller, shifted] {
                let found = corrected(&picture.rgb, &given);
                all += 1;
                corrected_ones += usize::from(found.is_some_and(|found| is_near(&found, &true_circle, 0.02)));
            }
        }
    }
    assert!(false_alarms.is_empty(), "{false_alarms:?}");
    assert!(10 * corrected_ones >= 7 * all, "{corrected_ones} of {all} were corrected");
}

#[test]
fn detects_no_ball_in_backdrops_alone() {
    let mut found = Vec::new();
    for (kind, backdrop) in BACKDROPS.into_iter().enumerate() {
        for seed in 0..3 {
            let mut rng = Pcg64::seed_from_u64(50_000 + 1000 * kind as u64 + seed);
            let behind = scenery(backdrop, &SETS[seed as usize % SETS.len()], &mut rng);
            let rgb = Plane::from_fn(WIDTH, HEIGHT, |x, y| behind(x as f64 + 0.5, y as f64 + 0.5));
            if let Ok(BallDetection { circle, reliability: sureness, .. }) =
                detect_ball(&Picture { rgb, alpha: None }, None)
            {
                found.push((backdrop, seed, circle, sureness));
            }
        }
    }
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn rejects_two_balls_on_a_texture() {
    let set = &SETS[0];
    let mut rng = Pcg64::seed_from_u64(3);
    let behind = scenery(Backdrop::Noise(12.0), set, &mut rng);
    let mut rgb = Plane::from_fn(WIDTH, HEIGHT, |x, y| behind(x as f64 + 0.5, y as f64 + 0.5));
    let circles = [Circle { x: 120.0, y: 170.0, radius: 80.0 }, Circle { x: 350.0, y: 190.0, radius: 84.0 }];
    circles.iter().for_each(|circle| put(&mut rgb, &set.balls[1], circle, 1.0));
    let refused = detect_ball(&Picture { rgb, alpha: None }, None).err().unwrap();
    let SceneError::Unsure { doubt, candidates } = &refused else { panic!("{refused}") };
    assert_eq!(*doubt, crate::scene::CircleDoubt::Rival);
    assert!(refused.to_string().ends_with("another circle is nearly as distinct"), "{refused}");
    assert!(candidates.len() <= 5);
    for circle in circles {
        assert!(candidates[..2].iter().any(|c| is_near(&c.circle, &circle, 0.01)), "{candidates:?}");
    }
    assert!(matches!(&refused.suggestions()[0], Suggestion::OneOf(circles) if circles.len() == candidates.len()));
}

fn each(colour: Vec3, of: impl Fn(f32) -> f32) -> Vec3 {
    Vec3::from_array(colour.to_array().map(of))
}

/// Simulates the losses of a JPEG file in sRGB.
///
/// Quantises the cosine transform of blocks of 8 x 8 pixels, on a scale of 255, by a table of a
/// quality of about 75.
fn compressed(rgb: &Plane<Vec3>) -> Plane<Vec3> {
    let rgb = rgb.map(|v| each(*v, |v| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }));
    let decoded = |v: f32| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    let basis: Vec<[f32; 8]> = (0..8)
        .map(|k| {
            let norm = if k == 0 { 0.125_f32.sqrt() } else { 0.5 };
            [0, 1, 2, 3, 4, 5, 6, 7].map(|i| norm * (std::f32::consts::PI * (i as f32 + 0.5) * k as f32 / 8.0).cos())
        })
        .collect();
    let mut out = rgb.clone();
    for (left, top) in (0..rgb.height() / 8).flat_map(|j| (0..rgb.width() / 8).map(move |i| (8 * i, 8 * j))) {
        let mut block = [[Vec3::ZERO; 8]; 8];
        for (k, l) in (0..8).flat_map(|k| (0..8).map(move |l| (k, l))) {
            let cells = (0..8).flat_map(|i| (0..8).map(move |j| (i, j)));
            let sum: Vec3 = cells.map(|(i, j)| 255.0 * basis[k][i] * basis[l][j] * rgb[(left + i, top + j)]).sum();
            let coarse = 8.0 + 3.5 * (k + l) as f32;
            block[k][l] = (sum / coarse).round() * coarse;
        }
        for (i, j) in (0..8).flat_map(|i| (0..8).map(move |j| (i, j))) {
            let cells = (0..8).flat_map(|k| (0..8).map(move |l| (k, l)));
            let value: Vec3 = cells.map(|(k, l)| basis[k][i] * basis[l][j] * block[k][l]).sum();
            out[(left + i, top + j)] = each((value / 255.0).clamp(Vec3::ZERO, Vec3::ONE), decoded);
        }
    }
    out
}

#[test]
fn detects_balls_despite_noise_and_compression_losses() {
    for seed in 0..6 {
        let mut rng = Pcg64::seed_from_u64(seed);
        let set = &SETS[seed as usize % SETS.len()];
        let want = Circle { x: rng.random_range(150.0..330.0), y: rng.random_range(150.0..210.0), radius: 120.0 };
        let base = [0.02, 0.5, 0.9][seed as usize % 3];
        let mut rgb = Plane::from_fn(WIDTH, HEIGHT, |_, _| Vec3::splat(base));
        put(&mut rgb, &set.balls[0], &want, 1.0);
        for pixel in rgb.as_mut_slice() {
            let gauss: f32 = StandardNormal.sample(&mut rng);
            *pixel = (*pixel + 0.01 * gauss).clamp(Vec3::ZERO, Vec3::ONE);
        }
        let rgb = compressed(&rgb);
        let spotted =
            detect_ball(&Picture { rgb, alpha: None }, None).unwrap_or_else(|error| panic!("{seed}: {error}"));
        assert!(is_near(&spotted.circle, &want, 0.013), "{seed}: {want:?} {:?}", spotted.circle);
        assert!(spotted.coverage.is_none());
    }
}

/// Grey shapes on a plain background with noise.
fn shapes(inside: impl Fn(f64, f64) -> bool) -> Picture {
    let mut rng = Pcg64::seed_from_u64(1);
    let rgb = Plane::from_fn(WIDTH, HEIGHT, |x, y| {
        let value = if inside(x as f64 + 0.5, y as f64 + 0.5) { 0.8 } else { 0.1 };
        Vec3::splat(value + 0.004 * rng.random_range(-1.0..1.0_f32))
    });
    Picture { rgb, alpha: None }
}

#[test]
fn reports_separate_objects() {
    let ball = |x: f64, y: f64| (x - 130.0).hypot(y - 180.0) < 80.0;
    let card = |x: f64, y: f64| (300.0..420.0).contains(&x) && (100.0..240.0).contains(&y);
    let refused = detect_ball(&shapes(|x, y| ball(x, y) || card(x, y)), None).err().unwrap();
    let SceneError::Several { objects } = &refused else { panic!("{refused}") };
    assert_eq!(objects.len(), 2);
    let round = objects.iter().find_map(|object| object.circle).unwrap();
    assert!(is_near(&round, &Circle { x: 130.0, y: 180.0, radius: 80.0 }, 0.02), "{round:?}");
    let square = objects.iter().find(|object| object.circle.is_none()).unwrap();
    assert!(square.from.0.abs_diff(300) <= 1 && square.to.1.abs_diff(240) <= 1, "{square:?}");
    assert_eq!(refused.suggestions(), [Suggestion::OneOf(vec![round]), Suggestion::Mask]);
    assert!(refused.to_string().starts_with("detected 2 separate objects: (1) "), "{refused}");
    // Objects that are small compared with the largest are ignored.
    let speck = |x: f64, y: f64| (300.0..320.0).contains(&x) && (100.0..120.0).contains(&y);
    let found = detect_ball(&shapes(|x, y| ball(x, y) || speck(x, y)), None).unwrap().circle;
    assert!(is_near(&found, &Circle { x: 130.0, y: 180.0, radius: 80.0 }, 0.01), "{found:?}");
}

#[test]
fn suggests_normals_and_meshes_for_outlines_that_are_not_ellipses() {
    let bar = shapes(|x, y| (100.0..380.0).contains(&x) && (150.0..220.0).contains(&y));
    let star = shapes(|x, y| {
        let at = DVec2::new(x - 240.0, y - 180.0);
        at.length() < 100.0 + 50.0 * (5.0 * at.to_angle()).cos()
    });
    for picture in [bar, star] {
        let refused = detect_ball(&picture, None).err().unwrap();
        let suggestions = refused.suggestions();
        assert!(
            suggestions.contains(&Suggestion::Normals) && suggestions.contains(&Suggestion::Mesh),
            "{refused}: {suggestions:?}"
        );
        let coverage = outlined(&picture, None).unwrap();
        let suggestions = crate::scene::find_ellipse(&coverage).unwrap_err().suggestions();
        assert!(
            suggestions.contains(&Suggestion::Normals) && suggestions.contains(&Suggestion::Mesh),
            "{suggestions:?}"
        );
    }
}

#[test]
fn rejects_objects_that_are_nearly_balls() {
    let noisy = noise(12.0, &mut Pcg64::seed_from_u64(8));
    let corner = |x: f64, y: f64| (0.866 * (x - 240.0).abs() + 0.5 * (y - 180.0).abs()).max((y - 180.0).abs());
    let inside: [&dyn Fn(f64, f64) -> bool; 3] = [
        &|x, y| ((x - 240.0) / 110.0).hypot((y - 180.0) / 101.0) < 1.0,
        &|x, y| ((x - 240.0) / 100.0).powi(4) + ((y - 180.0) / 100.0).powi(4) < 1.0,
        &|x, y| corner(x, y) < 90.0,
    ];
    for (shape, inside) in inside.into_iter().enumerate() {
        for plain in [true, false] {
            let mut rng = Pcg64::seed_from_u64(2);
            let rgb = Plane::from_fn(WIDTH, HEIGHT, |x, y| {
                let (u, v) = (x as f64 + 0.5, y as f64 + 0.5);
                let behind = if plain { Vec3::splat(0.2) } else { noisy(u, v) };
                let value = if inside(u, v) { Vec3::splat(2.0) } else { behind };
                value * (1.0 + 0.01 * rng.random_range(-1.0..1.0_f32))
            });
            let spotted =
                detect_ball(&Picture { rgb, alpha: None }, None).map(|spotted| (spotted.circle, spotted.reliability));
            assert!(spotted.is_err(), "{shape} {plain}: {spotted:?}");
        }
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let (picture, _) = photograph(Backdrop::Scales, 7);
    let all = |threads| {
        on_threads(threads, || {
            let small = Small::of(&picture.rgb, REDUCED_SIDE);
            CircleDetection::of(&picture.rgb, &small, &Edges::of(&small), None)
        })
    };
    assert_eq!(all(1), all(3));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(30))]

    #[test]
    fn no_picture_panics(
        (width, height, values) in (0_usize..40, 0_usize..40).prop_flat_map(|(w, h)| {
            let odd = prop_oneof![
                4 => 0.0_f32..2.0,
                2 => Just(0.5_f32),
                1 => prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(-1.0), Just(f32::MAX), Just(1e-40), Just(0.0)],
            ];
            (Just(w), Just(h), prop::collection::vec(odd, w * h))
        }),
        factor in 1_usize..12,
    ) {
        let rgb = Plane::from_fn(width * factor, height * factor, |x, y| {
            let value = values[y / factor * width + x / factor];
            Vec3::new(value, 0.5 * value, value)
        });
        let picture = Picture { rgb, alpha: None };
        if let Ok(spotted) = detect_ball(&picture, None) {
            prop_assert!(spotted.circle.radius.is_finite() && spotted.circle.radius > 0.0);
        }
        let _ = outlined(&picture, None);
        let given = Circle { x: 0.5 * picture.rgb.width() as f64, y: 10.0, radius: 9.0 };
        let _ = corrected(&picture.rgb, &given);
    }
}
