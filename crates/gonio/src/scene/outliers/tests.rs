use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::*;

const SIZE: usize = 120;

/// A smooth gradient with a broad highlight.
fn smooth(x: usize, y: usize) -> Vec3 {
    let (x, y) = (x as f32 / SIZE as f32, y as f32 / SIZE as f32);
    let lobe = (-40.0 * ((x - 0.3).powi(2) + (y - 0.4).powi(2))).exp();
    Vec3::new(0.2, 0.3, 0.1) * (0.3 + x + 0.5 * y * y) + 0.8 * lobe
}

/// Outliers `(x, y)` of a picture that shows the object everywhere.
fn found(rgb: &Plane<Vec3>) -> Vec<(usize, usize)> {
    let all = outliers(rgb, &rgb.map(|_| true)).excluded;
    all.into_iter().map(|i| (i % rgb.width(), i / rgb.width())).collect()
}

fn noisy(of: &Plane<Vec3>, relative: f32) -> Plane<Vec3> {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut draw = || 1.0 + relative * Distribution::<f32>::sample(&StandardNormal, &mut rng);
    of.map(|v| *v * Vec3::new(draw(), draw(), draw()))
}

#[test]
fn finds_planted_pixels() {
    let clean = Plane::from_fn(SIZE, SIZE, smooth);
    assert!(found(&clean).is_empty());
    for at in [(60, 60), (36, 48), (40, 52), (1, 70), (0, 0), (119, 60)] {
        for value in [0.0, 5.0, 20.0, 1e4, 1e9, f32::MAX] {
            let mut rgb = clean.clone();
            rgb[at] = Vec3::splat(value);
            // A corner has only three adjacent pixels, which are too few.
            let want = if at == (0, 0) { vec![] } else { vec![at] };
            assert_eq!(found(&rgb), want, "{at:?} {value}");
        }
        for channel in (0..3).filter(|_| at != (0, 0)) {
            let mut rgb = clean.clone();
            rgb[at][channel] *= 2.0;
            assert_eq!(found(&rgb), [at], "{at:?} {channel}");
        }
    }
}

#[test]
fn finds_pairs_and_pixels_in_noise() {
    let mut rgb = noisy(&Plane::from_fn(SIZE, SIZE, smooth), 0.05);
    assert!(found(&rgb).is_empty());
    rgb[(30, 90)] = Vec3::splat(7.0);
    rgb[(31, 91)] = Vec3::splat(9.0);
    rgb[(80, 20)].y = 4.0;
    rgb[(80, 80)] = Vec3::ZERO;
    assert_eq!(found(&rgb), [(80, 20), (80, 80), (30, 90), (31, 91)]);
}

#[test]
fn keeps_noise() {
    let clean = Plane::from_fn(SIZE, SIZE, smooth);
    for relative in [0.001, 0.01, 0.05, 0.2] {
        assert!(found(&noisy(&clean, relative)).len() <= 1, "{relative}");
    }
    // Quantised to 40 steps of an sRGB curve, then in blocks as of a JPEG file.
    let coarse = noisy(&clean, 0.02).map(|v| {
        let coded = |v: f32| crate::picture::srgb_decode((40.0 * crate::picture::srgb_encode(v)).round() / 40.0);
        Vec3::new(coded(v.x), coded(v.y), coded(v.z))
    });
    assert!(found(&coarse).len() <= 1);
    let blocks = Plane::from_fn(SIZE, SIZE, |x, y| coarse[(x / 8 * 8, y / 8 * 8)]);
    assert!(found(&blocks).is_empty());
}

#[test]
fn keeps_edges_and_sharp_highlights() {
    let edge = Plane::from_fn(SIZE, SIZE, |x, y| smooth(x, y) * if 3 * x + y > 200 { 5.0 } else { 1.0 });
    assert!(found(&edge).is_empty());
    let lines = Plane::from_fn(SIZE, SIZE, |x, y| smooth(x, y) * if x == 30 || y == 70 { 50.0 } else { 1.0 });
    assert!(found(&lines).is_empty());
    // A lamp of two pixels, blurred by about a pixel; then a lamp of one pixel with the tails of a
    // lobe.
    for (width, peak) in [(0.7, 1000.0), (0.5, 50.0), (0.6, 5.0)] {
        let lamp = |x: f32, y: f32| (-0.5 * (x * x + y * y) / (width * width)).exp();
        let rgb = Plane::from_fn(SIZE, SIZE, |x, y| {
            let (x0, y0) = (x as f32 - 60.0, y as f32 - 50.0);
            smooth(x, y) + peak * (lamp(x0, y0) + lamp(x0 - 1.0, y0))
        });
        assert!(found(&rgb).is_empty(), "{width} {peak}");
    }
    let tails = Plane::from_fn(SIZE, SIZE, |x, y| {
        let square = (x as f32 - 60.0).powi(2) + (y as f32 - 50.0).powi(2);
        smooth(x, y) + 300.0 / (1.0 + 12.0 * square).powi(2)
    });
    assert!(found(&tails).is_empty());
}

#[test]
fn keeps_pixels_of_a_sparkling_picture() {
    // One pixel in a hundred glints, so glints are structure of the picture.
    let mut rng = Pcg64::seed_from_u64(4);
    let mut draw = || Distribution::<f32>::sample(&StandardNormal, &mut rng);
    let glints = Plane::from_fn(SIZE, SIZE, |x, y| smooth(x, y) * if draw() > 2.3 { 2.0 + draw().abs() } else { 1.0 });
    assert!(found(&glints).is_empty());
}

#[test]
fn keeps_a_lamp_with_a_rim() {
    // The highlight of a phenolic, 64 pixels across: three neighbours are 1.4 times the body.
    let mut rgb = Plane::from_fn(SIZE, SIZE, smooth);
    let at = (60, 50);
    rgb[at] *= 10.0;
    assert_eq!(found(&rgb), [at]);
    for next in [(59, 50), (60, 49), (60, 51)] {
        rgb[next] *= 1.4;
    }
    assert!(found(&rgb).is_empty());
}

#[test]
fn keeps_the_sun_in_a_mirror() {
    // A mirror shows ground with sharp edges below a smooth sky; the sun covers one pixel.
    let mut rng = Pcg64::seed_from_u64(5);
    let mut draw = || Distribution::<f32>::sample(&StandardNormal, &mut rng).abs();
    let blocks = Plane::from_fn(SIZE, SIZE, |_, _| Vec3::splat(0.05 + 0.5 * draw()));
    let mut rgb = Plane::from_fn(SIZE, SIZE, |x, y| if y < 80 { smooth(x, y) } else { blocks[(x / 4, y / 4)] });
    let clean = outliers(&rgb, &rgb.map(|_| true));
    assert_eq!(clean, Outliers::default());
    rgb[(50, 30)] = Vec3::splat(1000.0);
    rgb[(90, 40)] = Vec3::ZERO;
    let found = outliers(&rgb, &rgb.map(|_| true));
    assert_eq!(found, Outliers { excluded: vec![40 * SIZE + 90], kept: 1 });
}

#[test]
fn ignores_pixels_outside_the_region() {
    let rgb = Plane::from_fn(SIZE, SIZE, |x, y| if x < 60 { smooth(x, y) } else { Vec3::splat(1e6) });
    let region = Plane::from_fn(SIZE, SIZE, |x, _| x < 60);
    assert!(outliers(&rgb, &region).excluded.is_empty());
    assert_eq!(outliers(&rgb, &region.map(|_| false)), Outliers::default());
    let none = Plane::from_vec(0, 0, Vec::new());
    assert_eq!(outliers(&none, &Plane::from_vec(0, 0, Vec::new())), Outliers::default());
}
