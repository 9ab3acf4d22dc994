//! Weight of each pixel, from the noise of the camera and the effect of uncertain normals on
//! brightness.

use glam::Vec3;

use crate::picture::{Plane, luminance};
use crate::statistics::quantile;

/// Standard deviation at which a pixel has half its weight, relative to the root mean square of the
/// picture: the error of the model itself ([`MODEL_ERROR`](crate::inference::MODEL_ERROR)).
const NOISE_FLOOR: f64 = 0.05;
/// Number of brightness classes, in each of which the noise is assumed constant.
const CLASSES: usize = 8;
/// Quantile of the local residuals from which the noise of a class is estimated, from its quieter
/// pixels.
const QUIET: f64 = 0.25;
/// Value of this quantile relative to the variance, for Gaussian noise and six degrees of freedom
/// (chi-square).
const QUIET_SHARE: f64 = 0.576;

/// A plane through the values of a 3 x 3 neighbourhood.
struct Fit {
    /// Squared change from pixel to pixel, summed over both axes.
    slope_square: f64,
    /// Variance about the plane.
    variance: f64,
}

/// Fits planes to the components of a quantity around a pixel.
///
/// Returns `None` at the border of the picture or of the known region.
fn fit<const N: usize>(
    (x, y): (usize, usize),
    (w, h): (usize, usize),
    at: impl Fn(usize, usize) -> Option<[f64; N]>,
) -> Option<Fit> {
    if x == 0 || y == 0 || x + 1 >= w || y + 1 >= h {
        return None;
    }
    let mut values = [[0.0; N]; 9];
    for (i, value) in values.iter_mut().enumerate() {
        *value = at(x + i % 3 - 1, y + i / 3 - 1)?;
    }
    let (mut slope_square, mut variance) = (0.0, 0.0);
    for c in 0..N {
        let (dx, dy) = (|i: usize| (i % 3) as f64 - 1.0, |i: usize| (i / 3) as f64 - 1.0);
        let mean = values.iter().map(|v| v[c]).sum::<f64>() / 9.0;
        let along = |d: &dyn Fn(usize) -> f64| values.iter().enumerate().map(|(i, v)| d(i) * v[c]).sum::<f64>() / 6.0;
        let (a, b) = (along(&dx), along(&dy));
        slope_square += a * a + b * b;
        let rest = |(i, v): (usize, &[f64; N])| (v[c] - mean - a * dx(i) - b * dy(i)).powi(2);
        variance += values.iter().enumerate().map(rest).sum::<f64>() / 6.0;
    }
    Some(Fit { slope_square, variance })
}

/// Computes a weight in 0..=1 for each of `pixels` (row-major indices).
///
/// The weight is `1 / (1 + (s^2 + t^2) / floor^2)`. `s` is the noise of pixels of similar
/// brightness, from the residuals about local planes. `t` is the error of brightness caused by the
/// residual of the normals about a plane and the slope of the picture. Pixels outside `region` have
/// no value.
pub(super) fn weights(rgb: &Plane<Vec3>, normals: &Plane<Vec3>, region: &Plane<bool>, pixels: &[usize]) -> Vec<f64> {
    let (size, width) = (rgb.size(), rgb.width());
    let bright = |i: usize| f64::from(luminance(rgb.as_slice()[i]));
    let (sum, count) = pixels
        .iter()
        .filter(|i| region.as_slice()[**i])
        .fold((0.0, 0_usize), |(sum, count), &i| (sum + bright(i).powi(2), count + 1));
    let square = sum / count.max(1) as f64;
    let floor = NOISE_FLOOR * NOISE_FLOOR * square;
    let light = |x: usize, y: usize| region[(x, y)].then(|| [f64::from(luminance(rgb[(x, y)]))]);
    let normal = |x: usize, y: usize| region[(x, y)].then(|| normals[(x, y)].normalize_or_zero().as_dvec3().to_array());
    let fits: Vec<(Option<Fit>, Option<Fit>)> = pixels
        .iter()
        .map(|&i| (fit((i % width, i / width), size, light), fit((i % width, i / width), size, normal)))
        .collect();

    let mut order: Vec<usize> = (0..pixels.len()).filter(|&k| fits[k].0.is_some()).collect();
    order.sort_by(|&a, &b| bright(pixels[a]).total_cmp(&bright(pixels[b])));
    let mut noise = vec![0.0; pixels.len()];
    for class in order.chunks(order.len().div_ceil(CLASSES).max(1)) {
        let mut variances: Vec<f64> = class.iter().filter_map(|&k| fits[k].0.as_ref().map(|f| f.variance)).collect();
        let quiet = quantile(&mut variances, QUIET).unwrap_or(0.0) / QUIET_SHARE;
        class.iter().for_each(|&k| noise[k] = quiet);
    }
    let weight = |(k, fits): (usize, &(Option<Fit>, Option<Fit>))| {
        let tilt = match fits {
            (Some(light), Some(normal)) if normal.slope_square > 0.0 => {
                // The noise itself adds a sixth of its variance to the squared slope along each
                // axis.
                let slopes = (normal.slope_square - normal.variance / 3.0).max(0.1 * normal.slope_square);
                light.slope_square / slopes * normal.variance
            }
            _ => 0.0,
        };
        if floor > 0.0 { 1.0 / (1.0 + (noise[k] + tilt) / floor) } else { 1.0 }
    };
    fits.iter().enumerate().map(weight).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    use super::*;

    const SIZE: usize = 120;

    fn normal(x: usize, y: usize) -> Vec3 {
        let (a, b) = ((x as f32 - 60.0) / 90.0, (60.0 - y as f32) / 90.0);
        Vec3::new(a, b, (1.0 - a * a - b * b).sqrt())
    }

    fn all(rgb: &Plane<Vec3>, normals: &Plane<Vec3>) -> Vec<f64> {
        let pixels: Vec<usize> = (0..SIZE * SIZE).collect();
        weights(rgb, normals, &normals.map(|_| true), &pixels)
    }

    fn draw(seed: u64) -> impl FnMut() -> f32 {
        let mut rng = Pcg64::seed_from_u64(seed);
        move || StandardNormal.sample(&mut rng)
    }

    #[test]
    fn pixels_of_a_clean_picture_have_full_weight() {
        let normals = Plane::from_fn(SIZE, SIZE, normal);
        let weights = all(&normals.map(|n| Vec3::splat(1.0 + n.y)), &normals);
        assert!(weights.iter().all(|w| *w > 0.999));
    }

    #[test]
    fn estimates_the_noise_of_each_brightness() {
        let normals = Plane::from_fn(SIZE, SIZE, normal);
        let mut gauss = draw(3);
        // The upper half is bright and has noise of a tenth of the root mean square; the lower half
        // is dark and clean.
        let rgb = normals.map(|n| Vec3::splat(if n.y > 0.0 { 4.0 + 0.3 * gauss() } else { 1.0 }));
        let square = rgb.as_slice().iter().map(|c| f64::from(c.x).powi(2)).sum::<f64>() / (SIZE * SIZE) as f64;
        let want = 1.0 / (1.0 + 0.09 / (0.0025 * square));
        let weights = all(&rgb, &normals);
        let bright: Vec<f64> = (0..50 * SIZE).map(|i| weights[i]).collect();
        let mean = bright.iter().sum::<f64>() / bright.len() as f64;
        assert!((mean - want).abs() < 0.05, "{mean} {want}");
        assert!(weights[SIZE * 90 + 60] > 0.99);
    }

    #[test]
    fn uncertain_normals_reduce_weights_where_the_picture_has_slope() {
        let mut gauss = draw(5);
        let shift = 0.05;
        let noisy = Plane::from_fn(SIZE, SIZE, |x, y| {
            let n = normal(x, y);
            if x < 60 { (n + shift * Vec3::new(gauss(), gauss(), gauss())).normalize() } else { n }
        });
        // Flat above, steep below; the picture itself has no noise.
        let rgb =
            Plane::from_fn(SIZE, SIZE, |_, y| Vec3::splat(if y < 60 { 1.0 } else { 1.0 + 0.03 * (y - 60) as f32 }));
        let weights = all(&rgb, &noisy);
        let mean = |x: std::ops::Range<usize>, y: std::ops::Range<usize>| {
            let at: Vec<f64> = y.flat_map(|y| x.clone().map(move |x| SIZE * y + x)).map(|i| weights[i]).collect();
            at.iter().sum::<f64>() / at.len() as f64
        };
        let (steep, flat, sure) = (mean(5..55, 65..115), mean(5..55, 5..55), mean(65..115, 65..115));
        assert!(steep < 0.6 && flat > 0.99 && sure > 0.98, "{steep} {flat} {sure}");
    }
}
