//! Renders materials in a light, on spheres and on objects with any normals.

use std::f32::consts::PI;

use glam::{DVec3, Vec3, Vec3A};
use gonio::lighting::EnvironmentMap;
use gonio::picture::{Picture, Plane, luminance};
use gonio::reflectance::BivariateTable;
use gonio::render::{Brdf, HalfVectorSampler, LightTree, PrefilteredLight};
use gonio::shape::{SurfacePoint, Visibility};
use rayon::prelude::*;

use super::PANEL;
use super::half_vector_light::{HalfVectorLight, LEVELS, spline};
use super::narrow_lobe::{NarrowLobe, degree, split};

/// Radius of a sphere in a panel, in pixels.
pub(super) const RADIUS: f64 = 0.5 * PANEL as f64 - 2.0;

/// Sine of 80 degrees, the largest angle of the normals of a sphere. The rim beyond it has the
/// normal at this angle, because such normals are not observed and the part of an estimated light
/// that only they reflect is unconstrained.
const MAX_SINE: f64 = 0.985;

/// Rows of the light for smooth lobes.
const SMOOTH_ROWS: usize = 64;

/// Points along a side of the square grid of normals for smooth lobes, and the angle between two
/// points in radians.
const DOME: usize = 52;
const DOME_STEP: f32 = 3.5 * PI / 180.0;

/// Pixels between the points at which shadows are computed.
pub(super) const APART: usize = 4;

/// A light, prepared for rendering materials.
pub(crate) struct PanelRenderer {
    sharp: HalfVectorLight,
    smooth: PrefilteredLight,
}

impl PanelRenderer {
    pub(crate) fn of(light: &EnvironmentMap) -> Self {
        let smooth = || PrefilteredLight::of(&LightTree::of_map(&light.reduced(SMOOTH_ROWS)));
        let (sharp, smooth) = rayon::join(|| HalfVectorLight::of(light), smooth);
        Self { sharp, smooth }
    }

    /// Renders spheres of these materials that fill a panel.
    pub(crate) fn spheres(&self, materials: &[[BivariateTable; 3]]) -> Vec<Picture> {
        let (lit, count) = (Lit::of(self, materials), materials.len());
        let centre = 0.5 * PANEL as f64;
        let row = |row: usize| {
            let mut colours = vec![Vec3A::ZERO; PANEL * count];
            let mut rest = vec![Vec3A::ZERO; count];
            for (column, out) in colours.chunks_exact_mut(count).enumerate() {
                let (x, y) = (column as f64 + 0.5 - centre, centre - row as f64 - 0.5);
                let scale = 1.0 / RADIUS.max(x.hypot(y) / MAX_SINE);
                let (a, b) = (x * scale, y * scale);
                let normal = DVec3::new(a, b, (1.0 - a * a - b * b).sqrt()).as_vec3();
                if cover(row, column) > 0.0 {
                    lit.narrow(normal, Vec3::Z, out);
                    lit.wide(normal, &mut rest);
                    out.iter_mut().zip(&rest).for_each(|(sum, rest)| *sum = (*sum + *rest).max(Vec3A::ZERO));
                }
            }
            colours
        };
        let rows: Vec<Vec<Vec3A>> = (0..PANEL).into_par_iter().map(row).collect();
        let picture = |n: usize| Picture {
            rgb: Plane::from_fn(PANEL, PANEL, |x, y| Vec3::from(rows[y][x * count + n] * cover(y, x))),
            alpha: Some(Plane::from_fn(PANEL, PANEL, |x, y| cover(y, x))),
        };
        (0..count).map(picture).collect()
    }

    /// Renders an object in a panel. `points` contains the surface points of all pixels, `seen`
    /// those of every [`APART`]th pixel with their visibility.
    pub(super) fn object(
        &self,
        material: &[BivariateTable; 3],
        points: &[Option<SurfacePoint>],
        seen: (&[Option<SurfacePoint>], Option<&Visibility>),
    ) -> Picture {
        let lit = Lit::of(self, std::slice::from_ref(material));
        let real = points.iter().flatten().any(|p| p.view != DVec3::Z) || seen.1.is_some();
        let shadows = real.then(|| lit.shadows(seen));
        let pixel = |at: usize| {
            let Some(point) = &points[at] else { return (Vec3::ZERO, 0.0) };
            let (normal, view) = (point.normal.as_vec3(), point.view.as_vec3());
            let (narrow, wide) = shadows.as_ref().map_or((1.0, 1.0), |shadows| shadows.at(at % PANEL, at / PANEL));
            let (mut sharp, mut smooth) = ([Vec3A::ZERO], [Vec3A::ZERO]);
            lit.narrow(normal, view, &mut sharp);
            lit.wide(normal, &mut smooth);
            (Vec3::from(sharp[0] * narrow + smooth[0] * wide).max(Vec3::ZERO), 1.0)
        };
        let (rgb, alpha) = (0..PANEL * PANEL).into_par_iter().map(pixel).unzip();
        Picture { rgb: Plane::from_vec(PANEL, PANEL, rgb), alpha: Some(Plane::from_vec(PANEL, PANEL, alpha)) }
    }
}

/// Returns the share of a pixel that a sphere covers.
fn cover(row: usize, column: usize) -> f32 {
    let from_centre = |i: usize| i as f64 + 0.5 - 0.5 * PANEL as f64;
    (RADIUS - from_centre(row).hypot(from_centre(column)) + 0.5).clamp(0.0, 1.0) as f32
}

/// Materials in a light.
struct Lit<'a> {
    stage: &'a PanelRenderer,
    glosses: Vec<NarrowLobe>,
    rest: HalfVectorSampler,
    /// Radiance of the smooth lobes on the grid of normals, in which the distance from the centre
    /// is the angle to the camera. The values of all materials at a point are contiguous.
    dome: Vec<Vec3A>,
}

impl<'a> Lit<'a> {
    fn of(stage: &'a PanelRenderer, materials: &[[BivariateTable; 3]]) -> Self {
        let (glosses, rest): (Vec<NarrowLobe>, Vec<[BivariateTable; 3]>) =
            materials.iter().map(|tables| split(tables, RADIUS.recip() as f32)).unzip();
        let brdfs: Vec<&dyn Brdf> = rest.iter().map(|tables| tables as &dyn Brdf).collect();
        let lobe = HalfVectorSampler::new(&brdfs, &stage.smooth);
        let point = |at: usize| {
            let place = |i: usize| f64::from((i as f32 - 0.5 * (DOME - 1) as f32) * DOME_STEP);
            let (x, y) = (place(at % DOME), -place(at / DOME));
            let angle = x.hypot(y);
            // No pixel uses points further out.
            if angle > 95_f64.to_radians() {
                return vec![Vec3::ZERO; brdfs.len()];
            }
            let (sin, cos) = angle.min(88_f64.to_radians()).sin_cos();
            let scale = sin / angle.max(1e-9);
            let normal = DVec3::new(x * scale, y * scale, cos);
            lobe.radiance(&SurfacePoint { normal, view: DVec3::Z }, &stage.smooth, |_| 1.0)
        };
        let dome: Vec<Vec<Vec3>> = (0..DOME * DOME).into_par_iter().map(point).collect();
        Self { stage, glosses, rest: lobe, dome: dome.into_iter().flatten().map(Vec3A::from).collect() }
    }

    /// Computes the radiance of the narrow lobe of each material.
    fn narrow(&self, normal: Vec3, view: Vec3, out: &mut [Vec3A]) {
        let cos = normal.dot(view).max(0.0);
        // The half vector that reflects the same light direction to a camera on the axis.
        let towards = 2.0 * cos * normal - view;
        let half = (towards + Vec3::Z).try_normalize().unwrap_or(Vec3::X);
        let degree = degree(cos);
        self.stage.sharp.gather(half, |material| self.glosses[material].at(degree), out);
        out.iter_mut().for_each(|sum| *sum *= 4.0 * cos * cos);
    }

    /// Computes the radiance of the smooth lobe of each material, for a camera on the axis.
    fn wide(&self, normal: Vec3, out: &mut [Vec3A]) {
        let across = normal.x.hypot(normal.y);
        let angle = across.atan2(normal.z).min(89_f32.to_radians());
        let scale = angle / (across.max(1e-9) * DOME_STEP);
        let place = |x: f32| {
            let at = (x * scale + 0.5 * (DOME - 1) as f32).clamp(1.0, (DOME - 3) as f32);
            (at as usize - 1, spline(at.fract()))
        };
        let ((column, horizontal), (row, vertical)) = (place(normal.x), place(-normal.y));
        out.fill(Vec3A::ZERO);
        for (j, v) in vertical.iter().enumerate() {
            for (i, u) in horizontal.iter().enumerate() {
                let first = ((row + j) * DOME + column + i) * out.len();
                out.iter_mut().zip(&self.dome[first..]).for_each(|(sum, value)| *sum += *value * (u * v));
            }
        }
    }

    /// Computes the factors by which self-shadowing and perspective change the picture, at the
    /// given points.
    fn shadows(&self, (points, visibility): (&[Option<SurfacePoint>], Option<&Visibility>)) -> Shadows {
        let factors = |(i, point): (usize, &Option<SurfacePoint>)| {
            let point = point.as_ref()?;
            let share = |d: Vec3| visibility.map_or(1.0, |v| v.share_along(i, d.as_dvec3()));
            let real = self.rest.radiance(point, &self.stage.smooth, share)[0];
            let mut plain = [Vec3A::ZERO];
            self.wide(point.normal.as_vec3(), &mut plain);
            let ratio = luminance(real) / luminance(Vec3::from(plain[0])).max(1e-9);
            let towards = 2.0 * point.normal.dot(point.view) * point.normal - point.view;
            Some((share(towards.as_vec3()), ratio.clamp(0.0, 4.0)))
        };
        Shadows { factors: points.par_iter().enumerate().map(factors).collect() }
    }
}

/// Factors of narrow and of smooth lobes at every [`APART`]th pixel.
struct Shadows {
    factors: Vec<Option<(f32, f32)>>,
}

impl Shadows {
    /// Interpolates the factors over the pixels with a surface point.
    fn at(&self, x: usize, y: usize) -> (f32, f32) {
        let side = PANEL / APART;
        let place = |x: usize| {
            let at = ((x as f32 + 0.5) / APART as f32 - 0.5).clamp(0.0, side as f32 - 1.001);
            [(at as usize, 1.0 - at.fract()), (at as usize + 1, at.fract())]
        };
        let (mut narrow, mut wide, mut total) = (0.0, 0.0, 0.0);
        for (j, v) in place(y) {
            for (i, u) in place(x) {
                if let Some((a, b)) = self.factors[j * side + i] {
                    // The weight is positive, so that the result is defined if the nearest points
                    // do not exist.
                    let weight = u * v + 1e-4;
                    (narrow, wide, total) = (narrow + weight * a, wide + weight * b, total + weight);
                }
            }
        }
        if total > 0.0 { (narrow / total, wide / total) } else { (1.0, 1.0) }
    }
}

const _: () = assert!(LEVELS > 1 && PANEL.is_multiple_of(APART));

#[cfg(test)]
mod tests {
    use gonio::lighting::sky_light;
    use gonio::render::{IntegratorSettings, radiance};

    use super::super::dark_studio;
    use super::*;

    #[test]
    fn spheres_match_the_integral() {
        let settings = IntegratorSettings { tolerance: 0.05, ..IntegratorSettings::default() };
        for (light, width) in [(dark_studio(128), 0.4), (dark_studio(128), 0.1), (sky_light(128), 0.15)] {
            let table = BivariateTable::from_fn(|h, d| 0.05 + 0.1 * d + 1.0 / (1.0 + (h / width).powi(2)).powi(3));
            let tables = [table.clone(), table.scaled(0.5), table.clone()];
            let got = PanelRenderer::of(&light).spheres(std::slice::from_ref(&tables)).remove(0);
            let tree = LightTree::of_map(&light);
            let mut off: Vec<f32> = (0..100)
                .filter_map(|i| {
                    let at = (26 + 51 * (i % 10), 26 + 51 * (i / 10));
                    let place = |i: usize| (i as f64 + 0.5 - 0.5 * PANEL as f64) / RADIUS;
                    let (x, y) = (place(at.0), -place(at.1));
                    let normal = DVec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt());
                    // Near the rim, the horizon cuts off a part of the lobe.
                    let point = (normal.z > 0.5).then_some(SurfacePoint { normal, view: DVec3::Z })?;
                    let want = radiance(&point, &tables, &table, &tree, &settings).as_vec3();
                    Some((got.rgb[at] - want).length() / want.length())
                })
                .collect();
            off.sort_by(f32::total_cmp);
            // The few rows of the light for smooth lobes blur the edge of the sun's highlight.
            let (middle, most) = (off[off.len() / 2], off[off.len() * 9 / 10]);
            assert!(middle < 0.01 && most < 0.1, "{width}: {middle} {most}");
        }
    }
}
