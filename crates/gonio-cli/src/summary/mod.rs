//! The pictures of a result: input, reproduction, light, and the material in a light of our own.

use font8x8::UnicodeFonts;
use glam::{DVec3, Vec3};
use gonio::lighting::{EnvironmentMap, LightGrid, studio_light};
use gonio::picture::{Picture, Plane, luminance};
use gonio::reflectance::BivariateTable;
use gonio::render::{
    Exposure, IntegratorSettings, LightTree, SphereSettings, Tinted, median_colour, render_normals, render_sphere,
};
use gonio::scene::Circle;

/// Everything that the pictures show.
pub(crate) struct Subject<'a> {
    pub(crate) picture: &'a Picture,
    pub(crate) coverage: Option<&'a Plane<f32>>,
    /// Outline of the sphere, unless the shape is given by normals.
    pub(crate) circle: Option<Circle>,
    pub(crate) normals: Option<&'a Plane<Vec3>>,
    pub(crate) colours: &'a [Option<Vec3>],
    /// Inferred reflectance.
    pub(crate) table: &'a BivariateTable,
    /// Estimated light, for a blind method.
    pub(crate) light: Option<&'a LightGrid>,
    /// Given light.
    pub(crate) known_light: Option<&'a EnvironmentMap>,
    pub(crate) caption: String,
}

/// Linear display values in 0..1.
pub(crate) struct Pictures {
    pub(crate) relit: Plane<Vec3>,
    pub(crate) summary: Plane<Vec3>,
}

/// Height of a panel, pixels.
const PANEL: usize = 240;
/// Space between panels.
const GAP: usize = 12;
/// Height of a line of text.
const LINE: usize = 24;
const PAPER: Vec3 = Vec3::new(0.012, 0.013, 0.015);
const INK: Vec3 = Vec3::new(0.75, 0.75, 0.72);
/// Good enough to look at.
const DRAFT: IntegratorSettings = IntegratorSettings { tolerance: 0.5, max_cells: 6000 };

/// Draws the pictures; `progress` is told a fraction in 0..=1.
pub(crate) fn draw(subject: &Subject<'_>, progress: &(dyn Fn(f64) + Sync)) -> Pictures {
    let colours: Vec<Vec3> = subject.colours.iter().flatten().copied().collect();
    let colour = median_colour(&Plane::from_vec(colours.len(), 1, colours), |_| true);
    let material = Tinted { table: subject.table.clone(), colour: colour.as_dvec3() };
    let view = View::of(subject);
    let input = view.cut(subject.picture);
    let tree = match (subject.light, subject.known_light) {
        (Some(grid), _) => LightTree::of_grid(grid),
        (None, Some(map)) => LightTree::of_map(map),
        (None, None) => LightTree::of_map(&studio_light(16)),
    };
    // With a known light its colours are in the picture already: show the reproduction in grey times the same colour.
    let model = view.render(&material, &tree, &|x| progress(0.5 * x));
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
    let studio = LightTree::of_map(&studio_light(128));
    let settings = SphereSettings { size: PANEL, integrator: DRAFT, ..SphereSettings::default() };
    let relit = render_sphere(&material, &studio, &settings, &|x| progress(0.5 + 0.5 * x));
    let relit_exposure = Exposure::by_quantile(&relit.rgb, |i| covered(&relit, i), 0.8, 0.5);
    let over_paper = |p: &Picture, exposure: Exposure| {
        let alpha = p.alpha.as_ref();
        Plane::from_fn(p.rgb.width(), p.rgb.height(), |x, y| {
            let a = alpha.map_or(1.0, |a| a[(x, y)]);
            exposure.apply(p.rgb[(x, y)]) + PAPER * (1.0 - a)
        })
    };
    let relit = over_paper(&relit, relit_exposure);
    let panels = [
        ("photograph", over_paper(&input, exposure)),
        ("the model's reproduction", over_paper(&model, Exposure(exposure.0 * scale))),
        (
            if subject.light.is_some() { "estimated light" } else { "given light" },
            light.map(|p| light_exposure.apply(*p)),
        ),
        ("BRDF found, in a new light", relit.clone()),
    ];
    Pictures { relit, summary: compose(&panels, &subject.caption) }
}

/// Puts panels side by side with a line of text under each, and one under all.
fn compose(panels: &[(&str, Plane<Vec3>)], caption: &str) -> Plane<Vec3> {
    let width = GAP + panels.iter().map(|(_, p)| p.width() + GAP).sum::<usize>();
    let mut out = Plane::from_fn(width, PANEL + 2 * GAP + 2 * LINE, |_, _| PAPER);
    let mut left = GAP;
    for (label, panel) in panels {
        for y in 0..panel.height().min(PANEL) {
            for x in 0..panel.width() {
                out[(left + x, GAP + y)] = panel[(x, y)];
            }
        }
        text(&mut out, left, PANEL + GAP + 8, label);
        left += panel.width() + GAP;
    }
    text(&mut out, GAP, PANEL + GAP + 8 + LINE, caption);
    out
}

/// Writes a line in eight by eight letters.
fn text(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    for (n, letter) in line.chars().enumerate() {
        let Some(rows) = font8x8::BASIC_FONTS.get(letter) else { continue };
        for (y, row) in rows.iter().enumerate() {
            for x in (0..8).filter(|x| row >> x & 1 == 1) {
                let at = (left + 8 * n + x, top + y);
                if at.0 < out.width() && at.1 < out.height() {
                    out[at] = INK;
                }
            }
        }
    }
}

/// The part of the photograph that a panel shows, and how the model is drawn into the same frame.
enum View<'a> {
    Sphere(Circle, Option<&'a Plane<f32>>),
    /// Normals, and the square frame in pixels: left, top, side.
    Normals(&'a Plane<Vec3>, [f64; 3], Option<&'a Plane<f32>>),
}

impl<'a> View<'a> {
    fn of(subject: &Subject<'a>) -> Self {
        match (subject.circle, subject.normals) {
            (Some(circle), _) => Self::Sphere(circle, subject.coverage),
            (None, Some(normals)) => {
                let (width, height) = normals.size();
                let (mut low, mut high) = ((width, height), (0, 0));
                for (i, n) in normals.as_slice().iter().enumerate() {
                    let seen = subject.coverage.is_none_or(|c| c.as_slice()[i] > 0.5);
                    if n.is_finite() && *n != Vec3::ZERO && seen {
                        let (x, y) = (i % width, i / width);
                        low = (low.0.min(x), low.1.min(y));
                        high = (high.0.max(x + 1), high.1.max(y + 1));
                    }
                }
                let side = (high.0 - low.0).max(high.1 - low.1) as f64 + 4.0;
                let centre = ((low.0 + high.0) as f64 / 2.0, (low.1 + high.1) as f64 / 2.0);
                Self::Normals(normals, [centre.0 - 0.5 * side, centre.1 - 0.5 * side, side], subject.coverage)
            }
            (None, None) => unreachable!("a subject has a circle or normals"),
        }
    }

    /// Position in the photograph of a panel's pixel.
    fn place(&self, x: usize, y: usize) -> (f64, f64) {
        let (x, y) = ((x as f64 + 0.5) / PANEL as f64, (y as f64 + 0.5) / PANEL as f64);
        match self {
            Self::Sphere(c, _) => {
                let side = 2.0 * c.radius * PANEL as f64 / (PANEL as f64 - 4.0);
                (c.x + (x - 0.5) * side, c.y + (y - 0.5) * side)
            }
            Self::Normals(_, [left, top, side], _) => (left + x * side, top + y * side),
        }
    }

    fn coverage(&self) -> Option<&'a Plane<f32>> {
        match self {
            Self::Sphere(_, coverage) | Self::Normals(_, _, coverage) => *coverage,
        }
    }

    /// The photograph in the frame; black where it has no pixels, alpha where the object is.
    fn cut(&self, picture: &Picture) -> Picture {
        let (width, height) = picture.rgb.size();
        let pixel = |x: usize, y: usize| {
            let (u, v) = self.place(x, y);
            let inside = u >= 0.0 && v >= 0.0 && (u as usize) < width && (v as usize) < height;
            inside.then_some((u as usize, v as usize))
        };
        let rgb = Plane::from_fn(PANEL, PANEL, |x, y| match pixel(x, y) {
            Some(at) if picture.rgb[at].is_finite() => picture.rgb[at].max(Vec3::ZERO),
            _ => Vec3::ZERO,
        });
        let alpha = Plane::from_fn(PANEL, PANEL, |x, y| match (pixel(x, y), self.coverage()) {
            (Some(at), Some(coverage)) => coverage[at].clamp(0.0, 1.0),
            (Some(_), None) => 1.0,
            (None, _) => 0.0,
        });
        // Around a ball on a real background only the ball is of interest.
        let rgb = Plane::from_fn(PANEL, PANEL, |x, y| if alpha[(x, y)] > 0.5 { rgb[(x, y)] } else { Vec3::ZERO });
        Picture { rgb, alpha: Some(alpha) }
    }

    fn render(&self, material: &Tinted, tree: &LightTree, progress: &(dyn Fn(f64) + Sync)) -> Picture {
        match self {
            Self::Sphere(..) => {
                let settings = SphereSettings { size: PANEL, integrator: DRAFT, ..SphereSettings::default() };
                render_sphere(material, tree, &settings, progress)
            }
            Self::Normals(normals, _, coverage) => {
                let frame = Plane::from_fn(PANEL, PANEL, |x, y| {
                    let (u, v) = self.place(x, y);
                    let at = (u as usize, v as usize);
                    let inside = u >= 0.0 && v >= 0.0 && at.0 < normals.width() && at.1 < normals.height();
                    let seen = inside && coverage.is_none_or(|c| c[at] > 0.5);
                    if seen && normals[at].is_finite() { normals[at] } else { Vec3::ZERO }
                });
                render_normals(material, tree, &frame, &DRAFT, progress)
            }
        }
    }
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
