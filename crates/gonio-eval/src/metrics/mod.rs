//! How estimates are judged. All measures are free of the common scale of reflectance, which the
//! problem leaves open.
//!
//! * [`relight`], [`brdf_error`]: how far an estimate is from the reference, to the eye and over
//!   the domain.
//! * [`Gloss`]: what kind of highlight it has; [`spearman`] compares the order of materials.
//! * [`coverage()`]: how much of the domain intervals hold.
//! * [`median_interval`], [`win_rate`]: how sure a median and a comparison are, given so many
//!   cells.

mod coverage;
mod gloss;
mod scale_free;
mod statistics;

pub(crate) use coverage::coverage;
pub(crate) use gloss::{Class, Gloss};
pub(crate) use scale_free::{Relight, brdf_error, log_fit, relight, sphere_pixels};
pub(crate) use statistics::{Interval, mean, median, median_interval, spearman, win_rate};
