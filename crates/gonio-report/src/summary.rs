//! Overview of a result in one picture.

use glam::Vec3;
use gonio::inference::learnt::Neighbour;
use gonio::picture::Plane;

use crate::canvas::{INK, LARGE_LINE, fill, large, large_note, place, sheet};
use crate::panels::{PANEL, Panels, Subject, resize, resolution};

/// Space between panels, in pixels.
const GAP: usize = 28;
/// Height of a name with its bar, in pixels.
const ROW: usize = PANEL / 4;

/// Height of a row of panels, in pixels.
const HIGH: usize = PANEL + GAP + LARGE_LINE + 8;

/// Composes photograph, reproduction, their difference and the light; below them the material with
/// both ends of its interval, and a caption. Returns linear display values in 0..=1.
pub fn compose(subject: &Subject<'_>, panels: &Panels, caption: &str) -> Plane<Vec3> {
    let given = match subject.light {
        Some(light) => format!("estimated light, resolution {:.0}°", resolution(light)),
        None => "known light".to_owned(),
    };
    let light = in_square(&panels.light);
    let mut rows = vec![vec![
        ("photograph", &panels.photograph),
        ("reproduction", &panels.reproduction),
        ("difference (±50 %)", &panels.residual),
        (&given, &light),
    ]];
    let found = panels.spheres.first().map(|(_, sphere)| ("BRDF in a new light", sphere));
    let names = subject.material.map(|material| nearest(&material.posterior.neighbours, &panels.similar));
    if let Some(names) = &names {
        let labels = ["dull end (5 %)", "glossy end (95 %)"];
        let mut second: Vec<_> = found.into_iter().chain(labels.into_iter().zip(&panels.ends)).collect();
        second.push(("similar highlight (not colour)", names));
        rows.push(second);
    } else {
        rows[0].extend(found);
    }
    side_by_side(&rows, caption)
}

/// Extracts the photograph from a picture by [`compose`]; `None` for other pictures.
pub fn photograph(sheet: &Plane<Vec3>) -> Option<Plane<Vec3>> {
    let (width, height) = sheet.size();
    let panels = width.checked_sub(GAP)? / (PANEL + GAP);
    let rows = height.checked_sub(GAP + LARGE_LINE)? / HIGH;
    let composed = (4..=5).contains(&panels) && (1..=2).contains(&rows);
    let whole = (GAP + panels * (PANEL + GAP), rows * HIGH + GAP + LARGE_LINE);
    (composed && whole == (width, height)).then(|| Plane::from_fn(PANEL, PANEL, |x, y| sheet[(GAP + x, GAP + y)]))
}

/// Puts the map of a light in the middle of a panel.
fn in_square(map: &Plane<Vec3>) -> Plane<Vec3> {
    let mut out = sheet(PANEL, PANEL);
    place(&mut out, 0, (PANEL - map.height()) / 2, map);
    out
}

/// Draws spheres with names and weights, and bars whose lengths are proportional to the weights.
fn nearest(neighbours: &[Neighbour], spheres: &[Plane<Vec3>]) -> Plane<Vec3> {
    let mut out = sheet(PANEL, PANEL);
    let top = neighbours.first().map_or(1.0, |m| m.weight);
    let left = ROW + GAP;
    for (n, (material, sphere)) in neighbours.iter().zip(spheres).enumerate() {
        let y = n * ROW;
        place(&mut out, 0, y, &resize(sphere, ROW - 8, ROW - 8));
        large(&mut out, left, y + 12, &material.name);
        large(&mut out, left, y + 12 + LARGE_LINE, &format!("{:.0} %", 100.0 * material.weight));
        let length = (material.weight / top * (PANEL - left) as f64) as usize;
        fill(&mut out, (left, y + 16 + 2 * LARGE_LINE), (length.max(1), 6), 0.4 * INK);
    }
    out
}

/// Arranges rows of panels, with a label under each panel and a caption at the bottom.
pub(crate) fn side_by_side(rows: &[Vec<(&str, &Plane<Vec3>)>], caption: &str) -> Plane<Vec3> {
    let width = |row: &Vec<(&str, &Plane<Vec3>)>| GAP + row.iter().map(|(_, p)| p.width() + GAP).sum::<usize>();
    let mut out = sheet(rows.iter().map(width).max().unwrap_or(0), rows.len() * HIGH + GAP + LARGE_LINE);
    for (n, row) in rows.iter().enumerate() {
        let (mut left, top) = (GAP, n * HIGH + GAP);
        for (label, panel) in row {
            place(&mut out, left, top, panel);
            large(&mut out, left, top + PANEL + 8, label);
            left += panel.width() + GAP;
        }
    }
    large_note(&mut out, GAP, rows.len() * HIGH + 16, caption);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extracts_the_photograph() {
        let panel = |grey: f32| Plane::from_fn(PANEL, PANEL, |x, y| Vec3::new(grey, x as f32, y as f32) / 512.0);
        let (first, other) = (panel(1.0), panel(2.0));
        let row = || vec![("photograph", &first), ("a", &other), ("b", &other), ("c", &other)];
        for rows in [vec![row()], vec![row(), row()]] {
            let sheet = side_by_side(&rows, "caption");
            assert_eq!(photograph(&sheet).unwrap().as_slice(), first.as_slice());
        }
        assert!(photograph(&first).is_none() && photograph(&Plane::from_fn(3, 2, |_, _| Vec3::ZERO)).is_none());
        assert!(photograph(&side_by_side(&[row()[..2].to_vec()], "caption")).is_none());
    }
}
