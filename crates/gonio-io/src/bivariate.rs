//! Sets of bivariate BRDF tables: a folder with `bivariate_rgb_f32.npy` and `materials.txt`.

use std::path::Path;

use gonio::reflectance::{BivariateTable, CELLS, THETA_D, THETA_H};

use crate::{Error, guard, npy};

/// Name of the array of shape (materials, `theta_h`, `theta_d`, RGB) in 1/sr.
const TABLES: &str = "bivariate_rgb_f32.npy";
/// Name of the list of materials, one name per line, in the order of the array.
const NAMES: &str = "materials.txt";

/// Reads all materials of a folder, in the order of `materials.txt`. A material has a name and
/// tables of red, green and blue in 1/sr.
///
/// # Errors
/// If a file cannot be read, the shape of the array is not (number of names, 90, 90, 3), a name
/// occurs twice, or values are negative or not finite.
pub fn read_bivariate_set(dir: impl AsRef<Path>) -> Result<Vec<(String, [BivariateTable; 3])>, Error> {
    let (names_path, path) = (dir.as_ref().join(NAMES), dir.as_ref().join(TABLES));
    let names = read_names(&names_path)?;
    let array = npy::read(&path)?;
    if array.shape[..] != [names.len(), THETA_H, THETA_D, 3] {
        let expected = format!("({}, {THETA_H}, {THETA_D}, 3)", names.len());
        let problem = format!("has the shape {:?}, but {NAMES} requires {expected}", array.shape);
        return Err(Error::invalid(&path, problem, "use matching files"));
    }
    let is_bad = |v: &f32| !(v.is_finite() && *v >= 0.0);
    let bad = array.values.iter().filter(|v| is_bad(v)).count();
    if let Some(first) = array.values.iter().position(is_bad) {
        let name = &names[first / (3 * CELLS)];
        let problem = format!("has {bad} values that are negative or not finite, the first in {name}");
        return Err(Error::damaged(&path, problem));
    }
    let tables = array.values.chunks_exact(3 * CELLS).map(|material| {
        [0, 1, 2].map(|c| BivariateTable::from_vec(material.chunks_exact(3).map(|rgb| rgb[c]).collect()))
    });
    Ok(names.into_iter().zip(tables).collect())
}

fn read_names(path: &Path) -> Result<Vec<String>, Error> {
    let bytes = guard::read_whole(path, 1 << 20)?;
    let text = String::from_utf8(bytes).map_err(|_| Error::damaged(path, "is not UTF-8 text"))?;
    let names: Vec<String> = text.lines().map(str::trim).filter(|l| !l.is_empty()).map(str::to_owned).collect();
    let mut sorted: Vec<_> = names.iter().collect();
    sorted.sort();
    if let Some(twice) = sorted.windows(2).find(|w| w[0] == w[1]) {
        return Err(Error::invalid(
            path,
            format!("contains the name {} twice", twice[0]),
            "use a unique name for each material",
        ));
    }
    if names.is_empty() {
        return Err(Error::invalid(path, "contains no material names", "write one name per line"));
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    fn folder(names: &str, shape: [usize; 4], poison: Option<usize>) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        let mut values: Vec<f32> = (0..shape.iter().product()).map(|i| i as f32).collect();
        if let Some(at) = poison {
            values[at] = f32::NAN;
        }
        std::fs::write(dir.path().join(NAMES), names).unwrap();
        std::fs::write(dir.path().join(TABLES), npy::encode(&npy::Array { shape: shape.to_vec(), values })).unwrap();
        dir
    }

    #[test]
    fn axes_and_names_are_in_order() {
        let dir = folder("a\nb\n", [2, 90, 90, 3], None);
        let set = read_bivariate_set(dir.path()).unwrap();
        assert_eq!(set[1].0, "b");
        assert_eq!(set[1].1[2].cell(3, 4), (((90 + 3) * 90 + 4) * 3 + 2) as f32);
    }

    #[test]
    fn rejects_inconsistent_sets() {
        for (names, shape, poison, kind, message) in [
            ("a\n", [2, 90, 90, 3], None, Kind::Invalid, "(1, 90, 90, 3)"),
            ("a\nb\n", [2, 90, 89, 3], None, Kind::Invalid, "shape"),
            ("a\nb\n", [2, 90, 90, 3], Some(30_000), Kind::Damaged, "the first in b"),
            ("a\na\n", [2, 90, 90, 3], None, Kind::Invalid, "twice"),
            ("\n", [1, 90, 90, 3], None, Kind::Invalid, "no material"),
        ] {
            let error = read_bivariate_set(folder(names, shape, poison).path()).unwrap_err();
            assert!(error.kind() == kind && error.to_string().contains(message), "{error}");
        }
        assert_eq!(read_bivariate_set("/nonexistent").unwrap_err().kind(), Kind::Io);
    }
}
