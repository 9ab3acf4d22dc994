//! Measures of the error of estimates. All are invariant to the common scale of reflectance, which
//! a photograph does not determine.
//!
//! * [`relight`], [`relight_rgb`], [`brdf_error`]: error of an estimate in rendered pictures, in
//!   luminance and in RGB, and over the domain of the BRDF.
//! * [`Gloss`]: height and width of the highlight; [`spearman`] compares the order of materials.
//! * [`coverage()`]: share of the domain on which intervals contain the reference.
//! * [`median_interval`], [`win_rate`]: uncertainty of a median, and comparison of two estimators.

mod coverage;
mod gloss;
mod scale_free;
mod statistics;

pub(crate) use coverage::coverage;
pub(crate) use gloss::{Class, Gloss};
pub(crate) use gonio::reflectance::{brdf_error, log_fit};
pub(crate) use scale_free::{Relight, RgbRelight, luminances, relight, relight_rgb, sphere_pixels};
pub(crate) use statistics::{Interval, mean, median, median_interval, spearman, win_rate};
