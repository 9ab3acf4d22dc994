//! Correct maps are kept, wrong ones are detected.

use super::*;

const SIZE: usize = 240;

fn map(f: impl Fn(f32, f32) -> Option<Vec3>) -> Plane<Vec3> {
    Plane::from_fn(SIZE, SIZE, |x, y| {
        let at = |i: usize| (i as f32 + 0.5 - 120.0) / 110.0;
        f(at(x), -at(y)).map_or(Vec3::ZERO, Vec3::normalize)
    })
}

fn sphere() -> Plane<Vec3> {
    ellipsoid(1.0, 1.0, 0.0)
}

/// An ellipsoid of semi-axes `a`, `b` and 1, rotated in the picture.
fn ellipsoid(a: f32, b: f32, turn: f32) -> Plane<Vec3> {
    map(|x, y| {
        let turned = glam::Vec2::from_angle(turn);
        let p = turned.rotate(glam::Vec2::new(x, y));
        let left = 1.0 - (p.x / a).powi(2) - (p.y / b).powi(2);
        let n = glam::Vec2::from_angle(-turn).rotate(glam::Vec2::new(p.x / (a * a), p.y / (b * b)));
        (left > 0.0).then(|| n.extend(left.sqrt()))
    })
}

/// Bumps on a plane that fills the picture.
fn relief() -> Plane<Vec3> {
    map(|x, y| {
        let (p, q) =
            ((5.0 * x + 2.0 * y).cos() * 0.5 + 0.3 * x, (5.0 * x + 2.0 * y).cos() * 0.2 - (4.0 * y).sin() * 0.4);
        Some(Vec3::new(-p, -q, 1.0))
    })
}

/// The upper right part of the sphere.
fn cropped() -> Plane<Vec3> {
    let sphere = sphere();
    Plane::from_fn(SIZE, SIZE, |x, y| if x > 135 && y < 110 { sphere[(x, y)] } else { Vec3::ZERO })
}

fn of(normals: &Plane<Vec3>) -> Orientation {
    Orientation::of(normals, None).unwrap()
}

const FLIP_Y: Correction = Correction { order: [0, 1, 2], flip_x: false, flip_y: true, flip_z: false };
const FLIP_X: Correction = Correction { flip_x: true, flip_y: false, ..FLIP_Y };

#[test]
fn keeps_correct_maps() {
    for (name, normals) in [
        ("sphere", sphere()),
        ("ellipsoid", ellipsoid(1.0, 0.6, 0.5)),
        ("upright", ellipsoid(0.5, 0.9, 0.0)),
        ("relief", relief()),
        ("cropped", cropped()),
        ("bowl", sphere().map(|n| Vec3::new(-n.x, -n.y, n.z))),
        ("plane", map(|_, _| Some(Vec3::new(0.1, 0.2, 1.0)))),
        ("cylinder", map(|x, _| (x.abs() < 0.8).then(|| Vec3::new(x, 0.0, (0.64 - x * x).sqrt())))),
        ("lying", map(|_, y| (y.abs() < 0.8).then(|| Vec3::new(0.0, y, (0.64 - y * y).sqrt())))),
        ("tiny", map(|x, y| (x.abs().max(y.abs()) < 0.02).then(|| Vec3::new(x, y, 1.0)))),
    ] {
        let got = of(&normals);
        assert!(got.corrections.is_empty() && got.contradiction().is_none(), "{name}: {got:?}");
    }
}

#[test]
fn detects_any_wrong_order_on_a_round_object() {
    for (name, right) in [("sphere", sphere()), ("ellipsoid", ellipsoid(1.0, 0.6, 0.5))] {
        for wrong in Correction::all() {
            // Skip correct orders, and hills that became hollows, which are also valid shapes.
            let Correction { order, flip_x, flip_y, flip_z } = wrong;
            if order == [0, 1, 2] && !flip_z && flip_x == flip_y {
                continue;
            }
            let given = wrong.apply_to(&right);
            let got = of(&given);
            assert_eq!(got.corrections.len(), 1, "{name} {wrong:?}: {got:?}");
            assert_eq!(got.corrections[0].apply_to(&given), right, "{name} {wrong:?}: {got:?}");
        }
    }
}

#[test]
fn corrections_have_names() {
    let swapped = Correction { order: [1, 0, 2], ..FLIP_Y };
    assert_eq!((swapped.reordered().as_deref(), swapped.flips()), (Some("yxz"), vec!['y']));
    assert_eq!(swapped.apply(Vec3::new(1.0, 2.0, 3.0)), Vec3::new(2.0, -1.0, 3.0));
    // Channels that contain y, z and x.
    let order = Correction::order_named("yzx").unwrap();
    assert_eq!(Correction { order, ..Correction::default() }.apply(Vec3::new(2.0, 3.0, 1.0)), Vec3::new(1.0, 2.0, 3.0));
    assert_eq!((Correction::order_named("xyx"), Correction::order_named("bgr")), (None, None));
    assert!(Correction::default().is_none() && !swapped.is_none() && Correction::all().len() == 48);
}

#[test]
fn suggests_either_flip_without_a_rim() {
    for wrong in [FLIP_Y, FLIP_X] {
        assert_eq!(of(&wrong.apply_to(&relief())).corrections[..2], [FLIP_Y, FLIP_X]);
        // A part of a rim is sufficient.
        assert_eq!(of(&wrong.apply_to(&cropped())).corrections, [wrong]);
    }
    let found = of(&FLIP_Y.apply_to(&relief())).contradiction().unwrap();
    let complaint = found.to_string();
    assert!(
        complaint.starts_with("the normals seem to have y flipped: their slopes are not integrable ("),
        "{complaint}"
    );
    assert_eq!(found.suggestion(), Suggestion::NormalAxes(vec![FLIP_Y, FLIP_X]));
}

#[test]
fn eight_bits_are_sufficient() {
    let coded = |normals: &Plane<Vec3>| {
        normals.map(|n| {
            let code = ((*n + Vec3::ONE) * 127.5).round();
            if *n == Vec3::ZERO { Vec3::ZERO } else { (code / 127.5 - Vec3::ONE).normalize() }
        })
    };
    for right in [sphere(), ellipsoid(1.0, 0.6, 0.5), relief()] {
        assert!(of(&coded(&right)).corrections.is_empty());
        assert_eq!(of(&FLIP_Y.apply_to(&coded(&right))).corrections[0], FLIP_Y);
    }
}

#[test]
fn noise_is_not_evidence() {
    let mut state = 1_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32 - 0.5
    };
    let normals = Plane::from_fn(SIZE, SIZE, |_, _| Vec3::new(noise(), noise(), 0.6 + noise().abs()).normalize());
    assert!(of(&normals).corrections.is_empty());
    let none = sphere().map(|_| Vec3::ZERO);
    assert_eq!(Orientation::of(&none, None).unwrap_err(), SceneError::NoNormals);
    let small = Plane::from_fn(2, 2, |_, _| 1.0_f32);
    assert!(matches!(Orientation::of(&sphere(), Some(&small)), Err(SceneError::Sizes { .. })));
}

#[test]
fn ignores_normals_outside_the_mask() {
    let mut normals = sphere();
    let mask = Plane::from_fn(SIZE, SIZE, |x, _| f32::from(x < 150));
    for y in 0..SIZE {
        for x in 150..SIZE {
            normals[(x, y)] = Vec3::NEG_Z;
        }
    }
    assert!(Orientation::of(&normals, Some(&mask)).unwrap().corrections.is_empty());
    assert_eq!(Orientation::of(&FLIP_Y.apply_to(&normals), Some(&mask)).unwrap().corrections, [FLIP_Y]);
}
