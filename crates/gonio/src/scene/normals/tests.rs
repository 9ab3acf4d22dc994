use super::*;
use crate::picture::luminance;

const SIZE: usize = 400;

/// Normals of a ball of radius 190 in the middle of the picture, without normals around it.
fn ball() -> Plane<Vec3> {
    Plane::from_fn(SIZE, SIZE, |x, y| {
        let (nx, ny) = ((x as f32 + 0.5 - 200.0) / 190.0, (200.0 - y as f32 - 0.5) / 190.0);
        let squared = nx * nx + ny * ny;
        if squared < 1.0 { Vec3::new(nx, ny, (1.0 - squared).sqrt()) } else { Vec3::ZERO }
    })
}

/// The radiance `2 + n`, which is never negative.
fn picture(normals: &Plane<Vec3>) -> Picture {
    Picture { rgb: normals.map(|n| Vec3::splat(2.0) + *n), alpha: None }
}

fn observe(normals: &Plane<Vec3>) -> Result<Observations, SceneError> {
    Observations::of_normals(&picture(normals), normals, None, &ObservationSettings::default())
}

/// The ball with each normal mapped by `f`, which also receives the index of the pixel.
fn with(f: impl Fn(usize, Vec3) -> Vec3) -> Plane<Vec3> {
    let mut normals = ball();
    for (i, normal) in normals.as_mut_slice().iter_mut().enumerate().filter(|(_, n)| **n != Vec3::ZERO) {
        *normal = f(i, *normal);
    }
    normals
}

#[test]
fn each_point_has_the_radiance_of_its_pixel() {
    let got = observe(&ball()).unwrap();
    assert_eq!(got.report.used, got.points.len());
    for ((point, value), (x, y)) in got.points.iter().zip(&got.values).zip(&got.pixels) {
        let want = luminance(Vec3::splat(2.0) + point.normal.as_vec3());
        assert!((value.unwrap() - f64::from(want)).abs() < 1e-5);
        let (nx, ny) = ((x - 200.0) / 190.0, (200.0 - y) / 190.0);
        assert!((point.normal.x - nx).abs() + (point.normal.y - ny).abs() < 1e-5 && point.view == DVec3::Z);
        assert!(point.normal.z > 80.0_f64.to_radians().cos());
    }
}

#[test]
fn thinning_is_even_over_the_directions() {
    let got = observe(&ball()).unwrap();
    assert!((9_000..=10_500).contains(&got.points.len()), "{}", got.points.len());
    // Mean height of a cap that extends to 80 degrees; the mean over all pixels is 0.66.
    let mean = got.points.iter().map(|p| p.normal).sum::<DVec3>() / got.points.len() as f64;
    assert!((mean - DVec3::new(0.0, 0.0, 0.587)).length() < 0.01, "{mean}");
    let mut counts = BTreeMap::new();
    for point in got.points.iter().filter(|p| p.normal.z > 0.3) {
        *counts.entry(cell(point.normal, 16)).or_insert(0_usize) += 1;
    }
    let mut counts: Vec<usize> = counts.into_values().collect();
    counts.sort_unstable();
    let (low, high) = (counts[counts.len() / 4], counts[counts.len() - 1]);
    assert!(high as f64 <= 1.35 * low as f64, "{counts:?}");
}

#[test]
fn takes_all_of_few_pixels_and_never_more_than_requested() {
    let all = Observations::of_normals(
        &picture(&ball()),
        &ball(),
        None,
        &ObservationSettings { normals: 1_000_000, ..ObservationSettings::default() },
    );
    let all = all.unwrap();
    assert_eq!(all.points.len(), all.report.observed_pixels);
    for normals in [90, 200, 1000, 5000] {
        let settings = ObservationSettings { normals, ..ObservationSettings::default() };
        let got = Observations::of_normals(&picture(&ball()), &ball(), None, &settings).unwrap();
        assert!(got.points.len() <= normals && got.points.len() >= normals / 2, "{normals} {}", got.points.len());
    }
}

#[test]
fn points_do_not_depend_on_the_radiance() {
    let (normals, settings) = (ball(), ObservationSettings::default());
    let one = observe(&normals).unwrap();
    assert_eq!(observe(&normals).unwrap(), one);
    let other = Picture { rgb: normals.map(|n| Vec3::splat((5.0 - 9.0 * n.z).clamp(0.0, 2.0))), alpha: None };
    let two = Observations::of_normals(&other, &normals, None, &settings).unwrap();
    assert_eq!(one.points, two.points);
    assert_eq!(two.report.clip_level, Some(2.0));
    assert!(two.report.clipped > 100 && two.report.clipped_pixels > two.report.clipped);
}

#[test]
fn a_mask_or_alpha_channel_defines_the_covered_pixels() {
    let mask = Plane::from_fn(SIZE, SIZE, |x, _| if x < 200 { 1.0 } else { 0.98 });
    let settings = ObservationSettings::default();
    let got = Observations::of_normals(&picture(&ball()), &ball(), Some(&mask), &settings).unwrap();
    assert!(got.points.iter().all(|p| p.normal.x < 0.0));
    assert!(got.report.without_normal > 1000);
    let by_alpha = Picture { alpha: Some(mask), ..picture(&ball()) };
    assert_eq!(Observations::of_normals(&by_alpha, &ball(), None, &settings).unwrap(), got);
    // An opaque alpha channel is that of a photograph without coverage.
    let opaque = Picture { alpha: Some(Plane::from_fn(SIZE, SIZE, |_, _| 1.0)), ..picture(&ball()) };
    let plain = Observations::of_normals(&picture(&ball()), &ball(), None, &settings).unwrap();
    assert_eq!(Observations::of_normals(&opaque, &ball(), None, &settings).unwrap(), plain);
}

#[test]
fn skips_and_counts_a_few_faulty_normals() {
    let got = observe(&with(|i, n| if i % 100 == 0 { 1.1 * n } else { n })).unwrap();
    assert!(got.report.not_unit > 500 && got.report.facing_away == 0, "{:?}", got.report);
    let got = observe(&with(|i, n| if i % 100 == 0 { -n } else { n })).unwrap();
    assert!(got.report.facing_away > 500 && got.report.not_unit == 0, "{:?}", got.report);
}

#[test]
fn rejects_faulty_maps() {
    let refused = |normals: &Plane<Vec3>| observe(normals).unwrap_err();
    assert_eq!(refused(&ball().map(|_| Vec3::ZERO)), SceneError::NoNormals);
    assert_eq!(refused(&ball().map(|_| Vec3::NAN)), SceneError::NoNormals);
    let coded = refused(&with(|_, n| 0.5 * (n + Vec3::ONE)));
    assert!(matches!(coded, SceneError::NotUnit { .. }), "{coded}");
    let long = refused(&with(|i, n| if i % 20 == 0 { 1.25 * n } else { n }));
    assert!(long.to_string().contains("worst length 1.25"), "{long}");
    let flipped = refused(&with(|_, n| n * Vec3::new(1.0, 1.0, -1.0)));
    assert!(matches!(flipped, SceneError::FacingAway { count, covered } if count == covered), "{flipped}");
    assert!(flipped.to_string().contains("check that no axis is flipped"));
    assert_eq!(refused(&with(|_, _| Vec3::Z)), SceneError::TooFlat { directions: 1 });
    let few = refused(&Plane::from_fn(6, 6, |_, _| Vec3::Z));
    assert!(matches!(few, SceneError::TooFewNormals { used: 36, covered: 36, .. }), "{few}");
}

#[test]
fn rejects_images_of_different_size() {
    let refused = |normals: &Plane<Vec3>, mask: Option<&Plane<f32>>| {
        Observations::of_normals(&picture(&ball()), normals, mask, &ObservationSettings::default()).unwrap_err()
    };
    let small = Plane::from_fn(30, 20, |_, _| Vec3::Z);
    let want = "the normal map is 30x20 pixels, but the image is 400x400; use images of the same size";
    assert_eq!(refused(&small, None).to_string(), want);
    let mask = Plane::from_fn(400, 20, |_, _| 1.0);
    let want = "the mask is 400x20 pixels, but the image is 400x400; use images of the same size";
    assert_eq!(refused(&ball(), Some(&mask)).to_string(), want);
}

#[test]
fn ignores_and_counts_faulty_pixels_in_the_observed_region() {
    let (normals, settings) = (ball(), ObservationSettings { normals: 1_000_000, ..ObservationSettings::default() });
    let observe = |picture: &Picture| Observations::of_normals(picture, &normals, None, &settings);
    let clean = observe(&picture(&normals)).unwrap();
    assert!(clean.statuses.is_none() && clean.report.faulty == 0);
    let mut bad = picture(&normals);
    bad.rgb[(0, 0)] = Vec3::NAN;
    bad.rgb[(200, 100)] = Vec3::splat(-1.0);
    bad.rgb[(201, 100)].z = f32::NAN;
    // A patch out of the gamut; a single pixel would be an outlier.
    for (x, y) in (0..25).map(|i| (148 + i % 5, 148 + i / 5)) {
        bad.rgb[(x, y)].x = -0.5;
    }
    let got = observe(&bad).unwrap();
    let ObservationReport { negative, not_finite, negative_channels, faulty, used, dark_outliers, .. } = got.report;
    assert_eq!((negative, not_finite, negative_channels, faulty, dark_outliers), (1, 1, 25, 2, 0));
    assert_eq!((used, &got.points), (clean.report.used - 2, &clean.points));
    let statuses = got.statuses.as_ref().unwrap();
    assert_eq!(
        [(200, 100), (201, 100), (150, 150), (0, 0)].map(|at| statuses[at]),
        [PixelStatus::Negative, PixelStatus::NotFinite, PixelStatus::Used, PixelStatus::Outside]
    );
    assert!(got.weights.iter().all(|w| (0.0..=1.0).contains(w)));
    let at = got.pixels.iter().position(|at| *at == (150.5, 150.5)).unwrap();
    let (colour, value) = (got.colours[at].unwrap(), got.values[at].unwrap());
    assert!(colour.x == 0.0 && value < f64::from(luminance(colour)), "{colour} {value}");
    let mostly =
        Picture { rgb: normals.map(|n| Vec3::splat(if n.x > -0.1 { f32::NAN } else { 1.0 + n.y })), alpha: None };
    assert!(matches!(observe(&mostly), Err(SceneError::BadPixels { negative: 0, not_finite: 50_000.., .. })));
    let black = Picture { rgb: normals.map(|_| Vec3::ZERO), alpha: None };
    assert_eq!(observe(&black).unwrap_err(), SceneError::Black);
}
