//! Errors and warnings, with suggestions that each front end words.

use std::fmt::{self, Display};
use std::io::ErrorKind;

use gonio::remedy::Remedy;
use gonio::scene::{Circle, SceneError};

/// Function that words a suggestion as an imperative clause; `None` if the front end does not
/// support it.
pub type Words<'a> = &'a dyn Fn(&Remedy) -> Option<String>;

/// An error: the faulty input and the reason.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    text: String,
    remedies: Vec<Remedy>,
    io: Option<ErrorKind>,
}

impl Problem {
    /// Creates an error with a text.
    pub fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), remedies: Vec::new(), io: None }
    }

    /// Creates an error about a named input.
    pub fn of(name: impl Display, error: impl Display) -> Self {
        Self::new(format!("{name}: {error}"))
    }

    /// Creates an error about a photograph, shape or mask, with its suggestions.
    pub fn of_scene(name: impl Display, error: &SceneError) -> Self {
        Self { remedies: error.remedies(), ..Self::of(name, error) }
    }

    /// Prefixes the error with a part of the input.
    #[must_use]
    pub fn within(mut self, part: &str) -> Self {
        self.text = format!("{part}: {}", self.text);
        self
    }

    /// Adds a suggestion.
    #[must_use]
    pub fn with(mut self, remedy: Remedy) -> Self {
        self.remedies.push(remedy);
        self
    }

    /// Returns candidates for the outline of the ball, the most probable first.
    pub fn candidates(&self) -> &[Circle] {
        let circles = self.remedies.iter().find_map(|remedy| match remedy {
            Remedy::OneOf(circles) => Some(circles.as_slice()),
            _ => None,
        });
        circles.unwrap_or_default()
    }

    /// Returns the error kind of the operating system, for errors of files.
    pub fn io_kind(&self) -> Option<ErrorKind> {
        self.io
    }

    /// Returns the error in one line, with the suggestions of a front end.
    pub fn worded(&self, words: Words<'_>) -> String {
        worded(&self.text, &self.remedies, words)
    }
}

/// Writes the error without its suggestions.
impl Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl std::error::Error for Problem {}

impl From<gonio_io::Error> for Problem {
    fn from(error: gonio_io::Error) -> Self {
        Self { text: error.to_string(), remedies: error.remedy().cloned().into_iter().collect(), io: error.io_kind() }
    }
}

/// A problem that did not stop the inference.
#[derive(Clone, Debug, PartialEq)]
pub struct Warning {
    text: String,
    remedies: Vec<Remedy>,
}

impl Warning {
    /// Creates a warning with suggestions.
    pub fn new(text: impl Into<String>, remedies: Vec<Remedy>) -> Self {
        Self { text: text.into(), remedies }
    }

    /// Returns the warning in one line, with the suggestions of a front end.
    pub fn worded(&self, words: Words<'_>) -> String {
        worded(&self.text, &self.remedies, words)
    }
}

impl From<String> for Warning {
    fn from(text: String) -> Self {
        Self { text, remedies: Vec::new() }
    }
}

fn worded(text: &str, remedies: &[Remedy], words: Words<'_>) -> String {
    let offered: Vec<String> = remedies.iter().filter_map(words).collect();
    if offered.is_empty() { text.to_owned() } else { format!("{text}; {}", offered.join(", or ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn front_end_words_the_suggestions() {
        let problem = Problem::of_scene("ball.exr", &SceneError::NoOutline);
        assert!(problem.to_string().starts_with("ball.exr: no object found"));
        assert_eq!(problem.worded(&|_| None), problem.to_string());
        let words = |remedy: &Remedy| (*remedy != Remedy::Camera).then(|| format!("give {remedy:?}"));
        assert!(problem.worded(&words).ends_with("; give Mask, or give Outline"), "{}", problem.worded(&words));
        let warning = Warning::new("odd", vec![Remedy::Linear]);
        assert_eq!(warning.worded(&words), "odd; give Linear");
        assert_eq!(Warning::from("odd".to_owned()).worded(&words), "odd");
    }
}
