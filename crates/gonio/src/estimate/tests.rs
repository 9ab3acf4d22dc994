//! Tests of estimates from rendered balls, in a small world of analytic materials.

use std::sync::Mutex;

use glam::Vec3;

use super::*;
use crate::colour::{Chroma, ChromaField, plain};
use crate::inference::learnt::tests::{WORLD, environment_map, knowing};
use crate::inference::learnt::{MaterialPosterior, interval_widths};
use crate::inference::{Embedding, Likelihood, MIN_SAME_MATERIAL_LOG_ODDS};
use crate::lighting::{EnvironmentMap, LightGrid, LightPrior, PriorSettings};
use crate::picture::{Picture, luminance};
use crate::reflectance::{BivariateTable, ReflectanceBasis, trusted_cells};
use crate::render::{Accuracy, IntegratorSettings, LightTree, SphereSettings, render_sphere};
use crate::scene::{Circle, Detection, ObjectShape, ObservationSettings, PixelStatus};
use crate::sphere::OctahedralMap;
use crate::transfer::{QuadratureSettings, predict};

/// Model that recognises one of the world's materials.
fn model(material: usize) -> Model {
    let grids: Vec<LightGrid> =
        (0..12).map(|seed| environment_map(seed).to_grid(OctahedralMap::EqualArea, 32)).collect();
    let light = LightPrior::learn(&grids, grids.len(), &PriorSettings { starts: 2, seed: 1 }).unwrap();
    let reflectance = ReflectanceBasis { functions: Vec::new(), rates: Vec::new(), materials: Vec::new() };
    Model { light, reflectance, learnt: Some(knowing(material)), provenance: String::new() }
}

/// Photograph of a ball of a material of the world, times `colour`, in a light outside the training
/// data.
fn photograph(material: usize, colour: Vec3) -> Picture {
    let table = WORLD.table(&WORLD.entries[material]);
    let settings = SphereSettings {
        size: 96,
        accuracy: Accuracy::Bound(IntegratorSettings { tolerance: 0.5, max_cells: 3000 }),
        ..SphereSettings::default()
    };
    let mut picture = render_sphere(&table, &LightTree::of_map(&environment_map(100)), &settings, &|_| ());
    picture.rgb.as_mut_slice().iter_mut().for_each(|p| *p *= colour);
    picture
}

fn observations(picture: &Picture) -> Observations {
    observed(picture, false)
}

fn observed(picture: &Picture, one_material: bool) -> Observations {
    let settings = observation_settings(one_material);
    Detection::of(picture, None, ObjectShape::Sphere(None), &settings).unwrap().observations
}

fn observation_settings(one_material: bool) -> ObservationSettings {
    ObservationSettings { normals: 3000, one_material, ..ObservationSettings::default() }
}

fn settings() -> EstimateSettings {
    EstimateSettings { side: 16, observations: 900, ..EstimateSettings::default() }
}

#[test]
fn rejects_observations_without_a_value() {
    let model = model(2);
    let mut observations = observations(&photograph(2, Vec3::ONE));
    observations.values.fill(None);
    observations.colours.fill(None);
    let error = estimate(&model, &observations, &settings(), &|_| ()).unwrap_err();
    assert!(matches!(error, EstimateError::Unobserved), "{error}");
}

#[test]
fn estimates_material_and_light_of_a_ball() {
    let model = model(2);
    let observations = observations(&photograph(2, Vec3::ONE));
    let stages = Mutex::new(Vec::new());
    let found = estimate(&model, &observations, &settings(), &|stage| stages.lock().unwrap().push(stage)).unwrap();
    assert_eq!(
        *stages.lock().unwrap(),
        [EstimateStage::Material, EstimateStage::Transfer, EstimateStage::Light, EstimateStage::Colours]
    );

    let material = &found.material;
    for table in material.ends.tables.iter().chain([&material.table]) {
        assert!((table.normal_albedo() - ALBEDO).abs() < 1e-6);
    }
    let ordered = |c: usize| material.quantiles.windows(2).all(|pair| pair[0][c] < pair[1][c]);
    assert!(material.quantiles.len() == QUANTILE_LEVELS.len() && trusted_cells().all(ordered));
    assert!(material.peak_height.windows(2).all(|pair| pair[0] < pair[1]), "{:?}", material.peak_height);
    assert!((0.0..=1.0).contains(&material.undetermined_share) && material.filled_cells < material.disk_cells);

    // BRDF and light in colour have the luminance of table and light.
    let brdf = BivariateTable::luminance(&found.brdf());
    assert!(brdf.as_slice().iter().zip(material.table.as_slice()).all(|(a, b)| (a / b - 1.0).abs() < 1e-3));
    let coloured = found.light_in_colour();
    let luminances = coloured.texels().iter().zip(found.light.grid.texels());
    assert!(luminances.into_iter().all(|(a, b)| (luminance(*a) - luminance(*b)).abs() < 1e-3 * (1.0 + luminance(*b))));

    // Table and light together reproduce the photograph.
    let all = predict(
        observations.points_with_visibility(),
        &material.table,
        &found.light.grid,
        QuadratureSettings::default(),
    );
    let (mut off, mut sum) = (0.0, 0.0);
    for (prediction, value) in all.iter().zip(&observations.values) {
        if let Some(value) = value {
            off += (prediction.shadowed - value).powi(2);
            sum += value * value;
        }
    }
    let misfit = (off / sum).sqrt();
    assert!(misfit < 0.15, "{misfit}");
    assert!((misfit - found.light.misfit).abs() < 0.03, "{misfit} {}", found.light.misfit);
    assert!(matches!(found.light.estimator, LightEstimator::NonNegative { .. }));
    assert!(found.light.grid.texels().iter().all(|t| luminance(*t) > -1e-6));
    assert_eq!(found.colouring, Colouring::GreyPhotograph);
}

#[test]
fn separate_steps_match_the_whole_estimate() {
    let (model, observations) = (model(4), observations(&photograph(4, Vec3::ONE)));
    let whole = estimate(&model, &observations, &settings(), &|_| ()).unwrap();
    let material = ColouredMaterial::of(&model, &observations, &settings()).unwrap();
    assert_eq!(material.material.table, whole.material.table);
    let found = material.with_light(&model, &observations, &settings(), &|_| ()).unwrap();
    assert_eq!((&found.light, &found.colouring), (&whole.light, &whole.colouring));
    assert_eq!(found.chromatic_light.is_some(), whole.chromatic_light.is_some());
}

#[test]
fn samples_lie_near_the_truth_and_depend_on_the_seed() {
    let model = model(1);
    let material = MaterialEstimate::of(&model, &observations(&photograph(1, Vec3::ONE)), 16).unwrap();
    let samples = material.samples(&model, 50, 7).unwrap();
    assert_eq!(samples, material.samples(&model, 50, 7).unwrap());
    assert_ne!(samples, material.samples(&model, 50, 8).unwrap());
    let place = &WORLD.coordinates[1];
    for sample in &samples {
        assert!((sample.normal_albedo() - ALBEDO).abs() < 1e-4);
        for (a, b) in WORLD.latent_space.of(sample).iter().zip(place) {
            assert!((a - b).abs() < 0.4, "{a} {b}");
        }
    }
}

#[test]
fn colours_follow_the_colouring_rule() {
    let colour = Vec3::new(1.0, 0.6, 0.3);
    let (mut model, observations) = (model(4), observations(&photograph(4, colour)));
    let table = BivariateTable::from_fn(|_, _| 0.2);
    assert_eq!(Colouring::of(&model, &observations, &table, &ColouringRule::Grey), Colouring::Grey);
    let median = Colouring::of(&model, &observations, &table, &ColouringRule::Median);
    let Colouring::Median(chroma) = &median else { panic!("{median:?}") };
    assert!(chroma.distance(Chroma::of(colour.as_dvec3())) < 0.02);
    assert_eq!(median.light(), Vec3::ONE);
    // The model has no colour model.
    assert_eq!(Colouring::of(&model, &observations, &table, &ColouringRule::default()), median);
    model.learnt.as_mut().unwrap().colours = Some(plain());
    // In a light known to have that colour, the body is less coloured than in an unknown one.
    let body = |light: Option<Chroma>| {
        let found = Colouring::of(&model, &observations, &table, &ColouringRule::Estimate { light });
        let Colouring::Estimate(found) = found else { panic!("{found:?}") };
        assert!((0..2).all(|c| found.body.interval[c][0] < found.body.interval[c][1]));
        found.body.chroma
    };
    let (blind, lit) = (body(None), body(Some(Chroma::of(colour.as_dvec3()))));
    assert!(blind.distance(Chroma::of(colour.as_dvec3())) < 0.05, "{blind:?}");
    assert!(lit.distance(Chroma::default()) < 0.05, "{lit:?}");
}

#[test]
fn channel_quantiles_contain_the_estimate() {
    let (mut model, observations) = (model(4), observations(&photograph(4, Vec3::new(1.0, 0.6, 0.3))));
    model.learnt.as_mut().unwrap().colours = Some(plain());
    let found = estimate(&model, &observations, &settings(), &|_| ()).unwrap();
    let tables = found.colouring.field().tables(&found.material.table);
    let quantiles = found.colouring.quantiles(&found.material);
    for (table, quantiles) in tables.iter().zip(&quantiles) {
        let inside = |c: &usize| (quantiles[0][*c]..=quantiles[3][*c]).contains(&table.as_slice()[*c]);
        let held = trusted_cells().filter(inside).count();
        assert!(held as f64 > 0.99 * trusted_cells().count() as f64, "{held}");
        assert!(trusted_cells().all(|c| quantiles.windows(2).all(|pair| pair[0][c] <= pair[1][c])));
    }
    // Without colours, the quantiles are those of the luminance.
    let grey = Colouring::Grey.quantiles(&found.material);
    assert!(grey.iter().all(|channel| *channel == found.material.quantiles));
    assert_eq!(Colouring::Grey.field(), ChromaField::GREY);
}

/// Recovers each channel of a coloured material under a coloured light; a grey estimate has a
/// larger misfit.
#[test]
fn known_light_recovers_each_channel() {
    let mut model = model(2);
    model.learnt.as_mut().unwrap().colours = Some(plain());
    let luminance = WORLD.table(&WORLD.entries[2]);
    let light = environment_map(100);
    let (red, blue) = (glam::DVec3::new(1.6, 0.9, 0.4), glam::DVec3::new(0.5, 0.9, 1.9));
    let colour = |y: usize, x: usize| {
        let d = crate::sphere::direction_of_lat_long((x as f64 + 0.5) / 96.0, (y as f64 + 0.5) / 48.0);
        red.lerp(blue, 0.5 + 0.5 * d.x).as_vec3()
    };
    let map =
        EnvironmentMap::new(crate::picture::Plane::from_fn(96, 48, |x, y| light.radiance()[(x, y)] * colour(y, x)));
    let map = map.unwrap();
    // A red body under a white highlight.
    let body = BivariateTable::from_fn(|_, _| 0.1);
    let channels = [0.6, 0.05, 0.02].map(|albedo: f64| {
        let cells = luminance.as_slice().iter().zip(body.as_slice());
        BivariateTable::from_vec(
            cells
                .map(|(all, body)| (f64::from(*all) - f64::from(*body)).max(0.0) as f32 + (albedo as f32) * body * 4.0)
                .collect(),
        )
    });
    let points = crate::testing::ball(800);
    let settings = IntegratorSettings { tolerance: 0.3, max_cells: 8_000 };
    let operators = crate::render::Relighter::of_channels(&points, &channels, &LightTree::of_map(&map), &settings);
    let image: Vec<Vec<f64>> =
        operators.iter().zip(&channels).map(|(operator, table)| operator.render(table)).collect();
    let pixels: Vec<Vec3> =
        (0..points.len()).map(|i| Vec3::from_array([0, 1, 2].map(|c| image[c][i] as f32))).collect();
    let observations = Observations::of_points(points, &pixels);
    let given = (&map, Alignment::Fixed);
    let found = estimate_known_light(&model, &observations, given, &ColouringRule::default(), &|_| ()).unwrap();
    let tables = found.colouring.field().tables(&found.material.table);
    // The common scale is free.
    let sums = [&tables, &channels].map(|rgb| BivariateTable::luminance(rgb).normal_albedo());
    for (c, (got, want)) in tables.iter().zip(&channels).enumerate() {
        let rendered = |table: &BivariateTable, scale: f64| -> Vec<f64> {
            operators[c].render(table).into_iter().map(|value| value / scale).collect()
        };
        let (got, want) = (rendered(got, sums[0]), rendered(want, sums[1]));
        let square = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
        let off = square(&mut got.iter().zip(&want).map(|(a, b)| a - b)) / square(&mut want.iter().copied());
        assert!(off.sqrt() < 0.06, "channel {c}: {}", off.sqrt());
    }
    let truth = ChromaField::of_tables(&channels).body(&BivariateTable::luminance(&channels));
    let body = found.colouring.field().body(&found.material.table);
    assert!(body.distance(truth) < 0.25, "{body:?} {truth:?}");
    // A grey estimate has a larger misfit under the same light.
    let grey = estimate_known_light(&model, &observations, given, &ColouringRule::Grey, &|_| ()).unwrap();
    assert!(found.misfit < 0.5 * grey.misfit, "{} {}", found.misfit, grey.misfit);
}

#[test]
fn rejects_unsupported_grids_and_models_without_a_posterior() {
    let (whole, observations) = (model(0), observations(&photograph(0, Vec3::ONE)));
    for side in [0, 3, 2, 64] {
        let wrong = EstimateSettings { side, ..settings() };
        let error = estimate(&whole, &observations, &wrong, &|_| ()).unwrap_err();
        assert!(matches!(error, EstimateError::Grid { max: 32, .. }), "{error}");
    }
    let bare = Model { learnt: None, ..whole };
    assert!(matches!(estimate(&bare, &observations, &settings(), &|_| ()), Err(EstimateError::NotLearnt)));
}

#[test]
fn known_light_recovers_material_and_scale() {
    let (model, observations) = (model(2), observations(&photograph(2, Vec3::ONE)));
    let under = |light: &EnvironmentMap| {
        let given = (light, Alignment::default());
        estimate_known_light(&model, &observations, given, &ColouringRule::default(), &|_| ()).unwrap()
    };
    let found = under(&environment_map(100));
    let truth = WORLD.table(&WORLD.entries[2]);
    assert!(found.diagnostics().is_empty() && found.converged && found.misfit < 0.05, "{}", found.misfit);
    let albedo = found.exposure * ALBEDO / truth.normal_albedo();
    assert!((albedo - 1.0).abs() < 0.05, "{albedo}");
    let ordered = |c: usize| found.material.quantiles.windows(2).all(|pair| pair[0][c] < pair[1][c]);
    assert!(trusted_cells().all(ordered));
    let samples = found.material.samples(&model, 5, 0).unwrap();
    assert!(samples.iter().all(|sample| (sample.normal_albedo() - ALBEDO).abs() < 1e-4));

    // The light of another place leaves a large misfit, which is reported.
    let other = under(&environment_map(101));
    let reported = other
        .diagnostics()
        .into_iter()
        .find(|d| matches!(d, Diagnostic::Misfit { cause: MisfitCause::KnownLight, .. }));
    assert!(reported.is_some(), "{} {}", other.misfit, other.expected_misfit());
}

/// Likelihood of a photograph of a material under its known light.
fn seen(model: &Model, material: usize, light: u64) -> Likelihood {
    let table = WORLD.table(&WORLD.entries[material]);
    let settings = SphereSettings {
        size: 64,
        accuracy: Accuracy::Bound(IntegratorSettings { tolerance: 0.5, max_cells: 3000 }),
        ..SphereSettings::default()
    };
    let map = environment_map(light);
    let picture = render_sphere(&table, &LightTree::of_map(&map), &settings, &|_| ());
    let given = (&map, Alignment::Fixed);
    let found = estimate_known_light(model, &observations(&picture), given, &ColouringRule::Grey, &|_| ()).unwrap();
    found.material.posterior.likelihood
}

#[test]
fn combining_photographs_narrows_the_intervals() {
    let model = model(2);
    let all = [100, 101, 102].map(|light| seen(&model, 2, light));
    let learnt = model.learnt.as_ref().unwrap();
    let width = |likelihood: &Likelihood| {
        let posterior = MaterialPosterior::of(learnt, likelihood.clone()).unwrap();
        let widths = interval_widths(&posterior.draws);
        trusted_cells().map(|c| f64::from(widths[c])).sum::<f64>() / trusted_cells().count() as f64
    };
    let combined = combine(&model, &all).unwrap();
    let together = width(&combined.material.posterior.likelihood);
    assert!(all.iter().all(|one| together < width(one)), "{together} {:?}", all.each_ref().map(width));
    assert!(combined.agreement.iter().all(|ratio| *ratio > 0.0), "{:?}", combined.agreement);
    let truth = WORLD.table(&WORLD.entries[2]).with_normal_albedo(ALBEDO).0;
    let found = &combined.material.table;
    let off = |c: usize| (found.as_slice()[c] / truth.as_slice()[c]).ln().abs();
    let mean = trusted_cells().map(|c| f64::from(off(c))).sum::<f64>() / trusted_cells().count() as f64;
    assert!(mean < 0.1, "{mean}");
}

#[test]
fn rejects_photographs_of_different_materials() {
    let model = model(2);
    let all = [seen(&model, 2, 100), seen(&model, 0, 101), seen(&model, 2, 102)];
    let error = combine(&model, &all).unwrap_err();
    let EstimateError::Product(ProductError::Contradiction { at: 1, ratio }) = error else { panic!("{error}") };
    assert!(ratio < MIN_SAME_MATERIAL_LOG_ODDS, "{ratio}");
}

#[test]
fn rejects_likelihoods_without_a_product() {
    let model = model(2);
    let (lit, blind) = (seen(&model, 2, 100), Likelihood::Embedding(Embedding::of(vec![0.0; 7])));
    let refused = |all: &[Likelihood]| match combine(&model, all).unwrap_err() {
        EstimateError::Product(error) => error,
        other => panic!("{other}"),
    };
    assert_eq!(refused(std::slice::from_ref(&lit)), ProductError::Few);
    assert_eq!(refused(&[lit.clone(), blind.clone()]), ProductError::Mixed);
    assert_eq!(refused(&[blind, Likelihood::Embedding(Embedding::of(vec![0.0; 3]))]), ProductError::Model(1));
}

#[test]
fn diagnostics_contain_their_percentages() {
    let text = [
        Diagnostic::Filled(0.3),
        Diagnostic::OutOfDistribution(0.12),
        Diagnostic::Undetermined(0.6),
        Diagnostic::Scatter(0.23),
    ]
    .map(|d| d.to_string());
    assert!(text[0].contains("70 %") && text[1].contains("12 %") && text[2].contains("60 %"), "{text:?}");
    assert!(text[3].contains("23 %"), "{text:?}");
}

#[test]
fn warns_about_a_ball_of_two_materials() {
    let model = model(4);
    let picture = photograph(4, Vec3::ONE);
    // A checkerboard; every second square is darker by a factor of five.
    let mut painted = picture.clone();
    let (width, height) = painted.rgb.size();
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        if (x / 12 + y / 12) % 2 == 1 {
            painted.rgb[(x, y)] /= 5.0;
        }
    }
    let with = |observations: &Observations, side: usize| {
        let settings = EstimateSettings { side, ..settings() };
        estimate(&model, observations, &settings, &|_| ()).unwrap()
    };
    let found = |observations: &Observations| with(observations, 16);
    let misfit = |found: &Estimate| found.diagnostics().into_iter().find(|d| matches!(d, Diagnostic::Misfit { .. }));
    let (one, two) = (found(&observations(&picture)), found(&observed(&painted, true)));
    // The expected misfit is that of a light of 32 x 32 texels.
    let resolved = with(&observations(&picture), 32);
    assert_eq!(misfit(&resolved), None, "{}", resolved.light.misfit);
    assert!(two.light.misfit > 2.0 * one.light.misfit, "{} {}", two.light.misfit, one.light.misfit);
    // Once its brighter squares are converted, the ball has one material: the misfit is that of the
    // same pixels without paint.
    let converted = observations(&painted);
    assert!(converted.report.pattern_ratio.is_some());
    let statuses = converted.statuses.as_ref().unwrap();
    let mask = statuses.map(|status| f32::from(u8::from(status.is_used())));
    let circle = Circle { x: 48.0, y: 48.0, radius: SphereSettings { size: 96, ..SphereSettings::default() }.radius() };
    let same = Detection::of(&picture, Some(mask), ObjectShape::Sphere(Some(circle)), &observation_settings(true));
    let (converted_misfit, plain) = (found(&converted).light.misfit, found(&same.unwrap().observations).light.misfit);
    assert!((converted_misfit - plain).abs() < 0.03 * plain, "{converted_misfit} {plain}");
    let count = statuses.as_slice().iter().filter(|status| **status == PixelStatus::Converted).count();
    assert!(count > 0 && count == converted.report.converted_pixels, "{count}");
    let reported = misfit(&two).unwrap_or_else(|| panic!("{} {}", two.light.misfit, expected_misfit(&two.material)));
    assert!(matches!(reported, Diagnostic::Misfit { cause: MisfitCause::Geometry, .. }), "{reported}");
    assert!(reported.to_string().contains("several materials"), "{reported}");
}
