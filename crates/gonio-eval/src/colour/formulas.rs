//! Coloured materials given by formulas: saturated bodies, coloured metals, coats over coloured
//! bodies.

use gonio::reflectance::BivariateTable;
use gonio::reflectance::parametric::Parametric;

use crate::out_of_domain::{Coated, Lobes, Metal, OrenNayar, Plastic};

/// Returns all coloured formulas with their names.
pub(super) fn coloured() -> Vec<(&'static str, [BivariateTable; 3])> {
    let channels = |one: &dyn Fn(usize) -> Box<dyn Parametric>| [0, 1, 2].map(|c| one(c).to_bivariate());
    // Refractive indices of gold and copper at about 610, 550 and 465 nm (Johnson & Christy 1972).
    let (gold, copper) = ([(0.21, 3.27), (0.42, 2.36), (1.38, 1.92)], [(0.27, 3.41), (1.04, 2.59), (1.16, 2.40)]);
    let metal = |index: [(f64, f64); 3], diffuse: [f64; 3], lobes: Lobes| {
        channels(&|c| Box::new(Metal { diffuse: diffuse[c], lobes, eta: index[c].0, k: index[c].1 }))
    };
    let coat = |albedo: [f64; 3], lobes: Lobes| {
        channels(&|c| Box::new(Coated { base: OrenNayar { albedo: albedo[c], slope: 0.3 }, lobes, eta: 1.5 }))
    };
    let plastic =
        |albedo: [f64; 3], roughness: f64| channels(&|c| Box::new(Plastic { diffuse: albedo[c], roughness, eta: 1.5 }));
    vec![
        ("red-plastic", plastic([0.55, 0.02, 0.02], 0.1)),
        ("blue-rough-plastic", plastic([0.03, 0.08, 0.45], 0.3)),
        ("green-plastic", plastic([0.05, 0.35, 0.06], 0.05)),
        ("black-plastic", plastic([0.01, 0.01, 0.012], 0.15)),
        ("orange-clay", channels(&|c| Box::new(OrenNayar { albedo: [0.6, 0.25, 0.08][c], slope: 0.5 }))),
        ("polished-gold", metal(gold, [0.01; 3], &[(1.0, 0.05)])),
        ("brushed-copper", metal(copper, [0.02; 3], &[(1.0, 0.2)])),
        ("red-car-paint", coat([0.4, 0.01, 0.015], &[(1.0, 0.02)])),
        ("violet-lacquer", coat([0.12, 0.02, 0.3], &[(0.7, 0.04), (0.3, 0.2)])),
        ("yellow-glaze", coat([0.7, 0.5, 0.05], &[(1.0, 0.08)])),
    ]
}

#[cfg(test)]
mod tests {
    use gonio::colour::{Chroma, ChromaField};

    use super::*;

    #[test]
    fn bodies_and_metals_are_saturated_and_coats_are_white() {
        for (name, rgb) in coloured() {
            let table = BivariateTable::luminance(&rgb);
            let field = ChromaField::of_tables(&rgb);
            let (body, highlight) = (field.body(&table), field.highlight(&table));
            let is_grey = |chroma: Chroma| chroma.distance(Chroma::default()) < 0.3;
            match name {
                "black-plastic" => assert!(is_grey(body) && is_grey(highlight), "{name}"),
                "polished-gold" | "brushed-copper" => assert!(!is_grey(highlight), "{name}: {highlight:?}"),
                "red-car-paint" => assert!(!is_grey(body) && is_grey(highlight), "{name}: {highlight:?}"),
                _ => assert!(!is_grey(body), "{name}: {body:?}"),
            }
        }
    }
}
