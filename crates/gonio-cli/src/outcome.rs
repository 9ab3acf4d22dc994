//! Prints the result of a command as text, or as JSON with `--json`.

use serde_json::{Map, Value, json};

use crate::progress::is_quiet;
use crate::{lines, one_line};

/// Result of a successful command.
pub(crate) struct Outcome {
    /// Lines for standard output.
    pub(crate) text: String,
    /// Warnings, one line each.
    pub(crate) warnings: Vec<String>,
    /// Results by name, for `--json`.
    pub(crate) fields: Map<String, Value>,
}

impl Outcome {
    /// Creates an outcome without warnings.
    pub(crate) fn new(text: impl Into<String>, fields: Value) -> Self {
        let fields = if let Value::Object(fields) = fields { fields } else { Map::new() };
        Self { text: text.into(), warnings: Vec::new(), fields }
    }

    /// Adds warnings.
    pub(crate) fn warning(mut self, warnings: Vec<String>) -> Self {
        self.warnings = warnings;
        self
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
        }
    }
}
