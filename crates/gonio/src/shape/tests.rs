//! Tests of rays and visibility against closed forms and brute force.

use std::f64::consts::{PI, TAU};

use glam::{DMat4, DVec2, DVec3};

use super::*;
use crate::lighting::LightGrid;
use crate::sphere::{OctahedralMap, fibonacci_hemisphere};
use crate::testing::on_threads;

const MAP: OctahedralMap = OctahedralMap::EqualArea;

/// Returns a grid of `rings` by `spokes` quads on a sphere, to the polar angle `end` about +y.
fn cap(centre: DVec3, radius: f64, end: f64, rings: usize, spokes: usize) -> MeshParts {
    let mut parts = MeshParts::default();
    for ring in 0..=rings {
        for spoke in 0..spokes {
            let (s, c) = (end * ring as f64 / rings as f64).sin_cos();
            let around = DVec2::from_angle(TAU * spoke as f64 / spokes as f64);
            parts.positions.push(centre + radius * DVec3::new(s * around.x, c, s * around.y));
        }
    }
    for ring in 0..rings {
        for spoke in 0..spokes {
            let at = |r: usize, s: usize| (r * spokes + s % spokes) as u32;
            let [a, b, c, d] = [at(ring, spoke), at(ring, spoke + 1), at(ring + 1, spoke + 1), at(ring + 1, spoke)];
            parts.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    parts
}

fn join(parts: impl IntoIterator<Item = MeshParts>) -> Tracer {
    let mut all = MeshParts::default();
    for part in parts {
        let first = all.positions.len() as u32;
        all.positions.extend(part.positions);
        all.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + first)));
    }
    Tracer::new(Mesh::new(all).unwrap().0)
}

fn plane(half: f64) -> MeshParts {
    let positions = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)].map(|(x, z)| half * DVec3::new(x, 0.0, z));
    MeshParts { positions: positions.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]], normals: None }
}

fn lookout(surface: &Tracer, above: DVec3, down: DVec3) -> (VisibilityPoint, Hit) {
    let hit = surface.hit(&Ray { origin: above, direction: down });
    let hit = hit.unwrap_or_else(|| panic!("no hit from {above} along {down}"));
    (VisibilityPoint { from: hit.ray_origin, normal: hit.normal }, hit)
}

#[test]
fn fine_mesh_of_a_sphere_matches_the_ellipsoid() {
    let (centre, radius) = (DVec3::new(120.0, -40.0, -900.0), 37.0);
    let exact = Ellipsoid::sphere(centre, radius).unwrap();
    let mesh = join([cap(centre, radius, PI, 128, 256)]);
    let camera = Camera::new(Projection::Perspective { focal: 900.0 }, (50.0, 160.0), (240, 240)).unwrap();
    let (got, want) = (GeometryBuffer::of(&mesh, &camera), GeometryBuffer::of(&exact, &camera));
    assert!(
        want.visible > 3000 && want.visible.abs_diff(got.visible) < want.visible / 200,
        "{} {}",
        got.visible,
        want.visible
    );
    let both = got.normals.as_slice().iter().zip(want.normals.as_slice());
    let worst =
        both.filter(|(a, b)| a.length() * b.length() > 0.5).map(|(a, b)| (*a - *b).length()).fold(0.0, f32::max);
    // At the rim, a facet of 1.4 degrees displaces the hit.
    assert!(worst < 0.1, "{worst}");
    let distance = got.distances.as_slice().iter().zip(want.distances.as_slice());
    let off = distance.filter(|(a, b)| a.is_finite() && b.is_finite()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(off < 1.0, "{off}");
}

#[test]
fn rays_match_brute_force() {
    let mesh = BuiltInShape::Bunny.mesh(24).unwrap().transformed(&DMat4::from_rotation_y(0.7)).unwrap();
    let all: Vec<[DVec3; 3]> = mesh.triangles().iter().map(|t| t.map(|i| mesh.positions()[i as usize])).collect();
    let tracer = Tracer::new(mesh);
    let nearest = |ray: &Ray| {
        let each = all.iter().filter_map(|[a, b, c]| {
            // Cramer's rule in double precision.
            let (e, f, g) = (*b - *a, *c - *a, -ray.direction);
            let det = e.dot(f.cross(g));
            let o = ray.origin - *a;
            let (u, v, t) = (o.dot(f.cross(g)) / det, e.dot(o.cross(g)) / det, e.dot(f.cross(o)) / det);
            (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
        });
        each.fold(f64::INFINITY, f64::min)
    };
    let (mut hits, mut wrong) = (0, 0);
    for (i, from) in fibonacci_hemisphere(40).enumerate() {
        for (j, to) in fibonacci_hemisphere(25).enumerate() {
            let origin = 5.0 * if i % 2 == 0 { from } else { -from };
            let ray = Ray { origin, direction: (0.7 * if j % 2 == 0 { to } else { -to } - origin).normalize() };
            let (want, got) = (nearest(&ray), tracer.hit(&ray).map_or(f64::INFINITY, |h| h.distance));
            hits += usize::from(want.is_finite());
            // Rounding may move a ray through an edge to either side of it.
            wrong += usize::from(!((want - got).abs() < 1e-6 || want == got));
            assert_eq!(tracer.blocked(ray.origin, &[ray.direction]), [got.is_finite()]);
        }
    }
    assert!(hits > 300 && wrong <= 2, "{wrong} of {hits}");
}

#[test]
fn packets_match_single_rays() {
    let tracer = Tracer::new(BuiltInShape::Bunny.mesh(40).unwrap());
    let sky: Vec<DVec3> = fibonacci_hemisphere(300).flat_map(|d| [d, -d]).collect();
    let axes = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let (mut blocked, mut wrong) = (0, 0);
    for from in fibonacci_hemisphere(30).flat_map(|d| [d, -d]) {
        let Some(hit) = tracer.hit(&Ray { origin: 5.0 * from, direction: -from }) else { continue };
        for directions in [&sky[..], &sky[..17], &axes, &[]] {
            let got = tracer.blocked(hit.ray_origin, directions);
            assert_eq!(got.len(), directions.len());
            for (direction, got) in directions.iter().zip(got) {
                let alone = tracer.hit(&Ray { origin: hit.ray_origin, direction: *direction });
                blocked += usize::from(got);
                wrong += usize::from(got != alone.is_some());
            }
        }
    }
    assert!(blocked > 10_000 && wrong <= 2, "{wrong} of {blocked}");
}

/// Returns the fraction of the light of a uniform sky that reaches a point.
fn open(surface: &Tracer, point: VisibilityPoint, side: usize) -> f64 {
    Visibility::trace(surface, &[point], MAP, side, &|_| ()).sky_visibilities(&[point.normal])[0].unoccluded
}

#[test]
fn openness_beside_a_sphere_matches_its_closed_form() {
    // A ball of radius 1 touches the plane at the origin. From a point at distance x, it fills a
    // cone of half angle a about the direction to its centre, sin a = 1 / sqrt(1 + x^2), entirely
    // above the horizon. It blocks sin^2 a cos(theta) of the irradiance, cos(theta) = 1 / sqrt(1 +
    // x^2).
    let scene = join([plane(40.0), cap(DVec3::Y, 1.0, PI, 96, 192)]);
    for x in [1.2, 1.5, 2.0, 3.0, 6.0] {
        let (point, hit) = lookout(&scene, DVec3::new(x, 0.4, 0.3 * x), DVec3::NEG_Y);
        assert!((hit.normal - DVec3::Y).length() < 1e-9);
        let distance = DVec3::new(x, 0.0, 0.3 * x).length();
        let want = 1.0 - (1.0 + distance * distance).powf(-1.5);
        let got = open(&scene, point, 32);
        assert!((got - want).abs() < 0.006, "{x}: {got} {want}");
    }
}

#[test]
fn openness_in_a_bowl_matches_its_closed_form() {
    // If the rim of a bowl is at the angle e from the vertical, seen from the bottom, it blocks the
    // fraction cos^2 e; sin^2 e arrives.
    for end in [0.3, 0.5, 0.75] {
        let down = |mut parts: MeshParts| {
            parts.positions.iter_mut().for_each(|p| p.y = -p.y);
            parts
        };
        let bowl = join([down(cap(DVec3::ZERO, 1.0, end * PI, 96, 192))]);
        let (point, _) = lookout(&bowl, DVec3::new(0.003, 0.0, 0.002), DVec3::NEG_Y);
        let rim = DVec2::new((end * PI).sin(), 1.0 - (end * PI).cos());
        let want = (rim.x / rim.length()).powi(2);
        let got = open(&bowl, point, 32);
        assert!((got - want).abs() < 0.01, "{end}: {got} {want}");
    }
}

#[test]
fn convex_meshes_do_not_shadow_themselves() {
    // Coarse facets approximate a sphere: rays start clear of the facets, which would otherwise
    // block light.
    for (rings, spokes) in [(12, 24), (40, 80)] {
        let sphere = join([cap(DVec3::ZERO, 1.0, PI, rings, spokes)]);
        for from in fibonacci_hemisphere(60) {
            let (point, _) = lookout(&sphere, 3.0 * from, -from);
            let got = open(&sphere, point, 16);
            assert!(got > 0.995, "{rings} {from}: {got}");
        }
    }
}

#[test]
fn shares_match_brute_force() {
    let tracer = Tracer::new(BuiltInShape::Bunny.mesh(40).unwrap());
    let (side, fine) = (32, 12);
    let mut points = Vec::new();
    for from in fibonacci_hemisphere(20) {
        points.extend(
            tracer
                .hit(&Ray { origin: 4.0 * from, direction: -from })
                .map(|h| VisibilityPoint { from: h.ray_origin, normal: h.normal }),
        );
    }
    let visibility = Visibility::trace(&tracer, &points, MAP, side, &|_| ());
    let normals: Vec<DVec3> = points.iter().map(|p| p.normal).collect();
    let openness = visibility.sky_visibilities(&normals);
    let (mut squares, mut count, mut shadowed) = (0.0, 0, 0);
    for (i, point) in points.iter().enumerate() {
        let (mut lit, mut all) = (0.0, 0.0);
        for texel in 0..side * side {
            let (u, v) = LightGrid::centre_of(side, texel);
            let (mut above, mut free) = (0, 0);
            for f in 0..fine * fine {
                let at = |k: usize| (2.0 * (k as f64 + 0.5) / fine as f64 - 1.0) / side as f64;
                let direction = MAP.direction(u + at(f % fine), v + at(f / fine));
                let cosine = direction.dot(point.normal);
                if cosine > 0.0 {
                    let passes = tracer.hit(&Ray { origin: point.from, direction }).is_none();
                    above += 1;
                    free += usize::from(passes);
                    all += cosine;
                    lit += if passes { cosine } else { 0.0 };
                }
            }
            if above > 0 {
                let want = free as f64 / above as f64;
                squares += (f64::from(visibility.share(i, texel)) - want).powi(2);
                count += 1;
                shadowed += usize::from(want < 1.0);
            }
        }
        assert!((openness[i].unoccluded - lit / all).abs() < 0.01, "{i}: {} {}", openness[i].unoccluded, lit / all);
    }
    let rms = (squares / f64::from(count)).sqrt();
    assert!(shadowed > 1000 && rms < 0.06, "{rms} {shadowed} of {count}");
}

#[test]
fn apply_multiplies_values_by_shares() {
    let scene = join([plane(40.0), cap(DVec3::Y, 1.0, PI, 48, 96)]);
    let (near, _) = lookout(&scene, DVec3::new(1.3, 0.2, 0.0), DVec3::NEG_Y);
    let (far, _) = lookout(&scene, DVec3::new(30.0, 0.2, 0.0), DVec3::NEG_Y);
    let visibility = Visibility::trace(&scene, &[near, far], MAP, 16, &|_| ());
    let mut values = vec![2.0; 256 * 3];
    visibility.apply(0, &mut values, 3);
    for (texel, three) in values.chunks_exact(3).enumerate() {
        assert!(three.iter().all(|v| *v == 2.0 * visibility.share(0, texel)));
    }
    let shares: Vec<f32> = (0..256).map(|t| visibility.share(0, t)).collect();
    assert!(shares.contains(&0.0) && shares.iter().any(|s| *s > 0.0 && *s < 1.0) && !visibility.is_open());
    let one = visibility.select(&[1]);
    assert!((0..256).all(|t| one.share(0, t) == visibility.share(1, t)));
    assert!(visibility.bytes() < 2000, "{}", visibility.bytes());
    // Convex shapes are not traced.
    let sphere = Ellipsoid::sphere(DVec3::ZERO, 1.0).unwrap();
    assert!(Visibility::trace(&sphere, &[near, far], MAP, 16, &|_| ()).is_open());
}

#[test]
fn visibility_does_not_depend_on_threads() {
    let tracer = Tracer::new(BuiltInShape::Bowl.mesh(30).unwrap());
    let points: Vec<VisibilityPoint> = fibonacci_hemisphere(50)
        .filter_map(|d| tracer.hit(&Ray { origin: 4.0 * d, direction: -d }))
        .map(|h| VisibilityPoint { from: h.ray_origin, normal: h.normal })
        .collect();
    let with = |threads| on_threads(threads, || Visibility::trace(&tracer, &points, MAP, 16, &|_| ()));
    assert_eq!(with(1), with(3));
}

#[test]
fn forms_are_closed_and_of_about_radius_one() {
    for form in [BuiltInShape::Blob, BuiltInShape::Bunny, BuiltInShape::Bowl] {
        let mesh = form.mesh(40).unwrap();
        let parts = MeshParts {
            positions: mesh.positions().to_vec(),
            triangles: mesh.triangles().to_vec(),
            normals: Some(mesh.normals().to_vec()),
        };
        let (_, defects) = Mesh::new(parts).unwrap();
        assert!(defects.triangles > 5000, "{form:?} {defects:?}");
        let MeshDefects { open_edges, non_manifold_edges, inconsistent_edges, inside_out, .. } = defects;
        assert_eq!((open_edges, non_manifold_edges, inconsistent_edges, inside_out), (0, 0, 0, false), "{form:?}");
        let (centre, radius) = mesh.bounds();
        assert!(centre.length() < 0.5 && (0.8..1.3).contains(&radius), "{form:?} {centre} {radius}");
    }
}
