//! Assignment of cells to paints by the conversion of the second paint.
//!
//! With the right assignment, the radiance converted to the first paint changes little between
//! neighbouring cells, whether or not the paint changes between them. The border of a sharp
//! reflection is a change in both groups. The assignment minimises the sum of the costs of these
//! changes, approximately, by min-sum belief propagation (Pearl 1988) on the graph of neighbours.

use glam::DVec3;

use super::convert::Conversion;
use super::{Cells, Groups};

/// Offsets of one half of the eight neighbours of a cell.
const OFFSETS: [(isize, isize); 4] = [(1, 0), (0, 1), (1, 1), (1, -1)];
/// Scale of the changes of a tone between neighbours: a natural logarithm.
const CHANGE: f64 = 0.05;
/// Cost of a border of the paints between two cells.
const BORDER_COST: f64 = 0.5;
/// Cost of a cell that leaves its group, and that of one whose conversion is inaccurate.
const MOVE_COST: f64 = 0.5;
const FIXED_COST: f64 = 1e3;
/// Relative error beyond which the conversion of a cell is inaccurate.
const MAX_ERROR: f64 = 0.1;
/// Number of rounds of messages, and the share of the earlier message in the next one. The
/// assignment of checkers no longer changes after 40 rounds.
const ROUNDS: usize = 60;
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
    let own = |(other, error): (&bool, f64)| {
        let cost = if error < MAX_ERROR { MOVE_COST } else { FIXED_COST };
        if *other { -cost } else { cost }
    };
    let own: Vec<f64> = groups.other.iter().zip(conversion.errors(groups, cells)).map(own).collect();
    let edges = groups.places.iter().enumerate().flat_map(|(from, at)| {
        let (groups, tones) = (&*groups, &tones);
        OFFSETS.into_iter().filter_map(move |offset| {
            let to = groups.at(*at, offset)?;
            Some((from, to, pair_costs(tones[from], tones[to])))
        })
    });
    groups.other = second_group(edges, &own);
}

/// Returns the costs of the groups of two neighbours with these tones in both groups.
fn pair_costs(from: [DVec3; 2], to: [DVec3; 2]) -> [[f64; 2]; 2] {
    let cost = |a: usize, b: usize| {
        let change = (from[a] - to[b]) / CHANGE;
        let jump = (change * change).to_array().map(f64::ln_1p).iter().sum::<f64>() / 3.0;
        if a == b { jump } else { jump + BORDER_COST }
    };
    [[cost(0, 0), cost(0, 1)], [cost(1, 0), cost(1, 1)]]
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
    for _ in 0..ROUNDS {
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
    }
    beliefs.iter().map(|belief| *belief < 0.0).collect()
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
