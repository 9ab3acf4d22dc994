//! Picture of a material that several photographs show.

use glam::Vec3;
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use gonio::render::{Exposure, LightTree};

use crate::canvas::fill;
use crate::panels::PANEL;
use crate::panels::{over_paper, own_sphere_light, spheres};
use crate::summary;

/// Spheres in a row, at most.
const ROW: usize = 4;

/// Height of a bar of colour under a sphere.
const BAR: usize = 6;

/// A sphere with the line under it.
pub struct Shown {
    /// The line.
    pub label: String,
    /// The material, linear RGB.
    pub tables: [BivariateTable; 3],
}

/// Composes the combined material with the ends of its probable range in the first row, and what
/// each photograph says by itself below, all in one light. Linear display values in 0..=1.
pub fn compose(combined: &[Shown; 3], singles: &[Shown], caption: &str) -> Plane<Vec3> {
    let all: Vec<&Shown> = combined.iter().chain(singles).collect();
    let tables: Vec<[BivariateTable; 3]> = all.iter().map(|shown| shown.tables.clone()).collect();
    let drawn = spheres(&tables, &LightTree::of_map(&own_sphere_light()));
    let covered = |i: usize| drawn[0].alpha.as_ref().is_none_or(|a| a.as_slice()[i] > 0.99);
    let exposure = Exposure::by_quantile(&drawn[0].rgb, covered, 0.8, 0.5);
    let panels: Vec<Plane<Vec3>> = drawn.iter().map(|picture| over_paper(picture, exposure)).collect();
    let labelled: Vec<(&str, &Plane<Vec3>)> = all.iter().map(|shown| shown.label.as_str()).zip(&panels).collect();
    let (first, rest) = labelled.split_at(combined.len());
    let rows: Vec<Vec<(&str, &Plane<Vec3>)>> =
        std::iter::once(first.to_vec()).chain(rest.chunks(ROW).map(<[_]>::to_vec)).collect();
    summary::side_by_side(&rows, caption)
}

/// Draws the material alone. Linear display values in 0..=1.
pub fn sphere(tables: &[BivariateTable; 3]) -> Plane<Vec3> {
    let drawn = spheres(std::slice::from_ref(tables), &LightTree::of_map(&own_sphere_light())).remove(0);
    let covered = |i: usize| drawn.alpha.as_ref().is_none_or(|a| a.as_slice()[i] > 0.99);
    over_paper(&drawn, Exposure::by_quantile(&drawn.rgb, covered, 0.8, 0.5))
}

/// Puts a picture and the spheres of several materials below each other, each material with a bar
/// of its colour in the picture. Linear display values in 0..=1.
pub fn side_by_side(
    (picture, title): (&Plane<Vec3>, &str),
    materials: &[Shown],
    colours: &[Vec3],
    caption: &str,
) -> Plane<Vec3> {
    let tables: Vec<[BivariateTable; 3]> = materials.iter().map(|shown| shown.tables.clone()).collect();
    let drawn = spheres(&tables, &LightTree::of_map(&own_sphere_light()));
    let panels: Vec<Plane<Vec3>> = drawn
        .iter()
        .zip(colours)
        .map(|(picture, colour)| {
            let covered = |i: usize| picture.alpha.as_ref().is_none_or(|a| a.as_slice()[i] > 0.99);
            let mut panel = over_paper(picture, Exposure::by_quantile(&picture.rgb, covered, 0.8, 0.5));
            fill(&mut panel, (0, PANEL - BAR), (PANEL, BAR), *colour);
            panel
        })
        .collect();
    let labelled: Vec<(&str, &Plane<Vec3>)> = materials.iter().map(|shown| shown.label.as_str()).zip(&panels).collect();
    let rows: Vec<Vec<(&str, &Plane<Vec3>)>> =
        std::iter::once(vec![(title, picture)]).chain(labelled.chunks(ROW).map(<[_]>::to_vec)).collect();
    summary::side_by_side(&rows, caption)
}
