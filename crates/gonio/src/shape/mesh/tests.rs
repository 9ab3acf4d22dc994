use super::*;

#[test]
fn loose_vertices_do_not_enlarge_the_bounds() {
    let mut parts = cube();
    parts.positions.insert(3, DVec3::splat(50.0));
    parts.positions.push(DVec3::splat(-90.0));
    parts.triangles.iter_mut().flatten().for_each(|i| *i += u32::from(*i >= 3));
    let (loose, defects) = Mesh::new(parts).unwrap();
    let (plain, expected) = Mesh::new(cube()).unwrap();
    assert_eq!((loose.positions(), loose.triangles()), (plain.positions(), plain.triangles()));
    assert_eq!((loose.bounds(), defects), (plain.bounds(), expected));
}

/// Returns a cube of side two about the origin, with split vertices as in a file of flat faces.
fn cube() -> MeshParts {
    let mut parts = MeshParts::default();
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        for sign in [1.0, -1.0] {
            let (n, u) = (sign * axis, DVec3::new(axis.y, axis.z, axis.x));
            let v = n.cross(u);
            let first = parts.positions.len() as u32;
            parts.positions.extend([n - u - v, n + u - v, n + u + v, n - u + v]);
            parts.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
    }
    parts
}

#[test]
fn cube_is_closed_and_keeps_its_edges() {
    let (mesh, defects) = Mesh::new(cube()).unwrap();
    let want = MeshDefects { triangles: 12, normals_computed: true, ..MeshDefects::default() };
    assert_eq!(defects, want);
    for (t, normals) in mesh.triangles().iter().zip(mesh.normals()) {
        let flat = face(mesh.positions(), *t).normalize();
        assert!(normals.iter().all(|n| (*n - flat).length() < 1e-12), "{normals:?}");
    }
    assert_eq!(mesh.bounds(), (DVec3::ZERO, 3.0_f64.sqrt()));
}

#[test]
fn reports_defects_of_meshes() {
    let mut parts = cube();
    parts.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    assert!(Mesh::new(parts).unwrap().1.inside_out);
    let mut parts = cube();
    parts.triangles[0].swap(0, 1);
    assert_eq!(Mesh::new(parts).unwrap().1.inconsistent_edges, 3);
    let mut parts = cube();
    let repeated = parts.triangles[5];
    parts.triangles.extend([[1, 1, 2], repeated]);
    let defects = Mesh::new(parts).unwrap().1;
    assert_eq!((defects.degenerate, defects.non_manifold_edges, defects.triangles), (1, 3, 13));
    let mut parts = cube();
    parts.triangles.pop();
    assert_eq!(Mesh::new(parts).unwrap().1.open_edges, 3);
    let mut parts = cube();
    parts.normals = Some(parts.triangles.iter().map(|t| [-2.0 * face(&parts.positions, *t); 3]).collect());
    let (mesh, defects) = Mesh::new(parts).unwrap();
    assert_eq!((defects.inconsistent_normals, defects.normals_computed), (12, false));
    assert!(mesh.normals().iter().flatten().all(|n| (n.length() - 1.0).abs() < 1e-12));
    let mut parts = cube();
    parts.normals = Some(vec![[DVec3::ZERO; 3]; 12]);
    assert!(Mesh::new(parts).unwrap().1.normals_computed);
}

#[test]
fn rejects_invalid_meshes() {
    let refused = |change: &dyn Fn(&mut MeshParts)| {
        let mut parts = cube();
        change(&mut parts);
        Mesh::new(parts).unwrap_err()
    };
    assert_eq!(refused(&|p| p.triangles.clear()), MeshError::Empty { vertices: 24, triangles: 0 });
    assert_eq!(refused(&|p| p.triangles[3][1] = 24), MeshError::Index { triangle: 3, index: 24, vertices: 24 });
    assert_eq!(refused(&|p| p.positions[7].y = f64::NAN), MeshError::NotFinite(7));
    assert_eq!(refused(&|p| p.normals = Some(Vec::new())), MeshError::Normals { normals: 0, triangles: 12 });
    let line = |p: &mut MeshParts| p.positions.iter_mut().for_each(|v| *v = DVec3::splat(v.x));
    assert_eq!(refused(&line), MeshError::AllDegenerate(12));
}

#[test]
fn smooth_surfaces_have_smooth_normals() {
    // A cylinder of 24 sides without lids; every other side faces inwards.
    let sides = 24_u32;
    let ring = |z: f64| {
        (0..sides).map(move |i| DVec3::from((glam::DVec2::from_angle(f64::from(i) * std::f64::consts::TAU / 24.0), z)))
    };
    let positions: Vec<DVec3> = ring(0.0).chain(ring(1.0)).collect();
    let mut triangles = Vec::new();
    for i in 0..sides {
        let (j, up) = ((i + 1) % sides, sides);
        let turn = |t: [u32; 3]| if i % 2 == 0 { t } else { [t[0], t[2], t[1]] };
        triangles.extend([turn([i, j, j + up]), turn([i, j + up, i + up])]);
    }
    let (mesh, defects) = Mesh::new(MeshParts { positions, triangles, normals: None }).unwrap();
    assert_eq!((defects.open_edges, defects.inconsistent_edges), (48, 24));
    for (triangle, normals) in mesh.triangles().iter().zip(mesh.normals()) {
        for (vertex, normal) in triangle.iter().zip(normals) {
            let position = mesh.positions()[*vertex as usize];
            let out = DVec3::new(position.x, position.y, 0.0);
            assert!(normal.dot(out).abs() > 0.999, "{normal} at {out}");
        }
    }
}

#[test]
fn position_maps_are_cut_at_steps() {
    // Two planes one above the other, and a pixel without a position.
    let map = Plane::from_fn(10, 6, |x, y| {
        let z = if x < 5 { 0.0 } else { 40.0 };
        ((x, y) != (1, 1)).then(|| DVec3::new(x as f64, -(y as f64), z))
    });
    let (mesh, defects) = Mesh::of_positions(&map, 8.0).unwrap();
    // Eight columns of five quads remain without the step; six triangles touch the missing
    // pixel.
    assert_eq!(defects.triangles, 2 * 8 * 5 - 6);
    assert!(mesh.normals().iter().flatten().all(|n| (*n - DVec3::Z).length() < 1e-12));
    let none = Plane::from_fn(4, 4, |_, _| None);
    assert_eq!(Mesh::of_positions(&none, 8.0).unwrap_err(), MeshError::Empty { vertices: 0, triangles: 0 });
}

#[test]
fn transformed_normals_stay_perpendicular() {
    let (mesh, _) = Mesh::new(cube()).unwrap();
    let squeeze = DMat4::from_scale(DVec3::new(-1.0, 3.0, 0.5)) * DMat4::from_rotation_z(0.4);
    let moved = mesh.transformed(&squeeze).unwrap();
    for (t, normals) in moved.triangles().iter().zip(moved.normals()) {
        let flat = face(moved.positions(), *t).normalize();
        assert!(normals.iter().all(|n| n.dot(flat) > 1.0 - 1e-9));
    }
    assert_eq!(mesh.transformed(&DMat4::from_scale(DVec3::new(1.0, 0.0, 1.0))), Err(MeshError::Pose));
    assert_eq!(mesh.transformed(&DMat4::NAN), Err(MeshError::Pose));
}
