//! Light probes: estimates the light around a mirror ball from one or two photographs.
//!
//! 1. [`View::of`] detects the ball in an image, with an orthographic or a given camera, and its
//!    usable pixels.
//! 2. [`probe`] reads the light from each direction at the point of the ball that reflects it to
//!    the camera, divided by the [`Reflectance`] there.
//! 3. Two views from different sides of the ball are merged. Each has a high weight near the front
//!    of the ball, except at the reflection of the camera. The angle between the views is estimated
//!    from their overlap.
//! 4. Directions that no view shows are interpolated from their surroundings.
//!
//! The light is assumed to be distant: the size of the ball is ignored. Directions are in the space
//! of the first camera: x right, y up, z towards the camera.

mod ball;
mod error;
mod fill;
mod matte;
mod reflectance;
mod turn;
mod unwrap;
mod view;

#[cfg(test)]
mod tests;

use std::f64::consts::PI;

use glam::DVec3;
use serde::Serialize;

pub use ball::{MirrorBall, Reflection};
pub use error::{ProbeError, ProbeWarning};
pub use reflectance::Reflectance;
pub use turn::Agreement;
pub use view::View;

use crate::lighting::EnvironmentMap;
use crate::picture::{Plane, luminance};
use crate::scene::PixelStatus;
use turn::{compare, estimate_azimuth, solid_angle};
use unwrap::{Texel, unwrap};

/// Smallest and largest number of rows of a map that are chosen automatically.
const OWN_ROWS: (usize, usize) = (64, 1024);
/// Smallest and largest number of rows that can be requested.
const ROWS: (usize, usize) = (8, 4096);
/// Smallest share of the sphere that the views must show.
const MIN_SEEN: f64 = 0.25;
/// Share of the sphere that no view shows above which gonio warns.
const MUCH_UNSEEN: f64 = 0.12;
/// Median difference of two views above which gonio warns.
const MAX_DIFFERENCE: f64 = 0.2;
/// Correlation of two views below which gonio warns.
const MIN_CORRELATION: f64 = 0.6;
/// Ratio of the brightness of two views above which gonio warns.
const MAX_BRIGHTNESS: f64 = 1.1;

/// Settings of [`probe`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProbeSettings {
    /// Reflectance of the ball.
    pub reflectance: Reflectance,
    /// Number of rows of the map, a power of two from 8 to 4096; by default about the radius of the
    /// ball in pixels, from 64 to 1024.
    pub rows: Option<usize>,
}

/// A second view of the ball.
pub struct SecondView {
    /// The view. Its camera is at the height of the first one and also level.
    pub view: View,
    /// Angle in radians by which the camera moved around the ball, counterclockwise as seen from
    /// above; `None` estimates it from the views.
    pub azimuth: Option<f64>,
}

/// Properties of a probe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ProbeReport {
    /// Number of rows of the map.
    pub rows: usize,
    /// Reflectance of the ball, at normal incidence.
    pub reflectance: Reflectance,
    /// Share of the sphere of directions that no view shows, which is interpolated, 0..=1.
    pub unseen: f64,
    /// Share of the interpolated directions in the light of the whole sphere, in luminance.
    pub filled_light: f64,
    /// Agreement of two views.
    pub views: Option<Agreement>,
}

/// The light around a mirror ball.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// The light, in the space of the first camera, on the scale of its picture.
    pub light: EnvironmentMap,
    /// Share of each texel that a view shows, 0..=1; the rest is interpolated.
    pub coverage: Plane<f32>,
    /// Properties of the probe.
    pub report: ProbeReport,
}

/// Estimates the light from one or two views of a mirror ball.
///
/// # Errors
/// [`ProbeError::Rows`] and [`ProbeError::Angle`] for invalid settings;
/// [`ProbeError::AmbiguousAzimuth`] if the angle between the views is not given and the views do
/// not determine it; [`ProbeError::TooLittle`] if they show less than a quarter of all directions;
/// [`ProbeError::Black`].
pub fn probe(first: &View, second: Option<&SecondView>, settings: &ProbeSettings) -> Result<Probe, ProbeError> {
    let rows = rows(first, settings)?;
    let reflectance = &settings.reflectance;
    let mut texels = unwrap(first, rows, 0.0, reflectance);
    let mut views = None;
    if let Some(SecondView { view, azimuth: turn }) = second {
        let (turn, found) = match turn {
            Some(turn) if turn.is_finite() => (*turn, false),
            Some(_) => return Err(ProbeError::Angle),
            None => (estimate_azimuth(first, view, reflectance)?, true),
        };
        let others = unwrap(view, rows, turn, reflectance);
        let agreement = compare(&texels, &others, rows, turn, found);
        texels.iter_mut().zip(&others).for_each(|(a, b)| *a = merged(a, b, agreement.brightness));
        views = Some(agreement);
    }
    let whole = |f: &dyn Fn(usize) -> f64| (0..texels.len()).map(|i| solid_angle(rows, i) * f(i)).sum::<f64>();
    let unseen = (1.0 - whole(&|i| texels[i].coverage) / (4.0 * PI)).max(0.0);
    if 1.0 - unseen < MIN_SEEN {
        return Err(ProbeError::TooLittle { share: 1.0 - unseen, min: MIN_SEEN });
    }
    let known: Vec<f64> = texels.iter().map(|texel| texel.coverage).collect();
    let mut radiance: Vec<DVec3> = texels.iter().map(|texel| texel.radiance).collect();
    if radiance.iter().all(|r| *r == DVec3::ZERO) {
        return Err(ProbeError::Black);
    }
    fill::fill(&mut radiance, &known, rows);
    let bright = |i: usize| f64::from(luminance(radiance[i].as_vec3()));
    let filled_light = whole(&|i| (1.0 - known[i]) * bright(i)) / whole(&bright).max(f64::MIN_POSITIVE);
    let finite = |r: &DVec3| r.min(DVec3::splat(f32::MAX.into())).as_vec3();
    let plane = Plane::from_vec(2 * rows, rows, radiance.iter().map(finite).collect());
    let light = EnvironmentMap::new(plane).map_err(|_| ProbeError::Black)?;
    Ok(Probe {
        light,
        coverage: Plane::from_vec(2 * rows, rows, known.iter().map(|k| *k as f32).collect()),
        report: ProbeReport { rows, reflectance: *reflectance, unseen, filled_light, views },
    })
}

fn rows(first: &View, settings: &ProbeSettings) -> Result<usize, ProbeError> {
    let (least, most) = ROWS;
    match settings.rows {
        Some(rows) if rows.is_power_of_two() && (least..=most).contains(&rows) => Ok(rows),
        Some(rows) => Err(ProbeError::Rows { rows, min: least, max: most }),
        None => {
            let near = 2.0_f64.powf(first.ball().pixels().log2().round());
            Ok((near as usize).clamp(OWN_ROWS.0, OWN_ROWS.1))
        }
    }
}

/// Merges one texel of two views, the second of which is brighter by a factor.
fn merged(first: &Texel, second: &Texel, brightness: f64) -> Texel {
    let trust = first.trust + second.trust;
    if trust <= 0.0 {
        return *first;
    }
    let sum = first.trust * first.radiance + second.trust * second.radiance / brightness;
    Texel { radiance: sum / trust, coverage: first.coverage.max(second.coverage), trust }
}

impl View {
    /// Lists the warnings about the view.
    pub fn warnings(&self) -> Vec<ProbeWarning> {
        let used = self.count(&[PixelStatus::Used, PixelStatus::Clipped]);
        let (clipped, faulty) =
            (self.count(&[PixelStatus::Clipped]), self.count(&[PixelStatus::Negative, PixelStatus::NotFinite]));
        let clipped = (clipped > 0).then_some(ProbeWarning::Clipped { clipped, used });
        let faulty = (faulty > 0).then_some(ProbeWarning::Faulty { faulty, used });
        clipped.into_iter().chain(faulty).chain(matte::matte(self).map(ProbeWarning::Matte)).collect()
    }
}

impl ProbeReport {
    /// Lists the warnings about the probe.
    pub fn warnings(&self) -> Vec<ProbeWarning> {
        let unseen = (self.unseen > MUCH_UNSEEN).then_some(ProbeWarning::Unseen(self.unseen));
        let unlike =
            self.views.filter(|views| views.difference > MAX_DIFFERENCE || views.correlation < MIN_CORRELATION);
        let unlike = unlike.map(|Agreement { difference, correlation, .. }| ProbeWarning::InconsistentViews {
            difference,
            correlation,
        });
        let ratio = self.views.map(|views| views.brightness).filter(|ratio| ratio.ln().abs() > MAX_BRIGHTNESS.ln());
        unseen.into_iter().chain(unlike).chain(ratio.map(ProbeWarning::Brightness)).collect()
    }
}
