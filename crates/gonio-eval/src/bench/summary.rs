//! Statistics over the cells.

use std::collections::BTreeMap;

use serde::Serialize;

use super::errors::{Record, Records};
use super::estimators::Estimator;
use super::grid::Protocol;
use crate::metrics::{Class, Interval, mean, median, median_interval, spearman, win_rate};

/// Statistics of one protocol.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Summary {
    pub(crate) protocol: Protocol,
    /// Numbers of materials and of lights of the photographs.
    pub(crate) materials: usize,
    pub(crate) lights: usize,
    /// Whether all photographs were rendered from full tables.
    pub(crate) full_tables: bool,
    pub(crate) rows: Vec<Row>,
    /// `wins[a][b]`: share of the photographs on which estimator `a` has a smaller logarithmic
    /// relight error than `b`, in the order of `rows`. Photographs with the result of only one of
    /// them do not count.
    pub(crate) wins: Vec<Vec<f64>>,
    /// Median logarithmic relight error by class of material, in the order of `rows`.
    pub(crate) classes: Vec<Group>,
    /// Median logarithmic relight error by light of the photograph, in the order of `rows`.
    pub(crate) by_light: Vec<Group>,
}

/// Statistics of one estimator over all photographs.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) estimator: Estimator,
    pub(crate) cells: usize,
    /// Cells without an estimate.
    pub(crate) failures: usize,
    /// Median errors; whole materials are resampled for the intervals.
    pub(crate) relative: Interval,
    pub(crate) log: Interval,
    pub(crate) brdf: Interval,
    /// Median RGB relight error in the estimated colours, or in the median colour of the photograph
    /// if the estimator has no colours.
    pub(crate) rgb: Interval,
    /// Median RGB relight error in the median colour, in grey, and in the true chroma of every
    /// cell.
    pub(crate) rgb_median: Interval,
    pub(crate) rgb_grey: Interval,
    pub(crate) rgb_true_chroma: Interval,
    /// Median distance of the chroma of the mean pixel from the true one.
    pub(crate) mean_chroma: Interval,
    /// Spearman correlation of the gloss of estimate and reference.
    pub(crate) gloss: f64,
    /// Share of cells whose estimate is more than four times as glossy as the reference.
    pub(crate) too_glossy: f64,
    /// Mean shares of the domain whose reference lies in the 50 % and the 90 % interval.
    pub(crate) coverage: Option<[f64; 2]>,
    /// Share of the runs that met their stopping rule.
    pub(crate) converged: Option<f64>,
    /// Median and largest seconds of one core.
    pub(crate) seconds: f64,
    pub(crate) slowest: f64,
}

/// Median errors of a subset of the photographs.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Group {
    pub(crate) name: String,
    pub(crate) photographs: usize,
    pub(crate) log: Vec<Interval>,
}

/// Summarises each protocol that has cells.
pub(crate) fn summaries(records: &Records) -> Vec<Summary> {
    [Protocol::LeaveOut, Protocol::All, Protocol::OutOfDomain].into_iter().filter_map(|p| summary(records, p)).collect()
}

fn summary(records: &Records, protocol: Protocol) -> Option<Summary> {
    let mine: Vec<&Record> = records.values().filter(|r| r.protocol == protocol).collect();
    if mine.is_empty() {
        return None;
    }
    let ids = |f: fn(&Record) -> &str| {
        let mut all: Vec<&str> = mine.iter().map(|r| f(r)).collect();
        all.sort_unstable();
        all.dedup();
        all
    };
    let (materials, lights) = (ids(|r| &r.material), ids(|r| &r.light));
    let mut estimators: Vec<Estimator> = mine.iter().map(|r| r.estimator).collect();
    estimators.sort_unstable();
    estimators.dedup();
    let of = |e: Estimator| mine.iter().copied().filter(move |r| r.estimator == e);
    let rows = estimators.iter().map(|&e| row(e, &of(e).collect::<Vec<_>>(), &materials)).collect();
    let errors: Vec<BTreeMap<(&str, &str), f64>> = estimators
        .iter()
        .map(|&e| of(e).map(|r| ((r.material.as_str(), r.light.as_str()), r.log())).collect())
        .collect();
    let wins = errors
        .iter()
        .map(|a| {
            let against =
                |b: &BTreeMap<(&str, &str), f64>| win_rate(a.iter().filter_map(|(at, x)| b.get(at).map(|y| (*x, *y))));
            errors.iter().map(against).collect()
        })
        .collect();
    let class_of: BTreeMap<&str, Class> =
        mine.iter().filter_map(|r| r.gloss.map(|g| (r.material.as_str(), Class::of(&g[1])))).collect();
    let group = |name: String, keep: &dyn Fn(&Record) -> bool| {
        let cells = |e: Estimator| of(e).filter(|r| keep(r)).collect::<Vec<&Record>>();
        let cells: Vec<Vec<&Record>> = estimators.iter().map(|&e| cells(e)).collect();
        let photographs = cells.iter().map(Vec::len).max().unwrap_or(0);
        Group { name, photographs, log: cells.iter().map(|c| interval(c, &materials, &Record::log)).collect() }
    };
    let classes = Class::ALL
        .iter()
        .map(|class| group(class.title().to_owned(), &|r| class_of.get(r.material.as_str()) == Some(class)))
        .filter(|g| g.photographs > 0)
        .collect();
    let by_light = lights.iter().map(|light| group((*light).to_owned(), &|r| r.light == *light)).collect();
    Some(Summary {
        protocol,
        materials: materials.len(),
        lights: lights.len(),
        full_tables: mine.iter().all(|r| r.full_table),
        rows,
        wins,
        classes,
        by_light,
    })
}

/// Median of a measure over cells, with an interval from resampling whole materials; `materials`
/// are sorted.
fn interval(cells: &[&Record], materials: &[&str], f: &dyn Fn(&Record) -> f64) -> Interval {
    let place = |r: &&Record| materials.binary_search(&r.material.as_str()).expect("a listed material");
    let values: Vec<f64> = cells.iter().map(|r| f(r)).collect();
    median_interval(&values, &cells.iter().map(place).collect::<Vec<usize>>(), 1)
}

fn row(estimator: Estimator, cells: &[&Record], materials: &[&str]) -> Row {
    let interval = |f: &dyn Fn(&Record) -> f64| interval(cells, materials, f);
    let gloss: Vec<[f64; 2]> = cells.iter().filter_map(|r| r.gloss).map(|g| g.map(|g| g.peak)).collect();
    let (estimates, references): (Vec<f64>, Vec<f64>) = gloss.iter().map(|[e, r]| (*e, *r)).unzip();
    let too_glossy = gloss.iter().filter(|[e, r]| e - r > 4.0_f64.ln()).count() as f64 / cells.len() as f64;
    let covered: Vec<[f64; 2]> = cells.iter().filter_map(|r| r.coverage).collect();
    let coverage =
        (!covered.is_empty()).then(|| [0, 1].map(|i| mean(&covered.iter().map(|c| c[i]).collect::<Vec<_>>())));
    let ended: Vec<f64> = cells.iter().filter_map(|r| r.report.converged).map(|c| f64::from(u8::from(c))).collect();
    let seconds: Vec<f64> = cells.iter().map(|r| r.seconds).collect();
    Row {
        estimator,
        cells: cells.len(),
        failures: cells.iter().filter(|r| r.failure.is_some()).count(),
        relative: interval(&Record::relative),
        log: interval(&Record::log),
        rgb: interval(&|r| r.rgb(|errors| errors.estimate)),
        rgb_median: interval(&|r| r.rgb(|errors| errors.median)),
        rgb_grey: interval(&|r| r.rgb(|errors| errors.grey)),
        rgb_true_chroma: interval(&|r| r.rgb(|errors| errors.true_chroma)),
        mean_chroma: interval(&|r| r.mean_chroma().unwrap_or(f64::INFINITY)),
        // Without an estimate the error counts as infinite.
        brdf: interval(&|r| r.brdf.unwrap_or(f64::INFINITY)),
        gloss: spearman(&estimates, &references),
        too_glossy,
        coverage,
        converged: (!ended.is_empty()).then(|| mean(&ended)),
        slowest: seconds.iter().copied().fold(0.0, f64::max),
        seconds: median(seconds),
    }
}
