//! The one error of this crate: which file, what is wrong, what to do.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use gonio::remedy::Remedy;

/// Longest text of a problem that is shown, in characters: files and third parties may bring any.
const LONGEST_PROBLEM: usize = 500;

/// What kind of thing went wrong; decides, for instance, an exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Kind {
    /// The operating system refused to open, read or write; [`Error::io_kind`] says why.
    Io,
    /// A format, or a feature of a format, that is not read here.
    Unsupported,
    /// The file contradicts itself or its format: cut short, wrong dimensions, a bad header.
    Damaged,
    /// The file asks for more memory than allowed; found out before taking the memory.
    Limits,
    /// The file is sound, but its content is not what is asked for here.
    Invalid,
}

/// Why a file could not be read or written. Displays as one line, `FILE: PROBLEM; WHAT TO DO`.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Error(Box<Inner>);

#[derive(Debug)]
struct Inner {
    kind: Kind,
    path: PathBuf,
    problem: String,
    advice: String,
    remedy: Option<Remedy>,
    /// Already part of `problem`, so that it is not repeated as the `source` of a chain of errors.
    os: Option<io::Error>,
}

impl Error {
    /// What kind of thing went wrong.
    pub fn kind(&self) -> Kind {
        self.0.kind
    }

    /// The file or folder that the error is about.
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// What is wrong, without the name of the file and without advice. May hold several lines if a
    /// third party's message does.
    pub fn problem(&self) -> &str {
        &self.0.problem
    }

    /// The operating system's reason for an error of [`Kind::Io`].
    pub fn io_kind(&self) -> Option<io::ErrorKind> {
        self.0.os.as_ref().map(io::Error::kind)
    }

    /// The input that settles it, if there is one; the advice does without.
    pub fn remedy(&self) -> Option<&Remedy> {
        self.0.remedy.as_ref()
    }

    pub(crate) fn with_remedy(mut self, remedy: Remedy) -> Self {
        self.0.remedy = Some(remedy);
        self
    }

    fn new(kind: Kind, path: &Path, problem: impl Into<String>, advice: impl Into<String>) -> Self {
        let (problem, advice) = (problem.into(), advice.into());
        Self(Box::new(Inner { kind, path: path.to_owned(), problem, advice, remedy: None, os: None }))
    }

    /// `action` completes "cannot ...": "open", "write".
    pub(crate) fn io(path: &Path, action: &str, os: io::Error) -> Self {
        use io::ErrorKind as K;
        let advice = match os.kind() {
            K::NotFound => "check the path",
            K::PermissionDenied => "check the permissions",
            K::StorageFull | K::QuotaExceeded | K::FileTooLarge => "free some space or write elsewhere",
            K::ReadOnlyFilesystem => "write elsewhere",
            K::IsADirectory => "give a file, not a folder",
            K::NotADirectory => "give a folder, not a file",
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
        Self::new(Kind::Damaged, path, problem, "the file seems damaged: fetch or write it again")
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
        match self.problem.char_indices().nth(LONGEST_PROBLEM) {
            None => one_line(&self.problem, f)?,
            Some((end, _)) => one_line(&format!("{} ...", &self.problem[..end]), f)?,
        }
        f.write_str("; ")?;
        one_line(&self.advice, f)
    }
}

/// Names of files and messages of third parties may hold line breaks and worse, which would forge
/// lines of output.
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
    fn long_texts_are_cut() {
        let error = Error::invalid(Path::new("x"), "é".repeat(5000), "try again");
        assert_eq!(error.to_string(), format!("x: {} ...; try again", "é".repeat(LONGEST_PROBLEM)));
    }

    #[test]
    fn keeps_the_reason_of_the_system_without_repeating_it() {
        let error = Error::io(Path::new("x"), "open", io::Error::from(io::ErrorKind::NotFound));
        assert_eq!(error.to_string(), "x: cannot open: entity not found; check the path");
        assert_eq!(error.io_kind(), Some(io::ErrorKind::NotFound));
        assert!(std::error::Error::source(&error).is_none());
    }
}
