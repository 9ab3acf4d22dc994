//! Removes outliers from the photograph for display.

use std::borrow::Cow;

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::scene::Fate;

/// Replaces each outlier by the mean of the used pixels next to it.
///
/// An outlier of any value thus changes neither the exposure of the panels nor adjacent pixels.
pub(super) fn repaired<'a>(picture: &'a Picture, fates: Option<&Plane<Fate>>) -> Cow<'a, Picture> {
    let Some(fates) = fates.filter(|fates| fates.as_slice().contains(&Fate::Outlier)) else {
        return Cow::Borrowed(picture);
    };
    let (width, height) = fates.size();
    let mean = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for v in y.saturating_sub(1)..(y + 2).min(height) {
            for u in x.saturating_sub(1)..(x + 2).min(width) {
                if fates[(u, v)] == Fate::Used {
                    sum += picture.rgb[(u, v)];
                    count += 1.0;
                }
            }
        }
        if count > 0.0 { sum / count } else { Vec3::ZERO }
    };
    let each = picture.rgb.as_slice().iter().zip(fates.as_slice()).enumerate();
    let rgb = each.map(|(i, (rgb, fate))| if *fate == Fate::Outlier { mean(i) } else { *rgb }).collect();
    Cow::Owned(Picture { rgb: Plane::from_vec(width, height, rgb), alpha: picture.alpha.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_become_the_mean_of_their_neighbours() {
        let mut rgb = Plane::from_fn(5, 5, |_, _| Vec3::splat(2.0));
        let mut fates = rgb.map(|_| Fate::Used);
        rgb[(2, 2)] = Vec3::splat(1e9);
        rgb[(3, 2)] = Vec3::ZERO;
        let picture = Picture { rgb, alpha: None };
        assert!(matches!(repaired(&picture, Some(&fates)), Cow::Borrowed(_)));
        (fates[(2, 2)], fates[(3, 2)]) = (Fate::Outlier, Fate::Outlier);
        assert!(repaired(&picture, Some(&fates)).rgb.as_slice().iter().all(|v| *v == Vec3::splat(2.0)));
    }
}
