//! Likelihood of a material given a photograph: `posterior.json` in the folder of results
//! (docs/combine.md).

use std::path::Path;

use gonio::colour::SavedChroma;
use gonio::inference::Likelihood;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::guard::read_whole;

/// Name of the file in a folder of results.
pub const FILE: &str = "posterior.json";

/// Format of the file.
const FORMAT: &str = "gonio-posterior";

/// Version that is written, and the newest version that is read.
const VERSION: u32 = 1;

/// Largest file, in bytes.
const MAX_BYTES: u64 = 64 << 20;

/// Contents of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SavedPosterior {
    format: String,
    version: u32,
    /// Identifier of the model that computed the likelihood: its
    /// [`id`](gonio::inference::learnt::LearntPosterior::id).
    pub model: String,
    /// Names of the photographs.
    pub images: Vec<String>,
    /// Likelihood of the material.
    pub likelihood: Likelihood,
    /// Colours, if they were estimated. Those in files of earlier versions cannot be read.
    #[serde(default)]
    pub chroma: Option<SavedChroma>,
}

impl SavedPosterior {
    /// Builds the contents of a file.
    pub fn new(model: String, images: Vec<String>, likelihood: Likelihood, chroma: Option<SavedChroma>) -> Self {
        Self { format: FORMAT.to_owned(), version: VERSION, model, images, likelihood, chroma }
    }

    /// Encodes a file.
    pub fn encode(&self) -> Vec<u8> {
        serde_json::to_vec(self).unwrap_or_default()
    }

    /// Reads a file, or the file [`FILE`] of a folder of results.
    ///
    /// # Errors
    /// If the file cannot be read, is damaged, or has a newer version.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let file = if path.is_dir() { path.join(FILE) } else { path.to_owned() };
        Self::decode(&file, &read_whole(&file, MAX_BYTES)?)
    }

    /// Decodes a file held in memory; `path` is only used in error messages.
    ///
    /// # Errors
    /// Like [`SavedPosterior::read`].
    pub fn decode(path: &Path, bytes: &[u8]) -> Result<Self, Error> {
        let saved: Self = serde_json::from_slice(bytes)
            .map_err(|error| Error::damaged(path, format!("is not a posterior: {error}")))?;
        if saved.format != FORMAT {
            return Err(Error::damaged(path, format!("is not a posterior, but {:?}", saved.format)));
        }
        if saved.version > VERSION {
            let problem = format!("has version {}, which is newer than this program", saved.version);
            return Err(Error::unsupported(path, problem, "update gonio"));
        }
        if saved.chroma.as_ref().is_some_and(|chroma| !chroma.is_sound()) {
            return Err(Error::damaged(path, "has colours of the wrong size or with values that are not finite"));
        }
        Ok(saved)
    }
}

#[cfg(test)]
mod tests {
    use gonio::colour::{Chroma, ChromaField};
    use gonio::inference::Embedding;

    use super::*;

    #[test]
    fn files_round_trip() {
        let chroma = SavedChroma::of(&ChromaField::uniform(Chroma([0.1, 1.0 / 3.0])), [0.3, 0.1]);
        let likelihood = Likelihood::Embedding(Embedding::of(vec![1.0, -0.1, 1e-7]));
        let saved = SavedPosterior::new("abc".into(), vec!["ball.exr".into()], likelihood, Some(chroma));
        assert_eq!(SavedPosterior::decode(Path::new("p"), &saved.encode()).unwrap(), saved);
    }

    #[test]
    fn errors_state_that_a_file_is_not_a_posterior() {
        let saved =
            SavedPosterior::new(String::new(), Vec::new(), Likelihood::Embedding(Embedding::of(vec![1.0])), None);
        let text = String::from_utf8(saved.encode()).unwrap();
        let wrong = [
            "{}".to_owned(),
            text.replace("gonio-posterior", "other"),
            text.replace("\"version\":1", "\"version\":9"),
            text[..text.len() / 2].to_owned(),
        ];
        for text in wrong {
            let error = SavedPosterior::decode(Path::new("out/posterior.json"), text.as_bytes()).unwrap_err();
            let text = error.to_string();
            assert!(text.contains(": is not a posterior") || text.contains(": has version 9"), "{text}");
        }
    }
}
