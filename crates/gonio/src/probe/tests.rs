//! Probes of exactly rendered pictures of a mirror ball in a light.

use std::f64::consts::PI;

use glam::{DQuat, DVec3, Vec3};

use super::*;
use crate::lighting::{lamp_light, studio_light};
use crate::picture::Picture;
use crate::scene::{Circle, ObjectShape, SceneError};
use crate::shape::{Camera, Projection};
use crate::sphere::direction_of_lat_long;

type Light<'a> = &'a dyn Fn(DVec3) -> DVec3;

/// Renders a mirror ball for a camera that moved around it by `turn`.
///
/// Each pixel is the mean of `samples` x `samples` exact reflections.
fn photograph(ball: &MirrorBall, size: (usize, usize), light: Light<'_>, turn: f64, samples: usize) -> Picture {
    let to_map = DQuat::from_rotation_y(turn);
    let reflectance = Reflectance::new([0.6, 0.65, 0.7]).unwrap();
    let pixel = |x: usize, y: usize| {
        let (mut sum, mut covered) = (DVec3::ZERO, 0.0);
        for i in 0..samples * samples {
            let at = |whole: usize, part: usize| whole as f64 + (part as f64 + 0.5) / samples as f64;
            if let Some(seen) = ball.reflection_at((at(x, i % samples), at(y, i / samples))) {
                sum += light(to_map * seen.direction) * reflectance.at(seen.cosine);
                covered += 1.0;
            }
        }
        let count = (samples * samples) as f64;
        ((sum / count).as_vec3(), (covered / count) as f32)
    };
    let (rgb, alpha): (Vec<Vec3>, Vec<f32>) = (0..size.0 * size.1).map(|i| pixel(i % size.0, i / size.0)).unzip();
    Picture { rgb: Plane::from_vec(size.0, size.1, rgb), alpha: Some(Plane::from_vec(size.0, size.1, alpha)) }
}

fn settings(rows: usize) -> ProbeSettings {
    ProbeSettings { reflectance: Reflectance::new([0.6, 0.65, 0.7]).unwrap(), rows: Some(rows) }
}

const SIZE: (usize, usize) = (260, 256);

fn far() -> MirrorBall {
    MirrorBall::of_circle(Circle { x: 131.3, y: 127.6, radius: 120.0 }, SIZE).unwrap()
}

fn near() -> (MirrorBall, Camera) {
    let camera = Camera::new(Projection::Perspective { focal: 600.0 }, (120.0, 140.0), SIZE).unwrap();
    (MirrorBall::new(camera, DVec3::new(0.02, 0.03, -1.0), 0.19).unwrap(), camera)
}

fn view(picture: &Picture, object: &ObjectShape) -> View {
    View::of(picture, None, object, None).unwrap()
}

/// Light of a lamp of a small angular radius.
fn lamp(direction: DVec3, centre: DVec3, radius: f64, colour: DVec3) -> DVec3 {
    if direction.angle_between(centre) < radius { colour } else { DVec3::ZERO }
}

/// Smooth light from all directions, with detail of about ten degrees.
fn rippled(d: DVec3) -> DVec3 {
    let wave = |k: DVec3| 0.5 + 0.45 * (k.dot(d)).sin();
    DVec3::new(wave(DVec3::new(9.0, 3.0, -4.0)), wave(DVec3::new(-5.0, 8.0, 2.0)), wave(DVec3::new(3.0, -6.0, 7.0)))
}

/// Root mean square difference over visible texels, relative to the light.
fn error(probe: &Probe, light: Light<'_>, least_seen: f32) -> f64 {
    let rows = probe.report.rows;
    let (mut off, mut all) = (0.0, 0.0);
    for i in (0..2 * rows * rows).filter(|i| probe.coverage.as_slice()[*i] >= least_seen) {
        let at = |k: usize, n: usize| (k as f64 + 0.5) / n as f64;
        let want = light(direction_of_lat_long(at(i % (2 * rows), 2 * rows), at(i / (2 * rows), rows)));
        let got = probe.light.radiance().as_slice()[i].as_dvec3();
        off += solid_angle(rows, i) * (got - want).length_squared();
        all += solid_angle(rows, i) * want.length_squared();
    }
    f64::sqrt(off / all)
}

#[test]
fn the_map_equals_the_light() {
    let picture = photograph(&far(), SIZE, &rippled, 0.0, 3);
    let found = probe(&view(&picture, &ObjectShape::Sphere(None)), None, &settings(128)).unwrap();
    let orthographic = error(&found, &rippled, 1.0);
    let (ball, camera) = near();
    let picture = photograph(&ball, SIZE, &rippled, 0.0, 3);
    let before = view(&picture, &ObjectShape::Ball(camera));
    let found_near = probe(&before, None, &settings(128)).unwrap();
    let perspective = error(&found_near, &rippled, 1.0);
    assert!(orthographic < 0.01 && perspective < 0.01, "{orthographic} {perspective}");
    assert!(found.report.unseen < 0.05 && found_near.report.unseen < 0.16);
    assert!(view(&picture, &ObjectShape::Ball(camera)).warnings().is_empty());
    // The radius in pixels determines the default number of rows.
    let own = probe(&before, None, &ProbeSettings { rows: None, ..settings(8) }).unwrap();
    assert_eq!(own.light.radiance().size(), (256, 128));
}

#[test]
fn lamps_keep_their_position_and_flux() {
    let lamps = [
        (DVec3::X, DVec3::X),
        (DVec3::Y, DVec3::Z),
        (DVec3::new(0.25, -0.2, 1.0).normalize(), DVec3::Y),
        (DVec3::new(-0.9, 0.1, -1.0).normalize(), DVec3::new(1.0, 1.0, 0.0)),
    ];
    // Smaller than a pixel in the middle, and smaller than any texel.
    let radius = 0.02;
    let light = |d: DVec3| {
        DVec3::splat(0.01) + lamps.iter().map(|(at, colour)| lamp(d, *at, radius, 1e3 * *colour)).sum::<DVec3>()
    };
    let (near, camera) = near();
    for (ball, object) in [(far(), ObjectShape::Sphere(None)), (near, ObjectShape::Ball(camera))] {
        let picture = photograph(&ball, SIZE, &light, 0.0, 16);
        for rows in [32, 128, 256] {
            let found = probe(&view(&picture, &object), None, &settings(rows)).unwrap();
            for (at, colour) in lamps {
                // Flux and its centre within eight degrees.
                let (mut flux, mut centre) = (DVec3::ZERO, DVec3::ZERO);
                for i in 0..2 * rows * rows {
                    let part = |k: usize, n: usize| (k as f64 + 0.5) / n as f64;
                    let d = direction_of_lat_long(part(i % (2 * rows), 2 * rows), part(i / (2 * rows), rows));
                    if d.angle_between(at) < 0.14 + PI / rows as f64 {
                        let light = solid_angle(rows, i) * found.light.radiance().as_slice()[i].as_dvec3();
                        flux += light;
                        centre += light.dot(colour) * d;
                    }
                }
                let want = 1e3 * colour * 2.0 * PI * (1.0 - radius.cos());
                let off = (flux - want).length() / want.length();
                let aside = centre.angle_between(at).to_degrees();
                assert!(off < 0.03 && aside < 0.3 + 40.0 / rows as f64, "{at} {flux} {want}");
            }
        }
    }
}

/// Light of a high dynamic range with soft lamps.
fn lively(d: DVec3) -> DVec3 {
    let lamps = [DVec3::new(0.6, 0.5, 0.7), DVec3::new(-0.8, 0.3, -0.5), DVec3::new(0.1, -0.4, -1.0)];
    let lamp = |at: &DVec3| 20.0 * (-0.5 * (d.angle_between(*at) / 0.08).powi(2)).exp();
    (2.0 * rippled(d)).map(f64::exp) + DVec3::splat(lamps.iter().map(lamp).sum())
}

#[test]
fn two_views_cover_the_sphere_and_determine_their_turn() {
    let studio = studio_light(256);
    let studio = |d: DVec3| studio.at(d).as_dvec3();
    for (light, degrees) in [(&lively as Light<'_>, 90.0), (&studio, -65.3), (&lively, 125.0)] {
        let turn = f64::to_radians(degrees);
        // A bright camera is part of the light of its own view.
        let with = |eye: DVec3| move |d: DVec3| if d.angle_between(eye) < 0.15 { DVec3::splat(30.0) } else { light(d) };
        let eye = DQuat::from_rotation_y(turn) * DVec3::Z;
        let first = photograph(&far(), SIZE, &with(DVec3::Z), 0.0, 3);
        let mut second = photograph(&far(), SIZE, &with(eye), turn, 3);
        second.rgb = second.rgb.map(|v| 0.8 * *v);
        let first = view(&first, &ObjectShape::Sphere(None));
        let pair = |turn| {
            let second = SecondView { view: view(&second, &ObjectShape::Sphere(None)), azimuth: turn };
            probe(&first, Some(&second), &settings(128)).unwrap()
        };
        let (found, given, alone) = (pair(None), pair(Some(turn)), probe(&first, None, &settings(128)).unwrap());
        let views = found.report.views.unwrap();
        let [off, off_given, off_alone] = [&found, &given, &alone].map(|probe| error(probe, light, 0.0));
        assert!((views.azimuth_degrees - degrees).abs() < 0.2 && views.estimated, "{views:?}");
        assert!((views.brightness - 0.8).abs() < 0.03 && views.difference < 0.01 && views.correlation > 0.95);
        assert!(found.report.unseen < 1e-9 && off < 0.5 * off_alone && off < off_given + 0.01, "{off} {off_alone}");
        // The result contains neither camera.
        for d in [DVec3::Z, eye] {
            let got = found.light.at(d).as_dvec3();
            assert!((got - light(d)).length() < 0.1 * light(d).length(), "{got} {}", light(d));
        }
        assert!(matches!(found.report.warnings()[..], [ProbeWarning::Brightness(_)]), "{:?}", found.report.warnings());
        let wrong = pair(Some(turn + 1.0)).report.warnings();
        assert!(wrong.iter().any(|warning| matches!(warning, ProbeWarning::InconsistentViews { .. })), "{wrong:?}");
    }
}

#[test]
fn rejects_views_of_a_rotationally_symmetric_light() {
    let banded = |d: DVec3| DVec3::splat(1.5 + (9.0 * d.y).sin());
    let [first, second] = [0.0, 1.2].map(|turn| photograph(&far(), SIZE, &banded, turn, 1));
    let [first, second] = [first, second].map(|picture| view(&picture, &ObjectShape::Sphere(None)));
    let refused = probe(&first, Some(&SecondView { view: second, azimuth: None }), &settings(64)).err().unwrap();
    assert!(matches!(refused, ProbeError::AmbiguousAzimuth { .. }), "{refused}");
    assert_eq!(refused.suggestions(), [crate::suggestion::Suggestion::SecondAzimuth]);
}

#[test]
fn warns_of_clipped_faulty_and_matte_pictures() {
    // Clipped, with a region of invalid values.
    let mut picture = photograph(&far(), SIZE, &rippled, 0.0, 1);
    picture.rgb = picture.rgb.map(|v| v.min(Vec3::splat(0.5)));
    for x in 100..105 {
        picture.rgb[(x, 90)] = Vec3::NAN;
    }
    let clipped = view(&picture, &ObjectShape::Sphere(None));
    let warnings = clipped.warnings();
    assert!(
        matches!(warnings[..], [ProbeWarning::Clipped { clipped, .. }, ProbeWarning::Faulty { faulty: 5, .. }] if clipped > 5000),
        "{warnings:?}"
    );
    let found = probe(&clipped, None, &settings(64)).unwrap();
    assert!(found.light.radiance().as_slice().iter().all(|v| v.is_finite()));
    // A matte ball, shaded by its normal.
    let ball = far();
    let lights = [DVec3::new(0.5, 0.7, 0.6).normalize(), DVec3::new(-0.9, 0.1, 0.3).normalize()];
    let shade = |n: DVec3| 0.1 + lights[0].dot(n).max(0.0) + 0.4 * lights[1].dot(n).max(0.0);
    let rgb = Plane::from_fn(SIZE.0, SIZE.1, |x, y| {
        let seen = ball.reflection_at((x as f64 + 0.5, y as f64 + 0.5));
        Vec3::splat(seen.map_or(0.0, |seen| shade(seen.normal) as f32))
    });
    let matte = view(&Picture { rgb, alpha: None }, &ObjectShape::Sphere(None)).warnings();
    assert!(matches!(matte[..], [ProbeWarning::Matte(share)] if share > 0.97), "{matte:?}");
    for light in [lamp_light(128), studio_light(128)] {
        let picture = photograph(&ball, SIZE, &|d| light.at(d).as_dvec3(), 0.0, 1);
        assert_eq!(view(&picture, &ObjectShape::Sphere(None)).warnings(), []);
    }
}

#[test]
fn rejects_invalid_settings_and_pictures() {
    let picture = photograph(&far(), SIZE, &rippled, 0.0, 1);
    let seen = view(&picture, &ObjectShape::Sphere(None));
    for rows in [0, 7, 100, 8192] {
        assert!(matches!(probe(&seen, None, &settings(rows)), Err(ProbeError::Rows { .. })), "{rows}");
    }
    let second = SecondView { view: view(&picture, &ObjectShape::Sphere(None)), azimuth: Some(f64::NAN) };
    assert_eq!(probe(&seen, Some(&second), &settings(64)).err(), Some(ProbeError::Angle));
    let black = Picture { rgb: picture.rgb.map(|_| Vec3::ZERO), ..picture.clone() };
    let black = probe(&view(&black, &ObjectShape::Sphere(None)), None, &settings(64));
    assert_eq!(black.err(), Some(ProbeError::Black));
    let aside = ObjectShape::Sphere(Some(Circle { x: -80.0, y: 128.0, radius: 100.0 }));
    let outside = View::of(&Picture { alpha: None, ..picture.clone() }, None, &aside, None).unwrap();
    assert!(matches!(probe(&outside, None, &settings(64)), Err(ProbeError::TooLittle { .. })));
    let full = Picture { rgb: picture.rgb.map(|v| *v + Vec3::splat(0.1)), alpha: None };
    let wavy = Plane::from_fn(64, 64, |x, y| Vec3::splat((1 + x + 100 * y) as f32));
    let refused = View::of(&Picture { rgb: wavy, alpha: None }, None, &ObjectShape::Sphere(None), None).err().unwrap();
    assert_eq!(refused, ProbeError::Scene(SceneError::NoOutline));
    let mask = Plane::from_fn(3, 3, |_, _| 1.0);
    let sizes = View::of(&full, Some(&mask), &ObjectShape::Sphere(None), None).err().unwrap();
    assert!(matches!(sizes, ProbeError::Scene(SceneError::Sizes { .. })), "{sizes}");
    assert_eq!(View::of(&picture, None, &ObjectShape::Ellipsoid(None), None).err(), Some(ProbeError::NotABall));
}
