//! Assignment of cells to paints by the conversion of the second paint.
//!
//! With the right assignment, the radiance converted to the first paint changes little where the
//! paint changes between neighbouring cells. The border of a sharp reflection costs the same in
//! both paints. The assignment minimises the sum of the costs of these changes, approximately, by
//! min-sum belief propagation (Pearl 1988) on the graph of neighbours.

use glam::DVec3;

use super::convert::Conversion;
use super::{Cells, Groups};

/// Offsets of one half of the eight neighbours of a cell.
const OFFSETS: [(isize, isize); 4] = [(1, 0), (0, 1), (1, 1), (1, -1)];
/// Scale of the changes of a tone between neighbours: a natural logarithm.
const CHANGE: f64 = 0.05;
/// Cost of a border of the paints between two cells.
const BORDER_COST: f64 = 0.5;
/// Cost of a cell that leaves its group.
const MOVE_COST: f64 = 0.05;
/// Largest number of rounds of messages.
const MAX_ROUNDS: usize = 400;
/// Number of rounds without a moved cell after which they end.
const UNCHANGED_ROUNDS: usize = 40;
/// Share of the earlier message in the next one.
const DAMPING: f64 = 0.5;

/// A message between neighbouring cells.
struct Edge {
    from: usize,
    to: usize,
    /// Index of the message in the opposite direction.
    back: usize,
    /// Cost for the groups of both cells: first the one that sends the message.
    costs: [[f64; 2]; 2],
    /// Cost of the second group of the receiver less that of the first.
    message: f64,
}

/// Moves cells to the group whose conversion agrees better with their neighbours.
pub(super) fn reassign(groups: &mut Groups, cells: &Cells, conversion: &Conversion) {
    let converted = |i: usize| {
        let radiance = cells.radiance(groups.tones[i]).as_vec3();
        cells.tone(conversion.convert(radiance, groups.normals[i]))
    };
    let tones: Vec<[DVec3; 2]> = (0..groups.tones.len()).map(|i| [groups.tones[i], converted(i)]).collect();
    let errors = conversion.errors(groups, cells);
    let own: Vec<f64> = groups.other.iter().map(|other| if *other { -MOVE_COST } else { MOVE_COST }).collect();
    let edges = groups.places.iter().enumerate().flat_map(|(from, at)| {
        let (groups, tones, errors) = (&*groups, &tones, &errors);
        OFFSETS.into_iter().filter_map(move |offset| {
            let to = groups.at(*at, offset)?;
            Some((from, to, pair_costs(tones[from], tones[to], errors[from].max(errors[to]))))
        })
    });
    groups.other = second_group(edges, &own);
}

/// Returns the costs of the groups of two neighbours with these tones in both groups. `error` is
/// the relative error of the conversion, which lets the tones of different groups differ.
fn pair_costs(from: [DVec3; 2], to: [DVec3; 2], error: f64) -> [[f64; 2]; 2] {
    let jump = |from: DVec3, to: DVec3, scale: f64| {
        let change = (from - to) / scale;
        (change * change).to_array().map(f64::ln_1p).iter().sum::<f64>() / 3.0
    };
    let same = jump(from[0], to[0], CHANGE);
    let scale = CHANGE.hypot(error);
    let border = |from: DVec3, to: DVec3| BORDER_COST + (scale / CHANGE).ln() + jump(from, to, scale);
    [[same, border(from[0], to[1])], [border(from[1], to[0]), same]]
}

/// Returns the cells in the second group at a minimum of the sum of all costs. A pair of cells has
/// a cost for each of its groups. A cell in the second group has its own cost, relative to the
/// first. The minimum is exact if the pairs form no loops.
fn second_group(pairs: impl Iterator<Item = (usize, usize, [[f64; 2]; 2])>, own: &[f64]) -> Vec<bool> {
    let mut edges: Vec<Edge> = Vec::new();
    for (from, to, costs) in pairs {
        let next = edges.len();
        let [[a, b], [c, d]] = costs;
        edges.push(Edge { from, to, back: next + 1, costs, message: 0.0 });
        edges.push(Edge { from: to, to: from, back: next, costs: [[a, c], [b, d]], message: 0.0 });
    }
    let mut beliefs = own.to_vec();
    let assigned = |beliefs: &[f64]| -> Vec<bool> { beliefs.iter().map(|belief| *belief < 0.0).collect() };
    let (mut other, mut unchanged) = (assigned(&beliefs), 0);
    for _ in 0..MAX_ROUNDS {
        let messages: Vec<f64> = edges
            .iter()
            .map(|edge| {
                let belief = beliefs[edge.from] - edges[edge.back].message;
                let least = |to: usize| edge.costs[0][to].min(edge.costs[1][to] + belief);
                DAMPING * edge.message + (1.0 - DAMPING) * (least(1) - least(0))
            })
            .collect();
        beliefs.copy_from_slice(own);
        for (edge, message) in edges.iter_mut().zip(messages) {
            edge.message = message;
            beliefs[edge.to] += message;
        }
        let next = assigned(&beliefs);
        unchanged = if next == other { unchanged + 1 } else { 0 };
        other = next;
        if unchanged == UNCHANGED_ROUNDS {
            break;
        }
    }
    other
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::simulation::generator;

    #[test]
    fn assignments_of_a_tree_have_the_least_cost() {
        let mut random = generator(1);
        for _ in 0..50 {
            let mut cost = || random.random_range(-1.0..1.0);
            let own: [f64; 10] = std::array::from_fn(|_| cost());
            // Each cell is a neighbour of an earlier one.
            let pairs: Vec<_> =
                (1..own.len()).map(|i| ((i - 1) / 2, i, [[cost(), cost()], [cost(), cost()]])).collect();
            let total = |other: &[bool]| -> f64 {
                let of_pairs = pairs.iter().map(|(i, j, costs)| costs[usize::from(other[*i])][usize::from(other[*j])]);
                let of_cells = own.iter().zip(other).filter(|(_, other)| **other).map(|(cost, _)| cost);
                of_pairs.sum::<f64>() + of_cells.sum::<f64>()
            };
            let least = (0..1 << own.len())
                .map(|bits| total(&std::array::from_fn::<bool, 10, _>(|i| bits >> i & 1 == 1)))
                .fold(f64::INFINITY, f64::min);
            let found = total(&second_group(pairs.iter().copied(), &own));
            assert!((found - least).abs() < 1e-9, "{found} {least}");
        }
    }
}
