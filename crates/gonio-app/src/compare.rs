//! Compares several folders of results on one HTML page.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use glam::Vec3;
use gonio::picture::Plane;
use gonio::reflectance::BivariateTable;
use gonio_io::picture::{self, ReadOptions};
use gonio_io::result::{self, RegionEntry, ResultDocument, ResultFile};
use gonio_report::compare::{Comparison, Entry, FolderContents, MAX_COMPARED, MAX_PICTURES, thumbnail};
use gonio_report::page::GENERATOR;
use gonio_report::summary;
use rayon::prelude::*;

use crate::folder::{holds_results, is_plain};
use crate::regions::MAX_REGIONS;
use crate::results::{BRDF, PICTURES, REPORT, RESULT, brdf_in};
use crate::{AppError, read_brdf};

/// Default name of the page.
pub const PAGE: &str = "compare.html";

/// Largest picture that is read, in pixels: three times the size that gonio writes.
const MAX_PIXELS: u64 = 1 << 23;
/// Number of leading bytes that contain the generator of a page.
const BEGINNING: u64 = 1024;

/// A folder of results to compare.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparedFolder {
    /// Name on the page.
    pub name: String,
    /// The folder.
    pub folder: PathBuf,
    /// Error, if the inference failed.
    pub failed: Option<String>,
}

/// Returns the names of folders: the last component of the path, or the path if it is not unique.
pub fn names(folders: &[PathBuf]) -> Vec<String> {
    let last = |folder: &PathBuf| folder.file_name().map(|name| name.to_string_lossy().into_owned());
    let mut times: BTreeMap<Option<String>, usize> = BTreeMap::new();
    folders.iter().for_each(|folder| *times.entry(last(folder)).or_default() += 1);
    let name = |folder: &PathBuf| last(folder).filter(|name| times[&Some(name.clone())] == 1);
    folders.iter().map(|folder| name(folder).unwrap_or_else(|| folder.display().to_string())).collect()
}

/// Checks that a folder contains results of one photograph or of its regions.
///
/// # Errors
/// If `result.json` cannot be read or was not written by gonio.
pub fn check(folder: &Path) -> Result<(), AppError> {
    // The page shows the errors of damaged results.
    if !holds_results(folder) {
        result::read(&folder.join(RESULT))?;
    }
    Ok(())
}

/// Whether gonio wrote a page, so that a new page may replace it.
pub fn is_page(path: &Path) -> bool {
    let mut beginning = Vec::new();
    let read = File::open(path).and_then(|file| file.take(BEGINNING).read_to_end(&mut beginning));
    read.is_ok() && beginning.windows(GENERATOR.len()).any(|part| part == GENERATOR.as_bytes())
}

/// Reads all results. The page reports missing and damaged files. `page` is its path: it links to
/// the reports in folders below its own.
pub fn read(given: &[ComparedFolder], page: &Path) -> Comparison {
    Comparison::of(entries(given, page))
}

/// Reads all results, like [`read`], without comparing them.
pub fn entries(given: &[ComparedFolder], page: &Path) -> Vec<Entry> {
    let folders: Vec<Folder> = given.par_iter().flat_map_iter(Folder::of).collect();
    let (tables, pictures) = (folders.len() <= MAX_COMPARED, folders.len() <= MAX_PICTURES);
    let beside = page.parent().unwrap_or(Path::new(""));
    folders.into_par_iter().map(|folder| folder.entry(beside, tables, pictures)).collect()
}

/// A folder with the result of one material.
struct Folder {
    name: String,
    path: PathBuf,
    result: Result<ResultDocument, String>,
}

impl Folder {
    /// Returns the result of a folder, or the results of its regions.
    fn of(given: &ComparedFolder) -> Vec<Self> {
        let one = |name: String, path: PathBuf, result| vec![Self { name, path, result }];
        let (name, path) = (given.name.clone(), given.folder.clone());
        if let Some(failed) = &given.failed {
            return one(name, path, Err(failed.clone()));
        }
        match result::read(&path.join(RESULT)) {
            Ok(ResultFile::Regions(document)) => {
                let region = |region: RegionEntry| {
                    let path = path.join(&region.folder);
                    let result = material(&path);
                    Self { name: format!("{name}/{}", region.folder), path, result }
                };
                let inside = document.regions.into_iter().filter(|region| is_plain(&region.folder));
                inside.take(MAX_REGIONS).map(region).collect()
            }
            Ok(ResultFile::Material(document)) => one(name, path, Ok(*document)),
            Err(error) => one(name, path, Err(error.to_string())),
        }
    }

    /// Reads the contents that the page shows.
    fn entry(self, beside: &Path, tables: bool, pictures: bool) -> Entry {
        let Self { name, path, result } = self;
        let report = path.join(REPORT);
        let report = report.is_file().then(|| address(&report, beside)).flatten();
        let found = result.map(|result| {
            let mut faults = Vec::new();
            let mut image = |name: &str| {
                let file = path.join(format!("{name}.png"));
                (pictures && file.is_file()).then(|| noted(read_picture(&file), &mut faults)).flatten()
            };
            let sphere = image(PICTURES[0]).map(|sphere| thumbnail(&sphere));
            let photograph = image(PICTURES[2]).and_then(|sheet| summary::photograph(&sheet));
            let photograph = photograph.map(|photograph| thumbnail(&photograph));
            let table = match brdf_in(&path) {
                Some(brdf) => tables.then(|| noted(read_table(&brdf), &mut faults)).flatten(),
                None => {
                    faults.push(format!("{}: does not contain {BRDF}", path.display()));
                    None
                }
            };
            FolderContents { result, photograph, sphere, table, faults }
        });
        Entry { name, report, contents: found }
    }
}

/// Reads the result of one material in a folder.
fn material(folder: &Path) -> Result<ResultDocument, String> {
    let file = folder.join(RESULT);
    match result::read(&file).map_err(|error| error.to_string())? {
        ResultFile::Material(document) => Ok(*document),
        ResultFile::Regions(_) => Err(format!("{}: a region cannot contain regions", file.display())),
    }
}

/// Returns the value, or records the error.
fn noted<T>(read: Result<T, gonio_io::Error>, faults: &mut Vec<String>) -> Option<T> {
    read.map_err(|error| faults.push(error.to_string())).ok()
}

fn read_picture(file: &Path) -> Result<Plane<Vec3>, gonio_io::Error> {
    let options = ReadOptions { max_pixels: MAX_PIXELS, ..ReadOptions::default() };
    Ok(picture::read(file, &options)?.picture.rgb)
}

fn read_table(file: &Path) -> Result<BivariateTable, gonio_io::Error> {
    let table = read_brdf(file)?;
    Ok(BivariateTable::luminance(&[0, 1, 2].map(|channel| table.bivariate(channel))))
}

/// Returns the URL of a file relative to the folder `beside`, if the file is below it.
fn address(file: &Path, beside: &Path) -> Option<String> {
    let mut address = ".".to_owned();
    let (file, beside) = (std::path::absolute(file).ok()?, std::path::absolute(beside.join(".")).ok()?);
    for part in file.strip_prefix(beside).ok()?.components() {
        let Component::Normal(part) = part else { return None };
        address.push('/');
        for byte in part.to_str()?.bytes() {
            match byte {
                b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => address.push(byte.into()),
                _ => address += &format!("%{byte:02X}"),
            }
        }
    }
    Some(address)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique() {
        let names = names(&["a/out", "b/out", "c/other/", "."].map(PathBuf::from));
        assert_eq!(names, ["a/out", "b/out", "other", "."]);
    }

    #[test]
    fn addresses_are_relative_and_encoded() {
        let of = |file: &str, beside: &str| address(Path::new(file), Path::new(beside));
        assert_eq!(of("out/a/report.html", "out").as_deref(), Some("./a/report.html"));
        assert_eq!(of("a b#?%/\"é.html", "").as_deref(), Some("./a%20b%23%3F%25/%22%C3%A9.html"));
        assert_eq!(of("javascript:x/report.html", "").as_deref(), Some("./javascript%3Ax/report.html"));
        for (file, beside) in [("one/report.html", "."), ("./one/report.html", ""), ("a/../one/report.html", "a/..")] {
            assert_eq!(of(file, beside).as_deref(), Some("./one/report.html"), "{file} {beside}");
        }
        let here = std::env::current_dir().unwrap().join("one/report.html");
        assert_eq!(of(here.to_str().unwrap(), "").as_deref(), Some("./one/report.html"));
        assert_eq!((of("../a/report.html", ""), of("/a/report.html", "b")), (None, None));
    }

    #[test]
    fn reports_faults_by_folder() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        write("old/result.json", "{\"format\": \"gonio-result\"}");
        write("old/relit.png", "no picture");
        write("broken/result.json", "{");
        write("other/result.json", "{\"format\": \"gonio-export\"}");
        write(
            "regions/result.json",
            "{\"format\": \"gonio-regions\", \"regions\": [{\"folder\": \"1\"}, {\"folder\": \"../old\"}]}",
        );
        write("regions/1/result.json", "{\"format\": \"gonio-result\"}");
        let given = |name: &str| ComparedFolder { name: name.into(), folder: dir.path().join(name), failed: None };
        let failed = ComparedFolder { failed: Some("no photograph".into()), ..given("failed") };
        let all = ["old", "broken", "other", "regions", "missing"].map(given);
        let comparison = read(&[&all[..], &[failed]].concat(), &dir.path().join(PAGE));
        assert_eq!(comparison.count(), 6);
        let page = comparison.render();
        for text in [
            "relit.png: does not have the header of",
            "old: does not contain brdf.npz",
            "broken/result.json: is not valid JSON",
            "other/result.json: is not a result of gonio infer",
            "regions/1",
            "no photograph",
        ] {
            assert!(page.contains(text), "{text}");
        }
        let is_fine =
            ["old", "broken", "other", "regions", "missing"].map(|name| check(&dir.path().join(name)).is_ok());
        assert_eq!(is_fine, [true, false, false, true, false]);
        write("page.html", &page);
        write("mine.html", "<!DOCTYPE html><title>mine</title>");
        let ours = ["page.html", "mine.html", "none.html"].map(|name| is_page(&dir.path().join(name)));
        assert_eq!(ours, [true, false, false]);
    }
}
