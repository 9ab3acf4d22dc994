//! Tests against planted lights, and of the posterior against its closed form.

use super::*;
use crate::colour::{ChromaField, ColourEstimate};
use crate::estimate::LightEstimator;
use crate::lighting::PriorSettings;
use crate::scene::sphere_points;
use crate::testing::{lobe, on_threads, random};

const MAP: OctahedralMap = OctahedralMap::EqualArea;

/// Side of the planted lights.
const FINE: usize = 16;

fn prior() -> LightPrior {
    let light = |seed: u64| {
        let texel = |x: &f64| Vec3::splat((2.0 * x).exp() as f32);
        LightGrid::from_texels(MAP, FINE, random(FINE * FINE, seed).iter().map(texel).collect())
    };
    let lights: Vec<LightGrid> = (0..8).map(light).collect();
    LightPrior::learn(&lights, lights.len(), &PriorSettings { starts: 1, seed: 1 }).unwrap()
}

/// Light of lamps and sky; `tint` maps a direction to the tints of red and blue.
fn planted(tint: impl Fn(DVec3) -> [f64; 2]) -> LightGrid {
    let texel = |t: usize| {
        let d = LightGrid::direction_of(MAP, FINE, t);
        let brightness = if d.y > 0.6 { 6.0 } else { 1.0 + 0.5 * d.x };
        let [red, blue] = tint(d);
        let (y, one) = ([0, 1, 2].map(|c| f64::from(luminance(Vec3::AXES[c]))), brightness);
        let green = 1.0 - (y[0] * red + y[2] * blue) / y[1];
        (one * DVec3::new(1.0 + red, green, 1.0 + blue)).as_vec3()
    };
    LightGrid::from_texels(MAP, FINE, (0..FINE * FINE).map(texel).collect())
}

/// ChromaticLight from blue above to orange below, like that of captured light.
fn natural(d: DVec3) -> [f64; 2] {
    [-0.25 * d.y, 0.5 * d.y]
}

fn channel(light: &LightGrid, c: usize) -> LightGrid {
    LightGrid::from_texels(MAP, FINE, light.texels().iter().map(|t| Vec3::splat(t[c])).collect())
}

/// Photograph of a ball of these colours, channel by channel; `noise` is relative.
fn photograph(table: &BivariateTable, colours: &ChromaField, light: &LightGrid, noise: f64) -> Observations {
    let settings = crate::scene::ObservationSettings { normals: 900, ..Default::default() };
    let points = sphere_points(&settings);
    let transfer = TransferSettings::of_side(FINE);
    let prior = prior();
    let of_channel = |c: usize| -> Vec<f64> {
        let tables = colours.tables(table);
        let any = vec![Some(1.0); points.len()];
        let (rows, _) = observed_rows((&points[..]).into(), &any, &tables[c..=c], &prior, &transfer).unwrap();
        let coefficients = channel(light, c).coefficients();
        let noise = random(points.len(), 7 + c as u64).into_iter().map(|x| 1.0 + 3.0_f64.sqrt() * noise * x);
        let row = |row: &[f32]| row.iter().zip(&coefficients).map(|(a, l)| f64::from(*a) * l).sum::<f64>();
        rows.chunks(FINE * FINE).map(row).zip(noise).map(|(value, noise)| value * noise).collect()
    };
    let channels = [0, 1, 2].map(of_channel);
    let rgb: Vec<Vec3> =
        (0..points.len()).map(|i| Vec3::from_array([0, 1, 2].map(|c| channels[c][i] as f32))).collect();
    Observations::of_points(points, &rgb)
}

/// Wraps the luminance of a light as an estimate.
fn found(light: &LightGrid) -> Light {
    let grey = light.texels().iter().map(|t| Vec3::splat(luminance(*t))).collect();
    Light {
        grid: LightGrid::from_texels(MAP, FINE, grey),
        coefficients: Vec::new(),
        sd: Vec::new(),
        exposure: 1.0,
        estimator: LightEstimator::Clamped,
        observations: 0,
        objective: 0.0,
        effective: 0.0,
        trace: Vec::new(),
        converged: true,
        noise: 0.0,
        relative_noise: 0.0,
        misfit: 0.03,
        coarse_misfit: 0.03,
    }
}

/// Wraps `field` as estimated colours, in a light of white overall colour.
fn colouring(field: &ChromaField) -> Colouring {
    let draws = vec![field.clone(); 200];
    let light = (Chroma::default(), &[][..], false);
    Colouring::Estimate(Box::new(ColourEstimate::of(&table(), field.clone(), draws, light)))
}

fn chromatic_light(observed: &Observations, field: &ChromaField, light: &LightGrid) -> ChromaticLight {
    let (table, light, colouring) = (table(), found(light), colouring(field));
    Rows::of(&prior(), observed, &table, &colouring, FINE).unwrap().unwrap().under(&colouring, &light).unwrap()
}

fn table() -> BivariateTable {
    lobe(0.1, 4.0, 0.12)
}

/// A green body under a white highlight.
fn green() -> ChromaField {
    let (body, rgb) = (lobe(0.1, 0.0, 0.12), Chroma([-0.6, -0.7]).rgb());
    let body = |cell: usize| f64::from(body.as_slice()[cell]);
    let whole = table();
    ChromaField::of_tables(&[0, 1, 2].map(|c| {
        let cells = whole.as_slice().iter().enumerate();
        BivariateTable::from_vec(cells.map(|(k, all)| (rgb[c] * body(k) + f64::from(*all) - body(k)) as f32).collect())
    }))
}

#[test]
fn recovers_the_colours_of_the_light_and_keeps_its_luminance() {
    let light = planted(natural);
    let got = chromatic_light(&photograph(&table(), &green(), &light, 0.0), &green(), &light);
    let (mut off, mut all) = (0.0, 0.0);
    for (t, (got, want)) in got.grid.texels().iter().zip(light.texels()).enumerate() {
        assert!((luminance(*got) / luminance(*want) - 1.0).abs() < 1e-4);
        // Directions behind the ball are not visible in it.
        if LightGrid::direction_of(MAP, FINE, t).z > -0.5 {
            let (got, want) = (Chroma::of(got.as_dvec3()), Chroma::of(want.as_dvec3()));
            off += got.distance(want).powi(2);
            all += want.distance(Chroma::default()).powi(2);
        }
    }
    assert!((off / all).sqrt() < 0.3, "{}", (off / all).sqrt());
    assert!(got.misfit < 0.02, "{}", got.misfit);
    assert!(got.chroma_residual[0] > 0.1 && got.chroma_residual[1] < 0.05, "{:?}", got.chroma_residual);
    assert_eq!(got.diagnostic(), None);
}

#[test]
fn a_wrong_luminance_does_not_tint_the_light() {
    let (true_light, any) = (planted(|_| [0.0, 0.0]), planted(natural));
    let observed = photograph(&table(), &ChromaField::GREY, &true_light, 0.0);
    // Twice as bright everywhere but in the lamps.
    let texels = true_light.texels().iter().map(|t| if t.y > 4.0 { *t } else { 2.0 * *t }).collect();
    let wrong = LightGrid::from_texels(MAP, FINE, texels);
    let furthest = |grid: &LightGrid| {
        grid.texels().iter().map(|t| Chroma::of(t.as_dvec3()).distance(Chroma::default())).fold(0.0, f64::max)
    };
    let got = chromatic_light(&observed, &ChromaField::GREY, &wrong);
    assert!(furthest(&got.grid) < 1e-3 && furthest(&any) > 0.3, "{}", furthest(&got.grid));
}

#[test]
fn warns_about_wrong_colours_but_not_about_noise() {
    let light = planted(natural);
    let observed = photograph(&table(), &green(), &light, 0.0);
    let grey = chromatic_light(&observed, &ChromaField::GREY, &light);
    assert!(
        matches!(grey.diagnostic(), Some(Diagnostic::Colours(residual)) if residual > 0.3),
        "{:?}",
        grey.chroma_residual
    );
    // The coloured light explains the photograph nevertheless.
    assert!(grey.misfit < 0.06, "{}", grey.misfit);
    // Relative noise of 0.2 in each channel is a chroma difference of 0.34 in a single pixel. The
    // mean product over 450 pixels is zero, up to the square of 0.09.
    let noisy = chromatic_light(&photograph(&table(), &green(), &light, 0.2), &green(), &light);
    assert!(noisy.chroma_residual[1] < 0.15 && noisy.diagnostic().is_none(), "{:?}", noisy.chroma_residual);
}

#[test]
fn residual_widens_the_intervals() {
    let light = planted(natural);
    let colouring = colouring(&ChromaField::GREY);
    let light = chromatic_light(&photograph(&table(), &green(), &light, 0.0), &ChromaField::GREY, &light);
    let Colouring::Estimate(found) = colouring.less_certain(&table(), &light) else { panic!("no estimate") };
    let [low, high] = found.body.interval[0];
    assert!(low < -0.3 && high > 0.3, "{low} {high}");
    // The estimate and the interval of the light are unchanged.
    assert!(found.field.is_grey() && found.light.interval[0] == [0.0, 0.0]);
    assert_eq!(Colouring::Grey.less_certain(&table(), &light), Colouring::Grey);
}

#[test]
fn posterior_matches_the_closed_form_in_image_space() {
    // With K the prior covariance and X the image of the tints: K X' (X K X' + 1)^-1 r.
    let light = planted(natural);
    let mut observed = photograph(&table(), &green(), &light, 0.0).thinned(60);
    observed.colours.iter_mut().flatten().for_each(|c| c.x *= 1.05);
    let (light, colouring) = (found(&light), colouring(&green()));
    let rows = Rows::of(&prior(), &observed, &table(), &colouring, FINE).unwrap().unwrap();
    let squares = SquareContributions::of(&rows, &colouring, &light).unwrap();
    let (plain, error) = (squares.plain(), 0.05);
    let got = squares.posterior(&plain, error, MAP);
    let (count, directions) = (FINE * FINE, squares.directions());
    let centre = |k: usize| LightGrid::direction_of(MAP, FINE, k);
    let prior = |i: usize, j: usize| {
        let near = CORRELATED.1 * (-centre(i).angle_between(centre(j)) / CORRELATED.0).exp();
        if i == j { 1.0 } else { near }
    };
    let correlation = Mat::from_fn(count, count, prior);
    let mean = plain.iter().sum::<DVec3>() / plain.len() as f64;
    let size = 3 * plain.len();
    let scale =
        |at: usize| (1.0 + BRIGHTNESS_FLOOR) / (error * (plain[at / 3][at % 3] + BRIGHTNESS_FLOOR * mean[at % 3]));
    let part = |axis: usize| {
        Mat::from_fn(size, count, |at, k| scale(at) * directions[axis][at % 3] * squares.parts[at % 3][(k, at / 3)])
    };
    let (first, second) = (part(0), part(1));
    let image = &first * &correlation * first.transpose() + &second * &correlation * second.transpose();
    let observed: Vec<DVec3> = squares.colours.iter().zip(&plain).map(|(c, p)| at_luminance_of(*c, *p)).collect();
    let right: Vec<f64> = (0..size).map(|at| scale(at) * (observed[at / 3][at % 3] - plain[at / 3][at % 3])).collect();
    let dual = Cholesky::new(image + Mat::<f64>::identity(size, size)).unwrap().solve(&right);
    let dual = Mat::from_fn(size, 1, |i, _| dual[i]);
    let fields = [first, second].map(|x| &correlation * x.transpose() * &dual);
    for (k, got) in got.iter().enumerate() {
        let want = fields[0][(k, 0)] * directions[0] + fields[1][(k, 0)] * directions[1];
        assert!((*got - want).abs().max_element() < 1e-6, "{k}: {got} {want}");
    }
}

#[test]
fn result_is_independent_of_threads_and_none_for_grey() {
    let light = planted(natural);
    let observed = photograph(&table(), &green(), &light, 0.05);
    let run = || chromatic_light(&observed, &green(), &light);
    assert_eq!(on_threads(1, run), on_threads(3, run));
    for colouring in [Colouring::Grey, Colouring::GreyPhotograph] {
        assert!(Rows::of(&prior(), &observed, &table(), &colouring, FINE).unwrap().is_none());
    }
    let mut black = observed;
    black.colours.iter_mut().flatten().for_each(|c| *c = Vec3::ZERO);
    let colouring = colouring(&green());
    let rows = Rows::of(&prior(), &black, &table(), &colouring, FINE).unwrap().unwrap();
    assert!(rows.under(&colouring, &found(&light)).is_none());
}
