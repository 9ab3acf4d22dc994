//! Fig. 5: BRDFs of one material from two lights, beside the truth.

use glam::{DVec3, Vec3};
use gonio::lighting::EnvironmentMap;
use gonio::picture::{Picture, Plane};
use gonio::reflectance::{BivariateTable, log_distance};
use gonio::render::{Brdf, LightTree, Tinted, render_sphere};
use gonio::sphere::direction_of_lat_long;
use maud::{Markup, html};

use super::context::{LIGHTS, Material, PaperContext};
use super::recovery::Recovered;
use super::show;
use crate::metrics;
use gonio_report::page::figure;

/// Angles between lamp and view, degrees: at the highlight, theta_d runs from 0 to 70 degrees.
const ANGLES: [f64; 5] = [0.0, 35.0, 70.0, 105.0, 140.0];
/// Elevation of the lamp, degrees.
const ELEVATION: f64 = 20.0;
/// Half the width of the lamp, degrees.
const LAMP: f64 = 4.0;
/// Radiance of all other directions over that of the lamp.
const AMBIENT: f32 = 2e-4;
/// Side of each sphere, pixels.
const SIZE: usize = 96;
/// Rows of the maps of the lights.
const HEIGHT: usize = 180;

pub(super) fn section(context: &PaperContext, recovered: &[Recovered]) -> Markup {
    let lamps: Vec<LightTree> = ANGLES.iter().map(|a| lamp(*a)).collect();
    let pairs = || context.materials.iter().zip(recovered);
    let cards: Vec<Markup> = pairs().map(|(material, r)| card(material, r, &lamps)).collect();
    let tables: Vec<Vec<&BivariateTable>> =
        recovered.iter().map(|r| r.estimates.iter().map(|e| &e.table).collect()).collect();
    let (within, between) = (within(&tables), between(&tables));
    html! {
        p {
            "Each picture has five spheres, lit by a small round lamp at " (ANGLES.map(|a| format!("{a:.0}")).join(", "))
            " degrees from the view, raised by " (format!("{ELEVATION:.0}")) " degrees, with faint light from all directions. Top to bottom: the BRDF estimated under "
            (LIGHTS[0].1) ", the truth, the BRDF estimated under " (LIGHTS[1].1)
            ". Estimates are monochrome, in the colour that fits the truth best, and as bright as the truth in the median."
        }
        (figure::grid(26, &cards))
        p {
            "The same material from two lights: BRDF log error between the two estimates " (format!("{within:.2}"))
            " in the median. Two different materials under one light: " (format!("{between:.2}")) ". The ratio is "
            strong { (format!("{:.2}", within / between)) }
            ": 0 if estimates do not depend on the light, 1 if they depend on the light as much as on the material."
        }
    }
}

/// Light of a raised lamp at this angle (degrees) to the right of the view, with faint light from
/// all directions.
fn lamp(angle: f64) -> LightTree {
    let (turn, raise) = (angle.to_radians(), ELEVATION.to_radians());
    let centre = DVec3::new(turn.sin() * raise.cos(), raise.sin(), turn.cos() * raise.cos());
    let radiance = Plane::from_fn(2 * HEIGHT, HEIGHT, |x, y| {
        let d = direction_of_lat_long((x as f64 + 0.5) / (2 * HEIGHT) as f64, (y as f64 + 0.5) / HEIGHT as f64);
        Vec3::splat(if d.angle_between(centre) < LAMP.to_radians() { 1.0 } else { AMBIENT })
    });
    LightTree::of_map(&EnvironmentMap::new(radiance).expect("a lamp is lit and has the shape of a map"))
}

fn card(material: &Material, recovered: &Recovered, lamps: &[LightTree]) -> Markup {
    let settings = show::settings(SIZE, false);
    let render = |brdf: &dyn Brdf| -> Vec<Picture> {
        lamps.iter().map(|l| render_sphere(brdf, l, &settings, &|_| ())).collect()
    };
    let truth = render(&material.full);
    // The second sphere, lit at 35 degrees from the view, determines the exposure.
    let exposure = show::exposure(&truth[1]);
    let strip =
        |pictures: &[Picture]| show::beside(&pictures.iter().map(|p| show::display(p, exposure)).collect::<Vec<_>>());
    let pixels = |pictures: &[Picture]| -> Vec<f64> {
        pictures.iter().flat_map(|p| metrics::sphere_pixels(p, settings.radius())).collect()
    };
    let (reference, colour) = (pixels(&truth), mean_colour(&truth));
    let mut rows: Vec<(String, Markup)> = recovered
        .estimates
        .iter()
        .zip(LIGHTS)
        .map(|(estimate, (_, light))| {
            let pictures = render(&Tinted { table: estimate.table.clone(), colour });
            let factor = show::median_ratio(&pixels(&pictures), &reference);
            let pictures: Vec<Picture> = pictures.iter().map(|p| show::scaled(p, factor)).collect();
            let alt = format!("Five spheres of {} as inferred under {light}", material.name);
            (format!("from {light}"), figure::picture(&strip(&pictures), &alt))
        })
        .collect();
    rows.insert(1, ("truth".into(), figure::picture(&strip(&truth), &format!("Five spheres of {}", material.name))));
    let [a, b] = [0, 1].map(|i| &recovered.estimates[i].table);
    let rows = html! { @for (label, picture) in &rows { (figure::tiles(&[(label, picture.clone())])) } };
    figure::card(
        material.name,
        &rows,
        &html! { "BRDF log error between the two estimates " (format!("{:.2}", log_distance(a, b))) },
    )
}

/// Mean colour, of luminance one, of the pictures of a material in white light.
fn mean_colour(pictures: &[Picture]) -> DVec3 {
    let sum: DVec3 = pictures.iter().flat_map(|p| p.rgb.as_slice()).map(|c| c.as_dvec3()).sum();
    let luminance = f64::from(gonio::picture::luminance(sum.as_vec3()));
    if luminance > 0.0 { sum / luminance } else { DVec3::ONE }
}

/// Median distance of the estimates of one material from two lights; `tables[material][light]`.
fn within(tables: &[Vec<&BivariateTable>]) -> f64 {
    let of_one = |t: &Vec<&BivariateTable>| -> Vec<f64> {
        (0..t.len()).flat_map(|a| (0..a).map(move |b| (a, b))).map(|(a, b)| log_distance(t[a], t[b])).collect()
    };
    metrics::median(tables.iter().flat_map(of_one).collect())
}

/// Median distance of the estimates of two materials under one light.
fn between(tables: &[Vec<&BivariateTable>]) -> f64 {
    let pairs = (0..tables.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let of_pair = |(a, b): (usize, usize)| tables[a].iter().zip(&tables[b]).map(|(x, y)| log_distance(x, y)).collect();
    metrics::median(pairs.flat_map(|p| -> Vec<f64> { of_pair(p) }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimates_that_ignore_the_light_are_stable() {
        let lobe = |s: f64| BivariateTable::from_fn(move |h, _| 0.1 + s * (-(h / 0.2).powi(2)).exp());
        let (a, b) = (lobe(1.0), lobe(30.0));
        let stable = [vec![&a, &a], vec![&b, &b]];
        assert!(within(&stable) < 1e-6 && between(&stable) > 0.1);
        assert!((log_distance(&a, &b) - log_distance(&b, &a)).abs() < 1e-12);
        let fickle = [vec![&a, &b], vec![&a, &b]];
        assert!(within(&fickle) > 0.1 && between(&fickle) < 1e-6);
    }

    #[test]
    fn the_lamp_has_the_stated_direction() {
        // A mirror-like sphere shows the lamp where the normal is half way between lamp and view.
        let mirror = BivariateTable::from_fn(|h, _| if h < 0.05 { 100.0 } else { 0.0 });
        let settings = show::settings(64, false);
        for angle in [0.0, 70.0] {
            let picture = render_sphere(&mirror, &lamp(angle), &settings, &|_| ());
            let brightest =
                (0..64 * 64).max_by(|&a, &b| picture.rgb.as_slice()[a].x.total_cmp(&picture.rgb.as_slice()[b].x));
            let (x, y) = ((brightest.unwrap() % 64) as f64 + 0.5 - 32.0, 32.0 - (brightest.unwrap() / 64) as f64 - 0.5);
            let (turn, raise) = (f64::to_radians(angle), ELEVATION.to_radians());
            let lamp = DVec3::new(turn.sin() * raise.cos(), raise.sin(), turn.cos() * raise.cos());
            let half = (lamp + DVec3::Z).normalize() * settings.radius();
            assert!((x - half.x).hypot(y - half.y) < 4.0, "{angle}: {x} {y} {half}");
        }
    }
}
