//! Comparison of results.

use std::path::{Path, PathBuf};

use gonio::reflectance::BivariateTable;
use gonio_app::AppError;
use gonio_app::compare::{ComparedFolder, check, entries as entries_of};
use gonio_io::result::{ResultDocument, ResultFile, decode as decode_result};
use gonio_report::compare::{Comparison, Entry, FolderContents, thumbnail};
use numpy::PyArray3;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays;
use crate::error::raise;

/// A result to compare.
#[derive(FromPyObject)]
pub(crate) enum Compared<'py> {
    /// A folder of results.
    Folder(PathBuf),
    /// Contents of `result.json`, the BRDF in colour, and an sRGB picture of a sphere of the
    /// material, with shape (height, width, 3).
    Memory(String, Bound<'py, PyArray3<f32>>, Option<Bound<'py, PyArray3<u8>>>),
}

/// Compares named results. Returns the pairs of results, the HTML page, and the number of results.
#[pyfunction]
pub(crate) fn compare(
    py: Python<'_>,
    given: Vec<(String, Compared<'_>)>,
) -> PyResult<(Vec<Py<PyDict>>, String, usize)> {
    let fail = |error: AppError| raise(&error, py);
    let (mut entries, mut folders) = (Vec::new(), Vec::new());
    for (name, compared) in given {
        match compared {
            Compared::Folder(folder) => {
                check(&folder).map_err(fail)?;
                folders.push((entries.len(), ComparedFolder { name, folder, failed: None }));
            }
            Compared::Memory(document, table, sphere) => {
                let result = document_of(&name, &document).map_err(fail)?;
                let table = BivariateTable::luminance(&arrays::tables(&table)?);
                let sphere = sphere.map(|picture| arrays::decoded(&picture)).transpose()?;
                let sphere = sphere.map(|picture| thumbnail(&picture));
                let contents = FolderContents { result, sphere, table: Some(table), ..FolderContents::default() };
                entries.push(Entry { name, report: None, contents: Ok(contents) });
            }
        }
    }
    let comparison = py.detach(|| {
        // From the last folder to the first, so that earlier positions stay valid.
        for (at, folder) in folders.into_iter().rev() {
            // The page may be written anywhere, so it has no links to reports.
            let read = entries_of(&[folder], Path::new("")).into_iter().map(|entry| Entry { report: None, ..entry });
            entries.splice(at..at, read);
        }
        Comparison::of(entries)
    });
    let pairs = comparison.pairs.iter().map(|pair| {
        let out = PyDict::new(py);
        out.set_item("of", comparison.names(pair))?;
        out.set_item("agreement", pair.agreement.word())?;
        out.set_item("distance", pair.distance)?;
        out.set_item("sentence", &pair.sentence)?;
        Ok(out.unbind())
    });
    Ok((pairs.collect::<PyResult<_>>()?, comparison.render(), comparison.count()))
}

fn document_of(name: &str, document: &str) -> Result<ResultDocument, AppError> {
    match decode_result(Path::new(name), document.as_bytes())? {
        ResultFile::Material(document) => Ok(*document),
        ResultFile::Regions(_) => Err(AppError::of(name, "contains several regions; compare each region")),
    }
}
