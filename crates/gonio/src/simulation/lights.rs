//! Lights for simulated photographs: captured ones, variations of them, and artificial ones.

use glam::{DQuat, DVec3, Vec3};
use rand::{Rng, RngExt};

use super::pyramid::LightPyramid;
use crate::lighting::EnvironmentMap;
use crate::picture::luminance;

/// Kind of light in a simulated photograph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightKind {
    /// A captured map.
    Captured,
    /// A captured map, dimmed, with one to four lamps.
    Lamped,
    /// A patch of a captured map on a black or dimmed background: a window, a screen, a stage of
    /// lamps.
    Patch,
    /// One to eight lamps in a dark room.
    Lamps,
    /// A single lamp near the camera.
    Flash,
    /// Even light from all directions, with a few large bright and dark panels: a tent, a studio.
    Tent,
    /// A dim room with one to three bright windows.
    Windows,
    /// Light without edges: an overcast sky over bright or dark ground, or fog.
    Overcast,
}

impl LightKind {
    /// All kinds with their frequencies. About half are captured lights, half of these with another
    /// contrast; the others resemble no captured map.
    pub const SHARES: [(Self, f64); 8] = [
        (Self::Captured, 0.48),
        (Self::Lamped, 0.07),
        (Self::Patch, 0.12),
        (Self::Lamps, 0.08),
        (Self::Flash, 0.06),
        (Self::Tent, 0.06),
        (Self::Windows, 0.07),
        (Self::Overcast, 0.06),
    ];

    /// Returns the kind of light of the `index`-th camera.
    ///
    /// The kinds are evenly spread; their frequencies are [`Self::SHARES`].
    pub fn of(index: usize) -> Self {
        let at = (index as f64 * 0.618_034).fract();
        let mut below = 0.0;
        for (kind, share) in Self::SHARES {
            below += share;
            if at < below {
                return kind;
            }
        }
        Self::Captured
    }

    /// Builds a light of this kind in the frame of a camera, with z towards the camera.
    ///
    /// `camera` is the rotation from this frame to that of the map.
    pub fn light(self, map: &EnvironmentMap, camera: DQuat, rng: &mut impl Rng) -> LightPyramid {
        let captured = |d: DVec3| f64::from(luminance(map.at(camera * d)));
        let mean = map.mean_luminance().max(1e-30);
        match self {
            Self::Captured => LightPyramid::new(captured),
            Self::Lamped => {
                let lamps = Lamp::several(4, mean, (0.1, 3.0), rng);
                let dim = log_between(rng, 0.05, 1.0);
                LightPyramid::new(|d| dim * captured(d) + lamps.iter().map(|l| l.at(d)).sum::<f64>())
            }
            Self::Patch => {
                let centre = around(DVec3::Z, between(rng, 0.0, 60.0), rng);
                let (radius, edge) = (between(rng, 20.0, 70.0).to_radians(), between(rng, 1.0, 15.0).to_radians());
                let rest = if rng.random_range(0.0..1.0) < 0.5 { 0.0 } else { log_between(rng, 0.003, 0.1) };
                LightPyramid::new(|d| {
                    let inside = ((radius - d.angle_between(centre)) / edge + 0.5).clamp(0.0, 1.0);
                    (rest + (1.0 - rest) * inside) * captured(d)
                })
            }
            Self::Lamps => {
                let lamps = Lamp::several(8, 1.0, (0.3, 1.5), rng);
                let rest = if rng.random_range(0.0..1.0) < 0.5 { 0.0 } else { log_between(rng, 0.003, 0.2) / mean };
                LightPyramid::new(|d| rest * captured(d) + lamps.iter().map(|l| l.at(d)).sum::<f64>())
            }
            Self::Flash => {
                let direction = around(DVec3::Z, between(rng, 0.0, 45.0), rng);
                let lamp = Lamp::new(direction, log_between(rng, 0.6, 12.0), 1.0);
                let rest = if rng.random_range(0.0..1.0) < 0.5 { 0.0 } else { log_between(rng, 0.003, 0.3) / mean };
                LightPyramid::new(|d| rest * captured(d) + lamp.at(d))
            }
            Self::Tent => {
                let towards = around(DVec3::Y, between(rng, 0.0, 90.0), rng);
                let slope = between(rng, 0.0, 0.9);
                let fields: Vec<Panel> = (0..rng.random_range(1..6))
                    .map(|_| {
                        let brightness =
                            if rng.random_range(0.0..1.0) < 0.6 { log_between(rng, 2.0, 15.0) } else { -0.9 };
                        Panel::new(around(DVec3::Z, between(rng, 0.0, 150.0), rng), (8.0, 35.0), brightness, rng)
                    })
                    .collect();
                LightPyramid::new(|d| {
                    let even = 1.0 + slope * d.dot(towards);
                    (even + fields.iter().map(|f| f.at(d)).sum::<f64>()).max(0.02)
                })
            }
            Self::Windows => {
                let windows: Vec<Panel> = (0..rng.random_range(1..4))
                    .map(|_| {
                        let centre = around(DVec3::Z, between(rng, 15.0, 110.0), rng);
                        let brightness = log_between(rng, 20.0, 300.0);
                        Panel::new(centre, (5.0, 22.0), brightness, rng)
                    })
                    .collect();
                let power = log_between(rng, 0.05, 1.0) / mean;
                // The view through a window, such as sky or a house, is not quite uniform.
                LightPyramid::new(|d| {
                    let view = 0.6 + 0.4 * (3.0 * d.y + 2.0 * d.x).sin();
                    power * captured(d) + view * windows.iter().map(|w| w.at(d)).sum::<f64>()
                })
            }
            Self::Overcast => {
                let sky = Sky::draw(rng);
                LightPyramid::new(|d| sky.at(d))
            }
        }
    }
}

fn between(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
    rng.random_range(low..high)
}

fn log_between(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
    between(rng, low.ln(), high.ln()).exp()
}

/// Returns a direction at an angle (degrees) from `axis`, at a random azimuth.
fn around(axis: DVec3, degrees: f64, rng: &mut impl Rng) -> DVec3 {
    let (x, y) = axis.any_orthonormal_pair();
    let (angle, phi) = (degrees.to_radians(), between(rng, 0.0, std::f64::consts::TAU));
    angle.cos() * axis + angle.sin() * (phi.cos() * x + phi.sin() * y)
}

/// A round lamp.
struct Lamp {
    direction: DVec3,
    least: f64,
    radiance: f64,
}

impl Lamp {
    /// Builds a lamp with a radius in degrees and the power of an even light of radiance `mean`
    /// over the whole sphere.
    fn new(direction: DVec3, degrees: f64, mean: f64) -> Self {
        let least = degrees.to_radians().cos();
        Self { direction, least, radiance: 2.0 * mean / (1.0 - least) }
    }

    /// Draws one to `most` lamps in front of or beside the object.
    ///
    /// The power of each lamp is a share of that of an even light of radiance `mean`.
    fn several(most: usize, mean: f64, share: (f64, f64), rng: &mut impl Rng) -> Vec<Self> {
        (0..rng.random_range(1..=most))
            .map(|_| {
                let direction = around(DVec3::Z, between(rng, 0.0, 115.0), rng);
                let power = mean * log_between(rng, share.0, share.1);
                Self::new(direction, log_between(rng, 0.6, 12.0), power)
            })
            .collect()
    }

    fn at(&self, d: DVec3) -> f64 {
        if d.dot(self.direction) > self.least { self.radiance } else { 0.0 }
    }
}

/// A rectangular light.
struct Panel {
    axes: [Vec3; 3],
    half: (f32, f32),
    radiance: f64,
}

impl Panel {
    /// Builds a panel whose half sides are drawn from a range of degrees.
    fn new(centre: DVec3, degrees: (f64, f64), radiance: f64, rng: &mut impl Rng) -> Self {
        let half = |rng: &mut _| between(rng, degrees.0, degrees.1).to_radians().tan() as f32;
        let (a, b) = centre.any_orthonormal_pair();
        let turn = between(rng, 0.0, std::f64::consts::TAU);
        let (x, y) = (turn.cos() * a + turn.sin() * b, turn.cos() * b - turn.sin() * a);
        Self { axes: [x, y, centre].map(|v| v.as_vec3()), half: (half(rng), half(rng)), radiance }
    }

    fn at(&self, d: DVec3) -> f64 {
        let [x, y, z] = self.axes.map(|a| a.dot(d.as_vec3()));
        if z > 0.0 && x.abs() < self.half.0 * z && y.abs() < self.half.1 * z { self.radiance } else { 0.0 }
    }
}

/// A light without edges: sky and ground with a soft horizon, and clouds.
struct Sky {
    up: DVec3,
    /// Radiance of the ground; that of the sky at the horizon is one.
    ground: f64,
    /// Increase of the radiance from the horizon to the zenith. The overcast sky of ISO 15469,
    /// 1 + 2 sin(elevation), has 2.
    rise: f64,
    /// Sine of the elevation up to which ground and sky mix above the horizon, and below it.
    horizon: f64,
    /// Wave vectors and phases of plane waves. Clouds multiply the radiance by the exponential of
    /// the sum of these waves.
    waves: [(DVec3, f64); 4],
    /// Amplitude of each wave.
    amplitude: f64,
}

impl Sky {
    fn draw(rng: &mut impl Rng) -> Self {
        let wave = |_| {
            let direction = around(DVec3::Z, between(rng, -1.0, 1.0).acos().to_degrees(), rng);
            (log_between(rng, 0.5, 3.0) * direction, between(rng, 0.0, std::f64::consts::TAU))
        };
        let waves = std::array::from_fn(wave);
        Self {
            up: around(DVec3::Y, between(rng, 0.0, 30.0), rng),
            ground: log_between(rng, 0.1, 1.2),
            rise: between(rng, 0.0, 2.0),
            horizon: between(rng, 0.2, 1.5),
            waves,
            amplitude: log_between(rng, 0.01, 0.5),
        }
    }

    fn at(&self, d: DVec3) -> f64 {
        let sine = d.dot(self.up);
        let share = (0.5 + 0.5 * sine / self.horizon).clamp(0.0, 1.0);
        let share = share * share * (3.0 - 2.0 * share);
        let even = (1.0 - share) * self.ground + share * (1.0 + self.rise * sine.max(0.0));
        let clouds: f64 = self.waves.iter().map(|(wave, phase)| (wave.dot(d) + phase).sin()).sum();
        even * (self.amplitude * clouds).exp()
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;
    use crate::sphere::fibonacci_hemisphere;
    use crate::testing::environment_map;

    fn map() -> EnvironmentMap {
        environment_map(64, |d| 2.0 + d.y)
    }

    fn mean(light: &LightPyramid, count: usize, of: impl Fn(DVec3) -> bool) -> f64 {
        let all: Vec<DVec3> = fibonacci_hemisphere(count).flat_map(|n| [n, -n]).filter(|d| of(*d)).collect();
        all.iter().map(|d| f64::from(light.towards(*d, 0))).sum::<f64>() / all.len() as f64
    }

    #[test]
    fn kinds_occur_in_their_shares() {
        for (kind, share) in LightKind::SHARES {
            let count = (0..2000).filter(|&i| LightKind::of(i) == kind).count();
            assert!((count as f64 / 2000.0 - share).abs() < 0.005, "{kind:?} {count}");
        }
    }

    #[test]
    fn captured_light_rotates_with_the_camera() {
        let mut rng = Pcg64::seed_from_u64(1);
        // The camera looks straight down: the top of the map is behind it.
        let turn = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
        let light = LightKind::Captured.light(&map(), turn, &mut rng);
        for d in fibonacci_hemisphere(50) {
            let want = 2.0 + (turn * d).y;
            assert!((f64::from(light.towards(d, 0)) - want).abs() < 0.06, "{d}");
        }
    }

    #[test]
    fn lamps_have_the_given_power() {
        let lamp = Lamp::new(DVec3::new(0.6, 0.0, 0.8), 5.0, 3.0);
        let light = LightPyramid::new(|d| lamp.at(d));
        assert!((mean(&light, 50_000, |_| true) / 3.0 - 1.0).abs() < 0.05);
    }

    #[test]
    fn overcast_light_has_no_edges() {
        for seed in 0..20 {
            let sky = Sky::draw(&mut Pcg64::seed_from_u64(seed));
            for d in fibonacci_hemisphere(500).flat_map(|n| [n, -n]) {
                // One degree away.
                let near = DQuat::from_rotation_arc(DVec3::Z, d) * DVec3::new(0.0175, 0.0, 0.99985);
                assert!((sky.at(near) / sky.at(d)).ln().abs() < 0.25, "{seed} {d}");
            }
        }
    }

    #[test]
    fn all_kinds_light_the_front_and_are_finite() {
        for (kind, _) in LightKind::SHARES {
            for seed in 0..6 {
                let light = kind.light(&map(), DQuat::IDENTITY, &mut Pcg64::seed_from_u64(seed));
                let (front, back) = (mean(&light, 5_000, |d| d.z > 0.0), mean(&light, 5_000, |d| d.z < -0.6));
                assert!(front.is_finite() && back >= 0.0 && front > 0.0, "{kind:?} {seed}: {front} {back}");
            }
        }
    }
}
