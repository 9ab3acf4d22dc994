//! The grid of the benchmark: the photographed materials, their lights, and the training materials
//! of the estimator.

use serde::{Deserialize, Serialize};

use crate::materials::Materials;

/// Returns the name of a choice in files and on the command line.
pub(crate) fn id(choice: &impl clap::ValueEnum) -> String {
    choice.to_possible_value().expect("no choice is hidden").get_name().to_owned()
}

/// Materials that basis, prior and starts are learnt from, and materials that are tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Protocol {
    /// All materials, including the tested ones, as in the paper. Errors are optimistic.
    All,
    /// All but every fifth material; the left-out ones are tested. Errors are unbiased.
    LeaveOut,
    /// All materials, tested on others: measurements from another laboratory and formulas of other
    /// families.
    OutOfDomain,
}

impl Protocol {
    /// Title for readers.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::All => "(a) all materials in the basis",
            Self::LeaveOut => "(b) leave-out: tested materials unseen",
            Self::OutOfDomain => "(c) out of domain: materials of other kinds than the training set",
        }
    }

    /// The materials that the protocol tests.
    pub(crate) fn tested(self, materials: &Materials) -> Vec<usize> {
        match self {
            Self::All => materials.database().collect(),
            Self::LeaveOut => materials.held_out(),
            Self::OutOfDomain => materials.out_of_domain().collect(),
        }
    }

    /// The first protocol with the same training materials; both share the models learnt from them.
    pub(crate) fn learns_as(self) -> Self {
        match self {
            Self::All | Self::OutOfDomain => Self::All,
            Self::LeaveOut => Self::LeaveOut,
        }
    }

    /// The materials that all models are learnt from.
    pub(crate) fn training(self, materials: &Materials) -> Vec<usize> {
        let held_out = if self.learns_as() == Self::LeaveOut { materials.held_out() } else { Vec::new() };
        materials.database().filter(|at| !held_out.contains(at)).collect()
    }
}

/// A photograph to estimate from: one material in one light, under one protocol.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Unit {
    pub(crate) protocol: Protocol,
    /// Index of the material.
    pub(crate) material: usize,
    /// Name of the light of the photograph.
    pub(crate) light: String,
}

/// All units in their order: protocol, material, light.
pub(crate) fn units(
    protocols: &[Protocol],
    materials: &dyn Fn(Protocol) -> Vec<usize>,
    lights: &[String],
) -> Vec<Unit> {
    let mut units = Vec::new();
    for &protocol in protocols {
        for material in materials(protocol) {
            units.extend(lights.iter().map(|light| Unit { protocol, material, light: light.clone() }));
        }
    }
    units
}

/// Returns the lights in which an estimate from `input` is relit: `wanted`, with `input` itself
/// replaced by the first spare light that `wanted` does not contain.
pub(crate) fn relight_lights(wanted: &[String], spare: &[String], input: &str) -> Vec<String> {
    let replacement = spare.iter().find(|s| *s != input && !wanted.contains(s));
    wanted.iter().filter_map(|w| if w == input { replacement.cloned() } else { Some(w.clone()) }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimates_are_not_relit_in_the_light_of_their_photograph() {
        let name = |s: &str| s.to_owned();
        let wanted = [name("a"), name("b")];
        let spare = [name("a"), name("c"), name("d")];
        assert_eq!(relight_lights(&wanted, &spare, "z"), wanted);
        assert_eq!(relight_lights(&wanted, &spare, "a"), [name("c"), name("b")]);
        assert_eq!(relight_lights(&wanted, &[], "a"), [name("b")]);
    }
}
