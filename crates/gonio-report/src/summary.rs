//! Overview of a result in one picture.

use glam::Vec3;
use gonio::inference::learnt::Neighbour;
use gonio::picture::Plane;

use crate::canvas::{INK, LETTER, fill, place, sheet, text};
use crate::panels::{PANEL, Panels, Subject};

/// Space between panels.
const GAP: usize = 12;
/// Height of a line of text.
const LINE: usize = 24;

/// Composes photograph, reproduction and light, below them the material with the ends of the
/// probable range, and a line of text below all. Linear display values in 0..=1.
pub fn compose(subject: &Subject<'_>, panels: &Panels, caption: &str) -> Plane<Vec3> {
    let given = if subject.light.is_some() { "estimated light" } else { "given light" };
    let found = panels.spheres.first().map(|(_, sphere)| ("BRDF found, in a new light", sphere));
    let mut rows = vec![vec![
        ("photograph", &panels.photograph),
        ("the model's reproduction", &panels.reproduction),
        (given, &panels.light),
    ]];
    let names = subject.material.map(|material| nearest(&material.neighbours));
    if let Some(names) = &names {
        let labels = ["its dull end, at 5 %", "its glossy end, at 95 %"];
        let mut second: Vec<_> = found.into_iter().chain(labels.into_iter().zip(&panels.ends)).collect();
        second.push(("nearest in gloss, not colour", names));
        rows.push(second);
    } else {
        rows[0].extend(found);
    }
    side_by_side(&rows, caption)
}

/// Draws names with bars as long as their weights.
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

/// Puts panels side by side and rows below each other with a line of text under each panel, and one
/// under all.
pub(crate) fn side_by_side(rows: &[Vec<(&str, &Plane<Vec3>)>], caption: &str) -> Plane<Vec3> {
    let width = |row: &Vec<(&str, &Plane<Vec3>)>| GAP + row.iter().map(|(_, p)| p.width() + GAP).sum::<usize>();
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
