//! Distances and agreement of all pairs of results.

use maud::{Markup, html};

use super::{Agreement, Comparison, Entry, MAX_COMPARED, Pair, left_out, plain};

/// Largest number of pairs that are described in sentences.
const SENTENCES: usize = 10;

pub(super) fn section(comparison: &Comparison) -> Markup {
    let Comparison { entries, pairs } = comparison;
    if entries.len() > MAX_COMPARED {
        return left_out("Distances and agreement of pairs are omitted");
    }
    // With many pairs, list only those that differ.
    let few = pairs.len() <= SENTENCES;
    let shown = pairs.iter().filter(|pair| few || pair.agreement == Agreement::Differ);
    let more = shown.clone().count().saturating_sub(SENTENCES);
    html! {
        @if !few { p { (counts(pairs)) } }
        ul { @for pair in shown.take(SENTENCES) { li { (pair.sentence) } } }
        @if more > 0 { p { "The table lists " (more) " more pairs that differ." } }
        p.note {
            "Two results " strong { "agree" } " if each estimate lies in the 90 % interval of the other, in \
                roughness and in peak height. They "
            strong { "overlap" } " if only their intervals overlap, and " strong { "differ" } " if their intervals do \
                not overlap. Agreement does not prove that the material is the same: a very uncertain result agrees \
                with most others."
        }
        (table(entries, pairs))
        p.note {
            "Distance: root mean square difference between the natural logarithms of both BRDFs, for both angles \
             below 80° and after the best scaling. 0.1 is a difference of about 10 %."
        }
    }
}

/// Counts the pairs by their agreement, in words.
pub(super) fn counts(pairs: &[Pair]) -> String {
    let count = |agreement: Agreement| {
        let count = pairs.iter().filter(|pair| pair.agreement == agreement).count();
        let (one, several) = match agreement {
            Agreement::Agree => ("agrees", "agree"),
            Agreement::Overlap => ("has overlapping intervals", "have overlapping intervals"),
            Agreement::Differ => ("differs", "differ"),
            Agreement::Unknown => ("has no intervals", "have no intervals"),
        };
        (count > 0).then(|| format!("{count} {}", if count == 1 { one } else { several }))
    };
    let all: Vec<String> = Agreement::ALL.into_iter().filter_map(count).collect();
    format!("Of {} pairs, {}.", pairs.len(), all.join(", "))
}

fn table(entries: &[Entry], pairs: &[Pair]) -> Markup {
    let farthest = pairs.iter().filter_map(|pair| pair.distance).fold(0.0, f64::max).max(1e-9);
    let pair = |a: usize, b: usize| pairs.iter().find(|pair| pair.of == [a.min(b), a.max(b)]);
    html! {
        div.scroll role="region" aria-label="Distances of the BRDFs" tabindex="0" {
            table.distances {
                caption { "Distance and agreement of each pair of results" }
                thead { tr {
                    th scope="col" { "result" }
                    @for at in 1..=entries.len() { th scope="col" { (at) } }
                } }
                tbody { @for (row, entry) in entries.iter().enumerate() { tr {
                    th scope="row" { (row + 1) " " (plain(&entry.name)) }
                    @for column in 0..entries.len() {
                        @match pair(row, column) {
                            Some(pair) => {
                                @let near = pair.distance.map(|distance| format!("--near: {:.0}%", 45.0 * (1.0 - distance / farthest)));
                                td style=[near] title=(pair.sentence) {
                                    (pair.distance.map_or_else(|| "–".to_owned(), |distance| format!("{distance:.2}")))
                                    small class=(pair.agreement.word()) { (pair.agreement.word()) }
                                }
                            }
                            None => { td {} }
                        }
                    }
                } } }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::FolderContents;
    use super::*;

    fn pair(of: [usize; 2], agreement: Agreement, distance: Option<f64>) -> Pair {
        Pair { of, agreement, distance, sentence: format!("sentence {of:?}") }
    }

    fn entries(count: usize) -> Vec<Entry> {
        let entry = |i: usize| Entry { name: format!("n{i}"), report: None, contents: Ok(FolderContents::default()) };
        (0..count).map(entry).collect()
    }

    #[test]
    fn the_table_is_symmetric_and_its_diagonal_empty() {
        let pairs = [
            pair([0, 1], Agreement::Agree, Some(0.1)),
            pair([0, 2], Agreement::Differ, Some(0.4)),
            pair([1, 2], Agreement::Unknown, None),
        ];
        let html = table(&entries(3), &pairs).into_string();
        assert_eq!((html.matches(">0.10<").count(), html.matches(">0.40<").count()), (2, 2));
        assert_eq!((html.matches("<td></td>").count(), html.matches("class=\"unknown\"").count()), (3, 2));
        assert!(html.contains("--near: 34%") && html.contains("--near: 0%"), "{html}");
    }

    #[test]
    fn lists_only_differing_pairs_of_many() {
        let of: Vec<[usize; 2]> = (0..6).flat_map(|b| (0..b).map(move |a| [a, b])).collect();
        let kind = |of: [usize; 2]| if of == [1, 4] { Agreement::Differ } else { Agreement::Agree };
        let pairs: Vec<Pair> = of.iter().map(|of| pair(*of, kind(*of), Some(0.2))).collect();
        let html = section(&Comparison { entries: entries(6), pairs }).into_string();
        assert!(html.contains("Of 15 pairs, 14 agree, 1 differs."), "{html}");
        assert_eq!(html.matches("<li>").count(), 1);
        assert!(html.contains("<li>sentence [1, 4]</li>"));
        let all = of.iter().map(|of| pair(*of, Agreement::Differ, None)).collect();
        let html = section(&Comparison { entries: entries(6), pairs: all }).into_string();
        assert!(html.matches("<li>").count() == SENTENCES && html.contains("lists 5 more pairs that differ"), "{html}");
    }
}
