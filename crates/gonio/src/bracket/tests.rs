//! Tests on brackets of known radiance, taken by cameras of known response.

use glam::Vec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::*;
use crate::statistics::median;
use crate::testing::on_threads;

/// Curves of a camera, exposure 0..=1 to code 0..=1. None is the sRGB curve or a power law.
fn camera(channel: usize, exposure: f64) -> f64 {
    let x = exposure.clamp(0.0, 1.0);
    match channel {
        // A shoulder, as in film.
        0 => (1.0 - (-3.0 * x).exp()) / (1.0 - (-3.0_f64).exp()),
        // A power law plus an S curve.
        1 => {
            let c = x.powf(1.0 / 2.4);
            0.6 * c + 0.4 * c * c * (3.0 - 2.0 * c)
        }
        // A logarithm.
        _ => (1.0 + 60.0 * x).ln() / 61.0_f64.ln(),
    }
}

/// Logarithm of the exposure of each of 256 codes.
fn truth() -> Response {
    let invert = |channel: usize, code: f64| {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if camera(channel, middle) < code { low = middle } else { high = middle }
        }
        (0.5_f64 * (low + high)).ln()
    };
    let curve = |channel| (0..=255).map(|code| invert(channel, f64::from(code).max(0.25) / 255.0)).collect();
    Response::from_curves([curve(0), curve(1), curve(2)]).unwrap()
}

/// A coloured scene of five decades, smooth except for some steps.
fn scene(width: usize, height: usize) -> Plane<Vec3> {
    Plane::from_fn(width, height, |x, y| {
        let (u, v) = (x as f32 / width as f32, y as f32 / height as f32);
        let level = 10_f32.powf(4.5 * u - 2.5 + 0.3 * (9.0 * v).sin());
        Vec3::new(1.0, 0.5 + v, 1.2 - 0.6 * v) * level * if (x / 16 + y / 16) % 5 == 0 { 0.3 } else { 1.0 }
    })
}

/// Photographs the scene with approximately Gaussian noise of `noise` codes.
fn take(scene: &Plane<Vec3>, amounts: &[f64], noise: f64) -> Vec<Exposure> {
    let mut random = Pcg64::seed_from_u64(7);
    let mut expose = |amount: f64| {
        let code = |channel: usize, radiance: f32, random: &mut Pcg64| {
            let sum: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let exposure = f64::from(radiance) * amount;
            // Clipped values remain clipped: no noise is added to them.
            let noise = if exposure >= 1.0 { 0.0 } else { noise * sum };
            (255.0 * camera(channel, exposure) + noise).round().clamp(0.0, 255.0) as u8
        };
        let plane = scene.map(|v| [0, 1, 2].map(|c| code(c, v[c], &mut random)));
        Exposure { codes: Codes::Eight(plane), amount }
    };
    amounts.iter().map(|&t| expose(t)).collect()
}

const AMOUNTS: [f64; 7] = [0.01, 0.04, 0.16, 0.64, 2.56, 10.24, 40.96];

/// Largest relative error of the known pixels and its 99th percentile; each channel may have its
/// own scale.
fn errors(merged: &Merged, scene: &Plane<Vec3>, free_scale: bool) -> (f64, f64) {
    let known: Vec<usize> = (0..scene.as_slice().len())
        .filter(|&i| matches!(merged.known.as_slice()[i], MergedPixelStatus::From(_)))
        .collect();
    let mut all = Vec::new();
    for c in 0..3 {
        let ratios: Vec<f64> =
            known.iter().map(|&i| f64::from(merged.picture.rgb.as_slice()[i][c] / scene.as_slice()[i][c])).collect();
        let scale = if free_scale { median(ratios.iter().copied()).unwrap() } else { 1.0 };
        all.extend(ratios.iter().map(|r| (r / scale - 1.0).abs()));
    }
    all.sort_by(f64::total_cmp);
    (all[all.len() - 1], all[all.len() * 99 / 100])
}

#[test]
fn recovers_the_radiance_with_a_known_response() {
    let scene = scene(256, 128);
    let merged = merge(&take(&scene, &AMOUNTS, 0.0), Some(&truth()), &MergeSettings::default()).unwrap();
    let report = &merged.report;
    let (worst, most) = errors(&merged, &scene, false);
    assert!(most < 0.01 && worst < 0.03, "{worst} {most}");
    assert_eq!(
        report.pixels_by_exposure.iter().sum::<usize>() + report.clipped + report.dark + report.inconsistent,
        report.pixels
    );
    assert_eq!(report.inconsistent, 0);
    assert!(report.time_errors.iter().all(|e| e.abs() < 0.01));
    for (i, known) in merged.known.as_slice().iter().enumerate() {
        let (got, want) = (merged.picture.rgb.as_slice()[i], scene.as_slice()[i]);
        match known {
            MergedPixelStatus::Clipped => {
                assert_eq!(got, Vec3::splat(merged.clip_level));
                assert!(f64::from(want.max_element()) * AMOUNTS[0] > 0.8, "{want}");
            }
            _ => assert!(got.max_element() < merged.clip_level),
        }
    }
}

#[test]
fn recovers_the_response_from_noisy_codes() {
    let scene = scene(256, 128);
    for (noise, bound) in [(0.0, 0.06), (0.8, 0.06)] {
        let exposures = take(&scene, &AMOUNTS, noise);
        let got = Response::recover(&exposures).unwrap();
        let truth = truth();
        for c in 0..3 {
            let (got, want) = (got.curve(c), truth.curve(c));
            assert!(got.windows(2).all(|w| w[1] > w[0]), "the curve rises");
            assert!(got[128].abs() < 1e-9);
            let worst = (8..248).map(|k| (got[k] - want[k] + want[128]).abs()).fold(0.0, f64::max);
            assert!(worst < bound, "noise {noise}, channel {c}: off by {worst}");
        }
        let merged = merge(&exposures, Some(&got), &MergeSettings::default()).unwrap();
        let (_, most) = errors(&merged, &scene, true);
        assert!(most < 0.06, "noise {noise}: {most}");
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let exposures = take(&scene(96, 64), &AMOUNTS, 0.5);
    let run = || {
        let response = Response::recover(&exposures).unwrap();
        let merged = merge(&exposures, Some(&response), &MergeSettings::default()).unwrap();
        (response, merged)
    };
    assert_eq!(on_threads(1, run), on_threads(3, run));
}

#[test]
fn the_order_of_the_exposures_does_not_matter() {
    let scene = scene(96, 64);
    let mut exposures = take(&scene, &AMOUNTS, 0.5);
    let one = merge(&exposures, Some(&truth()), &MergeSettings::default()).unwrap();
    exposures.reverse();
    let two = merge(&exposures, Some(&truth()), &MergeSettings::default()).unwrap();
    assert!(
        one.picture
            .rgb
            .as_slice()
            .iter()
            .zip(two.picture.rgb.as_slice())
            .all(|(a, b)| (*a - *b).length() <= 1e-5 * a.length())
    );
    assert_eq!(one.report.clipped, two.report.clipped);
}

/// Linear 16-bit values with a black level, as developed from raw files.
#[test]
fn merges_sixteen_bit_codes_with_a_black_level() {
    let scene = scene(128, 64);
    let expose = |amount: f64, black: f64| {
        let code = |v: f32| (black + (65535.0 - black) * f64::from(v) * amount).round().min(65535.0) as u16;
        Exposure { codes: Codes::Sixteen(scene.map(|v| v.to_array().map(code))), amount }
    };
    let take = |black: f64| -> Vec<_> { [0.01, 0.08, 0.64].into_iter().map(|t| expose(t, black)).collect() };
    let merged = merge(&take(1024.0), Some(&Response::linear(u16::MAX, 1024.0)), &MergeSettings::default()).unwrap();
    let (worst, most) = errors(&merged, &scene, false);
    assert!(most < 6e-3 && worst < 0.03, "{worst} {most}");
    let (recovered, want) = (Response::recover(&take(0.0)).unwrap(), Response::linear(u16::MAX, 0.0));
    for code in (4000..60000).step_by(100) {
        let error = recovered.curve(1)[code] - want.curve(1)[code] + want.curve(1)[32896];
        assert!(error.abs() < 0.03, "{code}: {error}");
    }
}

#[test]
fn detects_motion() {
    let scene = scene(128, 64);
    let mut exposures = take(&scene, &AMOUNTS, 0.5);
    let blot = |exposure: &mut Exposure, width: usize| {
        if let Codes::Eight(plane) = &mut exposure.codes {
            for (x, y) in (20..20 + width).flat_map(|x| (20..30).map(move |y| (x, y))) {
                plane[(x, y)] = [90, 200, 160];
            }
        }
    };
    blot(&mut exposures[2], 8);
    let merged = merge(&exposures, Some(&truth()), &MergeSettings::default()).unwrap();
    assert_eq!(merged.known[(24, 25)], MergedPixelStatus::Inconsistent);
    assert!((70..90).contains(&merged.report.inconsistent), "{}", merged.report.inconsistent);
    assert_eq!(merged.picture.rgb[(24, 25)], Vec3::splat(merged.clip_level));
    // The response is nevertheless recovered.
    let got = Response::recover(&exposures).unwrap();
    let worst = (16..240).map(|k| (got.curve(1)[k] - truth().curve(1)[k] + truth().curve(1)[128]).abs());
    assert!(worst.fold(0.0, f64::max) < 0.06);
    // If too many pixels differ, the exposure is left out.
    blot(&mut exposures[1], 100);
    let merged = merge(&exposures, Some(&truth()), &MergeSettings::default()).unwrap();
    assert_eq!(left_out(&merged), [1]);
    assert!(errors(&merged, &scene, false).1 < 0.03);
    // Two exposures do not show which one is wrong.
    let error = merge(&exposures[1..3], Some(&truth()), &MergeSettings::default()).unwrap_err();
    assert!(matches!(error, BracketError::Motion { moved, .. } if moved > 400), "{error}");
    let trusting = MergeSettings { trust_times: true, ..MergeSettings::default() };
    let merged = merge(&exposures[1..3], Some(&truth()), &trusting).unwrap();
    assert!(
        merged.report.inconsistent > 400 && merged.known[(24, 25)] == MergedPixelStatus::Inconsistent,
        "{:?}",
        merged.report
    );
}

/// Indices of the exposures that were left out.
fn left_out(merged: &Merged) -> Vec<usize> {
    let corrections = merged.report.corrections.iter().enumerate();
    corrections.filter(|(_, correction)| correction.is_none()).map(|(index, _)| index).collect()
}

/// Part of a larger scene from a position, so that a shift shows other parts.
fn part(scene: &Plane<Vec3>, (x, y): (usize, usize), width: usize, height: usize) -> Plane<Vec3> {
    Plane::from_fn(width, height, |u, v| scene[(u + x, v + y)])
}

/// A grey scene of four decades with details of many sizes.
fn textured(width: usize, height: usize) -> Plane<Vec3> {
    let waves = [(0.9, 0.031, 0.017), (0.6, 0.011, -0.043), (0.35, 0.13, 0.09), (0.3, -0.21, 0.17), (0.2, 0.4, -0.33)];
    Plane::from_fn(width, height, |x, y| {
        let wave = |&(size, u, v): &(f32, f32, f32)| size * (u * x as f32 + v * y as f32 + 9.0 * size).sin();
        Vec3::new(1.0, 0.9, 0.7) * 10_f32.powf(waves.iter().map(wave).sum::<f32>() - 0.3)
    })
}

#[test]
fn aligns_shifted_exposures() {
    let large = textured(400, 200);
    let (width, height) = (300, 150);
    let shifts = [(0, 0), (1, 0), (-3, 2), (12, -9), (0, 1), (-25, 17), (4, 4)];
    let amounts = [0.32, 0.01, 0.04, 0.16, 0.64, 2.56, 10.24];
    let shot = |(shift, amount): (&(i32, i32), &f64)| {
        // The scene moves right if the frame moves left.
        let from = ((50 - shift.0) as usize, (25 - shift.1) as usize);
        take(&part(&large, from, width, height), &[*amount], 0.5).swap_remove(0)
    };
    let exposures: Vec<Exposure> = shifts.iter().zip(&amounts).map(shot).collect();
    let reference = part(&large, (50, 25), width, height);
    for response in [Some(truth()), None] {
        let merged = merge(&exposures, response.as_ref(), &MergeSettings::default()).unwrap();
        let found: Vec<_> = merged.report.corrections.iter().map(|c| c.map(|c| c.shift)).collect();
        assert_eq!(found, shifts.map(Some));
        let (_, most) = errors(&merged, &reference, response.is_none());
        assert!(most < if response.is_none() { 0.06 } else { 0.03 }, "{most}");
    }
    let as_taken = MergeSettings { align: false, ..MergeSettings::default() };
    assert!(merge(&exposures, Some(&truth()), &as_taken).is_err());
}

#[test]
fn still_brackets_are_not_shifted() {
    for (scene, noise) in [(scene(256, 128), 0.0), (scene(256, 128), 1.2), (textured(256, 128), 1.2)] {
        let merged = merge(&take(&scene, &AMOUNTS, noise), Some(&truth()), &MergeSettings::default());
        let report = merged.unwrap().report;
        assert!(report.corrections.iter().all(|c| c.is_some_and(|c| c.shift == (0, 0))), "{noise}: {report:?}");
    }
}

#[test]
fn corrects_flicker_and_veiling_glare() {
    let scene = scene(256, 128);
    let mut exposures = take(&scene, &AMOUNTS, 0.3);
    // The light is 12 % brighter in one exposure.
    exposures[3] = take(&scene, &[1.12 * AMOUNTS[3]], 0.3).swap_remove(0);
    exposures[3].amount = AMOUNTS[3];
    let merged = merge(&exposures, Some(&truth()), &MergeSettings::default()).unwrap();
    let gains = merged.report.corrections.iter().map(|c| c.unwrap().gain[1]);
    for (i, gain) in gains.enumerate() {
        assert!((gain - if i == 3 { 1.12 } else { 1.0 }).abs() < 0.01, "{i}: {gain}");
    }
    assert!((merged.report.time_errors[3] - 0.12).abs() < 0.01 && errors(&merged, &scene, false).1 < 0.02);
    let plain = MergeSettings { trust_times: true, ..MergeSettings::default() };
    let uncorrected = merge(&exposures, Some(&truth()), &plain).unwrap();
    assert!(errors(&uncorrected, &scene, false).1 > 0.05);
    // The longest exposure of a dark scene has additional light.
    let dim = scene.map(|v| *v * 0.2);
    let mut exposures = take(&dim, &AMOUNTS, 0.3);
    let veil = Vec3::splat(0.004);
    exposures[5] = take(&dim.map(|v| *v + veil), &AMOUNTS[5..6], 0.3).swap_remove(0);
    let merged = merge(&exposures, Some(&truth()), &MergeSettings::default()).unwrap();
    let found = merged.report.corrections[5].unwrap().veiling_glare[1] / AMOUNTS[5];
    assert!((found - 0.004).abs() < 0.0006, "{found}");
    assert!(errors(&merged, &dim, false).1 < 0.05, "{:?}", errors(&merged, &dim, false));
}

#[test]
fn a_veil_in_the_shortest_exposure_does_not_raise_the_others() {
    let scene = scene(256, 128).map(|v| *v * 0.2);
    let veil = Vec3::splat(0.05);
    let mut exposures = take(&scene, &AMOUNTS, 0.3);
    exposures[2] = take(&scene.map(|v| *v + veil), &AMOUNTS[2..3], 0.3).swap_remove(0);
    let merged = merge(&exposures[2..], Some(&truth()), &MergeSettings::default()).unwrap();
    let veils: Vec<f64> = merged.report.corrections.iter().map(|c| c.map_or(0.0, |c| c.veiling_glare[1])).collect();
    assert!((veils[0] / AMOUNTS[2] - 0.05).abs() < 0.01 && veils[1..].iter().all(|veil| *veil == 0.0), "{veils:?}");
    assert!(errors(&merged, &scene, false).1 < 0.05, "{:?}", errors(&merged, &scene, false));
}

#[test]
fn pixels_that_no_exposure_shows_are_unknown() {
    let large = textured(400, 200);
    let shot =
        |shift: usize, amount: f64| take(&part(&large, (50 - shift, 25), 300, 150), &[amount], 0.3).swap_remove(0);
    // The first exposure has a wrong time; the others are shifted by 6 pixels.
    let mut exposures = vec![shot(0, 0.32), shot(6, 0.08), shot(6, 1.28), shot(6, 5.12)];
    exposures[0].amount = 0.02;
    let merged = merge(&exposures, Some(&truth()), &MergeSettings::default()).unwrap();
    assert_eq!(left_out(&merged), [0]);
    for y in 0..150 {
        assert_eq!(merged.known[(297, y)], MergedPixelStatus::Inconsistent);
        assert_eq!(merged.picture.rgb[(297, y)], Vec3::splat(merged.clip_level));
    }
}

#[test]
fn leaves_out_an_exposure_with_a_wrong_time() {
    let scene = scene(128, 64);
    let mut exposures = take(&scene, &AMOUNTS, 0.5);
    exposures[3].amount *= 2.0;
    for response in [Some(truth()), None] {
        let merged = merge(&exposures, response.as_ref(), &MergeSettings::default()).unwrap();
        assert_eq!(left_out(&merged), [3]);
        assert_eq!(merged.report.pixels_by_exposure[3], 0);
        assert!(errors(&merged, &scene, response.is_none()).1 < 0.06);
    }
}

#[test]
fn rejects_wrong_times() {
    let mut exposures = take(&scene(128, 64), &AMOUNTS[2..4], 0.5);
    exposures[1].amount *= 2.0;
    let error = merge(&exposures, Some(&truth()), &MergeSettings::default()).unwrap_err();
    let BracketError::Times { first: 1, second: 2, measured, stated } = error else { panic!("{error}") };
    assert!((measured - 4.0).abs() < 0.1 && (stated - 8.0).abs() < 1e-9);
    exposures[1].amount = exposures[0].amount;
    assert_eq!(merge(&exposures, None, &MergeSettings::default()), Err(BracketError::EqualTimes));
}

#[test]
fn rejects_invalid_brackets() {
    let exposures = take(&scene(64, 32), &AMOUNTS, 0.0);
    let refused = |exposures: &[Exposure]| merge(exposures, Some(&truth()), &MergeSettings::default()).unwrap_err();
    assert_eq!(refused(&[]), BracketError::Count { count: 0 });
    assert_eq!(refused(&vec![exposures[0].clone(); 65]), BracketError::Count { count: 65 });
    for amount in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let bad = Exposure { amount, ..exposures[1].clone() };
        assert!(matches!(refused(&[exposures[0].clone(), bad]), BracketError::Amount { exposure: 2, .. }));
    }
    let small = take(&scene(32, 32), &AMOUNTS[..1], 0.0).swap_remove(0);
    assert!(matches!(refused(&[exposures[0].clone(), small]), BracketError::Sizes { exposure: 2, width: 32, .. }));
    let sixteen = Exposure { codes: Codes::Sixteen(Plane::from_fn(64, 32, |_, _| [9; 3])), amount: 1.0 };
    assert_eq!(refused(&[exposures[0].clone(), sixteen]), BracketError::Depths { exposure: 2 });
    let white = Exposure { codes: Codes::Eight(Plane::from_fn(8, 8, |_, _| [255; 3])), amount: 1.0 };
    assert_eq!(refused(&[white]), BracketError::NothingKnown { clipped: 64, dark: 0 });
    let empty = Exposure { codes: Codes::Eight(Plane::from_fn(0, 8, |_, _| [255; 3])), amount: 1.0 };
    assert_eq!(refused(&[empty]), BracketError::Empty);
    assert!(matches!(Response::recover(&exposures[..1]), Err(BracketError::TooLittleOverlap { pixels: 0, .. })));
    let same = [exposures[1].clone(), exposures[1].clone()];
    assert_eq!(Response::recover(&same), Err(BracketError::EqualTimes));
}

#[test]
fn rejects_invalid_response_curves() {
    let good = vec![0.0, 1.0, 2.0];
    for bad in
        [vec![0.0, 2.0, 1.0], vec![0.0; 3], vec![0.0, f64::NAN, 1.0], vec![0.0, 1.0], vec![0.0, 1.0, 1e3], vec![]]
    {
        let error = Response::from_curves([good.clone(), bad, good.clone()]).unwrap_err();
        assert!(matches!(error, BracketError::Curve { channel: 2, .. }), "{error}");
    }
}

#[test]
fn resampled_curves_keep_their_shape() {
    let fine = Response::linear(255, 0.0).resampled(u16::MAX);
    let want = Response::linear(u16::MAX, 0.0);
    assert!((300..=65535).step_by(7).all(|k| (fine.curve(0)[k] - want.curve(0)[k]).abs() < 1e-9));
    assert_eq!(fine.resampled(255).curve(2)[17..], Response::linear(255, 0.0).curve(2)[17..]);
}
