//! Measured isotropic materials of the RGL database: `NAME_rgb.bsdf`.
//!
//! Source: Dupuy and Jakob 2018, *An Adaptive Parameterization for Efficient Material Acquisition
//! and Rendering*.
//!
//! A material was measured for a few incident directions. Each has a density of visible microfacet
//! normals, which distributes the outgoing directions so that the measured samples are dense where
//! the material is bright. With the half vector `m` of incident direction `i` and outgoing
//! direction `o`, all angles as unit coordinates (`sqrt(2 theta / pi)`, `phi / (2 pi) + 1/2`), and
//! the warp `w_i` of the density:
//!
//! `f(i, o) cos_o = rgb_i(w_i(m)) D(m) / (4 sigma(i))`,
//!
//! everything bilinear between its samples and linear between incident directions. Fields of the
//! file, with `phi` before `theta` and the last axis varying fastest:
//!
//! * `phi_i`, `theta_i`: the incident directions in radians;
//! * `sigma`: the projected area of the microfacets by direction;
//! * `ndf`: the density `D` of the microfacets by normal;
//! * `vndf`: for each incident direction, the density by normal, whose azimuth is relative to that
//!   of the incident direction;
//! * `rgb`: for each incident direction and channel, values over the square that the warp maps to;
//! * `jacobian`: whether the values must be multiplied by `D / (4 sigma)`;
//! * `description`.
//!
//! This module ignores `luminance`, for drawing samples, and `valid`, which marks measured samples.
//!
//! [`encode`] writes such a file from tables over half and difference angle.

mod encode;
mod spectra;
mod tensor;
mod warp;

use std::f64::consts::{FRAC_1_PI, TAU};
use std::path::Path;

use glam::DVec3;
use gonio::reflectance::MerlTable;
use gonio::reflectance::parametric::full_table;

use crate::{Error, guard};
pub use encode::{Channels, encode};
pub(crate) use tensor::MAGIC;
use tensor::Tensors;
use warp::{Directions, Stack, Warp};

/// Longest file read, 256 MiB: an isotropic RGB material takes less than 1 MiB.
const MAX_BYTES: u64 = 1 << 28;
/// Largest number of azimuths of the incident direction that an isotropic material has.
const ISOTROPIC: usize = 2;

/// A measured isotropic material in three channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Rgl {
    /// Description of the material in the file; may be empty.
    pub description: String,
    incident: Directions,
    sigma: Stack,
    ndf: Stack,
    vndf: Warp,
    /// Slices of red, green and blue for each incident direction.
    rgb: Stack,
    jacobian: bool,
}

/// Reads a material.
///
/// # Errors
/// If the file cannot be read, contradicts itself or its format, is anisotropic or has no RGB
/// values.
pub fn read(path: impl AsRef<Path>) -> Result<Rgl, Error> {
    let path = path.as_ref();
    decode(path, &guard::read_whole(path, MAX_BYTES)?)
}

/// Reads a material held in memory; `path` is only used in error messages.
///
/// # Errors
/// Like [`read`].
pub fn decode(path: &Path, bytes: &[u8]) -> Result<Rgl, Error> {
    let tensors = Tensors::parse(path, bytes)?;
    let ([phis], phi) = tensors.floats("phi_i")?;
    let ([thetas], theta) = tensors.floats("theta_i")?;
    if phis > ISOTROPIC {
        return Err(Error::unsupported(path, "is an anisotropic material", "use an isotropic material"));
    }
    let ([vndf_phis, vndf_thetas, h, w], values) = non_negative(&tensors, "vndf")?;
    fits(path, "vndf", [vndf_phis, vndf_thetas, 3], [phis, thetas, 3])?;
    let vndf = Warp::new(path, "vndf", Stack::new(path, "vndf", [h, w], values)?)?;
    let ([rgb_phis, rgb_thetas, channels, h, w], values) = tensors.floats("rgb")?;
    fits(path, "rgb", [rgb_phis, rgb_thetas, channels], [phis, thetas, 3])?;
    let rgb = Stack::new(path, "rgb", [h, w], values)?;
    let text = String::from_utf8_lossy(tensors.bytes("description").unwrap_or_default());
    Ok(Rgl {
        description: text.trim_end_matches('\0').to_owned(),
        incident: Directions::new(path, &phi, &theta)?,
        sigma: single(&tensors, "sigma")?,
        ndf: single(&tensors, "ndf")?,
        vndf,
        rgb,
        jacobian: jacobian(&tensors)?,
    })
}

/// Checks that the field has slices for all incident directions.
fn fits(path: &Path, name: &str, has: [usize; 3], needs: [usize; 3]) -> Result<(), Error> {
    if has == needs {
        return Ok(());
    }
    let [phis, thetas, _] = needs;
    let problem = format!("has a field {name} with the first axes {has:?}, but {phis} x {thetas} incident directions");
    Err(Error::damaged(path, problem))
}

/// Reads shape and values of a density.
fn non_negative<const AXES: usize>(tensors: &Tensors<'_>, name: &str) -> Result<([usize; AXES], Vec<f32>), Error> {
    let (shape, values) = tensors.floats(name)?;
    match values.iter().position(|v| *v < 0.0) {
        Some(at) => Err(Error::damaged(tensors.path(), format!("has a negative value at index {at} of {name}"))),
        None => Ok((shape, values)),
    }
}

/// Reads a function of one direction.
fn single(tensors: &Tensors<'_>, name: &str) -> Result<Stack, Error> {
    let (shape, values) = non_negative(tensors, name)?;
    Stack::new(tensors.path(), name, shape, values)
}

fn jacobian(tensors: &Tensors<'_>) -> Result<bool, Error> {
    match tensors.bytes("jacobian") {
        Some([flag]) => Ok(*flag != 0),
        _ => Err(Error::damaged(tensors.path(), "does not have a one-byte field for the Jacobian")),
    }
}

impl Rgl {
    /// Evaluates the BRDF in 1/sr, by channel.
    ///
    /// `wi` and `wo` are unit vectors towards the light and the viewer; the normal is `+z`. The
    /// result is zero if either is below the surface, and in channels with a negative value
    /// (saturated colours lie outside the gamut of red, green and blue). Measured values are
    /// reciprocal only within the error of the measurement; the light takes the role of the
    /// incident direction.
    pub fn eval(&self, wi: DVec3, wo: DVec3) -> [f64; 3] {
        // This form of the condition treats NaN as below the surface.
        if !(wi.z > 0.0 && wo.z > 0.0) {
            return [0.0; 3];
        }
        let half = wi + wo;
        let (theta_i, phi_i) = (elevation(wi), wi.y.atan2(wi.x));
        let corners = self.incident.corners(phi_i, theta_i);
        let (m_x, m_y) = (of_theta(elevation(half)), of_phi(half.y.atan2(half.x) - phi_i));
        let [u, v] = self.vndf.flatten(&corners, m_x, m_y);
        let value = |channel: usize| -> f64 {
            let used = corners.iter().filter(|c| c.1 > 0.0);
            used.map(|&(slice, weight)| weight * self.rgb.at(3 * slice + channel, u, v)).sum()
        };
        let facets = if self.jacobian {
            let sigma = self.sigma.at(0, of_theta(theta_i), of_phi(phi_i));
            if sigma > 0.0 { self.ndf.at(0, m_x, m_y) / (4.0 * sigma) } else { 0.0 }
        } else {
            1.0
        };
        [0, 1, 2].map(|channel| value(channel).max(0.0) * facets / wo.z)
    }

    /// Resamples the material to a table of the MERL database, missing (-1) below the horizon.
    ///
    /// The table is reciprocal, but the measurement only approximately. A cell holds the mean of
    /// [`Self::eval`] at its directions and with light and viewer exchanged, each weighted by the
    /// cosine of its outgoing direction. The measured quantity is the product with that cosine, so
    /// errors grow as it falls.
    pub fn to_merl(&self) -> MerlTable {
        full_table(|wi, wo| {
            let (there, back) = (self.eval(wi, wo), self.eval(wo, wi));
            [0, 1, 2].map(|channel| (there[channel] * wo.z + back[channel] * wi.z) / (wi.z + wo.z))
        })
    }
}

/// Returns the angle to the normal, accurate also for small angles.
fn elevation(d: DVec3) -> f64 {
    d.x.hypot(d.y).atan2(d.z)
}

/// Returns the unit coordinate of an angle to the normal, dense around the normal.
fn of_theta(theta: f64) -> f64 {
    (2.0 * FRAC_1_PI * theta).sqrt()
}

/// Returns the unit coordinate of an azimuth, periodic.
fn of_phi(phi: f64) -> f64 {
    (phi / TAU + 0.5).rem_euclid(1.0)
}
