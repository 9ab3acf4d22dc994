//! `gonio-eval tints`: measures how the colour of captured light varies over its directions. Its
//! output for the training lights gives the constants of `gonio::estimate::ChromaticLight`.

use std::path::Path;

use anyhow::Result;
use glam::DVec3;
use gonio::lighting::LightGrid;
use gonio::picture::luminance;
use gonio::sphere::OctahedralMap;

use crate::data::Lights;

/// Squares along a side of the map.
const MAP_SIDE: usize = 16;

/// Radiance over the mean above which the weight of a square is constant: the colour of a lamp is
/// no more certain than that of a sky.
const BRIGHT: f64 = 3.0;

/// Range to which tints are clipped: in dark squares they are arbitrary.
const RANGE: (f64, f64) = (-0.9, 1.5);

/// Bounds of the angles (degrees) that correlations are averaged over.
const ANGLES: [f64; 8] = [0.1, 12.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0];

/// Returns the weights of a light's squares, whose sum is one, and their tints of red and blue. A
/// tint is the ratio of a channel's radiance to the luminance, divided by the same ratio of the
/// whole light, minus one.
fn tints(light: &LightGrid) -> Vec<(f64, [f64; 2])> {
    let texels: Vec<(f64, DVec3)> =
        light.texels().iter().map(|t| (f64::from(luminance(*t)).max(0.0), t.as_dvec3())).collect();
    let (whole, sum) = texels.iter().fold((0.0, DVec3::ZERO), |(y, rgb), (luminance, t)| (y + luminance, rgb + *t));
    let white = sum / whole;
    let weight = |luminance: f64| (luminance * texels.len() as f64 / whole).min(BRIGHT);
    let total: f64 = texels.iter().map(|(luminance, _)| weight(*luminance)).sum();
    let tint = |(luminance, rgb): &(f64, DVec3)| {
        let of = |c: usize| (rgb[c] / (white[c] * luminance).max(1e-12) - 1.0).clamp(RANGE.0, RANGE.1);
        (weight(*luminance) / total, [of(0), of(2)])
    };
    texels.iter().map(tint).collect()
}

/// Principal axes of a covariance with their standard deviations, the larger first.
fn axes([[a, b], [_, d]]: [[f64; 2]; 2]) -> [([f64; 2], f64); 2] {
    let angle = 0.5 * (2.0 * b).atan2(a - d);
    let (half, spread) = (0.5 * (a + d), (0.5 * (a - d)).hypot(b));
    let axis = |angle: f64, variance: f64| ([angle.cos(), angle.sin()], variance.max(0.0).sqrt());
    [axis(angle, half + spread), axis(angle + std::f64::consts::FRAC_PI_2, half - spread)]
}

pub(crate) fn run(data: &Path) -> Result<()> {
    let lights = Lights::training(data)?;
    let centre = |k: usize| {
        let at = |i: usize| (2 * i + 1) as f64 / MAP_SIDE as f64 - 1.0;
        OctahedralMap::EqualArea.direction(at(k % MAP_SIDE), -at(k / MAP_SIDE))
    };
    let centres: Vec<DVec3> = (0..MAP_SIDE * MAP_SIDE).map(centre).collect();
    let mut covariance = [[0.0; 2]; 2];
    let mut products = [(0.0, 0.0); ANGLES.len()];
    for name in lights.names() {
        let tints = tints(&lights.map(&name)?.to_grid(OctahedralMap::EqualArea, MAP_SIDE));
        for (weight, t) in &tints {
            (0..4).for_each(|at| covariance[at / 2][at % 2] += weight * t[at / 2] * t[at % 2]);
        }
        for (i, (left, a)) in tints.iter().enumerate() {
            for (j, (right, b)) in tints.iter().enumerate() {
                let angle = centres[i].angle_between(centres[j]).to_degrees();
                if let Some(bin) = ANGLES.iter().rposition(|low| angle >= *low) {
                    products[bin].0 += left * right * (a[0] * b[0] + a[1] * b[1]);
                    products[bin].1 += left * right;
                }
            }
        }
    }
    let count = lights.names().len() as f64;
    let covariance = covariance.map(|row| row.map(|x| x / count));
    println!("tints of red and blue in {count} lights:");
    for ([red, blue], sd) in axes(covariance) {
        println!("axis ({red:.3}, {blue:.3}): standard deviation {sd:.3}");
    }
    let variance = covariance[0][0] + covariance[1][1];
    for (k, (sum, weight)) in products.iter().enumerate() {
        let to = ANGLES.get(k + 1).copied().unwrap_or(180.0);
        println!("{:.0} to {to:.0} degrees apart: correlation {:.2}", ANGLES[k], sum / weight / variance);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn tints_do_not_depend_on_brightness_or_overall_colour() {
        let texel = |k: usize| if k.is_multiple_of(2) { Vec3::new(1.2, 1.0, 0.6) } else { Vec3::new(0.8, 1.0, 1.5) };
        let light = |white: Vec3| {
            LightGrid::from_texels(OctahedralMap::EqualArea, 4, (0..16).map(|k| 5.0 * white * texel(k)).collect())
        };
        let (a, b) = (tints(&light(Vec3::ONE)), tints(&light(Vec3::splat(3.0))));
        assert!((a.iter().map(|(weight, _)| weight).sum::<f64>() - 1.0).abs() < 1e-12);
        for ((_, a), (_, b)) in a.iter().zip(&b) {
            assert!((a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-6);
        }
        assert!(a[0].1[0] > 0.1 && a[1].1[1] > 0.3, "{a:?}");
    }

    #[test]
    fn axes_are_those_of_the_ellipse() {
        let [(long, sd), (short, least)] = axes([[4.0, 0.0], [0.0, 9.0]]);
        assert!((sd - 3.0).abs() < 1e-12 && (least - 2.0).abs() < 1e-12);
        assert!(long[1].abs() > 1.0 - 1e-12 && short[0].abs() > 1.0 - 1e-12, "{long:?} {short:?}");
        let [(long, sd), (_, least)] = axes([[1.0, -0.6], [-0.6, 1.0]]);
        assert!((sd * sd - 1.6).abs() < 1e-12 && (least * least - 0.4).abs() < 1e-12);
        assert!((long[0] + long[1]).abs() < 1e-12, "{long:?}");
    }
}
