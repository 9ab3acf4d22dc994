//! CSV tables (RFC 4180).

use std::path::Path;

use crate::Error;
use crate::guard::read_whole;

/// Longest file, in bytes.
const MAX_BYTES: u64 = 1 << 28;

/// Largest number of rows.
pub const MAX_ROWS: usize = 1_000_000;

/// Largest number of columns.
const MAX_COLUMNS: usize = 1000;

const ADVICE: &str = "use a table with commas and a header line";

/// A table of text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Rows with one cell per column, without surrounding white space.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// Reads a table. Lines that begin with `#` and white space around cells are ignored.
    ///
    /// # Errors
    /// If the file cannot be read, is not UTF-8 text, has rows of different lengths, has no rows,
    /// or has more than 1000 columns or [`MAX_ROWS`] rows.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        Self::decode(path, &read_whole(path, MAX_BYTES)?)
    }

    /// Decodes a table held in memory; `path` is only used in error messages.
    ///
    /// # Errors
    /// Like [`Table::read`].
    pub fn decode(path: &Path, bytes: &[u8]) -> Result<Self, Error> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(bytes);
        let wrong = |what: &str, error: &csv::Error| Error::invalid(path, format!("{what}: {error}"), ADVICE);
        let columns = reader.headers().map_err(|e| wrong("has no header line", &e))?;
        if columns.len() > MAX_COLUMNS {
            return Err(Error::limits(path, format!("has more than {MAX_COLUMNS} columns"), ADVICE));
        }
        let columns: Vec<String> = columns.iter().map(str::to_owned).collect();
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(|e| wrong(&format!("row {} cannot be read", rows.len() + 1), &e))?;
            if rows.len() == MAX_ROWS {
                return Err(Error::limits(path, format!("has more than {MAX_ROWS} rows"), "split the table"));
            }
            rows.push(record.iter().map(str::to_owned).collect());
        }
        if rows.is_empty() {
            return Err(Error::invalid(path, "has no rows", ADVICE));
        }
        Ok(Self { columns, rows })
    }

    /// Encodes the table. Cells that a spreadsheet would evaluate as formulas get a leading
    /// apostrophe, which marks text; numbers are not changed.
    pub fn encode(&self) -> Vec<u8> {
        let mut writer = csv::WriterBuilder::new().flexible(true).comment(Some(b'#')).from_writer(Vec::new());
        for row in std::iter::once(&self.columns).chain(&self.rows) {
            // Writing to memory cannot fail.
            let _ = writer.write_record(row.iter().map(|cell| inert(cell)));
        }
        writer.into_inner().unwrap_or_default()
    }
}

/// Returns the cell, with a leading apostrophe if a spreadsheet would evaluate it.
fn inert(cell: &str) -> String {
    // Spreadsheets ignore leading white space before they detect formulas.
    let begins = cell.trim_start().starts_with(['=', '+', '-', '@', '\t', '\r', '＝', '＋', '－', '＠']);
    let runs = begins || cell.starts_with(['\t', '\r', '\n']);
    if runs && cell.parse::<f64>().is_err() { format!("'{cell}") } else { cell.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Kind;

    fn decode(text: &str) -> Result<Table, Error> {
        Table::decode(Path::new("list.csv"), text.as_bytes())
    }

    #[test]
    fn tables_round_trip() {
        let table = decode("name, image\n# a remark\none ,\"a,b.exr\"\n\"say \"\"x\"\"\",\n").unwrap();
        assert_eq!(table.columns, ["name", "image"]);
        assert_eq!(table.rows, [["one", "a,b.exr"], ["say \"x\"", ""]]);
        assert_eq!(Table::decode(Path::new("t"), &table.encode()).unwrap(), table);
    }

    #[test]
    fn formulas_become_text() {
        for formula in [
            "=1+1",
            "+cmd|' /C calc'!A0",
            "-2+3",
            "@SUM(A1)",
            "\t=1",
            "\r=1",
            "\n=1",
            " =1",
            "＝1+1",
            "=HYPERLINK(\"http://x\")",
        ] {
            assert_eq!(inert(formula), format!("'{formula}"));
        }
        for plain in ["", "-1.5", "+2", "1e-3", "-inf", "a=b", "ball-1.exr", "'x"] {
            assert_eq!(inert(plain), plain);
        }
        let table = Table { columns: vec!["name".into()], rows: vec![vec!["=a\",\"b".into()]] };
        assert_eq!(String::from_utf8(table.encode()).unwrap(), "name\n\"'=a\"\",\"\"b\"\n");
    }

    #[test]
    fn invalid_tables_are_rejected() {
        let wide = format!("{}\n1\n", "a,".repeat(MAX_COLUMNS + 1));
        let long = format!("a\n{}", "1\n".repeat(MAX_ROWS + 1));
        for (text, kind, message) in [
            ("", Kind::Invalid, "has no rows"),
            ("a,b\n", Kind::Invalid, "has no rows"),
            ("a,b\n1,2,3\n", Kind::Invalid, "row 1 cannot be read"),
            (&wide, Kind::Limits, "more than 1000 columns"),
            (&long, Kind::Limits, "more than 1000000 rows"),
        ] {
            let error = decode(text).unwrap_err();
            assert!(error.kind() == kind && error.to_string().contains(message), "{error}");
        }
        assert!(Table::decode(Path::new("t"), b"a\n\xff\n").is_err());
    }
}
