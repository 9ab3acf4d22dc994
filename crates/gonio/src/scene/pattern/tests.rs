use super::*;
use crate::picture::luminance;
use crate::scene::painted_ball::{SIZE, ball, clean_ball, highlights, irradiance, normal, usable};

/// Paints of the tests: checkers, stripes, spots, two halves and a label.
const PATTERNS: [fn(Vec3) -> bool; 5] = [
    |n| {
        let (azimuth, elevation) = (n.x.atan2(n.z), n.y.asin());
        ((3.0 * azimuth + 0.3).floor() + (3.0 * elevation + 0.1).floor()) as i32 % 2 == 0
    },
    |n| (5.0 * (0.8 * n.y + 0.6 * n.x)).floor() as i32 % 2 == 0,
    |n| {
        let spots = [[0.2, 0.5, 0.8], [-0.6, 0.1, 0.8], [0.5, -0.4, 0.8], [-0.2, -0.7, 0.7], [-0.4, 0.7, 0.6]];
        spots.iter().any(|spot| n.dot(Vec3::from_array(*spot).normalize()) > 0.95)
    },
    |n| n.x + 0.3 * (3.0 * n.y).sin() > 0.1,
    |n| n.x.abs() < 0.4 && (n.y - 0.1).abs() < 0.35,
];

fn segment(rgb: &Plane<Vec3>) -> Option<Pattern> {
    segment_pattern(rgb, &usable, &SurfaceGeometry { normal: &normal, convex: true })
}

#[test]
fn ignores_the_smaller_part_of_a_pattern() {
    for (number, pattern) in PATTERNS.iter().enumerate() {
        for (body, paint, gloss) in [
            (Vec3::splat(0.5), Vec3::splat(0.15), 0.0),
            (Vec3::new(0.2, 0.2, 0.25), Vec3::splat(0.7), 0.3),
            (Vec3::new(0.6, 0.15, 0.1), Vec3::new(0.1, 0.12, 0.4), 0.5),
        ] {
            let rgb = ball(|n, r| {
                let colour = if pattern(n) { paint } else { body };
                irradiance(n, 0.3) * colour + gloss * highlights(r, 300.0)
            });
            let found = segment(&rgb).unwrap_or_else(|| panic!("pattern {number}: {body} {paint} {gloss}"));
            let inside: Vec<(usize, usize)> =
                (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE)).filter(|at| usable(*at)).collect();
            // Which part is the smaller one is a matter of a few pixels for some patterns.
            let is_other = |at: (usize, usize)| found.other[at] || found.converted[at].is_some();
            let used: Vec<_> = inside.iter().filter(|at| !is_other(**at)).collect();
            let is_paint_smaller = 2 * used.iter().filter(|at| pattern(normal(***at))).count() < used.len();
            let (mut lost, mut kept, mut wrong) = (0, 0, 0);
            for at in &inside {
                let is_smaller = pattern(normal(*at)) == is_paint_smaller;
                lost += usize::from(!is_smaller && is_other(*at));
                kept += usize::from(!is_smaller && !is_other(*at));
                wrong += usize::from(is_smaller && !is_other(*at));
            }
            let smaller = inside.len() - lost - kept;
            assert!(100 * wrong < 2 * smaller, "pattern {number}: {wrong} of {smaller} pixels are used");
            assert!(kept > lost, "pattern {number}: {lost} of {} pixels are lost", lost + kept);
            let truth = f64::from(luminance(paint) / luminance(body));
            let truth = if is_paint_smaller { truth } else { 1.0 / truth };
            assert!((found.ratio / truth).ln().abs() < 0.15, "pattern {number}: {} for {truth}", found.ratio);
            // The map of albedo has the paint of nearly all pixels, also beside borders.
            let is_smaller = |at: &(usize, usize)| pattern(normal(*at)) == is_paint_smaller;
            let mapped = inside.iter().filter(|at| (found.relative[**at] != Vec3::ONE) == is_smaller(at)).count();
            assert!(100 * mapped >= 97 * inside.len(), "pattern {number}: {mapped} of {}", inside.len());
            let smaller = inside.iter().map(|at| found.relative[*at]).find(|value| *value != Vec3::ONE).unwrap();
            let truth = if is_paint_smaller { paint / body } else { body / paint };
            assert!((smaller / truth - 1.0).abs().max_element() < 0.2, "pattern {number}: {smaller} for {truth}");
        }
    }
}

#[test]
fn converts_the_second_paint_to_the_larger_one() {
    let (body, paint) = (Vec3::splat(0.5), Vec3::new(0.15, 0.1, 0.2));
    // Equal reflections at the surface; proportional reflections.
    for is_proportional in [false, true] {
        for (number, least) in [(0, 10_000), (4, 1_000)] {
            let radiance = |n: Vec3, r: Vec3, colour: Vec3| {
                let reflected = if is_proportional { colour / body } else { Vec3::ONE };
                irradiance(n, 0.3) * colour + 0.3 * highlights(r, 300.0) * reflected
            };
            let is_paint = PATTERNS[number];
            let picture = ball(|n, r| radiance(n, r, if is_paint(n) { paint } else { body }));
            let found = segment(&picture).unwrap();
            let is_larger_body = found.ratio < 1.0;
            let plain = clean_ball(|n, r| radiance(n, r, if is_larger_body { body } else { paint }));
            let converted = (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE)).filter(|at| usable(*at));
            let errors: Vec<f64> =
                converted.filter_map(|at| Some(f64::from((found.converted[at]? / plain[at]).y.ln()))).collect();
            assert!(errors.len() > least, "{number} {is_proportional}: {}", errors.len());
            let large = errors.iter().filter(|error| error.abs() > 0.2).count();
            // The noise of the picture alone has a median of 0.01; it cancels in the bias.
            let middle = median(errors.iter().map(|error| error.abs())).unwrap();
            let bias = median(errors.iter().copied()).unwrap();
            assert!(
                middle < 0.011 && bias.abs() < 0.003 && 50 * large < errors.len(),
                "{number} {is_proportional}: {middle} {bias} {large} of {}",
                errors.len()
            );
        }
    }
}

#[test]
fn squares_with_a_highlight_have_their_paint() {
    // Squares of 15 degrees of a satin paint and of one half as bright. In a highlight, a dark
    // square is as bright as the other paint.
    let is_dark = |n: Vec3| {
        let square = |angle: f32| (angle.to_degrees() / 15.0).floor();
        (square(n.x.atan2(n.z)) + square(n.y.asin())) as i32 % 2 == 0
    };
    let rgb = ball(|n, r| {
        let share = if is_dark(n) { 0.5 } else { 1.0 };
        share * (0.4 * irradiance(n, 0.3) + 0.6 * highlights(r, 40.0))
    });
    let found = segment(&rgb).unwrap();
    let is_darker = found.ratio < 1.0;
    let inside = (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE)).filter(|at| usable(*at));
    let is_second = |at: (usize, usize)| is_dark(normal(at)) == is_darker;
    let wrong = inside.clone().filter(|at| (found.relative[*at] != Vec3::ONE) != is_second(*at)).count();
    assert!(100 * wrong < inside.clone().count(), "{wrong} of {}", inside.count());
}

#[test]
fn finer_cells_keep_the_groups() {
    let rgb = ball(|n, _| irradiance(n, 0.3) * if PATTERNS[1](n) { 0.2 } else { 0.6 });
    let surface = SurfaceGeometry { normal: &normal, convex: true };
    let cells = |count: f64| Cells::of(&rgb, &usable, &surface, (count, false)).unwrap();
    let (coarse, fine) = (cells(90.0), cells(280.0));
    let groups = Groups::of(&coarse, -1.0).unwrap();
    let divided = groups.divided(&coarse, &fine);
    assert_eq!((coarse.side, fine.side), (3, 1));
    for (at, other) in divided.places.iter().zip(&divided.other) {
        if let Some(own) = groups.index[(at.0 / 3, at.1 / 3)] {
            assert_eq!(*other, groups.other[own], "{at:?}");
        }
    }
    let mut joined = groups.divided(&coarse, &coarse);
    joined.other.fill(false);
    joined.join_groups(&coarse, &divided, &fine);
    assert_eq!(joined.other, groups.other);
}

#[test]
fn detects_a_label_beside_a_bright_rim() {
    let label = PATTERNS[4];
    let rgb = ball(|n, _| {
        // A large lamp behind the ball.
        let rim = 12.0 * (0.6 - n.z).max(0.0) * (1.0 + n.x);
        irradiance(n, 0.3) * (1.0 + rim) * if label(n) { 0.25 } else { 0.7 }
    });
    let found = segment(&rgb).unwrap();
    assert!((found.ratio / (0.25 / 0.7)).ln().abs() < 0.1, "{}", found.ratio);
    assert!(found.relative[(150, 140)] != Vec3::ONE && found.relative[(150, 240)] == Vec3::ONE);
    assert!(found.other[(150, 140)] || found.converted[(150, 140)].is_some());
}

#[test]
fn keeps_objects_of_one_material() {
    // Windows and a horizon, in a mirror and behind a coat on a coloured body.
    let room = |r: Vec3| {
        let window = |x: f32, y: f32, size: f32| (r.x - x).abs() < size && (r.y - y).abs() < 1.5 * size;
        let lit = [(-0.5, 0.3, 0.15), (0.1, 0.4, 0.12), (0.6, 0.2, 0.2), (0.3, -0.4, 0.1), (-0.2, -0.5, 0.2)];
        let wall = if r.y > -0.1 { Vec3::new(0.5, 0.6, 0.8) } else { Vec3::new(0.3, 0.2, 0.1) };
        let shade = 1.0 + 0.5 * r.x + 0.2 * (5.0 * r.y).sin();
        shade * wall
            + lit
                .iter()
                .filter(|(x, y, size)| window(*x, *y, *size))
                .map(|w| Vec3::splat(2.0 + 9.0 * w.2))
                .sum::<Vec3>()
    };
    let mirror = ball(|_, r| room(r));
    let coated = ball(|n, r| irradiance(n, 0.3) * Vec3::new(0.6, 0.1, 0.1) + 0.05 * room(r));
    let glossy = ball(|n, r| irradiance(n, 1.0) * 0.2 + highlights(r, 200.0));
    let matte = ball(|n, _| irradiance(n, 1.0) * Vec3::new(0.7, 0.3, 0.2));
    let horizon = ball(|n, r| {
        irradiance(n, 0.0) * 0.1 + if r.y > 0.05 { Vec3::splat(1.0 + 0.8 * r.x) } else { Vec3::splat(0.2) }
    });
    for (name, rgb) in [("mirror", mirror), ("coat", coated), ("gloss", glossy), ("matte", matte), ("horizon", horizon)]
    {
        assert_eq!(segment(&rgb).map(|pattern| pattern.ratio), None, "{name}");
    }
}

#[test]
fn small_and_dark_objects_have_no_pattern() {
    let flat = |side: usize, value: f32| Plane::from_fn(side, side, |_, _| Vec3::splat(value));
    let found =
        |rgb: &Plane<Vec3>| segment_pattern(rgb, &|_| true, &SurfaceGeometry { normal: &|_| Vec3::Z, convex: true });
    assert_eq!(found(&flat(120, 1.0)), None);
    assert_eq!(found(&flat(120, 0.0)), None);
    assert_eq!(found(&flat(10, 1.0)), None);
    assert_eq!(
        segment_pattern(&flat(120, 1.0), &|_| false, &SurfaceGeometry { normal: &|_| Vec3::Z, convex: true }),
        None
    );
}

#[test]
fn deviations_are_those_of_the_sample() {
    assert!((deviation([-2.0, 1.0, 1.0, -1.0, 5.0].into_iter()) - 1.4826).abs() < 1e-12);
}
