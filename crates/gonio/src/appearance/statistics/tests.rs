use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::super::disk::centre;
use super::*;

fn of(f: impl Fn(f32, f32) -> f32, seen: impl Fn(usize) -> bool) -> Vec<f32> {
    let values: Vec<f32> = (0..DISK_SIDE * DISK_SIDE).map(|c| f(centre(c).0, centre(c).1)).collect();
    let counts: Vec<f32> = (0..DISK_SIDE * DISK_SIDE).map(|c| f32::from(u8::from(seen(c)))).collect();
    let mut out = vec![0.0; STATISTICS];
    let fine: Vec<Option<f32>> = values.iter().map(|v| Some(0.1 * v)).collect();
    statistics(&values, &fine, &observed(&counts), &mut out);
    out
}

fn waves(x: f32, y: f32) -> f32 {
    1.0 + 0.4 * (5.0 * x + 2.0 * y).sin() + 0.2 * (17.0 * y - 9.0 * x).sin()
}

/// Index of the power of the detail at a level: of the logarithm, in the middle region.
fn at(level: usize) -> usize {
    let before = QUANTILES.len() + 4 * (RINGS.len() - 1) + REGIONS.len() - 1;
    let field = (STATISTICS - before) / 2;
    let gradients = GRADIENTS.filter(|g| *g < level).count() * 2 * (REGIONS.len() - 1);
    before + field + level * 15 + level.saturating_sub(1) * 2 + gradients + 5
}

fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn rotation_and_mirroring_change_no_statistic() {
    let upright = of(waves, |_| true);
    assert!(upright.iter().all(|v| v.is_finite() && v.abs() < 10.0));
    for turned in [of(|x, y| waves(-x, y), |_| true), of(|x, y| waves(y, -x), |_| true)] {
        assert!(largest_difference(&upright, &turned) < 1e-3, "{}", largest_difference(&upright, &turned));
    }
    assert!(largest_difference(&upright, &of(|x, y| waves(3.0 * x, y), |_| true)) > 0.3);
}

#[test]
fn waves_have_the_largest_power_at_their_scale() {
    // Waves of 4, 8, 16 and 32 cells.
    for level in 0..4 {
        let k = std::f32::consts::TAU / (8 << level) as f32 * DISK_SIDE as f32;
        let found = of(|x, y| (0.3 * (k * x).sin() + 0.3 * (k * y).sin()).exp(), |_| true);
        let powers: Vec<f32> = (0..LEVELS).map(|l| found[at(l)]).collect();
        let most = powers.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap().0;
        assert_eq!(most, level, "{powers:?}");
    }
}

#[test]
fn holes_change_statistics_little() {
    let mut rng = Pcg64::seed_from_u64(1);
    let seen: Vec<bool> = (0..DISK_SIDE * DISK_SIDE).map(|_| rng.random_range(0.0..1.0) < 0.7).collect();
    let (whole, holed) = (of(waves, |_| true), of(waves, |c| seen[c]));
    for level in 0..LEVELS {
        let (a, b) = (whole[at(level)], holed[at(level)]);
        assert!((a - b).abs() < 0.12, "{level}: {a} {b}");
    }
}

#[test]
fn statistics_are_always_finite() {
    for found in
        [of(|_, _| 0.0, |_| true), of(|_, _| 1.0, |_| false), of(|_, _| 1.0, |c| c == DISK_SIDE * DISK_SIDE / 2 + 70)]
    {
        assert!(found.iter().all(|v| v.is_finite()));
    }
    let spike = of(|x, y| if x.hypot(y - 0.3) < 0.02 { 1e6 } else { 1e-6 }, |_| true);
    assert!(spike.iter().all(|v| v.is_finite() && v.abs() < 10.0), "{spike:?}");
}
