//! Error type of this crate: the file, the problem, and the advice.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use gonio::suggestion::Suggestion;

/// Largest displayed length of a problem in characters; third-party messages can be longer.
const MAX_PROBLEM_LENGTH: usize = 500;

/// Category of an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Kind {
    /// The operating system refused to open, read or write; [`Error::io_kind`] returns the reason.
    Io,
    /// The format, or a feature of it, is not supported.
    Unsupported,
    /// The file contradicts itself or its format: truncation, wrong dimensions, or an invalid
    /// header.
    Damaged,
    /// The file requires more memory than allowed; detected before allocation.
    Limits,
    /// The file is valid, but its content is unsuitable.
    Invalid,
}

/// Error of reading or writing a file. Displays as one line, `FILE: PROBLEM; WHAT TO DO`.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Error(Box<Inner>);

#[derive(Debug)]
struct Inner {
    kind: Kind,
    path: PathBuf,
    problem: String,
    advice: String,
    suggestion: Option<Suggestion>,
    /// Error of the operating system. `problem` contains its text, so [`std::error::Error::source`]
    /// does not return it.
    os: Option<io::Error>,
}

impl Error {
    /// Returns the category of the error.
    pub fn kind(&self) -> Kind {
        self.0.kind
    }

    /// Returns the file or folder that the error is about.
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// Describes the problem, without the name of the file and without advice. It may have several
    /// lines if a third-party message has.
    pub fn problem(&self) -> &str {
        &self.0.problem
    }

    /// Returns the operating system's reason for an error of [`Kind::Io`].
    pub fn io_kind(&self) -> Option<io::ErrorKind> {
        self.0.os.as_ref().map(io::Error::kind)
    }

    /// Returns the input that resolves the error, if any; the advice does not mention it.
    pub fn suggestion(&self) -> Option<&Suggestion> {
        self.0.suggestion.as_ref()
    }

    pub(crate) fn with_suggestion(mut self, suggestion: Suggestion) -> Self {
        self.0.suggestion = Some(suggestion);
        self
    }

    /// Replaces the advice of an error of [`Kind::Unsupported`].
    pub(crate) fn with_formats(mut self, advice: &str) -> Self {
        if self.kind() == Kind::Unsupported {
            advice.clone_into(&mut self.0.advice);
        }
        self
    }

    fn new(kind: Kind, path: &Path, problem: impl Into<String>, advice: impl Into<String>) -> Self {
        let (problem, advice) = (problem.into(), advice.into());
        Self(Box::new(Inner { kind, path: path.to_owned(), problem, advice, suggestion: None, os: None }))
    }

    /// Error of the operating system; `action` completes "cannot ...": "open", "write".
    pub(crate) fn io(path: &Path, action: &str, os: io::Error) -> Self {
        use io::ErrorKind as K;
        let advice = match os.kind() {
            K::NotFound => "check the path",
            K::PermissionDenied => "check the permissions",
            K::StorageFull | K::QuotaExceeded | K::FileTooLarge => "free disk space or write to another disk",
            K::ReadOnlyFilesystem => "write to another folder",
            K::IsADirectory => "specify a file, not a folder",
            K::NotADirectory => "specify a folder, not a file",
            K::AlreadyExists => "remove it or choose another name",
            _ => "check the disk and try again",
        };
        let mut error = Self::new(Kind::Io, path, format!("cannot {action}: {os}"), advice);
        error.0.os = Some(os);
        error
    }

    pub(crate) fn unsupported(path: &Path, problem: impl Into<String>, advice: impl Into<String>) -> Self {
        Self::new(Kind::Unsupported, path, problem, advice)
    }

    pub(crate) fn damaged(path: &Path, problem: impl Into<String>) -> Self {
        Self::new(Kind::Damaged, path, problem, "the file may be damaged; download or export it again")
    }

    pub(crate) fn limits(path: &Path, problem: impl Into<String>, advice: impl Into<String>) -> Self {
        Self::new(Kind::Limits, path, problem, advice)
    }

    pub(crate) fn invalid(path: &Path, problem: impl Into<String>, advice: impl Into<String>) -> Self {
        Self::new(Kind::Invalid, path, problem, advice)
    }
}

impl fmt::Display for Inner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        one_line(&self.path.to_string_lossy(), f)?;
        f.write_str(": ")?;
        match self.problem.char_indices().nth(MAX_PROBLEM_LENGTH) {
            None => one_line(&self.problem, f)?,
            Some((end, _)) => one_line(&format!("{} ...", &self.problem[..end]), f)?,
        }
        f.write_str("; ")?;
        one_line(&self.advice, f)
    }
}

/// Writes a text as one line without control characters. File names and third-party messages may
/// contain line breaks, which would forge lines of output.
fn one_line(text: &str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    text.chars().try_for_each(|c| match c {
        '\n' | '\r' | '\t' => f.write_str(" "),
        c if c.is_control() => write!(f, "{}", c.escape_default()),
        c => write!(f, "{c}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displays_file_problem_and_advice_on_one_line() {
        let error = Error::invalid(Path::new("a\nb.png"), "is\r\nodd\u{1b}", "try again");
        assert_eq!(error.to_string(), "a b.png: is  odd\\u{1b}; try again");
        assert_eq!(error.kind(), Kind::Invalid);
    }

    #[test]
    fn long_texts_are_truncated() {
        let error = Error::invalid(Path::new("x"), "é".repeat(5000), "try again");
        assert_eq!(error.to_string(), format!("x: {} ...; try again", "é".repeat(MAX_PROBLEM_LENGTH)));
    }

    #[test]
    fn keeps_the_reason_of_the_system_without_repeating_it() {
        let error = Error::io(Path::new("x"), "open", io::Error::from(io::ErrorKind::NotFound));
        assert_eq!(error.to_string(), "x: cannot open: entity not found; check the path");
        assert_eq!(error.io_kind(), Some(io::ErrorKind::NotFound));
        assert!(std::error::Error::source(&error).is_none());
    }
}
