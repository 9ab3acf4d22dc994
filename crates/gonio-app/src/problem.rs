//! Errors and warnings, with suggestions that each front end words.

use std::fmt::{self, Display};
use std::io::ErrorKind;

use gonio::bracket::BracketError;
use gonio::scene::{Circle, SceneError};
use gonio::suggestion::Suggestion;

/// Function that words a suggestion as an imperative clause; `None` if the front end does not
/// support it.
pub type SuggestionFormatter<'a> = &'a dyn Fn(&Suggestion) -> Option<String>;

/// An error: the faulty input and the reason.
#[derive(Clone, Debug, PartialEq)]
pub struct AppError {
    text: String,
    suggestions: Vec<Suggestion>,
    /// Whether suggestions of circles apply to the shape.
    takes_circle: bool,
    io: Option<ErrorKind>,
}

impl AppError {
    /// Creates an error with a text.
    pub fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), suggestions: Vec::new(), takes_circle: true, io: None }
    }

    /// Creates an error about a named input.
    pub fn of(name: impl Display, error: impl Display) -> Self {
        Self::new(format!("{name}: {error}"))
    }

    /// Creates an error about a photograph, shape or mask, with its suggestions.
    pub fn of_scene(name: impl Display, error: &SceneError) -> Self {
        Self::of(name, error).with(error.suggestions())
    }

    /// Sets whether the outline of the shape is a circle that the user can specify. If not, the
    /// error suggests no circle.
    #[must_use]
    pub(crate) fn for_shape(self, takes_circle: bool) -> Self {
        Self { takes_circle, ..self }
    }

    /// Creates an error about a bracket, with its suggestions.
    pub fn of_bracket(name: impl Display, error: &BracketError) -> Self {
        Self::of(name, error).with(error.suggestions())
    }

    /// Prefixes the error with a part of the input.
    #[must_use]
    pub fn within(mut self, part: &str) -> Self {
        self.text = format!("{part}: {}", self.text);
        self
    }

    /// Adds suggestions.
    #[must_use]
    pub fn with(mut self, suggestions: impl IntoIterator<Item = Suggestion>) -> Self {
        self.suggestions.extend(suggestions);
        self
    }

    /// Returns candidates for the outline of the ball, the most probable first.
    pub fn candidates(&self) -> &[Circle] {
        let circles = self.suggestions.iter().find_map(|suggestion| match suggestion {
            Suggestion::OneOf(circles) => Some(circles.as_slice()),
            _ => None,
        });
        circles.unwrap_or_default()
    }

    /// Returns the error kind of the operating system, for errors of files.
    pub fn io_kind(&self) -> Option<ErrorKind> {
        self.io
    }

    /// Returns the error in one line, with the suggestions of a front end.
    pub fn worded(&self, words: SuggestionFormatter<'_>) -> String {
        let is_circle =
            |it: &Suggestion| matches!(it, Suggestion::Outline | Suggestion::SecondOutline | Suggestion::OneOf(_));
        let apply = |it: &&Suggestion| self.takes_circle || !is_circle(it);
        worded(&self.text, &self.suggestions.iter().filter(apply).cloned().collect::<Vec<_>>(), words)
    }
}

/// Writes the error without its suggestions.
impl Display for AppError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl std::error::Error for AppError {}

impl From<gonio_io::Error> for AppError {
    fn from(error: gonio_io::Error) -> Self {
        Self {
            suggestions: error.suggestion().cloned().into_iter().collect(),
            io: error.io_kind(),
            ..Self::new(error.to_string())
        }
    }
}

/// A problem that did not stop the inference.
#[derive(Clone, Debug, PartialEq)]
pub struct Warning {
    text: String,
    suggestions: Vec<Suggestion>,
}

impl Warning {
    /// Creates a warning with suggestions.
    pub fn new(text: impl Into<String>, suggestions: Vec<Suggestion>) -> Self {
        Self { text: text.into(), suggestions }
    }

    /// Creates a warning about a named input.
    pub fn of(name: impl Display, text: impl Display) -> Self {
        Self::from(format!("{name}: {text}"))
    }

    /// Adds suggestions.
    #[must_use]
    pub fn with(mut self, suggestions: impl IntoIterator<Item = Suggestion>) -> Self {
        self.suggestions.extend(suggestions);
        self
    }

    /// Returns the warning in one line, with the suggestions of a front end.
    pub fn worded(&self, words: SuggestionFormatter<'_>) -> String {
        worded(&self.text, &self.suggestions, words)
    }
}

impl From<String> for Warning {
    fn from(text: String) -> Self {
        Self { text, suggestions: Vec::new() }
    }
}

fn worded(text: &str, suggestions: &[Suggestion], words: SuggestionFormatter<'_>) -> String {
    let offered: Vec<String> = suggestions.iter().filter_map(words).collect();
    if offered.is_empty() { text.to_owned() } else { format!("{text}; {}", offered.join(", or ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn front_end_words_the_suggestions() {
        let problem = AppError::of_scene("ball.exr", &SceneError::NoOutline);
        assert!(problem.to_string().starts_with("ball.exr: no object found"));
        assert_eq!(problem.worded(&|_| None), problem.to_string());
        let words =
            |suggestion: &Suggestion| (*suggestion != Suggestion::Camera).then(|| format!("give {suggestion:?}"));
        assert!(problem.worded(&words).ends_with("; give Mask, or give Outline"), "{}", problem.worded(&words));
        let warning = Warning::new("odd", vec![Suggestion::Linear]);
        assert_eq!(warning.worded(&words), "odd; give Linear");
        assert_eq!(Warning::from("odd".to_owned()).worded(&words), "odd");
    }

    #[test]
    fn the_page_of_warnings_describes_every_warning() {
        use gonio::estimate::{Diagnostic as D, MisfitCause};
        use gonio::scene::SceneWarning as W;
        let misfit = |cause| D::Misfit { misfit: 0.3, expected: 0.1, cause };
        let diagnostics = [
            D::Filled(0.5),
            D::OutOfDistribution(0.5),
            D::Undetermined(0.5),
            D::Colours(0.5),
            D::Scatter(0.5),
            D::LightRotated([1.0, 0.0, 0.0]),
            D::Clipped { gain: 2.0, sd: 0.1 },
            D::Coarse(3.0),
            D::Channel { channel: 0, misfit: 0.3 },
            misfit(MisfitCause::Texture),
            misfit(MisfitCause::KnownLight),
        ];
        let (pixels, observed) = (10, 100);
        let warnings = [
            W::Misaligned { overlap: 0.9 },
            W::BackFacing { inside: 10, visible: 100 },
            W::UnknownSemiAxis(10.0),
            W::Outline(Circle { x: 1.0, y: 2.0, radius: 3.0 }),
            W::FlatBackground { pixels },
            W::Clipped { clipped: 10, observed },
            W::Faulty { negative: 10, not_finite: 0, observed },
            W::EmptyChannel { channel: 2, empty: 90, used: 100 },
            W::Outliers { outliers: 10, observed },
            W::PossibleOutliers { pixels: 10, observed },
            W::Pattern { pixels, converted: 10, observed, ratio: 2.0 },
            W::Spots { count: 3 },
            W::OtherColour { pixels, observed },
        ];
        let image = |scale: f32| {
            let code = |x: usize, y: usize| glam::Vec3::splat(scale * ((x + 2 * y) % 256) as f32);
            crate::coded_floats::warning("a", &gonio::picture::Plane::from_fn(80, 80, code)).unwrap()
        };
        let coded = [1.0, 0.7].map(image);
        let texts: Vec<String> =
            diagnostics.iter().map(D::to_string).chain(warnings.iter().map(W::to_string)).chain(coded).collect();
        // The quotations after the headings.
        let page = include_str!("../../../docs/warnings.md");
        let entries: Vec<String> = page
            .split("\n\n")
            .filter_map(|part| Some(part.strip_prefix('"')?.split_once('"')?.0.replace('\n', " ")))
            .collect();
        for text in &texts {
            assert!(entries.iter().any(|entry| text.contains(entry)), "{text}");
        }
        // The axes of normals and 8-bit photographs are tested elsewhere.
        let known = |entry: &String| texts.iter().any(|text| text.contains(entry));
        let others: Vec<&String> = entries.iter().filter(|entry| !known(entry)).collect();
        assert_eq!(others, ["seem to have", "8-bit image, decoded as sRGB"]);
    }
}
