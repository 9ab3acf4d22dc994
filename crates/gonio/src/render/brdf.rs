//! BRDFs that can be rendered: isotropic, in half/difference coordinates.

use glam::DVec3;

use crate::reflectance::{BivariateTable, MerlTable, axis_d, axis_h};

/// An isotropic BRDF with RGB values in 1/sr (or relative units).
pub trait Brdf: Sync {
    /// Returns the RGB value at half/difference angles in radians.
    fn eval(&self, theta_h: f64, theta_d: f64, phi_d: f64) -> DVec3;

    /// Returns whether [`Self::eval`] depends on `phi_d`. The default is false: BRDFs over three
    /// angles must override it.
    fn depends_on_phi(&self) -> bool {
        false
    }

    /// Returns the largest channel, averaged over `phi_d`. Renderers use it to locate lobes.
    fn envelope(&self) -> BivariateTable;

    /// Returns one table per channel, or `None` if the BRDF depends on `phi_d`.
    fn tables(&self) -> Option<[BivariateTable; 3]>;
}

/// A grey table times an RGB colour, as the paper displays a monochrome BRDF.
#[derive(Clone, Debug)]
pub struct Tinted {
    /// Reflectance.
    pub table: BivariateTable,
    /// RGB factor.
    pub colour: DVec3,
}

impl Brdf for Tinted {
    fn eval(&self, theta_h: f64, theta_d: f64, _: f64) -> DVec3 {
        self.colour * self.table.eval(theta_h, theta_d)
    }

    fn envelope(&self) -> BivariateTable {
        self.table.scaled(self.colour.max_element())
    }

    fn tables(&self) -> Option<[BivariateTable; 3]> {
        Some(self.colour.to_array().map(|factor| self.table.scaled(factor)))
    }
}

/// One table per channel: red, green, blue.
impl Brdf for [BivariateTable; 3] {
    fn eval(&self, theta_h: f64, theta_d: f64, _: f64) -> DVec3 {
        let (h, d) = (axis_h(theta_h), axis_d(theta_d));
        DVec3::from_array(self.each_ref().map(|table| table.between(h, d)))
    }

    fn envelope(&self) -> BivariateTable {
        strongest(self)
    }

    fn tables(&self) -> Option<[BivariateTable; 3]> {
        Some(self.clone())
    }
}

/// Returns the largest channel in each cell.
fn strongest(rgb: &[BivariateTable; 3]) -> BivariateTable {
    let [r, g, b] = rgb.each_ref().map(BivariateTable::as_slice);
    BivariateTable::from_vec(r.iter().zip(g).zip(b).map(|((r, g), b)| r.max(*g).max(*b)).collect())
}

impl Brdf for BivariateTable {
    fn eval(&self, theta_h: f64, theta_d: f64, _: f64) -> DVec3 {
        DVec3::splat(BivariateTable::eval(self, theta_h, theta_d))
    }

    fn envelope(&self) -> BivariateTable {
        self.clone()
    }

    fn tables(&self) -> Option<[BivariateTable; 3]> {
        Some([0, 1, 2].map(|_| self.clone()))
    }
}

impl Brdf for MerlTable {
    fn eval(&self, theta_h: f64, theta_d: f64, phi_d: f64) -> DVec3 {
        DVec3::from_array(MerlTable::eval(self, theta_h, theta_d, phi_d))
    }

    fn depends_on_phi(&self) -> bool {
        true
    }

    fn envelope(&self) -> BivariateTable {
        strongest(&self.to_bivariate())
    }

    fn tables(&self) -> Option<[BivariateTable; 3]> {
        self.is_bivariate().then(|| self.to_bivariate())
    }
}
