//! Polar lobes: the BRDF in the plane of incidence, for light from one direction.

use gonio::reflectance::BivariateTable;
use maud::{Markup, html};

/// Size of a drawing, in its own units, and the radius of its half circle.
const WIDTH: f64 = 320.0;
const HEIGHT: f64 = 190.0;
const RADIUS: f64 = 140.0;
/// Height of the surface in the drawing.
const FOOT: f64 = 168.0;
/// Degrees between the points of a curve, and the largest angle; the table is unreliable beyond it.
const CURVE_STEP: f64 = 0.25;
const LAST_DEGREE: f64 = 80.0;

/// Draws a lobe for light at `incidence` degrees from the normal. The distance from the centre is
/// the cube root of the BRDF, approximately its perceived brightness; the band reaches from the 5
/// to the 95 % quantile. `top` (1/sr) lies on the half circle.
pub(super) fn lobe(
    table: &BivariateTable,
    band: Option<(&BivariateTable, &BivariateTable)>,
    incidence: f64,
    top: f64,
) -> Markup {
    let words = format!("Polar lobe for light at {incidence:.0} degrees from the normal");
    let place = |angle: f64, value: f64| {
        let r = RADIUS * (value / top).max(0.0).cbrt();
        let (sin, cos) = angle.to_radians().sin_cos();
        format!("{:.1} {:.1}", WIDTH / 2.0 + r * sin, FOOT - r * cos)
    };
    let points = |table: &BivariateTable| -> Vec<String> {
        curve(table, incidence).into_iter().map(|(angle, value)| place(angle, value)).collect()
    };
    let line = format!("M{}", points(table).join("L"));
    let area = band.map(|(low, high)| {
        let (outer, mut inner) = (points(high), points(low));
        inner.reverse();
        format!("M{}L{}Z", outer.join("L"), inner.join("L"))
    });
    let ring = |value: f64| RADIUS * (value / top).cbrt();
    let rings: Vec<f64> =
        (-4..7).map(|e| 10_f64.powi(e)).filter(|v| ring(*v) > 14.0 && ring(*v) <= RADIUS * 1.001).collect();
    // Place the labels from the outermost ring inwards; omit labels without space.
    let mut labels: Vec<(f64, f64)> = Vec::new();
    let mut free = f64::INFINITY;
    for &value in rings.iter().rev() {
        let (at, half) = (WIDTH / 2.0 + ring(value), 3.0 * value.to_string().len() as f64);
        if at + half < free && at - half > WIDTH / 2.0 {
            labels.push((value, at));
            free = at - half - 4.0;
        }
    }
    let (sin, cos) = incidence.to_radians().sin_cos();
    let from = (WIDTH / 2.0 - 1.06 * RADIUS * sin, FOOT - 1.06 * RADIUS * cos);
    html! {
        svg.lobe viewBox={ "0 0 " (WIDTH) " " (HEIGHT) } role="img" aria-label=(words) {
            @for &value in &rings {
                path.ring d={ "M" (WIDTH / 2.0 - ring(value)) " " (FOOT) "A" (ring(value)) " " (ring(value)) " 0 0 1 " (WIDTH / 2.0 + ring(value)) " " (FOOT) } {}
            }
            @for (value, at) in labels {
                text.tick x=(at) y=(FOOT + 14.0) text-anchor="middle" { (value) }
            }
            line.ground x1="0" x2=(WIDTH) y1=(FOOT) y2=(FOOT) {}
            @if let Some(area) = area { path.band d=(area) {} }
            path.mean d=(line) {}
            line.ray x1=(from.0) y1=(from.1) x2=(WIDTH / 2.0) y2=(FOOT) {}
        }
    }
}

/// Samples the BRDF in the plane of incidence at angles from the normal, in degrees; light comes
/// from `-incidence`, so a mirror has its peak at `incidence`.
pub(super) fn curve(table: &BivariateTable, incidence: f64) -> Vec<(f64, f64)> {
    let count = (2.0 * LAST_DEGREE / CURVE_STEP) as usize;
    let angles = (0..=count).map(|i| i as f64 * CURVE_STEP - LAST_DEGREE);
    angles
        .map(|angle| {
            let half = 0.5 * (angle - incidence).abs();
            let difference = 0.5 * (angle + incidence).abs();
            (angle, table.eval(half.to_radians(), difference.to_radians()))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirror_peaks_at_the_angle_of_reflection() {
        let table = BivariateTable::from_fn(|h, _| 0.1 + 100.0 * (-(h / 0.05).powi(2)).exp());
        for incidence in [0.0, 15.0, 45.0, 70.0] {
            let all = curve(&table, incidence);
            let peak = all.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap().0;
            assert!((peak - incidence).abs() < 0.3, "{incidence} {peak}");
        }
    }

    #[test]
    fn drawings_are_finite_and_have_rings() {
        let table = BivariateTable::from_fn(|_, d| 0.2 + d);
        let drawn = lobe(&table, Some((&table, &table)), 45.0, 2.0).into_string();
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"), "{drawn}");
        assert_eq!(drawn.matches("class=\"ring\"").count(), 3);
        let places = drawn.split("class=\"tick\" x=\"").skip(1).map(|rest| rest.split('"').next().unwrap());
        let places: Vec<f64> = places.map(|x| x.parse().unwrap()).collect();
        assert!(places.len() > 1 && places.windows(2).all(|pair| pair[0] - pair[1] > 12.0), "{places:?}");
        assert!(drawn.contains("class=\"band\"") && drawn.contains("role=\"img\""));
    }
}
