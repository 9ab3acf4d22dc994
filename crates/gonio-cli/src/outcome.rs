//! Prints the result of a command as text, or as JSON with `--json`.

use gonio_io::result::ResultDocument;
use serde_json::{Map, Value, json};

use crate::progress::is_quiet;
use crate::{lines, one_line};

/// Sections of `result.json` that are also printed with `--json`.
const SUMMARY: [&str; 10] = [
    "method",
    "photographs",
    "posterior",
    "colour",
    "colorspace",
    "residual",
    "known_light",
    "exposure",
    "reference",
    "seconds",
];

/// Result of a successful command.
pub(crate) struct Outcome {
    /// Lines for standard output.
    pub(crate) text: String,
    /// Warnings, one line each.
    pub(crate) warnings: Vec<String>,
    /// Whether docs/warnings.md describes the warnings.
    described: bool,
    /// Results by name, for `--json`.
    pub(crate) fields: Map<String, Value>,
}

impl Outcome {
    /// Creates an outcome without warnings.
    pub(crate) fn new(text: impl Into<String>, fields: Value) -> Self {
        let fields = if let Value::Object(fields) = fields { fields } else { Map::new() };
        Self { text: text.into(), warnings: Vec::new(), described: false, fields }
    }

    /// Creates an outcome with the sections of a result that summarise it, and the folder of the
    /// result as `output`.
    pub(crate) fn of_result(text: impl Into<String>, output: &str, document: &ResultDocument) -> Self {
        let mut outcome = Self::new(text, json!(document));
        outcome.fields.retain(|section, _| SUMMARY.contains(&section.as_str()));
        outcome.fields.insert("output".into(), json!(output));
        outcome
    }

    /// Adds warnings.
    pub(crate) fn warning(mut self, warnings: Vec<String>) -> Self {
        self.warnings = warnings;
        self
    }

    /// Adds warnings that docs/warnings.md describes.
    pub(crate) fn described_warnings(self, warnings: Vec<String>) -> Self {
        Self { warnings, described: true, ..self }
    }

    /// Prints text to standard output, then warnings to standard error. If `json`, prints one
    /// object with warnings and fields to standard output instead.
    pub(crate) fn print(mut self, json: bool) {
        if json {
            self.fields.insert("warnings".into(), json!(self.warnings));
            println!("{}", Value::Object(self.fields));
        } else if !is_quiet() {
            println!("{}", lines(&self.text));
            self.warnings.iter().for_each(|warning| eprintln!("warning: {}", one_line(warning)));
            if self.described && !self.warnings.is_empty() {
                eprintln!("docs/warnings.md lists causes and fixes");
            }
        }
    }
}
