//! Minus the log density of a mixture and its gradient in a network's outputs. The same density as
//! [`MixtureDensity`](gonio::inference::amortised::MixtureDensity).

use gonio::inference::amortised::LARGEST_LOG;

/// The loss of one sample: `-log sum_k share_k N(z; mean_k, (T_k' T_k)^-1)` in nats. The outputs
/// are overwritten by its gradient in them.
///
/// With the responsibilities `r_k` of the components, `w = T (z - mean)`: `share_k - r_k` in the
/// logarithm of a share, `-r_k T' w` in a mean, `r_k w_i (z - mean)_j` in an entry of `T` and `r_k
/// (w_i (z - mean)_i T_ii - 1)` in the logarithm of one on its diagonal.
pub(crate) fn mixture_loss(outputs: &mut [f32], z: &[f32], components: usize) -> f64 {
    let d = z.len();
    let each = d + d * (d + 1) / 2;
    debug_assert_eq!(outputs.len(), components * (1 + each));
    let bound = f64::from(LARGEST_LOG);
    let (logits, rest) = outputs.split_at_mut(components);
    let mut terms = Vec::with_capacity(components);
    for (logit, part) in logits.iter().zip(rest.chunks_exact(each)) {
        let gap: Vec<f64> = z.iter().zip(part).map(|(z, m)| f64::from(*z) - f64::from(*m)).collect();
        let mut factor: Vec<f64> = part[d..].iter().map(|v| f64::from(*v)).collect();
        let mut log = f64::from(*logit) - 0.5 * d as f64 * std::f64::consts::TAU.ln();
        let mut whitened = Vec::with_capacity(d);
        for i in 0..d {
            let start = i * (i + 1) / 2;
            let log_diagonal = factor[start + i].clamp(-bound, bound);
            factor[start + i] = log_diagonal.exp();
            let w: f64 = factor[start..=start + i].iter().zip(&gap).map(|(t, g)| t * g).sum();
            log += log_diagonal - 0.5 * w * w;
            whitened.push(w);
        }
        terms.push((log, gap, factor, whitened));
    }
    let all = log_sum_exp(terms.iter().map(|t| t.0));
    let shares = log_sum_exp(logits.iter().map(|l| f64::from(*l)));
    for ((logit, part), (log, gap, factor, whitened)) in logits.iter_mut().zip(rest.chunks_exact_mut(each)).zip(&terms)
    {
        let responsibility = (log - all).exp();
        *logit = ((f64::from(*logit) - shares).exp() - responsibility) as f32;
        let mut mean = vec![0.0; d];
        for (i, w) in whitened.iter().enumerate() {
            let start = i * (i + 1) / 2;
            for j in 0..=i {
                let t = factor[start + j];
                mean[j] -= responsibility * t * w;
                let at = d + start + j;
                part[at] = if i != j {
                    (responsibility * w * gap[j]) as f32
                } else if part[at].abs() < LARGEST_LOG {
                    (responsibility * (w * gap[j] * t - 1.0)) as f32
                } else {
                    // Outside of the bound the density does not follow.
                    0.0
                };
            }
        }
        part[..d].iter_mut().zip(mean).for_each(|(p, m)| *p = m as f32);
    }
    shares - all
}

fn log_sum_exp(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let largest = values.clone().fold(f64::NEG_INFINITY, f64::max);
    largest + values.map(|v| (v - largest).exp()).sum::<f64>().ln()
}

#[cfg(test)]
mod tests {
    use gonio::inference::amortised::MixtureDensity;

    use super::*;

    fn outputs(count: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * i) as f32 * 0.7 + 0.3).sin() * 0.8).collect()
    }

    #[test]
    fn it_is_minus_the_log_density() {
        for (d, k) in [(1, 1), (3, 2), (5, 4)] {
            let outputs = outputs(MixtureDensity::outputs(d, k));
            let z: Vec<f32> = (0..d).map(|i| 0.3 * i as f32 - 0.4).collect();
            let wide: Vec<f64> = z.iter().map(|v| f64::from(*v)).collect();
            let want = -MixtureDensity::of(&outputs, d, k).log_density(&wide);
            assert!((mixture_loss(&mut outputs.clone(), &z, k) - want).abs() < 1e-6);
        }
    }

    #[test]
    fn the_gradient_is_that_of_the_loss() {
        let (d, k) = (3, 3);
        let outputs = outputs(MixtureDensity::outputs(d, k));
        let z = [0.2, -0.5, 0.9];
        let mut gradient = outputs.clone();
        mixture_loss(&mut gradient, &z, k);
        for i in 0..outputs.len() {
            let at = |step: f32| {
                let mut moved = outputs.clone();
                moved[i] += step;
                mixture_loss(&mut moved, &z, k)
            };
            let numeric = (at(2e-3) - at(-2e-3)) / 4e-3;
            let got = f64::from(gradient[i]);
            assert!((numeric - got).abs() < 1e-3 * (1.0 + numeric.abs()), "{i}: {numeric} {got}");
        }
    }
}
