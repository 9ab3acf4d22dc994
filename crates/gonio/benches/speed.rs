//! Speed of rendering and of tracing meshes. Run with `cargo bench -p gonio`.

use std::sync::LazyLock;

use divan::{Bencher, black_box};
use glam::DVec3;
use gonio::lighting::studio_light;
use gonio::reflectance::parametric::{Ggx, Parametric};
use gonio::render::{IntegratorSettings, LightTree, radiance};
use gonio::shape::SurfacePoint;
use gonio::shape::{BuiltInShape, Camera, GeometryBuffer, Tracer, Visibility, VisibilityPoint, hit_at};
use gonio::sphere::OctahedralMap;

fn main() {
    divan::main();
}

/// Radiance of one point in the studio light.
#[divan::bench(args = [0.02, 0.1, 0.5])]
fn render_point(bencher: Bencher<'_, '_>, alpha: f64) {
    let table = Ggx { diffuse: 0.3, f0: 0.05, alpha }.to_bivariate();
    let light = LightTree::of_map(&studio_light(128));
    let point = SurfacePoint { normal: DVec3::new(-0.3, 0.4, 0.8).normalize(), view: DVec3::Z };
    let settings = IntegratorSettings::default();
    bencher.bench_local(|| radiance(black_box(&point), &table, &table, &light, &settings));
}

/// A self-shadowing mesh of 150,000 triangles, with its camera.
static BOWL: LazyLock<(Tracer, Camera)> = LazyLock::new(|| {
    let mesh = BuiltInShape::Bowl.mesh(101).expect("the lattice resolves the bowl");
    let (centre, radius) = mesh.bounds();
    let camera = Camera::framing(centre, radius, (512, 512), 0.05).expect("the camera is valid");
    let mesh = mesh.transformed(&camera.to_world.inverse()).expect("the transformation is rigid");
    assert!((140_000..170_000).contains(&mesh.triangles().len()), "{}", mesh.triangles().len());
    (Tracer::new(mesh), camera)
});

/// Builds the tree of the triangles.
#[divan::bench(sample_count = 3, sample_size = 1)]
fn tracer_of_150k_triangles(bencher: Bencher) {
    let mesh = BOWL.0.mesh().clone();
    bencher.with_inputs(|| mesh.clone()).bench_values(Tracer::new);
}

/// Traces one ray for each of 512 x 512 pixels.
#[divan::bench(sample_count = 3, sample_size = 1)]
fn geometry_buffer() -> GeometryBuffer {
    GeometryBuffer::of(&BOWL.0, &BOWL.1)
}

/// Traces the visibility of 12,000 points of the bowl, on 32 x 32 texels.
#[divan::bench(sample_count = 3, sample_size = 1)]
fn visibility_of_12000_points(bencher: Bencher) {
    let (surface, camera) = &*BOWL;
    let seen: Vec<VisibilityPoint> = (0..512 * 512)
        .filter_map(|i| hit_at(surface, camera, i % 512, i / 512))
        .map(|hit| VisibilityPoint { from: hit.ray_origin, normal: hit.normal })
        .collect();
    let points: Vec<VisibilityPoint> = (0..12_000).map(|i| seen[i * seen.len() / 12_000]).collect();
    bencher.bench(|| {
        let visibility = Visibility::trace(surface, &points, OctahedralMap::EqualArea, 32, &|_| ());
        assert!(visibility.bytes() < 20_000_000, "{}", visibility.bytes());
        black_box(visibility)
    });
}
