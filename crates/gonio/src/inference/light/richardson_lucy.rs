//! Light on a fine grid, by the iterations of Richardson and Lucy.
//!
//! For an image `y` with weights `w` and the operator `T`, each step multiplies every texel `x_t`
//! by `(T' (w y / T x))_t / (T' w)_t`. This is a step of expectation maximisation for values with
//! variances `(T x)_i / w_i`. It keeps lights non-negative, and never raises the divergence `sum_i
//! w_i (y_i ln(y_i / (T x)_i) - y_i + (T x)_i)`. Observations that no light reaches have no
//! influence. Texels whose light reaches no observation change only by the blur.
//!
//! The light is a blurred one (`T` includes the blur): otherwise, texels between observations would
//! stay dark beside bright ones. This is the method of sieves (Snyder and Miller 1985). At the
//! edges of the square, the blur does not continue on the other side of the sphere.
//!
//! The steps are extrapolated as by Biggs and Andrews (1997), in the logarithms of the texels, so
//! that the extrapolation keeps the light positive. If it raises the divergence, the plain step is
//! used.

use crate::transfer::SparseTransfer;

/// Largest number of steps.
const MAX_STEPS: usize = 30;

/// Relative decrease of the divergence in one step below which the light has converged.
const TOLERANCE: f64 = 0.02;

/// Relative root mean square error of the image, weighted by luminance and by its square, at which
/// the steps end. The error of the BRDF is larger, so that a better reproduction is not a better
/// light (Morozov's discrepancy principle).
const DISCREPANCY: f64 = 0.03;

/// Weight of each neighbour in the blur of the light. With 1/4, the sun would be too wide.
const BLUR: f32 = 0.08;

/// Smallest factor of a texel in one step: logarithms must be finite.
const MIN_FACTOR: f32 = 1e-6;

/// Smallest radiance at the start, relative to the mean of the light: a step cannot brighten a
/// black texel.
const MIN_START: f32 = 0.01;

/// Refined light.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RefinedLight {
    /// Radiance of the texels.
    pub texels: Vec<f32>,
    /// Image of the texels (points).
    pub image: Vec<f32>,
    /// Divergence before each step, and at the end.
    pub trace: Vec<f64>,
}

/// Refines a light, starting from the radiance `start` of its texels.
///
/// `values` is the image (points), and `weights` are the weights of its values. Negative values
/// count as zero, and texels of the start are at least 1 % of their mean. Returns `None` if the
/// image, or that of the start, is black or not finite.
///
/// # Panics
/// If the lengths differ from the points and texels of the operator.
pub(crate) fn refine(
    transfer: &SparseTransfer,
    values: &[f32],
    weights: &[f32],
    start: &[f32],
) -> Option<RefinedLight> {
    assert_eq!(values.len(), weights.len());
    let values: Vec<f32> = values.iter().map(|y| y.max(0.0)).collect();
    let floor = MIN_START * start.iter().sum::<f32>() / start.len() as f32;
    let mut texels: Vec<f32> = start.iter().map(|x| x.max(floor)).collect();
    let image_of = |texels: &[f32]| transfer.image(&blurred(texels));
    let adjoint_of = |image: &[f32]| blurred(&transfer.adjoint(image));
    let mut image = image_of(&texels);
    let weight = |(weight, made): (&f32, &f32)| if *made > 0.0 { *weight } else { 0.0 };
    let weights: &[f32] = &weights.iter().zip(&image).map(weight).collect::<Vec<_>>();
    let seen = adjoint_of(weights);
    let usable = |image: &[f32]| image.iter().all(|y| y.is_finite()) && image.iter().any(|y| *y > 0.0);
    if !usable(&image) || !values.iter().any(|y| *y > 0.0) {
        return None;
    }
    let sum = |value: &dyn Fn(usize) -> f32| (0..values.len()).map(|i| f64::from(weights[i] * value(i))).sum::<f64>();
    let (luminance, squares) = (sum(&|i| values[i]), sum(&|i| values[i].powi(2)));
    let explained = |image: &[f32], divergence: f64| {
        let residual = sum(&|i| (values[i] - image[i]).powi(2));
        // A relative error of e everywhere has a divergence of e^2 / 2 per unit of luminance.
        (2.0 * divergence / luminance).max(residual / squares) <= DISCREPANCY.powi(2)
    };
    let mut trace = vec![divergence(&values, weights, &image)];
    let mut last: Option<Step> = None;
    while trace.len() <= MAX_STEPS && !explained(&image, trace[trace.len() - 1]) {
        let ratio = |i: usize| if image[i] > 0.0 { weights[i] * (values[i] / image[i]) } else { 0.0 };
        let ratios: Vec<f32> = (0..values.len()).map(ratio).collect();
        let pulls = adjoint_of(&ratios);
        let step = Step::new(&texels, |t| if seen[t] > 0.0 { pulls[t] / seen[t] } else { 1.0 });
        let before = trace[trace.len() - 1];
        let better = |texels: Vec<f32>| {
            let image = image_of(&texels);
            let after = divergence(&values, weights, &image);
            (usable(&image) && after <= before).then_some((texels, image, after))
        };
        let bold = last.and_then(|last| better(step.extrapolated(&last)?));
        // Only round-off lets the plain step raise the divergence.
        let Some((next, next_image, after)) = bold.or_else(|| better(step.texels.clone())) else { break };
        (texels, image, last) = (next, next_image, Some(step));
        trace.push(after);
        if before - after < TOLERANCE * before {
            break;
        }
    }
    Some(RefinedLight { texels: blurred(&texels), image, trace })
}

/// Blurs the texels of a square along rows and columns: each neighbour has the weight [`BLUR`].
///
/// The blur is symmetric: at the edges, the outer neighbour of a texel is the texel itself.
fn blurred(texels: &[f32]) -> Vec<f32> {
    let side = texels.len().isqrt();
    let along = |texels: &[f32], stride: usize| -> Vec<f32> {
        let one = |t: usize| {
            let place = t / stride % side;
            let before = if place == 0 { t } else { t - stride };
            let after = if place == side - 1 { t } else { t + stride };
            (1.0 - 2.0 * BLUR) * texels[t] + BLUR * (texels[before] + texels[after])
        };
        (0..texels.len()).map(one).collect()
    };
    along(&along(texels, 1), side)
}

/// A step from one light to the next.
struct Step {
    /// Logarithms of the factors of the texels.
    logarithms: Vec<f32>,
    /// The texels after the step.
    texels: Vec<f32>,
}

impl Step {
    fn new(texels: &[f32], factor: impl Fn(usize) -> f32) -> Self {
        let factors: Vec<f32> = (0..texels.len()).map(|t| factor(t).max(MIN_FACTOR)).collect();
        Self {
            texels: texels.iter().zip(&factors).map(|(x, factor)| x * factor).collect(),
            logarithms: factors.into_iter().map(f32::ln).collect(),
        }
    }

    /// Returns the texels after an extrapolated step; `None` if the steps have opposite directions.
    ///
    /// The logarithms continue along the difference of this step's texels and those of the last
    /// step, by the share of the last step that this one repeats.
    fn extrapolated(&self, last: &Self) -> Option<Vec<f32>> {
        let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let repeated =
            product(&self.logarithms, &last.logarithms) / product(&last.logarithms, &last.logarithms).max(1e-30);
        let share = repeated.min(1.0) as f32;
        let texels = self.texels.iter().zip(&last.texels);
        (share > 0.0).then(|| texels.map(|(x, before)| x * (x / before).powf(share)).collect())
    }
}

fn divergence(values: &[f32], weights: &[f32], image: &[f32]) -> f64 {
    let one = |i: usize| {
        let (y, made) = (f64::from(values[i]), f64::from(image[i]));
        if made <= 0.0 {
            // No light reaches this observation.
            return 0.0;
        }
        let logarithm = if y > 0.0 { y * (y / made).ln() } else { 0.0 };
        f64::from(weights[i]) * (logarithm - y + made)
    };
    (0..values.len()).map(one).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reflectance::BivariateTable;
    use crate::shape::SurfacePoint;
    use crate::sphere::OctahedralMap;
    use crate::testing::ball;

    const SIDE: usize = 32;

    struct Planted {
        transfer: SparseTransfer,
        /// A lamp of one texel in a dim room with a bright quarter.
        light: Vec<f32>,
        image: Vec<f32>,
    }

    fn planted() -> Planted {
        let table = BivariateTable::from_fn(|h, _| 0.02 + 100.0 / (1.0 + (h / 0.02_f64).powi(2)).powi(2));
        let points: Vec<SurfacePoint> = ball(4000).into_iter().filter(|p| p.normal.z > 0.2).collect();
        let transfer = SparseTransfer::new((&points).into(), &table, OctahedralMap::EqualArea, SIDE);
        let radiance = |t: usize| match (t % SIDE, t / SIDE) {
            (18, 14) => 100.0,
            (x, y) if x > 16 && y > 16 => 2.0,
            _ => 0.5,
        };
        let light: Vec<f32> = blurred(&(0..SIDE * SIDE).map(radiance).collect::<Vec<_>>());
        let image = transfer.image(&light);
        Planted { transfer, light, image }
    }

    fn misfit(got: &RefinedLight, image: &[f32]) -> f32 {
        let residual: f32 = got.image.iter().zip(image).map(|(made, y)| (made - y).powi(2)).sum();
        (residual / image.iter().map(|y| y * y).sum::<f32>()).sqrt()
    }

    #[test]
    fn steps_never_raise_the_divergence_and_recover_a_planted_light() {
        let Planted { transfer, light, image } = planted();
        let ones = vec![1.0; image.len()];
        let mean = light.iter().sum::<f32>() / light.len() as f32;
        let got = refine(&transfer, &image, &ones, &vec![mean; light.len()]).unwrap();
        assert!(got.trace.windows(2).all(|pair| pair[1] <= pair[0]), "{:?}", got.trace);
        assert!(misfit(&got, &image) < 0.03, "{}", misfit(&got, &image));
        let lamp = 14 * SIDE + 18;
        assert!((got.texels[lamp] / light[lamp] - 1.0).abs() < 0.1, "{} {}", got.texels[lamp], light[lamp]);
        assert!(got.texels.iter().all(|x| *x >= 0.0));
    }

    #[test]
    fn a_light_that_explains_the_image_does_not_change() {
        let Planted { transfer, light, image } = planted();
        let blurry = transfer.image(&blurred(&light));
        let got = refine(&transfer, &blurry, &vec![1.0; image.len()], &light).unwrap();
        assert!(got.texels.iter().zip(blurred(&light)).all(|(x, l)| (x / l - 1.0).abs() < 1e-4));
        assert!(misfit(&got, &blurry) < 1e-5, "{}", misfit(&got, &blurry));
    }

    #[test]
    fn ignores_observations_without_light() {
        let Planted { light, .. } = planted();
        // Zero at half angles of a radian and more, as at a point that faces away.
        let value = |h: f64| if h < 1.0 { 0.02 + 100.0 / (1.0 + (h / 0.02).powi(2)).powi(2) } else { 0.0 };
        let table = BivariateTable::from_fn(|h, _| value(h));
        let transfer =
            |points: &[SurfacePoint]| SparseTransfer::new(points.into(), &table, OctahedralMap::EqualArea, SIDE);
        let mut points: Vec<SurfacePoint> = ball(4000).into_iter().filter(|p| p.normal.z > 0.2).collect();
        let of = |points: &[SurfacePoint], values: &[f32]| {
            refine(&transfer(points), values, &vec![1.0; values.len()], &vec![1.0; light.len()]).unwrap().texels
        };
        let mut values = transfer(&points).image(&light);
        let want = of(&points, &values);
        points.push(SurfacePoint { normal: -glam::DVec3::Z, view: glam::DVec3::Z });
        values.push(3.0);
        assert_eq!(transfer(&points).image(&light).pop(), Some(0.0));
        let got = of(&points, &values);
        assert!(got.iter().zip(&want).all(|(got, want)| (got / want - 1.0).abs() < 0.01));
    }

    #[test]
    fn ignores_values_of_weight_zero() {
        let Planted { transfer, light, image } = planted();
        let mut weights = vec![1.0; image.len()];
        let mut faulty = image.clone();
        for i in (0..image.len()).step_by(5) {
            (weights[i], faulty[i]) = (0.0, 1e4);
        }
        let of = |values: &[f32]| refine(&transfer, values, &weights, &vec![1.0; light.len()]).unwrap().texels;
        assert_eq!(of(&faulty), of(&image));
    }

    #[test]
    fn the_blur_is_symmetric_and_keeps_the_sum() {
        let of = |at: usize| blurred(&(0..64).map(|t| if t == at { 1.0 } else { 0.0 }).collect::<Vec<_>>());
        for a in 0..64 {
            assert!((of(a).iter().sum::<f32>() - 1.0).abs() < 1e-6);
            assert!((0..64).all(|b| of(a)[b] == of(b)[a]));
        }
    }

    #[test]
    fn black_images_have_no_light() {
        let Planted { transfer, light, image } = planted();
        let ones = vec![1.0; image.len()];
        assert_eq!(refine(&transfer, &vec![0.0; image.len()], &ones, &light), None);
        assert_eq!(refine(&transfer, &image, &ones, &vec![0.0; light.len()]), None);
    }
}
