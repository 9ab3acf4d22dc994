//! Colours of a BRDF whose luminance is known, from an RGB photograph in light of unknown colour
//! (beyond the paper, which infers luminance and displays it in one colour).
//!
//! A BRDF of [`TwoColours`] has a chroma `b` of its body and `h` of its highlight. In light of mean
//! chroma `w` the body shows `b + w` and the highlight `h + w`, in natural logarithms. [`Clues`]
//! are measurements of both sums in a photograph: means, medians, and the colour of fine detail,
//! which is that of the highlight because the body is smooth. A [`ColourModel`] learnt from
//! simulated photographs weights the clues and knows their errors; with priors of `b`, `h` and `w`
//! it gives a [`ColourPosterior`] in closed form:
//!
//! * `w`: colours of captured light, around white; or the given colour.
//! * `b`: broad.
//! * `h`: a mixture of white, as for all dielectrics, and of colours that follow the body's, as for
//!   metals.
//!
//! No photograph separates `b` from `w` by itself. A coloured highlight reveals the colour of the
//! light if the material's highlight is white.

mod chroma;
mod clues;
mod gaussian;
mod learn;
mod model;
mod parts;

pub use chroma::Chroma;
pub(crate) use clues::is_grey;
pub use clues::{CLUES, ClueFinder, Clues, white_chroma};
pub use learn::{LeftOut, Sample};
#[cfg(test)]
pub(crate) use model::tests::plain;
pub use model::{ColourModel, ColourPosterior, Normal, Reading};
pub use parts::{TwoColours, body, highlight_share};
