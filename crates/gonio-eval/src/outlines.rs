//! `gonio-eval outlines`: measures the detection of balls in simulated photographs.
//!
//! A photograph shows a measured material in a captured light, before the surroundings of this
//! light or before a plain backdrop. Width, position, distance, noise, exposure and coding vary. In
//! perspective, the outline of a ball is an ellipse; the reference is the circle with its centre
//! and its mean radius.

use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

use anyhow::Result;
use glam::{DQuat, DVec2, DVec3, Vec3};
use gonio::lighting::EnvironmentMap;
use gonio::picture::{Picture, Plane, srgb_decode, srgb_encode};
use gonio::render::{LightTree, SphereSettings, render_sphere};
use gonio::scene::{Circle, outline_of_ball};
use gonio::simulation::generator;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

use crate::data::Lights;
use crate::materials::Materials;
use crate::metrics::median;

/// Largest error of a centre or a radius that counts as correct, in pixels.
const CORRECT: f64 = 0.5;
/// Rows to which an environment map is reduced.
const MAP_ROWS: usize = 1024;
/// Side of the picture of the ball that is scaled to its outline, in pixels.
const BALL_SIDE: usize = 288;
/// Number of samples along each side of a pixel.
const SAMPLES: usize = 4;

/// Options of `gonio-eval outlines`.
#[derive(clap::Args)]
pub(crate) struct OutlinesOptions {
    /// Number of photographs
    #[arg(long, default_value_t = 200)]
    balls: u64,
    /// Number of the first photograph
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Use the test lights instead of the training lights
    #[arg(long)]
    test: bool,
    /// Existing folder to which photographs with a wrong outline are written
    #[arg(long, value_name = "FOLDER")]
    failures: Option<PathBuf>,
}

pub(crate) fn run(data: &Path, options: &OutlinesOptions) -> Result<()> {
    let lights = if options.test { Lights::open(data)? } else { Lights::training(data)? };
    let materials = Materials::open(data, None)?.with_out_of_domain(data)?;
    let (mut errors, mut ratios, mut refused, mut missed) = (Vec::new(), Vec::new(), 0, 0);
    println!("| photograph | true circle | error (pixels) | standard error (pixels) |");
    println!("|---|---|---|---|");
    for number in options.first..options.first + options.balls {
        let Simulated { picture, circle, description } = simulate(number, &lights, &materials)?;
        let found = outline_of_ball(&picture, None);
        let true_circle = format!("{:.2}, {:.2}, radius {:.2}", circle.x, circle.y, circle.radius);
        match found {
            Ok((found, sureness)) => {
                let error = error(&found, &circle);
                let expected = sureness.map_or(f64::NAN, |sureness| sureness.standard_error);
                println!("| {number}: {description} | {true_circle} | {error:.2} | {expected:.2} |");
                errors.push(error);
                ratios.extend(expected.is_finite().then(|| error / expected));
                if error > CORRECT {
                    missed += 1;
                    if let Some(folder) = &options.failures {
                        let path = folder.join(format!("outline-{number}.exr"));
                        std::fs::write(path, gonio_io::picture::encode_exr(&picture.rgb, None))?;
                    }
                }
            }
            Err(reason) => {
                println!("| {number}: {description} | {true_circle} | {reason} | |");
                refused += 1;
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| errors.get((share * errors.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    println!(
        "\n{} photographs: {missed} outlines are off by more than {CORRECT} pixels, {refused} photographs are refused; error of \
         the others: median {:.2}, 90 % {:.2}, 99 % {:.2}, largest {:.2} pixels",
        options.balls,
        median(errors.clone()),
        at(0.9),
        at(0.99),
        errors.last().copied().unwrap_or(f64::NAN),
    );
    let within = |most: f64| 100.0 * ratios.iter().filter(|r| **r <= most).count() as f64 / ratios.len() as f64;
    println!(
        "errors within 1, 2 and 3 standard errors: {:.0}, {:.0} and {:.0} %",
        within(1.0),
        within(2.0),
        within(3.0)
    );
    Ok(())
}

fn error(found: &Circle, want: &Circle) -> f64 {
    (found.x - want.x).abs().max((found.y - want.y).abs()).max((found.radius - want.radius).abs())
}

/// A simulated photograph and its outline.
struct Simulated {
    picture: Picture,
    circle: Circle,
    description: String,
}

/// An outline: semi-axes towards and across the centre of the picture, in pixels.
struct Outline {
    centre: DVec2,
    /// Unit vector from the centre of the picture to that of the outline.
    radial: DVec2,
    axes: (f64, f64),
}

impl Outline {
    /// Returns the outline of a ball in perspective.
    ///
    /// `place` is the direction to its centre. The length of `place` is the tangent of the angle to
    /// the axis of the camera. `sine` is the sine of the angular radius of the ball, and `focal`
    /// the focal length in pixels.
    fn of(place: DVec2, sine: f64, focal: f64) -> Self {
        let radial = place.normalize_or(DVec2::X);
        let (angle, half) = (place.length().atan(), sine.asin());
        let (near, far) = (focal * (angle - half).tan(), focal * (angle + half).tan());
        let along = 0.5 * (far - near);
        // Closed form of the minor axis of the intersection of cone and image plane.
        let across = focal * sine / ((angle.cos().powi(2) - sine * sine).max(1e-9)).sqrt();
        Self { centre: 0.5 * (near + far) * radial, radial, axes: (along, across) }
    }

    /// Returns the position on the unit disk of a place in the picture.
    fn disk(&self, place: DVec2) -> DVec2 {
        let off = place - self.centre;
        let (along, across) = (off.dot(self.radial) / self.axes.0, off.dot(self.radial.perp()) / self.axes.1);
        along * self.radial + across * self.radial.perp()
    }

    /// Returns the circle with the same centre and mean radius, in pixels from the corner.
    fn circle(&self, middle: DVec2) -> Circle {
        let radius = |i: usize| {
            let (s, c) = (TAU * i as f64 / 64.0).sin_cos();
            (self.axes.0 * c).hypot(self.axes.1 * s)
        };
        let radius = (0..64).map(radius).sum::<f64>() / 64.0;
        Circle { x: middle.x + self.centre.x, y: middle.y + self.centre.y, radius }
    }
}

fn simulate(number: u64, lights: &Lights, materials: &Materials) -> Result<Simulated> {
    let mut rng = generator(number);
    let names = lights.names();
    let light = &names[rng.random_range(0..names.len())];
    let material = rng.random_range(0..materials.names.len());
    let map = lights.map(light)?.reduced(MAP_ROWS);
    let turn = DQuat::from_rotation_y(rng.random_range(0.0..TAU));
    let mut tree = LightTree::of_map(&map);
    tree.set_rotation(turn);
    let settings = SphereSettings { size: BALL_SIDE, ..SphereSettings::default() };
    let ball = render_sphere(materials.rgb(material), &tree, &settings, &|_| ());

    let width = 64.0 * 32_f64.powf(rng.random_range(0.0..1.0));
    let size = (width as usize, (0.75 * width) as usize);
    let middle = 0.5 * DVec2::new(size.0 as f64, size.1 as f64);
    // Distance of the camera in radii of the ball.
    let distance = 8.0 * 16_f64.powf(rng.random_range(0.0..1.0));
    let radius = f64::max(10.0, rng.random_range(0.3..0.85) * middle.y);
    let focal = radius * distance;
    let mut free = |most: f64| rng.random_range(-1.0..=1.0) * (most - 1.1 * radius - 2.0).max(0.0);
    let place = DVec2::new(free(middle.x), free(middle.y));
    let outline = Outline::of(place / focal, 1.0 / distance, focal);

    let plain = rng.random_range(0.0..1.0) < 0.25;
    let backdrop = map.at(turn.inverse() * DVec3::NEG_Z);
    let behind = |off: DVec2| {
        if plain {
            return backdrop * (1.0 + 0.3 * (off.x + off.y) as f32 / size.0 as f32);
        }
        interpolated(&map, turn.inverse() * DVec3::new(off.x, -off.y, -focal).normalize())
    };
    let mut rgb = Plane::from_fn(size.0, size.1, |x, y| {
        let sample = |s: usize| {
            let at = |i: usize, from: usize| from as f64 + (i as f64 + 0.5) / SAMPLES as f64;
            let off = DVec2::new(at(s % SAMPLES, x), at(s / SAMPLES, y)) - middle;
            let disk = outline.disk(off);
            if disk.length() < 1.0 { radiance(&ball, disk * settings.radius()) } else { behind(off) }
        };
        (0..SAMPLES * SAMPLES).map(sample).sum::<Vec3>() / (SAMPLES * SAMPLES) as f32
    });
    let noise = 0.02 * rng.random_range(0.0..1.0_f32).powi(2);
    let is_coded = rng.random_range(0.0..1.0) < 0.5;
    expose(&mut rgb, noise, is_coded, &mut rng);
    let coding = if is_coded { "8 bits" } else { "linear" };
    let behind = if plain { "plain" } else { "surroundings" };
    let description = format!(
        "{} in {light}, {behind}, {} x {}, {distance:.0} radii, {coding}, noise {:.1} %",
        materials.names[material],
        size.0,
        size.1,
        100.0 * noise
    );
    Ok(Simulated { picture: Picture { rgb, alpha: None }, circle: outline.circle(middle), description })
}

/// Adds noise, and encodes the picture in 8 bits if requested, with a few clipped pixels.
fn expose(rgb: &mut Plane<Vec3>, noise: f32, is_coded: bool, rng: &mut impl Rng) {
    for pixel in rgb.as_mut_slice() {
        let gauss = Vec3::from_array(std::array::from_fn(|_| StandardNormal.sample(rng)));
        *pixel *= Vec3::ONE + noise * gauss;
    }
    if is_coded {
        let mut values: Vec<f32> = rgb.as_slice().iter().map(|v| v.max_element()).collect();
        let at = (rng.random_range(0.9..0.999) * values.len() as f64) as usize;
        let white = *values.select_nth_unstable_by(at, f32::total_cmp).1;
        let coded = |v: f32| srgb_decode((255.0 * srgb_encode((v / white).clamp(0.0, 1.0))).round() / 255.0);
        rgb.as_mut_slice().iter_mut().for_each(|pixel| *pixel = Vec3::from_array(pixel.to_array().map(coded)));
    }
}

/// Returns the radiance of the ball at an offset from the centre of its picture, in pixels.
fn radiance(ball: &Picture, off: DVec2) -> Vec3 {
    let at = off + 0.5 * BALL_SIDE as f64 - 0.5;
    let low = at.floor();
    let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
    for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let corner = low + DVec2::new(dx, dy);
        let weight = ((1.0 - (at.x - corner.x).abs()) * (1.0 - (at.y - corner.y).abs())) as f32;
        let place = (corner.x as usize, corner.y as usize);
        // The picture is premultiplied by its coverage.
        sum += weight * ball.rgb[place];
        weights += weight * ball.alpha.as_ref().map_or(1.0, |alpha| alpha[place]);
    }
    sum / weights.max(1e-6)
}

/// Returns the radiance of a map in a direction, interpolated between its pixels.
fn interpolated(map: &EnvironmentMap, direction: DVec3) -> Vec3 {
    let (width, height) = map.radiance().size();
    let u = (direction.x.atan2(-direction.z) / TAU + 0.5).rem_euclid(1.0);
    let v = direction.y.clamp(-1.0, 1.0).acos() / PI;
    let (x, y) = (u * width as f64 - 0.5, (v * height as f64 - 0.5).clamp(0.0, height as f64 - 1.001));
    let (column, row) = (x.floor(), y as usize);
    let (s, t) = ((x - column) as f32, y.fract() as f32);
    let left = (column.rem_euclid(width as f64) as usize).min(width - 1);
    let right = (left + 1) % width;
    let line = |row: usize| map.radiance()[(left, row)].lerp(map.radiance()[(right, row)], s);
    line(row).lerp(line(row + 1), t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_in_perspective_are_tangent_to_the_ball() {
        let (place, distance, focal) = (DVec2::new(0.2, -0.1), 9.0, 500.0);
        let outline = Outline::of(place, 1.0 / distance, focal);
        let centre = distance * place.extend(1.0).normalize();
        for i in 0..32 {
            let (s, c) = (TAU * f64::from(i) / 32.0).sin_cos();
            let radial = outline.radial;
            let at = outline.centre + outline.axes.0 * c * radial + outline.axes.1 * s * radial.perp();
            let ray = at.extend(focal).normalize();
            let from_ray = (centre - centre.dot(ray) * ray).length();
            assert!((from_ray - 1.0).abs() < 1e-9, "{i}: {from_ray}");
            assert!((outline.disk(at).length() - 1.0).abs() < 1e-9);
        }
    }
}
