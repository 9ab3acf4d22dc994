//! Contrastive loss between images and materials.

/// Returns the sum over images of `log sum_c exp(s_c) - s_own - log(count)`, in nats.
///
/// The index `c` runs over the image's own material and all negatives. The scores are `s = u v /
/// sqrt(width)`, with the embeddings `u` of the image and `v` of a material. Each term is the
/// negative log probability of the right material, relative to a guess (van den Oord, Li & Vinyals
/// 2018). It is smallest where the score is `log p(I | F) / p(I)` up to a constant of the image.
///
/// `images` and `own` are `[image][width]` and are overwritten by the gradients with respect to
/// them; the gradient with respect to `negatives`, `[negative][width]`, is added to `to_negatives`.
pub(crate) fn contrast(
    images: &mut [f32],
    own: &mut [f32],
    negatives: &[f32],
    to_negatives: &mut [f32],
    width: usize,
) -> f64 {
    let scale = 1.0 / (width as f32).sqrt();
    let mut loss = 0.0;
    for (image, own) in images.chunks_exact_mut(width).zip(own.chunks_exact_mut(width)) {
        let score = |material: &[f32]| scale * image.iter().zip(material).map(|(u, v)| u * v).sum::<f32>();
        let right = score(own);
        let scores: Vec<f32> = negatives.chunks_exact(width).map(score).collect();
        let top = scores.iter().copied().fold(right, f32::max);
        let shares: Vec<f32> = scores.iter().map(|s| (s - top).exp()).collect();
        let total = shares.iter().map(|s| f64::from(*s)).sum::<f64>() + f64::from((right - top).exp());
        loss += total.ln() + f64::from(top - right) - ((scores.len() + 1) as f64).ln();
        // Probability of the right material minus one.
        let missing = (f64::from((right - top).exp()) / total - 1.0) as f32;
        let mut back: Vec<f32> = own.iter().map(|v| scale * missing * v).collect();
        own.iter_mut().zip(&*image).for_each(|(v, u)| *v = scale * missing * u);
        let pairs = negatives.chunks_exact(width).zip(to_negatives.chunks_exact_mut(width));
        for ((material, to), share) in pairs.zip(&shares) {
            let factor = scale * (f64::from(*share) / total) as f32;
            back.iter_mut().zip(material).for_each(|(b, v)| *b += factor * v);
            to.iter_mut().zip(&*image).for_each(|(t, u)| *t += factor * u);
        }
        image.copy_from_slice(&back);
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(count: usize, seed: f32) -> Vec<f32> {
        (0..count).map(|i| 2.0 * ((i * i) as f32 * 0.7 + seed).sin()).collect()
    }

    #[test]
    fn the_loss_is_zero_for_a_guess_and_minus_log_count_for_certainty() {
        let loss = |image: [f32; 2], own: [f32; 2]| {
            contrast(&mut image.to_vec(), &mut own.to_vec(), &[0.0; 14], &mut [0.0; 14], 2)
        };
        assert!(loss([0.0, 0.0], [1.0, 3.0]).abs() < 1e-12);
        assert!((loss([50.0, 0.0], [50.0, 0.0]) + 8.0_f64.ln()).abs() < 1e-6);
    }

    #[test]
    fn the_gradient_matches_the_loss() {
        let width = 3;
        let (images, own, negatives) = (numbers(6, 0.3), numbers(6, 1.1), numbers(15, 2.3));
        let loss = |images: &[f32], own: &[f32], negatives: &[f32]| {
            contrast(&mut images.to_vec(), &mut own.to_vec(), negatives, &mut [0.0; 15], width)
        };
        let (mut to_images, mut to_own, mut to_negatives) = (images.clone(), own.clone(), vec![0.0; 15]);
        contrast(&mut to_images, &mut to_own, &negatives, &mut to_negatives, width);
        let step = 1e-2;
        let moved = |values: &[f32], at: usize, by: f32| {
            let mut values = values.to_vec();
            values[at] += by;
            values
        };
        let check = |got: f32, of: &dyn Fn(f32) -> f64| {
            let numeric = (of(step) - of(-step)) / f64::from(2.0 * step);
            assert!((numeric - f64::from(got)).abs() < 1e-3 * (1.0 + numeric.abs()), "{numeric} {got}");
        };
        for at in 0..6 {
            check(to_images[at], &|by| loss(&moved(&images, at, by), &own, &negatives));
            check(to_own[at], &|by| loss(&images, &moved(&own, at, by), &negatives));
        }
        for (at, &got) in to_negatives.iter().enumerate() {
            check(got, &|by| loss(&images, &own, &moved(&negatives, at, by)));
        }
    }
}
