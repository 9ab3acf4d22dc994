//! Distant light: environment maps, their octahedral grids and wavelet statistics (paper 3.1).

mod grid;
mod map;
mod mixture;
mod prior;
mod rectified;
mod scenes;

pub use grid::LightGrid;
pub use map::{EnvironmentMap, MapError};
pub use mixture::{MixtureSettings, ScaleMixture};
pub use prior::{CoefficientPrior, LightPrior, PriorError, PriorGroup, PriorSettings};
pub use rectified::{Moments, RectifiedGaussian};
pub use scenes::{lamp_light, named_light, sky_light, studio_light};
