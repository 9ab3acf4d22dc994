//! Agreement of two results, and distance of their BRDFs.

use gonio::reflectance::{BivariateTable, log_distance};
use gonio_io::result::{Quantiles, ResultDocument};
use rayon::prelude::*;

use super::{Entry, plain};
use crate::report::short;

/// 5, 50 and 95 % quantiles of roughness and peak; `None` if a result does not contain them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Highlight {
    /// Roughness of the principled models.
    pub(super) roughness: Option<[f64; 3]>,
    /// Peak height.
    pub(super) peak: Option<[f64; 3]>,
}

impl Highlight {
    /// Returns the quantiles of a result; invalid quantiles are ignored.
    pub(super) fn of(result: &ResultDocument) -> Self {
        let sound = |[low, median, high]: &[f64; 3]| 0.0 < *low && low <= median && median <= high;
        let read = |quantiles: Quantiles| Some(<[f64; 3]>::from(quantiles)).filter(sound);
        let Some(posterior) = &result.posterior else { return Self::default() };
        let highlight = &posterior.highlight;
        Self { roughness: highlight.roughness.and_then(read), peak: read(highlight.peak_height.quantiles) }
    }
}

/// Agreement of the intervals of two results, from the best to the worst.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Agreement {
    /// The estimate of each lies in the interval of the other.
    Agree,
    /// The intervals overlap, but an estimate lies outside of the other's interval.
    Overlap,
    /// Intervals do not overlap.
    Differ,
    /// One of the results has no intervals.
    Unknown,
}

impl Agreement {
    /// All values, from the best to the worst.
    pub(super) const ALL: [Self; 4] = [Self::Agree, Self::Overlap, Self::Differ, Self::Unknown];

    /// Returns the name of the agreement.
    pub fn word(self) -> &'static str {
        match self {
            Self::Agree => "agree",
            Self::Overlap => "overlap",
            Self::Differ => "differ",
            Self::Unknown => "unknown",
        }
    }

    /// Compares the quantiles of one number in two results.
    fn of(a: [f64; 3], b: [f64; 3]) -> Self {
        let within = |x: f64, [low, _, high]: [f64; 3]| (low..=high).contains(&x);
        if a[0] > b[2] || b[0] > a[2] {
            Self::Differ
        } else if within(a[1], b) && within(b[1], a) {
            Self::Agree
        } else {
            Self::Overlap
        }
    }
}

/// Comparison of two results.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// Indices of the results.
    pub(super) of: [usize; 2],
    /// Agreement of their intervals.
    pub agreement: Agreement,
    /// [`log_distance`] of their BRDFs, if both exist and are not zero.
    pub distance: Option<f64>,
    /// Description of the agreement in a sentence.
    pub sentence: String,
}

/// Compares all pairs of results, except those of missing results.
pub(super) fn pairs(entries: &[Entry]) -> Vec<Pair> {
    let of: Vec<[usize; 2]> = (0..entries.len()).flat_map(|b| (0..b).map(move |a| [a, b])).collect();
    of.into_par_iter()
        .filter_map(|of| {
            let [a, b] = of.map(|at| &entries[at]);
            let (one, other) = (a.contents.as_ref().ok()?, b.contents.as_ref().ok()?);
            let distance = one.table.as_ref().zip(other.table.as_ref()).and_then(|(a, b)| distance(a, b));
            let (agreement, sentence) = agreement(
                (&plain(&a.name), Highlight::of(&one.result)),
                (&plain(&b.name), Highlight::of(&other.result)),
            );
            Some(Pair { of, agreement, distance, sentence })
        })
        .collect()
}

fn distance(a: &BivariateTable, b: &BivariateTable) -> Option<f64> {
    Some(log_distance(a, b)).filter(|distance| distance.is_finite())
}

/// Compares two named results. Returns the worst agreement of the numbers that both contain.
fn agreement((a, of_a): (&str, Highlight), (b, of_b): (&str, Highlight)) -> (Agreement, String) {
    let known = [("roughness", of_a.roughness, of_b.roughness), ("peak height", of_a.peak, of_b.peak)]
        .into_iter()
        .filter_map(|(name, a, b)| Some((name, a?, b?)));
    let measures: Vec<_> = known.map(|(name, a, b)| (Agreement::of(a, b), name, a, b)).collect();
    let Some(worst) = measures.iter().map(|measure| measure.0).max() else {
        let silent = if of_a == Highlight::default() { a } else { b };
        let sentence = format!("Agreement of {a} and {b} is unknown: {silent} has no intervals.");
        return (Agreement::Unknown, sentence);
    };
    let interval = |[low, median, high]: [f64; 3]| format!("{} ({} to {})", short(median), short(low), short(high));
    let of_worst = measures.iter().filter(|measure| measure.0 == worst);
    let numbers: Vec<String> =
        of_worst.map(|(_, name, a, b)| format!("{name} {} and {}", interval(*a), interval(*b))).collect();
    let numbers = numbers.join(", ");
    let sentence = match worst {
        Agreement::Agree | Agreement::Unknown => format!("{a} and {b} agree within their intervals: {numbers}."),
        Agreement::Overlap => format!(
            "{a} and {b} are possibly the same material: their intervals overlap, but at least one does not contain \
             the other estimate: {numbers}."
        ),
        Agreement::Differ => format!("{a} and {b} differ, because their intervals do not overlap: {numbers}."),
    };
    (worst, sentence)
}

#[cfg(test)]
mod tests {
    use gonio_io::result::{PeakHeight, Posterior};

    use super::super::FolderContents;
    use super::*;

    fn highlight(peak: [f64; 3], roughness: [f64; 3]) -> Highlight {
        Highlight { peak: Some(peak), roughness: Some(roughness) }
    }

    fn said(a: Highlight, b: Highlight) -> (Agreement, String) {
        let (agreement, sentence) = agreement(("one", a), ("two", b));
        assert_eq!(agreement, super::agreement(("two", b), ("one", a)).0, "the order does not matter");
        (agreement, sentence)
    }

    #[test]
    fn estimates_in_each_others_intervals_agree() {
        let (a, b) =
            (highlight([4.0, 30.0, 300.0], [0.1, 0.17, 0.28]), highlight([20.0, 50.0, 90.0], [0.12, 0.15, 0.2]));
        let (agreement, sentence) = said(a, b);
        assert_eq!(agreement, Agreement::Agree);
        assert_eq!(
            sentence,
            "one and two agree within their intervals: roughness 0.17 (0.10 to 0.28) and 0.15 (0.12 to 0.20), \
             peak height 30 (4.0 to 300) and 50 (20 to 90)."
        );
    }

    #[test]
    fn overlapping_intervals_without_the_estimates_overlap() {
        let (a, b) = (highlight([4.0, 10.0, 30.0], [0.1, 0.2, 0.3]), highlight([20.0, 50.0, 90.0], [0.1, 0.2, 0.3]));
        let (agreement, sentence) = said(a, b);
        assert_eq!(agreement, Agreement::Overlap);
        assert_eq!(
            sentence,
            "one and two are possibly the same material: their intervals overlap, but at least one does not contain \
             the other estimate: peak height 10 (4.0 to 30) and 50 (20 to 90)."
        );
    }

    #[test]
    fn one_disjoint_interval_is_a_difference() {
        let (a, b) = (highlight([4.0, 10.0, 30.0], [0.1, 0.2, 0.3]), highlight([4.0, 10.0, 30.0], [0.5, 0.6, 0.7]));
        let (agreement, sentence) = said(a, b);
        assert_eq!(agreement, Agreement::Differ);
        assert_eq!(
            sentence,
            "one and two differ, because their intervals do not overlap: roughness 0.20 (0.10 to 0.30) and 0.60 (0.50 to 0.70)."
        );
        // Intervals with a common end overlap.
        let touching = highlight([30.0, 40.0, 50.0], [0.3, 0.4, 0.5]);
        assert_eq!(said(a, touching).0, Agreement::Overlap);
    }

    #[test]
    fn names_the_result_without_intervals() {
        let a = highlight([4.0, 10.0, 30.0], [0.1, 0.2, 0.3]);
        let (agreement, sentence) = said(a, Highlight::default());
        assert_eq!(agreement, Agreement::Unknown);
        assert_eq!(sentence, "Agreement of one and two is unknown: two has no intervals.");
        // An older result without roughness is compared by its peak.
        assert_eq!(said(a, Highlight { roughness: None, ..a }).0, Agreement::Agree);
    }

    #[test]
    fn ignores_invalid_quantiles() {
        let of = |low: f64| {
            let peak_height = PeakHeight { quantiles: [low, 2.0, 3.0].into(), factor: 3.0 };
            let roughness = Some([0.1, 0.2, 0.3].into());
            let highlight = gonio_io::result::Highlight { peak_height, roughness, ..Default::default() };
            let posterior = Some(Posterior { highlight, ..Posterior::default() });
            Highlight::of(&ResultDocument { posterior, ..ResultDocument::default() })
        };
        assert_eq!(of(1.0), highlight([1.0, 2.0, 3.0], [0.1, 0.2, 0.3]));
        for wrong in [2.5, -1.0, 0.0, f64::NAN] {
            assert_eq!(of(wrong).peak, None);
        }
        assert_eq!(Highlight::of(&ResultDocument::default()), Highlight::default());
    }

    #[test]
    fn pairs_have_the_distance_of_their_tables() {
        let table = |width: f64| BivariateTable::from_fn(|h, _| 0.1 + 5.0 * (-(h / width).powi(2)).exp());
        let entry = |name: &str, table: Option<BivariateTable>| Entry {
            name: name.into(),
            report: None,
            contents: Ok(FolderContents { table, ..FolderContents::default() }),
        };
        let failed = Entry { name: "failed".into(), report: None, contents: Err("no photograph".into()) };
        let entries = [
            entry("a", Some(table(0.1))),
            entry("b", Some(table(0.3))),
            failed,
            entry("none", None),
            entry("black", Some(BivariateTable::from_fn(|_, _| 0.0))),
        ];
        let pairs = pairs(&entries);
        let distance = |a: usize, b: usize| pairs.iter().find(|pair| pair.of == [a, b]).map(|pair| pair.distance);
        assert_eq!(distance(0, 1), Some(Some(log_distance(&table(0.1), &table(0.3)))));
        // A missing result, a missing table, and a zero table.
        assert_eq!([distance(0, 2), distance(0, 3), distance(0, 4)], [None, Some(None), Some(None)]);
        assert_eq!(pairs.len(), 6);
    }
}
