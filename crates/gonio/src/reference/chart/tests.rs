use super::*;
use crate::reference::testing::{chart_picture, pose};

const LIGHT: DVec3 = DVec3::new(2.6, 2.0, 1.1);

fn corners_of(pose: &DMat3) -> Corners {
    CHART_CORNERS.map(|corner| apply(pose, corner)).map(|p| (p.x, p.y))
}

fn scene() -> (Plane<Vec3>, DMat3) {
    let pose = pose(80.0, 60.0, 40.0, 0.2, (0.02, -0.03));
    (chart_picture((400, 320), pose, LIGHT, 0.05, |_, _| Vec3::new(0.3, 0.5, 0.2)), pose)
}

#[test]
fn measures_light_and_scale_under_coloured_light() {
    let (picture, pose) = scene();
    let read = ChartReading::of(&picture, &corners_of(&pose), None).unwrap();
    assert!((read.light.white / LIGHT - 1.0).abs().max_element() < 0.02, "{}", read.light.white);
    assert!(read.chroma_residual < 0.1 && read.chroma_correlation > 0.99 && read.luminance_residual < 0.05, "{read:?}");
    assert!(read.light.log_sd < 0.07 && read.neutral_patches == 6 && read.clipped_patches == 0, "{read:?}");
    let (x, y) = read.corners[0];
    assert!((x - 80.0).hypot(y - 60.0) < 1e-6);
    assert!(read.tilt < 0.6, "{}", read.tilt);
    let region = read.region(picture.size());
    let covered = region.as_slice().iter().filter(|inside| **inside).count();
    assert!(region[(100, 80)] && !region[(40, 30)] && covered > 20 * 1000, "{covered}");
}

#[test]
fn sorts_corners_in_any_order() {
    let (picture, pose) = scene();
    let right = corners_of(&pose);
    for order in ORDERS {
        let read = ChartReading::of(&picture, &order.map(|i| right[i]), None).unwrap();
        let off = |(a, b): (&(f64, f64), &(f64, f64))| (a.0 - b.0).hypot(a.1 - b.1);
        assert!(read.corners.iter().zip(&right).map(off).all(|off| off < 1e-6), "{order:?}");
    }
}

#[test]
fn accepts_corners_off_by_a_fifth_of_a_patch_and_other_primaries() {
    let (picture, pose) = scene();
    let mut corners = corners_of(&pose);
    corners[0].0 += 6.0;
    corners[2].1 -= 7.0;
    let read = ChartReading::of(&picture, &corners, None).unwrap();
    assert!((read.light.white / LIGHT - 1.0).abs().max_element() < 0.03, "{}", read.light.white);
    // Channels of a camera before its colour matrix.
    let camera = |c: &Vec3| {
        Vec3::new(
            0.65 * c.x + 0.3 * c.y + 0.05 * c.z,
            0.2 * c.x + 0.65 * c.y + 0.15 * c.z,
            0.05 * c.x + 0.25 * c.y + 0.7 * c.z,
        )
    };
    let raw = ChartReading::of(&picture.map(camera), &corners_of(&pose), None).unwrap();
    assert!(raw.chroma_residual > 0.8 && raw.chroma_correlation > 0.88, "{raw:?}");
    let white = camera(&LIGHT.as_vec3()).as_dvec3();
    assert!((raw.light.white / white - 1.0).abs().max_element() < 0.03, "{}", raw.light.white);
}

#[test]
fn rejects_wrong_corners() {
    let (picture, pose) = scene();
    let right = corners_of(&pose);
    let shifted = apply(&pose, DVec2::X) - apply(&pose, DVec2::ZERO);
    let beside = right.map(|(x, y)| (x + shifted.x, y + shifted.y));
    let of = |corners: &Corners| ChartReading::of(&picture, corners, None).unwrap_err();
    assert!(matches!(of(&beside), ReferenceError::NotAChart { .. }), "{}", of(&beside));
    let outer = [(60.0, 40.0), (320.0, 40.0), (320.0, 280.0), (60.0, 280.0)];
    assert!(matches!(of(&outer), ReferenceError::NotAChart { .. }), "{}", of(&outer));
    let crossed = [right[0], right[2], right[1], right[3]];
    assert_eq!(of(&crossed), ReferenceError::Corners);
    assert_eq!(of(&[right[0]; 4]), ReferenceError::Corners);
    assert_eq!(of(&right.map(|(x, _)| (x, f64::NAN))), ReferenceError::Corners);
    assert!(matches!(of(&right.map(|(x, y)| (x + 400.0, y))), ReferenceError::Outside { .. }));
    let small = right.map(|(x, y)| (100.0 + 0.1 * x, 100.0 + 0.1 * y));
    assert!(ChartReading::of(&picture, &small, None).is_err());
    let coded = picture.map(|c| Vec3::from_array(c.to_array().map(|v| (v / 3.0).max(0.0).powf(1.0 / 2.2))));
    let error = ChartReading::of(&coded, &right, None).unwrap_err();
    assert!(matches!(error, ReferenceError::NotAChart { .. }), "{error}");
    let black = picture.map(|_| Vec3::ZERO);
    assert!(matches!(ChartReading::of(&black, &right, None), Err(ReferenceError::NotAChart { .. })));
}

#[test]
fn ignores_clipped_patches() {
    let (picture, pose) = scene();
    let corners = corners_of(&pose);
    let clipped = |level: f32| picture.map(|c| c.min(Vec3::splat(level)));
    let read = ChartReading::of(&clipped(1.8), &corners, None).unwrap();
    assert!(read.clipped_patches > 0 && read.neutral_patches < 6, "{read:?}");
    assert!((read.light.white / LIGHT - 1.0).abs().max_element() < 0.03, "{}", read.light.white);
    let error = ChartReading::of(&clipped(0.3), &corners, None).unwrap_err();
    assert!(matches!(error, ReferenceError::ClippedChart { .. }), "{error}");
}

#[test]
fn measures_the_tilt_by_foreshortening() {
    let upright = pose(80.0, 60.0, 40.0, 0.3, (0.0, 0.0));
    assert!(tilt(&upright) < 1e-3);
    let angle = 0.6_f64;
    let tilted = DMat3::from_scale(DVec2::new(angle.cos(), 1.0)) * upright;
    assert!((tilt(&tilted) - angle).abs() < 1e-6, "{}", tilt(&tilted));
}
