//! Determines which files in a folder gonio wrote. New results replace these files, and no others.
//!
//! A folder contains results if its `result.json` has the format of gonio. gonio then owns the
//! files named in [`results`](crate::results), the folders of the regions that `result.json` lists,
//! and the exports that `export.json` lists.

use std::fs;
use std::path::{Path, PathBuf};

use gonio::suggestion::Suggestion;
use gonio_io::atomic::StagedFolder;
use gonio_io::result::{ExportDocument, region_folders};
use gonio_io::{Error, json};

use crate::AppError;
use crate::export::SUMMARY;
use crate::results::{RESULT, names};

/// Folder of exports, within the folder of results.
pub const EXPORT: &str = "export";

/// Suffix of the default folder of results.
const DEFAULT_SUFFIX: &str = "-gonio";

/// Prepares a folder for new results, which replace earlier results on commit.
///
/// # Errors
/// See [`StagedFolder::create`].
pub fn for_results(dir: impl AsRef<Path>) -> Result<StagedFolder, Error> {
    replacing(dir.as_ref(), results_in)
}

/// Prepares a folder for new exports, which replace earlier exports on commit.
///
/// # Errors
/// If the folder contains results, because an export has files of the same names; see also
/// [`StagedFolder::create`].
pub fn for_exports(dir: impl AsRef<Path>) -> Result<StagedFolder, AppError> {
    let dir = dir.as_ref();
    if holds_results(dir) {
        let problem = "contains results of gonio infer, whose light the export would replace";
        return Err(AppError::of(dir.display(), problem).with([Suggestion::OtherFolder]));
    }
    Ok(replacing(dir, exports_in)?)
}

/// Prepares a folder; a commit removes the files that `find` lists.
fn replacing(dir: &Path, find: impl Fn(&Path, &Path, &mut Vec<PathBuf>)) -> Result<StagedFolder, Error> {
    let mut folder = StagedFolder::create(dir)?;
    let mut ours = Vec::new();
    find(dir, Path::new(""), &mut ours);
    folder.discard(ours);
    Ok(folder)
}

/// Whether a folder contains results of gonio.
pub fn holds_results(dir: &Path) -> bool {
    region_folders(&dir.join(RESULT)).is_some()
}

/// Returns the default folder of results: `ball-gonio` for `ball.exr`.
pub fn default_output(image: &Path) -> PathBuf {
    let mut name = image.file_stem().unwrap_or_default().to_owned();
    name.push(DEFAULT_SUFFIX);
    image.with_file_name(name)
}

/// Whether results in `dir` could overwrite or remove this input file.
pub fn would_replace(dir: &Path, file: &Path) -> bool {
    let mut earlier = Vec::new();
    results_in(dir, Path::new(""), &mut earlier);
    let same = |a: &Path, b: &Path| fs::canonicalize(a).ok().zip(fs::canonicalize(b).ok()).is_some_and(|(a, b)| a == b);
    names().map(PathBuf::from).chain(earlier).any(|name| same(&dir.join(name), file))
}

/// Adds the files that gonio wrote in a folder of results to `ours`. `within` is the path of `dir`
/// relative to the outer folder.
fn results_in(dir: &Path, within: &Path, ours: &mut Vec<PathBuf>) {
    let Some(regions) = region_folders(&dir.join(RESULT)) else { return };
    ours.extend(names().map(|name| within.join(name)));
    exports_in(&dir.join(EXPORT), &within.join(EXPORT), ours);
    // The folder of a region contains no regions.
    if within != Path::new("") {
        return;
    }
    for region in regions.into_iter().filter(|name| is_plain(name)) {
        results_in(&dir.join(&region), Path::new(&region), ours);
        ours.push(region.into());
    }
}

/// Adds the files that gonio wrote in a folder of exports to `ours`.
fn exports_in(dir: &Path, within: &Path, ours: &mut Vec<PathBuf>) {
    let Ok(summary) = json::read::<ExportDocument>(&dir.join(SUMMARY)) else { return };
    if summary.format != ExportDocument::FORMAT {
        return;
    }
    let files = summary.exports.values().flat_map(|entry| &entry.files);
    ours.extend(files.filter(|name| is_plain(name)).map(|name| within.join(name)));
    ours.push(within.join(SUMMARY));
    if within != Path::new("") {
        ours.push(within.to_owned());
    }
}

/// Whether this is a file name without a path.
pub(crate) fn is_plain(name: &str) -> bool {
    Path::new(name).file_name().is_some_and(|n| n == name)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// Creates a temporary folder with these files, given by name and content.
    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        dir
    }

    fn left(dir: &Path) -> Vec<String> {
        let (mut found, mut open) = (Vec::new(), vec![dir.to_owned()]);
        while let Some(next) = open.pop() {
            for entry in fs::read_dir(next).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    open.push(path);
                } else {
                    found.push(path.strip_prefix(dir).unwrap().to_string_lossy().into_owned());
                }
            }
        }
        found.sort();
        found
    }

    #[test]
    fn replaces_earlier_results_and_keeps_other_files() {
        let result = json!({
            "format": "gonio-regions",
            "regions": [{ "folder": "1" }, { "folder": "../outside" }, { "folder": "mine" }],
        })
        .to_string();
        let region = json!({ "format": "gonio-result" }).to_string();
        let export = json!({
            "format": "gonio-export", "exports": { "ward": { "files": ["ward.json", "../brdf.txt"] } },
        })
        .to_string();
        let dir = folder(&[
            ("result.json", &result),
            ("report.html", ""),
            ("brdf.txt", ""),
            ("photo.exr", ""),
            ("1/result.json", &region),
            ("1/brdf.npz", ""),
            ("1/export/export.json", &export),
            ("1/export/ward.json", ""),
            ("mine/report.html", "a folder without results"),
            ("export/export.json", &export),
            ("export/ward.json", ""),
            ("export/scene.blend", ""),
        ]);
        let staged = for_results(dir.path()).unwrap();
        assert_eq!(left(dir.path()).len(), 12);
        staged.fill(&[("relit.png".to_owned(), b"new".to_vec())]).unwrap();
        assert_eq!(left(dir.path()), ["brdf.txt", "export/scene.blend", "mine/report.html", "photo.exr", "relit.png"]);
        assert!(!dir.path().join("1").exists());
    }

    #[test]
    fn keeps_files_of_folders_without_results() {
        for result in ["", "no JSON", "{\"format\": \"another\"}"] {
            let dir = folder(&[("result.json", result), ("report.html", ""), ("export/ward.json", "")]);
            assert!(!holds_results(dir.path()));
            for_results(dir.path()).unwrap().fill(&[("relit.png".to_owned(), Vec::new())]).unwrap();
            assert_eq!(left(dir.path()), ["export/ward.json", "relit.png", "report.html", "result.json"]);
        }
    }

    #[test]
    fn would_replace_photographs_named_like_results() {
        let dir = folder(&[("light.exr", ""), ("photo.exr", "")]);
        let name = |name: &str| dir.path().join(name);
        assert!(would_replace(dir.path(), &name("light.exr")));
        assert!(!would_replace(dir.path(), &name("photo.exr")));
        assert!(!would_replace(&name("out"), &name("light.exr")));
        assert!(!would_replace(dir.path(), &name("relit.png")));
    }

    #[test]
    fn default_folder_is_beside_the_photograph() {
        assert_eq!(default_output(Path::new("a/ball.exr")), Path::new("a/ball-gonio"));
        assert_eq!(default_output(Path::new("ball.1.exr")), Path::new("ball.1-gonio"));
    }
}
