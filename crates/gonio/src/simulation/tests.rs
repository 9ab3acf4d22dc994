//! Tests of the pool of scenes.

use super::*;
use crate::inference::learnt::tests::WORLD;
use crate::testing::environment_map;

fn pool() -> ScenePool {
    let lights = [1.0, -1.0].map(|slope| environment_map(32, move |d| 2.0 + slope * d.y)).into();
    ScenePool::new(
        WORLD.clone(),
        lights,
        ScenePoolSettings { groups: 1, views: 1, group_materials: 3, ..ScenePoolSettings::default() },
    )
}

/// A pool with a group that is not rendered.
fn unrendered() -> ScenePool {
    let mut pool = pool();
    let materials = vec![WORLD.entries[0].clone(); 3];
    pool.groups.push_back(Group { materials, coordinates: vec![vec![]; 3], views: vec![vec![]; 3] });
    pool
}

#[test]
fn groups_depend_only_on_their_number() {
    let mut moved = pool();
    moved.load_groups(0);
    assert_eq!(moved.scenes(), 3);
    let before = moved.photograph(5);
    moved.load_groups(1);
    let mut fresh = pool();
    fresh.load_groups(1);
    for number in 0..8 {
        let (a, b) = (moved.photograph(number), fresh.photograph(number));
        assert!(a.image == b.image && a.coordinates == b.coordinates, "{number}");
    }
    moved.load_groups(0);
    let again = moved.photograph(5);
    assert!(again.image == before.image && again.coordinates == before.coordinates);
}

#[test]
fn photographs_sum_views_in_the_stated_shares() {
    let pool = unrendered();
    let mut counts = [0.0; 4];
    let mut mixed = 0.0;
    for number in 0..4000 {
        let pick = pool.pick(&mut pool.generator(number));
        counts[pick.views.len() - 1] += 1.0 / 4000.0;
        mixed += f64::from(u8::from(pick.share < 1.0)) / 4000.0;
    }
    for (count, share) in counts.iter().zip(SUMMED) {
        assert!((count - share).abs() < 0.03, "{counts:?}");
    }
    assert!((mixed - MIXED).abs() < 0.03, "{mixed}");
}

#[test]
fn summed_scenes_are_turned_and_squares_of_details_add() {
    let spot = (DISK_SIDE / 2 + 5, DISK_SIDE / 2 - 9);
    let mut scene = Scene::black();
    let (value, detail) = (2.0, 0.3);
    (scene.values[spot.1 * DISK_SIDE + spot.0], scene.details[spot.1 * DISK_SIDE + spot.0]) = (value, detail);
    let last = DISK_SIDE - 1;
    // Places of the spot under the first four symmetries.
    let places = [spot, (last - spot.0, spot.1), (spot.0, last - spot.1), (last - spot.0, last - spot.1)];
    for way in 0..8 {
        let mut sum = Scene::black();
        scene.add_turned(way, 2.0, &mut sum);
        scene.add_turned(way, 1.0, &mut sum);
        let lit: Vec<usize> = (0..DISK_SIDE * DISK_SIDE).filter(|&c| sum.values[c] > 0.0).collect();
        assert_eq!(lit.len(), 1, "{way}");
        if let Some((x, y)) = places.get(way) {
            assert_eq!(lit[0], y * DISK_SIDE + x, "{way}");
        }
        assert!((sum.values[lit[0]] - 3.0 * value).abs() < 1e-6);
        assert!((sum.details[lit[0]] - 5.0_f32.sqrt() * detail).abs() < 1e-6);
    }
}

#[test]
fn candidates_do_not_depend_on_the_groups() {
    let (some, none) = (unrendered(), pool());
    let materials: Vec<Vec<f64>> = (0..3).map(|number| some.draw_coordinates(number)).collect();
    assert!(materials[0] != materials[1] && materials[0].len() == WORLD.latent_space.axes.len());
    assert_eq!(materials, (0..3).map(|number| none.draw_coordinates(number)).collect::<Vec<_>>());
}
