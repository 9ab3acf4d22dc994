//! Reflectance: tables, the non-negative basis learnt from measured materials, parametric models (paper 3.2).

pub mod nmf;
pub mod nnls;
mod table;

pub use table::{
    BivariateTable, CELLS, MerlTable, PHI_D, THETA_D, THETA_H, TRUSTED, above_horizon, is_trusted, theta_d_of,
    theta_h_of,
};
