//! Scales masks to the size of the photograph.

use gonio::picture::Plane;

/// Largest ratio of the sides of mask and photograph.
const MAX_RATIO: f64 = 8.0;

/// Whether two sizes have the same aspect ratio, to one pixel of the smaller size, and differ by a
/// factor of at most [`MAX_RATIO`].
pub(crate) fn alike(one: (usize, usize), other: (usize, usize)) -> bool {
    let sides = [one.0, one.1, other.0, other.1].map(|side| side as f64);
    let [across, down] = [sides[2] / sides[0], sides[3] / sides[1]];
    let longest = sides.into_iter().fold(0.0, f64::max);
    // A pixel of the smaller picture, in pixels of the larger.
    let pixel = across.max(1.0 / across);
    sides.iter().all(|side| *side > 0.0) && pixel <= MAX_RATIO && (across / down).ln().abs() * longest <= pixel
}

/// Scales a mask to another size: each pixel is the mean over its area.
pub(crate) fn resampled(mask: &Plane<f32>, (width, height): (usize, usize)) -> Plane<f32> {
    let columns = shares(mask.width(), width);
    let narrow = Plane::from_fn(width, mask.height(), |x, y| {
        columns[x].iter().map(|&(u, part)| part * mask[(u, y)]).sum::<f32>()
    });
    let rows = shares(mask.height(), height);
    Plane::from_fn(width, height, |x, y| rows[y].iter().map(|&(v, part)| part * narrow[(x, v)]).sum())
}

/// Returns, for each pixel of a line of `to` pixels, the covered pixels of a line of `from` pixels
/// and their weights, which sum to one. Enlarged lines are interpolated.
fn shares(from: usize, to: usize) -> Vec<Vec<(usize, f32)>> {
    let scale = from as f64 / to as f64;
    let shares = |at: usize| {
        if scale < 1.0 {
            let place = ((at as f64 + 0.5) * scale - 0.5).clamp(0.0, from as f64 - 1.0);
            let (low, part) = (place as usize, place.fract() as f32);
            return vec![(low, 1.0 - part), ((low + 1).min(from - 1), part)];
        }
        let (start, end) = (at as f64 * scale, (at as f64 + 1.0) * scale);
        let covered = |u: usize| ((u as f64 + 1.0).min(end) - (u as f64).max(start)).max(0.0) / scale;
        (start as usize..(end.ceil() as usize).min(from)).map(|u| (u, covered(u) as f32)).collect()
    };
    (0..to).map(shares).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alike_compares_aspect_ratios() {
        for (one, other) in
            [((48, 48), (24, 24)), ((4000, 3000), (1001, 751)), ((1001, 751), (4000, 3000)), ((3, 2), (9, 7))]
        {
            assert!(alike(one, other), "{one:?} {other:?}");
        }
        for (one, other) in [
            ((48, 48), (24, 27)),
            ((4000, 3000), (3000, 4000)),
            ((0, 0), (4, 4)),
            ((160, 90), (40, 30)),
            ((6000, 6000), (5, 5)),
        ] {
            assert!(!alike(one, other) && !alike(other, one), "{one:?} {other:?}");
        }
    }

    #[test]
    fn resampling_preserves_the_area() {
        let disk = |side: usize| {
            Plane::from_fn(side, side, |x, y| {
                let off = |at: usize| (at as f64 + 0.5) / side as f64 - 0.5;
                f32::from(off(x).hypot(off(y)) < 0.4)
            })
        };
        let area = |plane: &Plane<f32>| plane.as_slice().iter().sum::<f32>() / plane.as_slice().len() as f32;
        for (from, to) in [(300, 70), (70, 300), (300, 299), (7, 7)] {
            let got = resampled(&disk(from), (to, to));
            assert_eq!(got.size(), (to, to));
            assert!((area(&got) - area(&disk(from))).abs() < 0.01, "{from} {to}");
            assert!(got.as_slice().iter().all(|v| (-1e-5..=1.00001).contains(v)));
        }
        // Partly covered pixels have values between 0 and 1.
        let half = resampled(&Plane::from_fn(4, 2, |x, _| f32::from(x > 0)), (2, 1));
        assert_eq!(half.as_slice(), [0.5, 1.0]);
    }
}
