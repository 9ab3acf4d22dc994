//! Rotation of a known light relative to its map.

use faer::Mat;
use glam::{DQuat, DVec3};
use gonio_linalg::{Cholesky, product};

use super::fit::{ImageModel, LaplaceFit, whitened};
use super::light::KnownLight;
use super::{ObservedPoints, thinned};
use crate::parallel;
use crate::picture::luminance;
use crate::reflectance::BivariateTable;
use crate::render::{IntegratorSettings, nodes};
use crate::sphere::half_difference;

/// Prior standard deviation of a rotation about each axis: 3 degrees, as for a hand-held probe.
const DEVIATION: f64 = 3.0 / DEGREES;

const DEGREES: f64 = 180.0 / std::f64::consts::PI;

/// Angle of finite differences: 1 degree, the resolution of tables at the highlight.
const DIFFERENCE_ANGLE: f64 = 1.0 / DEGREES;

/// Largest number of observations for a proposal.
const COMPARED: usize = 300;

/// Accuracy of their renderings, which are used only for derivatives.
const ACCURACY: IntegratorSettings = IntegratorSettings { tolerance: 0.5, max_cells: 3_000 };

/// Proposed rotation of the light.
pub(super) struct Proposal {
    /// Rotation vector (radians), to be applied after the previous rotations.
    pub(super) rotation: DVec3,
    /// Expected decrease of the cost, in nats.
    pub(super) gain: f64,
}

/// Light that one point receives from a direction.
struct Share {
    direction: DVec3,
    /// Irradiance over the cosine.
    weight: f64,
}

/// Returns the Gauss-Newton step of the rotation, jointly with the material.
///
/// `made` is the rotation vector so far. Returns `None` if the equations have no solution.
pub(super) fn propose(
    (image, found): (&ImageModel<'_>, &LaplaceFit),
    rows: &ObservedPoints<'_>,
    light: &KnownLight,
    table: &BivariateTable,
    made: DVec3,
) -> Option<Proposal> {
    let some = thinned(rows.values.len(), COMPARED);
    let gain = image.gain(&found.state.coefficients);
    let slopes: Vec<[f64; 3]> = parallel::map(&some, |&at| slopes(image, rows, (light, gain), table, at));
    let (m, n) = (some.len(), image.len());
    let of_material = image.derivatives(&found.state, &some);
    let mut design = Mat::from_fn(m, n + 3, |i, j| if j < n { of_material[(i, j)] } else { slopes[i][j - n] });
    let covariance = found.errors.of_rows(&some).factor()?;
    covariance.whiten(&mut design);
    let residuals: Vec<f64> = some.iter().map(|&at| found.state.residuals[at]).collect();
    let residuals = whitened(&covariance, &residuals);
    let prior = |j: usize| if j < n { image.precisions()[j] } else { DEVIATION.powi(-2) };
    let value = |j: usize| if j < n { found.state.coefficients[j] } else { made[j - n] };
    // The sample represents all observations, to the extent that they are independent.
    let gradient: Vec<f64> = (0..n + 3)
        .map(|j| design.col(j).iter().zip(&residuals).map(|(d, r)| d * r).sum::<f64>() - prior(j) * value(j))
        .collect();
    let mut normal = product(design.transpose(), design.as_ref());
    (0..n + 3).for_each(|j| normal[(j, j)] += prior(j));
    let step = Cholesky::new(normal.clone())?.solve(&gradient);
    let fixed = Cholesky::new(normal.submatrix(0, 0, n, n).to_owned())?.solve(&gradient[..n]);
    let decrease = |step: &[f64]| 0.5 * step.iter().zip(&gradient).map(|(s, g)| s * g).sum::<f64>();
    let worth = decrease(&step) - decrease(&fixed);
    Some(Proposal { rotation: DVec3::new(step[n], step[n + 1], step[n + 2]), gain: worth })
}

/// Returns the derivatives of the log luminance of a point by the rotation vector of the light.
fn slopes(
    image: &ImageModel<'_>,
    rows: &ObservedPoints<'_>,
    (light, gain): (&KnownLight, f64),
    table: &BivariateTable,
    at: usize,
) -> [f64; 3] {
    let point = &rows.points[at];
    let mut shares = Vec::new();
    for (tree, factor) in light.parts(gain) {
        for node in nodes(point, table, tree, &ACCURACY).nodes {
            let cosine = node.direction.dot(point.normal).max(1e-6);
            let visibility = rows.visibility.map_or(1.0, |v| f64::from(v.share_along(at, node.direction)));
            let weight = factor * visibility * f64::from(luminance(node.weight.as_vec3())) / cosine;
            shares.push(Share { direction: node.direction, weight });
        }
    }
    let turned = |turn: DQuat| -> f64 {
        let shine = |share: &Share| {
            let direction = turn * share.direction;
            let angles = half_difference(point.normal, direction, point.view);
            share.weight * direction.dot(point.normal).max(0.0) * table.eval(angles.theta_h, angles.theta_d)
        };
        shares.iter().map(shine).sum()
    };
    [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
        let at = |angle: f64| image.log(turned(DQuat::from_axis_angle(axis, angle)));
        (at(DIFFERENCE_ANGLE) - at(-DIFFERENCE_ANGLE)) / (2.0 * DIFFERENCE_ANGLE)
    })
}
