//! Reflectance: tables, the non-negative basis and parametric models (paper 3.2).

mod basis;
mod dictionary;
mod distance;
mod log_basis;
pub mod nnls;
pub mod parametric;
mod table;

pub use basis::{BasisError, ReflectanceBasis, TrainingMaterial};
pub(crate) use dictionary::unit_field;
pub use dictionary::{
    Dictionary, DictionarySettings, DrawnMaterial, LatentSpace, MaterialField, MaterialKind, Mixture, Prior,
};
pub use distance::{brdf_error, brdf_scale, diffuse_level, log_distance, log_fit};
pub use log_basis::LogBasis;
pub use table::{
    BivariateTable, CELLS, CellCountError, MerlTable, PHI_D, THETA_D, THETA_H, TRUSTED, angles_of, indices_of,
    is_trusted, theta_d_of, theta_h_of, trusted_cells,
};
pub(crate) use table::{axis_d, axis_h, nearest_trusted};
