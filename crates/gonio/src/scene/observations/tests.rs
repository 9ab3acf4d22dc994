use super::*;

const CIRCLE: Circle = Circle { x: 151.3, y: 148.6, radius: 140.0 };

/// A ball whose radiance is `f` of the normal, over a background that no point may use.
fn ball(f: impl Fn(DVec3) -> Vec3) -> Picture {
    let rgb = Plane::from_fn(300, 300, |x, y| {
        let (nx, ny) = ((x as f64 + 0.5 - CIRCLE.x) / CIRCLE.radius, (CIRCLE.y - y as f64 - 0.5) / CIRCLE.radius);
        let squared = nx * nx + ny * ny;
        if squared < 1.0 { f(DVec3::new(nx, ny, (1.0 - squared).sqrt())) } else { Vec3::splat(f32::NAN) }
    });
    Picture { rgb, alpha: None }
}

fn tilted() -> Picture {
    ball(|n| Vec3::new(2.0 + n.x as f32, 2.0 + n.y as f32, 1.0))
}

fn observe(picture: &Picture) -> Result<Observations, SceneError> {
    Observations::of_sphere(picture, &CIRCLE, None, &ObservationSettings::default())
}

#[test]
fn reproduces_radiance_that_is_linear_in_the_picture() {
    let got = observe(&tilted()).unwrap();
    assert_eq!((got.report.points, got.report.used), (9916, 9916), "{:?}", got.report);
    for ((point, colour), value) in got.points.iter().zip(&got.colours).zip(&got.values) {
        let n = point.normal.as_vec3();
        let want = Vec3::new(2.0 + n.x, 2.0 + n.y, 1.0);
        assert!((colour.unwrap() - want).length() < 1e-5, "{n}");
        assert!((value.unwrap() - f64::from(luminance(want))).abs() < 1e-5);
    }
}

#[test]
fn counts_pixels_separately_from_points() {
    // A ball with a radius of ten pixels: the points are interpolated between few pixels.
    let small = Circle { x: 15.0, y: 15.0, radius: 10.0 };
    let mut rgb = Plane::from_fn(30, 30, |x, y| Vec3::splat(1.0 + 0.01 * (x + y) as f32));
    let observe = |rgb: &Plane<Vec3>| {
        let picture = Picture { rgb: rgb.clone(), alpha: None };
        Observations::of_sphere(&picture, &small, None, &ObservationSettings::default()).unwrap().report
    };
    let clean = observe(&rgb);
    assert!(clean.used_pixels == clean.observed_pixels && clean.used > 20 * clean.used_pixels, "{clean:?}");
    // Pixels entirely within the circle: fewer than its area.
    assert!((240..=300).contains(&clean.used_pixels), "{clean:?}");
    rgb[(15, 15)] = Vec3::splat(f32::NAN);
    rgb[(12, 17)] = Vec3::splat(-1.0);
    assert_eq!(observe(&rgb).used_pixels, clean.used_pixels - 2);
}

#[test]
fn reproduces_curved_radiance_to_interpolation_accuracy() {
    let got = observe(&ball(|n| Vec3::splat(n.z as f32))).unwrap();
    for (point, value) in got.points.iter().zip(&got.values) {
        // The error is h^2 / 4 times the second derivative, 1 / (r^2 z^3), and larger at the rim.
        let bound = 0.5 / (CIRCLE.radius * CIRCLE.radius * point.normal.z.powi(3));
        assert!((value.unwrap() - point.normal.z).abs() < bound + 1e-6, "{}", point.normal);
    }
}

#[test]
fn y_points_up_and_pixel_centres_are_at_one_half() {
    let got = observe(&tilted()).unwrap();
    for (point, (x, y)) in got.points.iter().zip(&got.pixels) {
        assert_eq!(point.normal.y > 0.0, *y < CIRCLE.y);
        assert_eq!(point.normal.x > 0.0, *x > CIRCLE.x);
        assert_eq!(point.view, DVec3::Z);
    }
    let picture = Plane::from_fn(4, 4, |x, y| Vec3::splat((x + 10 * y) as f32));
    let everywhere = picture.map(|_| PixelStatus::Used);
    let at = |x, y| sample(&picture, &everywhere, (x, y));
    assert_eq!(at(1.5, 2.5), ObservedColour::Colour(Vec3::splat(21.0)));
    assert_eq!(at(2.0, 1.0), ObservedColour::Colour(Vec3::splat(6.5)));
    assert_eq!(at(0.5, 0.5), ObservedColour::Colour(Vec3::splat(0.0)));
    assert_eq!((at(0.4, 2.0), at(2.0, 3.6)), (ObservedColour::Outside, ObservedColour::Outside));
}

#[test]
fn points_depend_only_on_the_settings() {
    let settings = ObservationSettings::default();
    let mut clipped = tilted();
    for (i, colour) in clipped.rgb.as_mut_slice().iter_mut().enumerate().filter(|(i, _)| i % 7 == 0) {
        *colour = if colour.is_finite() { Vec3::splat(9.0 + (i % 2) as f32) } else { *colour };
    }
    let (one, two) = (observe(&tilted()).unwrap(), observe(&clipped).unwrap());
    assert_eq!(one.points, two.points);
    assert_eq!(one.points, sphere_points(&settings));
    assert_eq!(observe(&tilted()).unwrap(), one);
    assert!(two.report.used < one.report.used);
}

#[test]
fn points_next_to_clipped_pixels_have_no_value() {
    let mut picture = tilted();
    // A patch of 6 x 6 pixels about the centre, one channel only.
    for y in 146..152 {
        for x in 149..155 {
            picture.rgb[(x, y)].z = 50.0;
        }
    }
    let got = observe(&picture).unwrap();
    assert_eq!((got.report.clip_level, got.report.clipped_pixels), (Some(50.0), 36));
    for ((x, y), value) in got.pixels.iter().zip(&got.values) {
        let near = (148.5..155.5).contains(x) && (145.5..152.5).contains(y);
        assert_eq!(value.is_none(), near, "{x} {y}");
    }
    let expected = got.pixels.iter().filter(|(x, y)| (x - 152.0).abs() < 3.5 && (y - 149.0).abs() < 3.5).count();
    assert_eq!((got.report.clipped, got.report.outside), (expected, 0));
    let given = ObservationSettings { clip: Some(2.5), ..ObservationSettings::default() };
    let got = Observations::of_sphere(&tilted(), &CIRCLE, None, &given).unwrap();
    assert!(got.colours.iter().flatten().all(|c| c.max_element() < 2.5) && got.report.clipped > 1000);
}

#[test]
fn uncovered_and_cropped_points_have_no_value() {
    let mask = Plane::from_fn(300, 300, |x, _| if x < 150 { 1.0 } else { 0.98 });
    let settings = ObservationSettings::default();
    let got = Observations::of_sphere(&tilted(), &CIRCLE, Some(&mask), &settings).unwrap();
    assert!(got.pixels.iter().zip(&got.values).all(|((x, _), value)| value.is_some() == (*x < 149.5)));
    let by_alpha = Picture { alpha: Some(mask), ..tilted() };
    assert_eq!(observe(&by_alpha).unwrap(), got);
    let cropped = Circle { x: 10.0, ..CIRCLE };
    let grey = Picture { rgb: Plane::from_fn(300, 300, |x, y| Vec3::splat((x + y) as f32)), alpha: None };
    let got = Observations::of_sphere(&grey, &cropped, None, &settings).unwrap();
    assert!(got.pixels.iter().zip(&got.values).all(|((x, _), value)| value.is_some() == (*x >= 0.5)));
}

#[test]
fn skips_faulty_pixels_next_to_valid_ones() {
    let clean = observe(&tilted()).unwrap();
    for (bad, status) in
        [(f32::NAN, PixelStatus::NotFinite), (f32::INFINITY, PixelStatus::NotFinite), (-0.1, PixelStatus::Negative)]
    {
        let mut picture = tilted();
        picture.rgb[(170, 140)] = Vec3::splat(bad);
        let got = observe(&picture).unwrap();
        let report = &got.report;
        assert_eq!((report.negative + report.not_finite, report.used + report.faulty), (1, report.points));
        assert_eq!(got.statuses.as_ref().unwrap()[(170, 140)], status);
        for ((at, value), was) in got.pixels.iter().zip(&got.values).zip(&clean.values) {
            let weight = (1.0 - (at.0 - 170.5).abs()).max(0.0) * (1.0 - (at.1 - 140.5).abs()).max(0.0);
            assert_eq!(value.is_none(), weight > 0.5, "{at:?}");
            let off = value.map_or(0.0, |v| (v - was.unwrap()).abs());
            assert!(off < 0.01 && (weight > 0.0 || off == 0.0), "{at:?}");
        }
        // Faults outside the observed part of the picture are not reported.
        picture.alpha = Some(Plane::from_fn(300, 300, |_, y| f32::from(!(140..142).contains(&y))));
        let report = observe(&picture).unwrap().report;
        assert!(report.outside > 0 && report.negative + report.not_finite == 0);
    }
}

#[test]
fn other_values_of_the_same_pixels_have_the_same_points() {
    let mut picture = tilted();
    for with_faults in [false, true] {
        if with_faults {
            picture.rgb[(150, 150)] = Vec3::splat(f32::NAN);
            picture.rgb[(100, 120)] = Vec3::splat(500.0);
        }
        let own = observe(&picture).unwrap();
        let again =
            |picture: &Picture| own.with_values(picture, &CIRCLE, None, &ObservationSettings::default()).unwrap();
        assert_eq!(own.statuses.is_some(), with_faults);
        assert_eq!(again(&picture), own);
        let doubled = Picture { rgb: picture.rgb.map(|colour| 2.0 * *colour), alpha: None };
        let twice = again(&doubled);
        for (one, two) in own.values.iter().zip(&twice.values) {
            assert_eq!(one.map(|value| (2.0 * value) as f32), two.map(|value| value as f32));
        }
        assert_eq!((twice.report, twice.dense.len()), (own.report, own.dense.len()));
    }
}

#[test]
fn negative_channels_are_zero_in_the_colour_but_not_in_the_luminance() {
    let got = observe(&ball(|n| Vec3::new(-0.1, 2.0 + n.x as f32, 1.0))).unwrap();
    assert_eq!((got.report.used, got.report.negative, got.statuses), (9916, 0, None));
    assert_eq!(got.report.negative_channels, got.report.observed_pixels);
    for (colour, value) in got.colours.iter().zip(&got.values) {
        let colour = colour.unwrap();
        let want = luminance(colour) - 0.1 * luminance(Vec3::X);
        assert!(colour.x == 0.0 && (value.unwrap() - f64::from(want)).abs() < 1e-6);
    }
}

#[test]
fn rejects_pictures_with_too_few_valid_pixels() {
    let most = observe(&ball(|n| Vec3::splat(if n.x < 0.2 { f32::NAN } else { 1.0 }))).unwrap_err();
    assert!(matches!(most, SceneError::BadPixels { negative: 0, not_finite: 30_000.., .. }), "{most}");
    let dark = observe(&ball(|n| Vec3::splat(n.x as f32 - 0.2))).unwrap_err();
    assert!(dark.to_string().contains("are negative and 0 are NaN"), "{dark}");
    // Black is a valid value, even on half of the ball.
    let black = observe(&ball(|n| Vec3::splat((n.x as f32).max(0.0)))).unwrap();
    assert_eq!((black.report.used, black.report.negative), (9916, 0));
}

#[test]
fn rejects_pictures_without_observations() {
    assert_eq!(observe(&ball(|_| Vec3::ZERO)).unwrap_err(), SceneError::Black);
    let error = observe(&ball(|_| Vec3::ONE)).unwrap_err();
    assert_eq!(error, SceneError::TooFewPoints { used: 0, clipped: 9916, outside: 0 });
    let settings = ObservationSettings::default();
    let observe = |circle, coverage| Observations::of_sphere(&tilted(), &circle, coverage, &settings).unwrap_err();
    let away = observe(Circle { x: 900.0, ..CIRCLE }, None);
    assert!(matches!(away, SceneError::TooFewPoints { outside: 9916, .. }));
    for radius in [7.9, f64::NAN, f64::INFINITY] {
        assert!(matches!(observe(Circle { radius, ..CIRCLE }, None), SceneError::BadCircle { .. }), "{radius}");
    }
    assert!(matches!(observe(Circle { y: f64::NAN, ..CIRCLE }, None), SceneError::BadCircle { .. }));
    let small = Plane::from_fn(30, 20, |_, _| 1.0);
    let error = observe(CIRCLE, Some(&small));
    assert_eq!(error.to_string(), "the mask is 30x20 pixels, but the image is 300x300; use images of the same size");
}

#[test]
fn settings_of_the_paper_leave_8600_normals_away_from_the_poles() {
    let points = sphere_points(&ObservationSettings::of_paper());
    assert!(points.len().abs_diff(8600) <= 10, "{}", points.len());
    let steepest = points.iter().map(|p| p.normal.y.abs()).fold(0.0, f64::max);
    assert!(steepest < 34.4_f64.to_radians().cos(), "{steepest}");
}
