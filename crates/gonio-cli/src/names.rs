//! Parses the names of values that the program and the package share.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use gonio_app::names::Names;

/// Returns the parser of an option whose value has one of these names.
pub(crate) fn parser<T: Copy + Send + Sync + 'static>(
    names: &'static Names<T>,
) -> impl TypedValueParser<Value = T> + use<T> {
    let possible = names.iter().map(|(name, help, _)| {
        let value = PossibleValue::new(*name);
        if help.is_empty() { value } else { value.help(*help) }
    });
    PossibleValuesParser::new(possible).map(|name| {
        let found = names.iter().find(|(known, ..)| *known == name);
        found.expect("the parser accepts only these names").2
    })
}
