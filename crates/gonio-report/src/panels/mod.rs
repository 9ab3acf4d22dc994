//! Individual pictures of a result: the photograph, its reproduction, and the material under
//! built-in lights.

mod half_vector_light;
mod light;
mod narrow_lobe;
mod renderer;
mod repaired;
pub mod used;
mod view;

use glam::{DVec3, Vec3};
use gonio::colour::ChromaField;
use gonio::estimate::{ALBEDO, MaterialEstimate};
use gonio::lighting::{EnvironmentMap, LightGrid, lamp_light, sky_light};
use gonio::picture::{Picture, Plane, luminance};
use gonio::reflectance::BivariateTable;
use gonio::render::Exposure;
use gonio::scene::Detection;

use crate::canvas::PAPER;
pub use light::{dark_studio, display, resolution};
pub(crate) use renderer::PanelRenderer;
use view::View;

/// Height of a panel, in pixels.
pub const PANEL: usize = 512;
/// Largest number of [`Panels::similar`].
const SIMILAR: usize = 4;
/// Rows of the lights for rendering. A mirror shows details below one degree.
const LIGHT_ROWS: usize = 256;

/// Colours of observations with and without a value in [`Panels::observed`].
const USED: Vec3 = Vec3::new(0.10, 0.85, 0.75);
const UNUSED: Vec3 = Vec3::new(0.95, 0.08, 0.05);
/// Difference of a channel, relative to the luminance, that is shown as black or full intensity.
const FULL: f32 = 0.5;

/// Data from which the pictures are drawn.
#[derive(Clone)]
pub struct Subject<'a> {
    /// The photograph.
    pub picture: &'a Picture,
    /// Location and observations of the object in it.
    pub detection: &'a Detection,
    /// Whether the reproduction includes self-shadowing.
    pub shadows: bool,
    /// Chroma of the inferred reflectance in every cell.
    pub chroma: ChromaField,
    /// Inferred reflectance, luminance in 1/sr.
    pub table: &'a BivariateTable,
    /// Estimated light in linear RGB, for a blind method.
    pub light: Option<&'a LightGrid>,
    /// Known light.
    pub known_light: Option<&'a EnvironmentMap>,
    /// Uncertainty of the reflectance, if the method estimates it.
    pub material: Option<&'a MaterialEstimate>,
}

/// Pictures in linear display values in 0..=1; squares of [`PANEL`] pixels unless stated otherwise.
pub struct Panels {
    /// The photograph of the object.
    pub photograph: Plane<Vec3>,
    /// Photograph of the object with a dot at each observation.
    pub observed: Plane<Vec3>,
    /// Photograph with marks on ignored pixels; `None` if only pixels outside the object are
    /// ignored.
    pub used: Option<Plane<Vec3>>,
    /// Reproduction from table and light.
    pub reproduction: Plane<Vec3>,
    /// Difference of photograph and reproduction in each channel, relative to their luminance: grey
    /// where they are equal, lighter where the photograph is brighter; black, white or a full
    /// colour at 50 %.
    pub residual: Plane<Vec3>,
    /// The light as a lat-long picture as wide as the other panels and half as high.
    pub light: Plane<Vec3>,
    /// Spheres of the BRDF in [`builtin_lights`], with their names.
    pub spheres: Vec<(&'static str, Plane<Vec3>)>,
    /// Spheres of the dull and the glossy end of the interval in the first of these lights, for
    /// methods that estimate the uncertainty.
    pub ends: Vec<Plane<Vec3>>,
    /// Spheres of draws from the posterior in the first of these lights, for the report of the same
    /// methods.
    pub draws: Vec<Plane<Vec3>>,
    /// Spheres of the most similar measured materials, in the estimated colours, in the first of
    /// these lights, half as large as the other panels.
    pub similar: Vec<Plane<Vec3>>,
}

/// Returns the first built-in light of [`builtin_lights`].
pub(crate) fn builtin_sphere_light() -> EnvironmentMap {
    dark_studio(LIGHT_ROWS)
}

/// Returns names and maps of the built-in lights for spheres, `2 height` x `height` pixels.
pub fn builtin_lights(height: usize) -> [(&'static str, EnvironmentMap); 3] {
    [("studio", dark_studio(height)), ("clear sky", sky_light(height)), ("lamps at night", lamp_light(height))]
}

impl Subject<'_> {
    /// Returns a BRDF with this luminance in the estimated colours.
    pub fn coloured(&self, table: &BivariateTable) -> [BivariateTable; 3] {
        self.chroma.tables(table)
    }
}

impl Panels {
    /// Draws all pictures, with those of draws if `with_draws`; `progress` receives a fraction in
    /// 0..=1.
    pub fn draw(subject: &Subject<'_>, with_draws: bool, progress: &(dyn Fn(f64) + Sync)) -> Self {
        let view = View::of(subject);
        let statuses = subject.detection.observations.statuses.as_deref();
        let input = view.cut(&repaired::repaired(subject.picture, statuses), PANEL);
        let exposure = Exposure::own(&input.rgb, |i| is_covered(&input, i));
        let model = reproduction(subject, &view, &input);
        progress(0.3);
        let coloured = |table: &BivariateTable| subject.coloured(table);
        let ends = subject.material.iter().flat_map(|material| &material.ends.tables);
        let shown: Vec<[BivariateTable; 3]> = std::iter::once(subject.table).chain(ends).map(coloured).collect();
        let (mut spheres, mut ends, mut draws, mut similar) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (i, (name, light)) in builtin_lights(LIGHT_ROWS).into_iter().enumerate() {
            // Draw the ends in the first light only; they differ as clearly in it as in the others.
            let materials = if i == 0 { &shown[..] } else { &shown[..1] };
            let stage = PanelRenderer::of(&light);
            let drawn = stage.spheres(materials);
            let exposure = sphere_exposure(&drawn[0]);
            let mut drawn = drawn.iter().map(|p| over_paper(p, exposure));
            spheres.extend(drawn.next().map(|p| (name, p)));
            ends.extend(drawn);
            if let Some(material) = subject.material.filter(|_| i == 0) {
                let neighbours = material.posterior.neighbours.iter().take(SIMILAR);
                let mut others: Vec<_> = neighbours.map(|n| coloured(&n.table.with_normal_albedo(ALBEDO).0)).collect();
                let count = others.len();
                others.extend(material.ends.examples.iter().filter(|_| with_draws).map(coloured));
                // Materials rendered together share half vectors, so these would change the
                // pictures above.
                let pictures = stage.spheres(&others);
                let small = |p: &Picture| resize(&over_paper(p, exposure), PANEL / 2, PANEL / 2);
                similar.extend(pictures[..count].iter().map(small));
                draws.extend(pictures[count..].iter().map(small));
            }
            progress(0.3 + 0.7 * (i + 1) as f64 / 3.0);
        }
        Self {
            observed: observed(subject, &view, &over_paper(&input, exposure)),
            used: used::draw(subject, &view, &over_paper(&input, exposure)),
            residual: residual(&input, &model),
            photograph: over_paper(&input, exposure),
            reproduction: over_paper(&model, exposure),
            light: light(subject),
            spheres,
            ends,
            draws,
            similar,
        }
    }
}

/// Renders the object in the estimated or known light, on the scale of the photograph. Pixels of a
/// second paint are multiplied by the ratio of the paints, which also dims their highlights.
fn reproduction(subject: &Subject<'_>, view: &View<'_>, input: &Picture) -> Picture {
    let stage = match (subject.light, subject.known_light) {
        (Some(grid), _) => display(grid).map(|map| PanelRenderer::of(&map)),
        (None, Some(map)) => Some(PanelRenderer::of(&map.reduced(2 * LIGHT_ROWS))),
        (None, None) => None,
    };
    let stage = stage.unwrap_or_else(|| PanelRenderer::of(&builtin_sphere_light()));
    let mut model = view.render(&subject.coloured(subject.table), &stage);
    // A known light has its own scale; an estimated light has the scale of the photograph.
    if subject.light.is_none() {
        let sum = |p: &Picture| -> f32 {
            let covered = (0..p.rgb.as_slice().len()).filter(|&i| is_covered(p, i));
            covered.map(|i| luminance(p.rgb.as_slice()[i])).sum()
        };
        let factor = sum(input) / sum(&model).max(1e-30);
        model.rgb.as_mut_slice().iter_mut().for_each(|p| *p *= factor);
    }
    if let Some(albedo) = &subject.detection.observations.albedo_map {
        let known = albedo.map(|value| if *value == Vec3::ZERO { Vec3::ONE } else { *value });
        let albedo = view.cut(&Picture { rgb: known, alpha: None }, PANEL);
        model.rgb.as_mut_slice().iter_mut().zip(albedo.rgb.as_slice()).for_each(|(p, albedo)| *p *= *albedo);
    }
    model
}

/// Draws a dot for each observation on the darkened photograph.
fn observed(subject: &Subject<'_>, view: &View<'_>, photograph: &Plane<Vec3>) -> Plane<Vec3> {
    let side = PANEL;
    let mut out = photograph.map(|p| 0.6 * *p);
    let observations = &subject.detection.observations;
    for (at, value) in observations.pixels.iter().zip(&observations.values) {
        let (x, y) = view.shown(*at, side);
        if x >= 0.0 && y >= 0.0 && (x as usize) < side && (y as usize) < side {
            out[(x as usize, y as usize)] = if value.is_some() { USED } else { UNUSED };
        }
    }
    out
}

/// Draws the difference of photograph and model, relative to the mean luminance of both.
fn residual(input: &Picture, model: &Picture) -> Plane<Vec3> {
    let both = |i: usize| is_covered(input, i) && is_covered(model, i);
    let count = input.rgb.as_slice().len();
    let (seen, made) = (input.rgb.as_slice(), model.rgb.as_slice());
    let add = |(sum, n), i: usize| (sum + luminance(seen[i]), n + 1.0_f32);
    let (sum, number) = (0..count).filter(|&i| both(i)).fold((0.0, 0.0), add);
    // The floor keeps relative errors small where both are dark.
    let floor = 0.1 * sum / number.max(1.0);
    Plane::from_fn(input.rgb.width(), input.rgb.height(), |x, y| {
        let i = y * input.rgb.width() + x;
        if !both(i) {
            return PAPER;
        }
        let off = (seen[i] - made[i]) / (0.5 * luminance(seen[i] + made[i]) + floor);
        // sRGB has a gamma of about 2.2, so equal steps of the difference become equal steps of
        // code.
        (0.5 + 0.5 * (off / FULL).clamp(Vec3::NEG_ONE, Vec3::ONE)).powf(2.2)
    })
}

fn light(subject: &Subject<'_>) -> Plane<Vec3> {
    let light = match (subject.light, subject.known_light) {
        (Some(grid), _) => match display(grid) {
            Some(map) => shown_at(map.radiance()),
            None => Plane::from_fn(PANEL, PANEL / 2, |_, _| Vec3::ZERO),
        },
        (None, Some(map)) if map.radiance().height() < PANEL / 2 => shown_at(map.radiance()),
        (None, Some(map)) => resize(map.radiance(), PANEL, PANEL / 2),
        (None, None) => Plane::from_fn(PANEL, PANEL / 2, |_, _| Vec3::ZERO),
    };
    let exposure = Exposure::by_quantile(&light, |_| true, 0.9, 0.6);
    light.map(|p| exposure.apply(*p))
}

/// Resamples a lat-long map to the width of a panel with bilinear interpolation.
fn shown_at(map: &Plane<Vec3>) -> Plane<Vec3> {
    Plane::from_fn(PANEL, PANEL / 2, |x, y| {
        let (u, v) = ((x as f64 + 0.5) / PANEL as f64, (2.0 * y as f64 + 1.0) / PANEL as f64);
        half_vector_light::between(map, gonio::sphere::direction_of_lat_long(u, v).as_vec3())
    })
}

/// Returns the exposure for the picture of a sphere.
pub(crate) fn sphere_exposure(sphere: &Picture) -> Exposure {
    Exposure::by_mean(&sphere.rgb, |i| is_covered(sphere, i), 0.3)
}

fn is_covered(picture: &Picture, i: usize) -> bool {
    picture.alpha.as_ref().is_none_or(|a| a.as_slice()[i] > 0.99)
}

pub(crate) fn over_paper(p: &Picture, exposure: Exposure) -> Plane<Vec3> {
    let alpha = p.alpha.as_ref();
    Plane::from_fn(p.rgb.width(), p.rgb.height(), |x, y| {
        let a = alpha.map_or(1.0, |a| a[(x, y)]);
        exposure.apply(p.rgb[(x, y)]) + PAPER * (1.0 - a)
    })
}

/// Resizes by the mean over the source pixels of each target pixel.
pub(crate) fn resize(source: &Plane<Vec3>, width: usize, height: usize) -> Plane<Vec3> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_have_the_colour_of_their_sign() {
        let picture = |left: f32, right: f32| Picture {
            rgb: Plane::from_fn(2, 1, |x, _| Vec3::splat(if x == 0 { left } else { right })),
            alpha: None,
        };
        let off = residual(&picture(1.0, 1.0), &picture(1.0, 1.0));
        let grey = Vec3::splat(0.5_f32.powf(2.2));
        assert_eq!(off.as_slice(), [grey, grey]);
        let off = residual(&picture(3.0, 1.0), &picture(1.0, 3.0));
        assert_eq!(off.as_slice(), [Vec3::ONE, Vec3::ZERO]);
        // The difference is red where the photograph is redder than its model, cyan where less red.
        let red = Picture { rgb: Plane::from_fn(2, 1, |_, _| Vec3::new(1.5, 1.0, 1.0)), alpha: None };
        let [more, less] = [residual(&red, &picture(1.0, 1.0)), residual(&picture(1.0, 1.0), &red)];
        assert!(more[(0, 0)].x > grey.x + 0.1 && more[(0, 0)].y == grey.y, "{}", more[(0, 0)]);
        assert!(less[(0, 0)].x < grey.x - 0.1 && less[(0, 0)].y == grey.y, "{}", less[(0, 0)]);
    }

    #[test]
    fn resizing_preserves_the_mean() {
        let source = Plane::from_fn(6, 4, |x, y| Vec3::new(x as f32, y as f32, 1.0));
        let small = resize(&source, 3, 2);
        assert_eq!(small[(0, 0)], Vec3::new(0.5, 0.5, 1.0));
        assert_eq!(resize(&source, 12, 8)[(11, 7)], Vec3::new(5.0, 3.0, 1.0));
    }
}
