//! Removes outliers from the photograph for display.

use std::borrow::Cow;

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::scene::PixelStatus;

/// Replaces each outlier by the mean of the used pixels next to it.
///
/// An outlier of any value thus changes neither the exposure of the panels nor adjacent pixels.
pub(super) fn repaired<'a>(picture: &'a Picture, statuses: Option<&Plane<PixelStatus>>) -> Cow<'a, Picture> {
    let Some(statuses) = statuses.filter(|statuses| statuses.as_slice().contains(&PixelStatus::Outlier)) else {
        return Cow::Borrowed(picture);
    };
    let (width, height) = statuses.size();
    let mean = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for v in y.saturating_sub(1)..(y + 2).min(height) {
            for u in x.saturating_sub(1)..(x + 2).min(width) {
                if statuses[(u, v)] == PixelStatus::Used {
                    sum += picture.rgb[(u, v)];
                    count += 1.0;
                }
            }
        }
        if count > 0.0 { sum / count } else { Vec3::ZERO }
    };
    let each = picture.rgb.as_slice().iter().zip(statuses.as_slice()).enumerate();
    let rgb = each.map(|(i, (rgb, status))| if *status == PixelStatus::Outlier { mean(i) } else { *rgb }).collect();
    Cow::Owned(Picture { rgb: Plane::from_vec(width, height, rgb), alpha: picture.alpha.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_become_the_mean_of_their_neighbours() {
        let mut rgb = Plane::from_fn(5, 5, |_, _| Vec3::splat(2.0));
        let mut statuses = rgb.map(|_| PixelStatus::Used);
        rgb[(2, 2)] = Vec3::splat(1e9);
        rgb[(3, 2)] = Vec3::ZERO;
        let picture = Picture { rgb, alpha: None };
        assert!(matches!(repaired(&picture, Some(&statuses)), Cow::Borrowed(_)));
        (statuses[(2, 2)], statuses[(3, 2)]) = (PixelStatus::Outlier, PixelStatus::Outlier);
        assert!(repaired(&picture, Some(&statuses)).rgb.as_slice().iter().all(|v| *v == Vec3::splat(2.0)));
    }
}
