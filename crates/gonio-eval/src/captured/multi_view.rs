//! Errors of estimates from several photographs of a captured object.

use std::fmt::Write as _;

use anyhow::{Context, Result};
use gonio::estimate::MaterialEstimate;
use gonio::model::Model;
use gonio::reflectance::BivariateTable;

use super::errors;
use super::slice::Cell;
use crate::metrics::{mean, median};
use crate::multi_view::joined;

/// Errors of the estimate from one or more photographs.
struct CombinedErrors {
    slice: f64,
    /// Mean width of the 90 % interval of the logarithm over the judged cells.
    width: f64,
    coverage: [f64; 2],
}

/// Errors of the estimates from one, two, three and more photographs of an object.
pub(super) struct MultiViewErrors {
    object: String,
    /// Errors by number of photographs, from one on.
    joint: Vec<Vec<CombinedErrors>>,
    /// Number of refused combinations.
    refused: usize,
}

impl MultiViewErrors {
    /// Measures the errors of each cyclic run of consecutive photographs in the list.
    ///
    /// # Errors
    /// If an estimate has no quantiles.
    pub(super) fn of(object: &str, cells: &[Cell], model: &Model, ones: &[&MaterialEstimate]) -> Result<Self> {
        let (mut joint, mut refused) = (Vec::new(), 0);
        for count in 1..=ones.len() {
            let mut of_count = Vec::new();
            for found in joined(model, ones, count) {
                match found {
                    Some(found) => of_count.push(CombinedErrors::of(&found, cells)?),
                    None => refused += 1,
                }
            }
            joint.push(of_count);
        }
        Ok(Self { object: object.to_owned(), joint, refused })
    }
}

impl CombinedErrors {
    fn of(material: &MaterialEstimate, cells: &[Cell]) -> Result<Self> {
        let quantiles = quantiles(material)?;
        let width = |c: &Cell| {
            let [low, .., high] = &quantiles;
            (high.eval(c.theta_h, c.theta_d) / low.eval(c.theta_h, c.theta_d).max(1e-12)).ln()
        };
        Ok(Self {
            slice: errors::slice_error(cells, &|h, d| material.table.eval(h, d)),
            width: mean(&cells.iter().map(width).collect::<Vec<f64>>()),
            coverage: errors::coverage(cells, &material.table, &quantiles),
        })
    }
}

/// Tables of the quantiles of a material.
///
/// # Errors
/// If the material does not have four quantiles.
pub(super) fn quantiles(material: &MaterialEstimate) -> Result<[BivariateTable; 4]> {
    let tables: Vec<BivariateTable> =
        material.quantiles.iter().map(|values| BivariateTable::from_vec(values.clone())).collect();
    tables.try_into().ok().context("the estimate lacks the four quantiles for the coverage")
}

/// Table of the medians over the combinations.
pub(super) fn markdown(all: &[MultiViewErrors]) -> String {
    let mut text = "\
| object | photographs together | slice | width of the 90 % interval | 50 % / 90 % covered |
|---|---|---|---|---|
"
    .to_owned();
    for MultiViewErrors { object, joint, refused } in all {
        for (at, errors) in joint.iter().enumerate().filter(|(_, errors)| !errors.is_empty()) {
            let typical = |f: &dyn Fn(&CombinedErrors) -> f64| median(errors.iter().map(f).collect());
            let _ = writeln!(
                text,
                "| {object} | {} | {:.2} | {:.2} | {:.0} % / {:.0} % |",
                at + 1,
                typical(&|j| j.slice),
                typical(&|j| j.width),
                100.0 * typical(&|j| j.coverage[0]),
                100.0 * typical(&|j| j.coverage[1]),
            );
        }
        if *refused > 0 {
            let _ = writeln!(text, "| {object} | {refused} combinations refused | | | |");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use gonio::scene::{Detection, ObjectShape, ObservationSettings};

    use super::super::planted;
    use super::*;

    /// More photographs of one planted ball give a narrower interval.
    #[test]
    fn more_photographs_narrow_the_interval() {
        let model = gonio_io::model::embedded().unwrap();
        let ball = planted::ball(&BivariateTable::from_fn(|h, _| 0.2 + 2.0 * (-(h / 0.15).powi(2)).exp()));
        let picture = &ball.photographs[0].picture;
        let detection =
            Detection::of(picture, None, ObjectShape::Sphere(None), &ObservationSettings::default()).unwrap();
        let one = MaterialEstimate::of(&model, &detection.observations, 16).unwrap();
        let several = MultiViewErrors::of("ball", &ball.slice.judged(), &model, &[&one, &one, &one]).unwrap();
        assert_eq!(several.refused, 0);
        let widths: Vec<f64> = several.joint.iter().map(|joint| joint[0].width).collect();
        assert!(several.joint[0].len() == 3 && several.joint[2].len() == 1);
        assert!(widths[2] < widths[1] && widths[1] < widths[0], "{widths:?}");
        let text = markdown(&[several]);
        assert_eq!(text.lines().count(), 5, "{text}");
    }
}
