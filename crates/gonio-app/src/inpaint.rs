//! Removes a reference ball from a photograph, so that the object beside it can be detected.

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::scene::Circle;

/// Width around the outline of a ball that is erased with it: a share of the radius, and pixels.
const MARGIN: (f64, f64) = (0.03, 2.0);

/// Returns the picture without a ball: each row is interpolated between both sides of the ball, so
/// that no edge remains.
pub(crate) fn inpaint_ball(picture: &Picture, circle: &Circle) -> Picture {
    let (width, height) = picture.rgb.size();
    let radius = circle.radius * (1.0 + MARGIN.0) + MARGIN.1;
    let mut erased = picture.clone();
    for y in 0..height {
        let half = (radius * radius - (y as f64 + 0.5 - circle.y).powi(2)).max(0.0).sqrt();
        if half == 0.0 {
            continue;
        }
        let column = |x: f64| x.clamp(0.0, width as f64) as usize;
        let (first, end) = (column(circle.x - half), column((circle.x + half).ceil()));
        let side = |x: Option<usize>| x.filter(|x| *x < width).map(|x| picture.rgb[(x, y)]);
        let (left, right) = (side(first.checked_sub(1)), side(Some(end)));
        for x in first..end {
            let share = (x - first + 1) as f32 / (end - first + 1) as f32;
            erased.rgb[(x, y)] = match (left, right) {
                // Exact for a uniform background, which is detected by equal values.
                (Some(left), Some(right)) => left + (right - left) * share,
                (Some(one), None) | (None, Some(one)) => one,
                (None, None) => Vec3::ZERO,
            };
        }
    }
    erased.alpha = picture.varying_alpha().map(|alpha| {
        Plane::from_fn(width, height, |x, y| {
            let is_erased = (x as f64 + 0.5 - circle.x).hypot(y as f64 + 0.5 - circle.y) < radius;
            if is_erased { 0.0 } else { alpha[(x, y)] }
        })
    });
    erased
}

#[cfg(test)]
mod tests {
    use gonio::scene::outline_of_ball;

    use super::*;

    fn two_balls(background: impl Fn(usize) -> f32) -> (Picture, Circle, Circle) {
        let (mirror, matte) = (Circle { x: 70.0, y: 60.0, radius: 40.0 }, Circle { x: 180.0, y: 64.0, radius: 45.0 });
        let within = |c: &Circle, x: usize, y: usize| {
            ((x as f64 + 0.5 - c.x) / c.radius).hypot((y as f64 + 0.5 - c.y) / c.radius)
        };
        let rgb = Plane::from_fn(250, 128, |x, y| {
            let (a, b) = (within(&mirror, x, y), within(&matte, x, y));
            if a < 1.0 {
                Vec3::splat(if (x / 7 + y / 5) % 2 == 0 { 3.0 } else { 0.2 })
            } else if b < 1.0 {
                Vec3::splat((1.0 - b * b).sqrt() as f32 + 0.1)
            } else {
                Vec3::splat(background(x))
            }
        });
        (Picture { rgb, alpha: None }, mirror, matte)
    }

    #[test]
    fn the_other_ball_is_detected() {
        for slope in [0.0001, 0.0] {
            let (picture, mirror, matte) = two_balls(|x| 0.02 + slope * x as f32);
            let (found, _) = outline_of_ball(&inpaint_ball(&picture, &mirror), None).unwrap();
            let off = (found.x - matte.x).hypot(found.y - matte.y) + (found.radius - matte.radius).abs();
            assert!(off < 1.0, "{slope} {found:?}");
        }
    }

    #[test]
    fn pixels_beside_the_erased_ball_do_not_change() {
        let (picture, mirror, _) = two_balls(|x| 0.02 + 0.0001 * x as f32);
        let opaque = Picture { alpha: Some(picture.rgb.map(|_| 1.0)), ..picture.clone() };
        assert_eq!(inpaint_ball(&opaque, &mirror).alpha, None);
        let alpha = Some(Plane::from_fn(250, 128, |x, _| if x < 249 { 1.0 } else { 0.5 }));
        let erased = inpaint_ball(&Picture { alpha, ..picture.clone() }, &mirror);
        for y in 0..128 {
            for x in 0..250 {
                let r = (x as f64 + 0.5 - mirror.x).hypot(y as f64 + 0.5 - mirror.y);
                if r > 1.1 * mirror.radius + 3.0 {
                    assert_eq!(erased.rgb[(x, y)], picture.rgb[(x, y)]);
                } else if r < mirror.radius {
                    assert!(erased.rgb[(x, y)].x < 0.05 && erased.alpha.as_ref().unwrap()[(x, y)] == 0.0);
                }
            }
        }
        // A ball that the border of the picture cuts.
        let cut = inpaint_ball(&picture, &Circle { x: -5.0, y: 130.0, radius: 30.0 });
        assert!(cut.rgb.as_slice().iter().all(|v| v.is_finite()));
    }
}
