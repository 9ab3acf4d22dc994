use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::*;

/// Sets the strength of an effect of a camera.
type Set<'a> = &'a dyn Fn(&mut PhotographEffects, f32);

fn scene() -> Scene {
    let values: Vec<f32> = (0..DISK_SIDE * DISK_SIDE)
        .map(|c| {
            let (x, y) = disk::centre(c);
            if on_disk(c) { 1.0 + 0.3 * y + 4.0 * (-60.0 * ((x - 0.2).powi(2) + y * y)).exp() } else { 0.0 }
        })
        .collect();
    let details = values.iter().map(|v| 0.05 * v).collect();
    Scene { values, details }
}

fn taken(camera: &PhotographEffects, seed: u64) -> DiskImage {
    let grey = Scene { values: vec![1.0; DISK_SIDE * DISK_SIDE], details: vec![0.0; DISK_SIDE * DISK_SIDE] };
    camera.photograph(&scene(), &grey, &mut Pcg64::seed_from_u64(seed))
}

/// Root mean square of the relative difference from the scene over the observed cells.
fn error(image: &DiskImage) -> f32 {
    let scene = scene().values;
    let used: Vec<usize> = (0..DISK_SIDE * DISK_SIDE).filter(|&c| image.counts[c] > 0.0).collect();
    let sum: f32 = used.iter().map(|&c| (image.values[c] / scene[c] - 1.0).powi(2)).sum();
    (sum / used.len() as f32).sqrt()
}

#[test]
fn a_clean_camera_reproduces_the_scene() {
    let image = taken(&PhotographEffects::CLEAN, 1);
    assert!(error(&image) < 1e-6 && image.observed() > 0.999);
    assert_eq!(
        taken(&PhotographEffects::draw(&mut Pcg64::seed_from_u64(5)), 2),
        taken(&PhotographEffects::draw(&mut Pcg64::seed_from_u64(5)), 2)
    );
}

#[test]
fn speckle_averages_out_over_pixels_and_sets_the_scatter() {
    let few = PhotographEffects { speckle: 0.2, ..PhotographEffects::CLEAN };
    let many = PhotographEffects { radius: 256.0, ..few };
    assert!((error(&taken(&few, 3)) / 0.2 - 1.0).abs() < 0.1);
    let image = taken(&many, 3);
    assert!((error(&image) / 0.05 - 1.0).abs() < 0.1);
    assert!((image.scatter / 0.2).ln().abs() < 0.6, "{}", image.scatter);
    assert!((taken(&few, 3).scatter / 0.2).ln().abs() < 0.3);
}

#[test]
fn each_effect_changes_the_image_and_grows_with_its_strength() {
    let with = |set: Set<'_>, strength: f32| {
        let mut camera = PhotographEffects { radius: 128.0, ..PhotographEffects::CLEAN };
        set(&mut camera, strength);
        error(&taken(&camera, 7))
    };
    let effects: [(&str, Set<'_>, f32); 12] = [
        ("read", &|c, s| c.read = s, 0.1),
        ("shot", &|c, s| c.shot = s, 0.1),
        ("blur", &|c, s| c.blur = s, 2.0),
        ("glare", &|c, s| c.glare = s, 0.1),
        ("stains", &|c, s| c.stains = s, 0.3),
        ("shadow", &|c, s| (c.figure, c.shadow) = (true, s), 0.5),
        ("bounce", &|c, s| (c.figure, c.bounce) = (true, s), 0.2),
        ("other material", &|c, s| c.other_material = s, 0.2),
        ("painted", &|c, s| c.painted = s, 0.4),
        ("defective", &|c, s| c.defective = s, 0.02),
        ("rough normals", &|c, s| c.rough_normals = s, 0.05),
        ("wrong normals", &|c, s| c.wrong_normals = s, 0.05),
    ];
    for (name, set, strength) in effects {
        let (less, more) = (with(set, 0.5 * strength), with(set, strength));
        assert!(less > 1e-4 && more > 1.2 * less, "{name}: {less} {more}");
    }
}

#[test]
fn details_require_many_pixels_and_a_sharp_lens() {
    let median = |image: &DiskImage| {
        let scene = scene();
        let mut all: Vec<f32> = (0..DISK_SIDE * DISK_SIDE)
            .filter(|&c| on_disk(c))
            .filter_map(|c| Some(image.details[c]? / scene.values[c]))
            .collect();
        all.sort_by(f32::total_cmp);
        (all.len() as f32 / DiskImage::cells() as f32, all.get(all.len() / 2).copied())
    };
    let near = |camera: PhotographEffects, wanted: f32| {
        let (known, detail) = median(&taken(&camera, 4));
        assert!(known > 0.99 && (detail.unwrap() / wanted - 1.0).abs() < 0.05, "{known} {detail:?} {wanted}");
    };
    let large = PhotographEffects { radius: 256.0, ..PhotographEffects::CLEAN };
    near(large, 0.05);
    near(PhotographEffects { blur: 0.3, ..large }, 0.05 * (-7.0_f32 * 0.09).exp());
    // In cells of 16 pixels, noise counts as detail: 0.2 / sqrt(16) times the median of a chi
    // distribution with three degrees of freedom.
    near(PhotographEffects { blur: 1.0, speckle: 0.2, ..large }, 0.05 * 1.538);
    assert_eq!(median(&taken(&PhotographEffects { radius: 100.0, ..large }, 4)).0, 0.0);
    let few = PhotographEffects { uneven: 0.01, ..large };
    let known = median(&taken(&few, 4)).0;
    assert!((known - 0.90).abs() < 0.02, "{known}");
}

#[test]
fn missing_occluded_and_clipped_cells_are_not_observed() {
    let gaps = taken(&PhotographEffects { missing: 0.3, ..PhotographEffects::CLEAN }, 1);
    assert!((gaps.observed() - 0.7).abs() < 0.02);
    let hidden = taken(&PhotographEffects { occluded: 0.4, ..PhotographEffects::CLEAN }, 1);
    assert!((hidden.observed() - 0.6).abs() < 0.02);
    let clipped = taken(&PhotographEffects { clipped: 0.05, ..PhotographEffects::CLEAN }, 1);
    assert!((clipped.observed() - 0.95).abs() < 0.02);
    let coarse = taken(&PhotographEffects { radius: 40.0, ..PhotographEffects::CLEAN }, 1);
    assert!((coarse.observed() - 0.39).abs() < 0.05, "{}", coarse.observed());
}
