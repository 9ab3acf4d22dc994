//! Pictures of several materials: from several photographs or regions.

use glam::Vec3;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::BivariateTable;

use crate::canvas::fill;
use crate::panels::{PANEL, PanelRenderer, builtin_sphere_light, over_paper, sphere_exposure};
use crate::summary;

/// Largest number of spheres in a row.
const ROW: usize = 4;

/// Height of the colour bar under a sphere, in pixels.
const BAR: usize = 6;

/// A sphere with its label.
pub struct Shown {
    /// Label under the sphere.
    pub label: String,
    /// The material, linear RGB.
    pub tables: [BivariateTable; 3],
}

/// Composes the combined material with both ends of its interval in the first row, and the
/// materials of the single photographs below, all in one light. Also returns the sphere of the
/// combined material. Pictures are linear display values in 0..=1.
pub fn compose(combined: &[Shown; 3], singles: &[Shown], caption: &str) -> (Plane<Vec3>, Plane<Vec3>) {
    let all: Vec<&Shown> = combined.iter().chain(singles).collect();
    let drawn = drawn(&all);
    let exposure = sphere_exposure(&drawn[0]);
    let panels: Vec<Plane<Vec3>> = drawn.iter().map(|picture| over_paper(picture, exposure)).collect();
    let labelled = labelled(&all, &panels);
    let (first, rest) = labelled.split_at(combined.len());
    let sheet = in_rows(first.to_vec(), rest, caption);
    (sheet, panels[0].clone())
}

/// Composes a picture and, below it, spheres of several materials, each with a bar in its colour in
/// the picture. Returns linear display values in 0..=1.
pub fn side_by_side(
    (picture, title): (&Plane<Vec3>, &str),
    materials: &[Shown],
    colours: &[Vec3],
    caption: &str,
) -> Plane<Vec3> {
    let all: Vec<&Shown> = materials.iter().collect();
    let panel = |(picture, colour): (&Picture, &Vec3)| {
        let mut panel = over_paper(picture, sphere_exposure(picture));
        fill(&mut panel, (0, PANEL - BAR), (PANEL, BAR), *colour);
        panel
    };
    let panels: Vec<Plane<Vec3>> = drawn(&all).iter().zip(colours).map(panel).collect();
    in_rows(vec![(title, picture)], &labelled(&all, &panels), caption)
}

/// Renders spheres in the first built-in light.
fn drawn(all: &[&Shown]) -> Vec<Picture> {
    let tables: Vec<[BivariateTable; 3]> = all.iter().map(|shown| shown.tables.clone()).collect();
    PanelRenderer::of(&builtin_sphere_light()).spheres(&tables)
}

fn labelled<'a>(all: &[&'a Shown], panels: &'a [Plane<Vec3>]) -> Vec<(&'a str, &'a Plane<Vec3>)> {
    all.iter().map(|shown| shown.label.as_str()).zip(panels).collect()
}

/// Arranges a first row, and all others below it in rows of [`ROW`].
fn in_rows(first: Vec<(&str, &Plane<Vec3>)>, rest: &[(&str, &Plane<Vec3>)], caption: &str) -> Plane<Vec3> {
    let rows: Vec<_> = std::iter::once(first).chain(rest.chunks(ROW).map(<[_]>::to_vec)).collect();
    summary::side_by_side(&rows, caption)
}
