use super::*;
use crate::scene::painted_ball::{SIZE, ball, highlights, irradiance, normal, usable};

fn found(rgb: &Plane<Vec3>, convex: bool) -> usize {
    segment_paint(rgb, &usable, &SurfaceGeometry { normal: &normal, convex })
        .map_or(0, |plane| plane.as_slice().iter().filter(|taken| **taken).count())
}

/// Shares of the pixels inside and outside a spot that are detected as another colour.
fn lost(rgb: &Plane<Vec3>, inside: impl Fn(Vec3) -> bool, convex: bool) -> (f64, f64) {
    let taken = segment_paint(rgb, &usable, &SurfaceGeometry { normal: &normal, convex });
    let share = |spot: bool| {
        let all =
            (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE)).filter(|at| usable(*at) && inside(normal(*at)) == spot);
        let (mut count, mut lost) = (0, 0);
        for at in all {
            count += 1;
            lost += usize::from(taken.as_ref().is_some_and(|taken| taken[at]));
        }
        f64::from(lost as u32) / f64::from(count)
    };
    (share(true), share(false))
}

#[test]
fn detects_paint_on_a_matte_ball() {
    let bodies = [Vec3::new(0.6, 0.1, 0.08), Vec3::new(0.7, 0.7, 0.65), Vec3::new(0.2, 0.3, 0.5)];
    let paints = [Vec3::new(0.1, 0.15, 0.5), Vec3::new(0.5, 0.06, 0.05), Vec3::new(0.25, 0.1, 0.06)];
    for (body, paint) in bodies.into_iter().zip(paints) {
        for (towards, radius) in [([0.2, 0.3, 0.9], 0.35), ([-0.5, 0.1, 0.8], 0.2), ([0.3, -0.6, 0.7], 0.1_f32)] {
            let towards = Vec3::from_array(towards).normalize();
            let inside = |n: Vec3| n.dot(towards) > radius.cos();
            for colour in [0.0, 0.5] {
                let rgb = ball(|n, _| irradiance(n, colour) * if inside(n) { paint } else { body });
                let (spot, rest) = lost(&rgb, inside, true);
                assert!(spot > 0.9 && rest < 0.01, "{body} {towards} {radius} {colour}: {spot:.3} {rest:.4}");
            }
        }
    }
}

#[test]
fn keeps_paint_that_only_darkens_where_shadows_are_possible() {
    let inside = |n: Vec3| n.dot(Vec3::new(0.2, 0.3, 0.93).normalize()) > 0.94;
    let rgb = ball(|n, _| irradiance(n, 0.3) * if inside(n) { Vec3::new(0.4, 0.06, 0.05) } else { Vec3::splat(0.7) });
    assert_eq!(lost(&rgb, inside, false), (0.0, 0.0));
    assert!(lost(&rgb, inside, true).0 > 0.9);
    let crossing =
        ball(|n, _| irradiance(n, 0.3) * if inside(n) { Vec3::new(0.1, 0.2, 0.5) } else { Vec3::new(0.5, 0.3, 0.1) });
    let (spot, rest) = lost(&crossing, inside, false);
    assert!(spot > 0.9 && rest < 0.01, "{spot} {rest}");
}

#[test]
fn highlights_and_coloured_lamps_are_not_paint() {
    for body in [Vec3::new(0.6, 0.05, 0.04), Vec3::new(0.05, 0.1, 0.4), Vec3::splat(0.4), Vec3::ZERO] {
        for power in [10.0, 100.0, 3000.0] {
            for strength in [0.1, 5.0] {
                for colour in [0.0, 0.7] {
                    let rgb = ball(|n, r| body * irradiance(n, colour) + strength * highlights(r, power));
                    assert_eq!(found(&rgb, true), 0, "{body} {power} {strength} {colour}");
                }
            }
            // White highlights with sharp edges, like those of windows.
            let rgb =
                ball(|n, r| body * irradiance(n, 0.0) + Vec3::splat(if r.x > 0.3 && r.y > 0.5 { 0.5 } else { 0.0 }));
            assert_eq!(found(&rgb, true), 0, "{body}");
        }
    }
}

#[test]
fn hard_terminators_in_the_dark_are_not_paint() {
    for body in [Vec3::new(0.6, 0.3, 0.1), Vec3::splat(0.5)] {
        for fill in [0.0, 0.01, 0.1] {
            let rgb = ball(|n, _| body * (irradiance(n, 1.0) - Vec3::splat(0.15 - fill)));
            assert_eq!(found(&rgb, true), 0, "{body} {fill}");
        }
    }
}

#[test]
fn reflections_in_metals_are_not_paint() {
    // Walls of many colours: the pieces of a room cut by planes, each with a gradient; then a
    // coloured card in front of a uniform or graded wall.
    let hue = |seed: u32| {
        let channel = |k: u32| 0.05 + ((seed.wrapping_mul(2_654_435_761).rotate_left(8 * k) >> 7) & 255) as f32 / 255.0;
        Vec3::new(channel(0), channel(1), channel(2))
    };
    let tints = [Vec3::ONE, Vec3::new(1.0, 0.7, 0.3), Vec3::new(0.9, 0.5, 0.4)];
    for (seed, tint) in (0..12).zip(tints.into_iter().cycle()) {
        for pieces in [1.5_f32, 2.5, 4.0, 8.0] {
            let rgb = ball(|_, r| {
                let cell = |v: f32| ((v + 1.0) * pieces) as u32;
                let number = seed * 1000 + cell(r.x) + 17 * cell(r.y) + 289 * cell(r.z);
                tint * hue(number) * (0.6 + 0.4 * r.x * r.y + 0.3 * r.y)
            });
            assert_eq!(found(&rgb, true), 0, "{tint} {pieces} {seed}");
        }
        for (grade, inner) in [(0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.5)] {
            let rgb = ball(|_, r| {
                let card = (r - Vec3::new(0.3, 0.4, 0.86)).length() < 0.7;
                let (colour, slope) = if card { (hue(seed), inner * r.x) } else { (hue(seed + 99), grade * r.y) };
                tint * colour * (1.0 + slope)
            });
            assert_eq!(found(&rgb, true), 0, "{tint} {grade} {inner} {seed}");
        }
    }
}

#[test]
fn keeps_large_areas_of_another_colour() {
    let rgb =
        ball(|n, _| irradiance(n, 0.2) * if n.x > 0.1 { Vec3::new(0.1, 0.2, 0.6) } else { Vec3::new(0.6, 0.2, 0.1) });
    assert_eq!(found(&rgb, true), 0);
    // Checks over the whole ball.
    let check = |n: Vec3| ((n.x * 6.0).floor() + (n.y * 6.0).floor()) as i32 % 2 == 0;
    let rgb =
        ball(|n, _| irradiance(n, 0.2) * if check(n) { Vec3::new(0.1, 0.2, 0.6) } else { Vec3::new(0.6, 0.2, 0.1) });
    assert_eq!(found(&rgb, true), 0);
}

#[test]
fn grey_and_empty_pictures_have_no_other_colour() {
    assert_eq!(found(&ball(|n, _| Vec3::splat(n.z)), true), 0);
    assert_eq!(found(&ball(|_, _| Vec3::ZERO), true), 0);
    assert!(
        segment_paint(&ball(|_, _| Vec3::ONE), &|_| false, &SurfaceGeometry { normal: &normal, convex: true })
            .is_none()
    );
}
