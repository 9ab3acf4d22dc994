//! The pictures of a result: input, reproduction, light, and the material in a light of our own.

mod view;

use glam::{DVec3, Vec3};
use gonio::colour::TwoColours;
use gonio::estimate::Material;
use gonio::inference::amortised::Neighbour;
use gonio::lighting::{EnvironmentMap, LightGrid, studio_light};
use gonio::picture::{Picture, Plane, luminance};
use gonio::reflectance::BivariateTable;
use gonio::render::{Exposure, IntegratorSettings, LightTree};
use gonio::scene::Sighting;

use crate::canvas::{INK, LETTER, PAPER, fill, place, sheet, text};
use view::View;

/// Everything that the pictures show.
#[derive(Clone)]
pub struct Subject<'a> {
    /// The photograph.
    pub picture: &'a Picture,
    /// Where the object is in it.
    pub sighting: &'a Sighting,
    /// Whether the surface keeps light from itself in the reproduction.
    pub shadows: bool,
    /// Of the inferred reflectance.
    pub colours: TwoColours,
    /// Of the estimated light, which is found in luminance alone.
    pub light_colour: Vec3,
    /// Inferred reflectance, luminance in 1/sr.
    pub table: &'a BivariateTable,
    /// Estimated light, for a blind method.
    pub light: Option<&'a LightGrid>,
    /// Given light.
    pub known_light: Option<&'a EnvironmentMap>,
    /// How sure the reflectance is, if the method tells.
    pub material: Option<&'a Material>,
    /// A line under all.
    pub caption: String,
}

/// Linear display values in 0..=1.
pub struct Pictures {
    /// A sphere of the BRDF found, in [`studio_light`].
    pub relit: Plane<Vec3>,
    /// The overview.
    pub summary: Plane<Vec3>,
}

/// Height of a panel, pixels.
const PANEL: usize = 240;
/// Space between panels.
const GAP: usize = 12;
/// Height of a line of text.
const LINE: usize = 24;
/// Good enough to look at.
const DRAFT: IntegratorSettings = IntegratorSettings { tolerance: 1.0, max_cells: 6000 };

/// Draws the pictures; `progress` is told a fraction in 0..=1.
pub fn draw(subject: &Subject<'_>, progress: &(dyn Fn(f64) + Sync)) -> Pictures {
    let coloured = |table: &BivariateTable| subject.colours.tables(table);
    let view = View::of(subject);
    let input = view.cut(subject.picture);
    let tree = match (subject.light, subject.known_light) {
        (Some(grid), _) => LightTree::of_grid(grid),
        (None, Some(map)) => LightTree::of_map(map),
        (None, None) => LightTree::of_map(&studio_light(16)),
    };
    let mut model = view.render(&coloured(subject.table), &tree);
    if subject.light.is_some() {
        model.rgb.as_mut_slice().iter_mut().for_each(|p| *p *= subject.light_colour);
    }
    progress(0.5);
    let covered = |p: &Picture, i: usize| p.alpha.as_ref().is_none_or(|a| a.as_slice()[i] > 0.99);
    let exposure = Exposure::by_quantile(&input.rgb, |i| covered(&input, i), 0.9, 0.6);
    // Reflectance and light carry the image's scale in luminance; a known light has its own.
    let scale = match subject.light {
        Some(_) => 1.0,
        None => {
            let sum = |p: &Picture| -> f32 {
                (0..p.rgb.as_slice().len()).filter(|&i| covered(p, i)).map(|i| luminance(p.rgb.as_slice()[i])).sum()
            };
            sum(&input) / sum(&model).max(1e-30)
        }
    };
    let light = match (subject.light, subject.known_light) {
        (Some(grid), _) => grid.to_lat_long(PANEL),
        (None, Some(map)) => resize(map.radiance(), 2 * PANEL, PANEL),
        (None, None) => Plane::from_fn(2 * PANEL, PANEL, |_, _| Vec3::ZERO),
    };
    let light_exposure = Exposure::by_quantile(&light, |_| true, 0.9, 0.6);
    let over_paper = |p: &Picture, exposure: Exposure| {
        let alpha = p.alpha.as_ref();
        Plane::from_fn(p.rgb.width(), p.rgb.height(), |x, y| {
            let a = alpha.map_or(1.0, |a| a[(x, y)]);
            exposure.apply(p.rgb[(x, y)]) + PAPER * (1.0 - a)
        })
    };
    let studio = LightTree::of_map(&studio_light(128));
    let ends = subject.material.iter().flat_map(|material| &material.ends);
    let shown: Vec<[BivariateTable; 3]> = std::iter::once(subject.table).chain(ends).map(coloured).collect();
    let mut relit = view::spheres(&shown, &studio);
    let ends = relit.split_off(1);
    let relit = relit.remove(0);
    let relit_exposure = Exposure::by_quantile(&relit.rgb, |i| covered(&relit, i), 0.8, 0.5);
    let relit = over_paper(&relit, relit_exposure);
    let given = if subject.light.is_some() { "estimated light" } else { "given light" };
    let mut rows = vec![vec![
        ("photograph", over_paper(&input, exposure)),
        ("the model's reproduction", over_paper(&model, Exposure(exposure.0 * scale))),
        (given, light.map(|p| light_exposure.apply(*p))),
    ]];
    if let Some(material) = subject.material {
        let mut second = vec![("BRDF found, in a new light", relit.clone())];
        let labels = ["its dull end, at 5 %", "its glossy end, at 95 %"];
        second.extend(labels.into_iter().zip(&ends).map(|(label, p)| (label, over_paper(p, relit_exposure))));
        second.push(("nearest measured materials", nearest(&material.neighbours)));
        rows.push(second);
    } else {
        rows[0].push(("BRDF found, in a new light", relit.clone()));
    }
    progress(1.0);
    Pictures { relit, summary: compose(&rows, &subject.caption) }
}

/// Names with bars as long as their weights.
fn nearest(neighbours: &[Neighbour]) -> Plane<Vec3> {
    let mut out = sheet(PANEL, PANEL);
    let top = neighbours.first().map_or(1.0, |m| m.weight);
    for (n, material) in neighbours.iter().enumerate() {
        let y = n * LINE;
        let name: String = material.name.chars().take(PANEL / LETTER - 6).collect();
        text(&mut out, 0, y, &name);
        text(&mut out, PANEL - 5 * LETTER, y, &format!("{:>3.0} %", 100.0 * material.weight));
        let length = (material.weight / top * PANEL as f64) as usize;
        fill(&mut out, (0, y + LETTER + 4), (length.max(1), 4), 0.4 * INK);
    }
    out
}

/// Puts panels side by side and rows below each other with a line of text under each panel, and one under all.
fn compose(rows: &[Vec<(&str, Plane<Vec3>)>], caption: &str) -> Plane<Vec3> {
    let width = |row: &Vec<(&str, Plane<Vec3>)>| GAP + row.iter().map(|(_, p)| p.width() + GAP).sum::<usize>();
    let high = PANEL + GAP + LINE;
    let mut out = sheet(rows.iter().map(width).max().unwrap_or(0), rows.len() * high + GAP + LINE);
    for (n, row) in rows.iter().enumerate() {
        let (mut left, top) = (GAP, n * high + GAP);
        for (label, panel) in row {
            place(&mut out, left, top, panel);
            text(&mut out, left, top + PANEL + 8, label);
            left += panel.width() + GAP;
        }
    }
    text(&mut out, GAP, rows.len() * high + 8, caption);
    out
}

/// Mean over the source pixels of each target pixel.
fn resize(source: &Plane<Vec3>, width: usize, height: usize) -> Plane<Vec3> {
    Plane::from_fn(width, height, |x, y| {
        let range = |i: usize, n: usize, of: usize| {
            let low = i * of / n;
            low..((i + 1) * of / n).max(low + 1)
        };
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for v in range(y, height, source.height()) {
            for u in range(x, width, source.width()) {
                sum += source[(u, v)].as_dvec3();
                count += 1.0;
            }
        }
        (sum / count).as_vec3()
    })
}
