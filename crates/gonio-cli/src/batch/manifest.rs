//! Reads the table of a batch.

use std::any::TypeId;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::{Arg, Command, CommandFactory};
use gonio_app::compare::PAGE;
use gonio_io::table::Table;

use super::{OUTCOMES, TABLE};
use crate::Args;
use crate::help::is_picture;

/// A row of the table: one run of `gonio infer`.
#[derive(Debug)]
pub(super) struct Row {
    pub(super) name: String,
    pub(super) folder: PathBuf,
    /// Arguments after `gonio infer`.
    pub(super) arguments: Vec<String>,
}

/// Meaning of a column.
enum Column {
    Name,
    /// Files, separated by semicolons.
    Image,
    /// Option name, whether it takes a value, and whether the value is a file.
    Option {
        flag: String,
        takes_value: bool,
        is_file: bool,
    },
}

impl Column {
    /// Returns the column with a header, which may be the name of an option of `gonio infer`.
    fn of(header: &str, path: &Path, infer: &Command) -> Result<Self> {
        let key = header.trim().trim_start_matches("--").replace('_', "-");
        match key.as_str() {
            "name" => return Ok(Self::Name),
            "image" => return Ok(Self::Image),
            "output" => {
                bail!(
                    "{}: column \"output\" is not supported; set the folders with -o DIR and column \"name\"",
                    path.display()
                )
            }
            _ => (),
        }
        let named = |arg: &Arg| {
            arg.get_long() == Some(&key) || arg.get_all_aliases().is_some_and(|all| all.contains(&key.as_str()))
        };
        let found = infer.get_arguments().find(|arg| named(arg) && !arg.is_global_set());
        let Some(arg) = found.filter(|_| !matches!(key.as_str(), "help" | "json")) else {
            bail!(
                "{}: column \"{}\" is not an option of gonio infer; use \"image\", \"name\" or a long option",
                path.display(),
                header.trim()
            );
        };
        Ok(Self::Option {
            flag: format!("--{key}"),
            takes_value: arg.get_action().takes_values(),
            // A response is a file or the name of a curve.
            is_file: arg.get_value_parser().type_id() == TypeId::of::<PathBuf>() || key == "response",
        })
    }
}

/// Reads a table; results go to folders below `output`.
pub(super) fn read(path: &Path, output: &Path) -> Result<Vec<Row>> {
    let shown = path.display();
    let table = Table::read(path)?;
    let mut program = Args::command();
    program.build();
    let infer = program.find_subcommand("infer").context("the command infer does not exist")?;
    let columns: Vec<Column> = table.columns.iter().map(|h| Column::of(h, path, infer)).collect::<Result<_>>()?;
    if !columns.iter().any(|c| matches!(c, Column::Image)) {
        bail!("{shown}: the table has no column \"image\"; add one with the file names of the photographs");
    }
    let base = path.parent().unwrap_or(Path::new(""));
    let (mut rows, mut names) = (Vec::new(), BTreeSet::new());
    for (n, cells) in table.rows.iter().enumerate() {
        let row = row(&columns, cells, base, output).with_context(|| format!("{shown}: row {}", n + 1))?;
        if !names.insert(row.name.clone()) {
            bail!("{shown}: row {}: duplicate name {}; add a column \"name\" with unique names", n + 1, row.name);
        }
        rows.push(row);
    }
    Ok(rows)
}

/// Returns one row per photograph, named after its file.
pub(super) fn of_images(images: &[PathBuf], output: &Path) -> Result<Vec<Row>> {
    let mut names = BTreeSet::new();
    let mut rows = Vec::new();
    for image in images {
        let shown = image.display();
        if !is_picture(image) {
            bail!("{shown}: the extension is not that of an image; specify either photographs or one table");
        }
        let row =
            row(&[Column::Image], &[shown.to_string()], Path::new(""), output).with_context(|| format!("{shown}"))?;
        if !names.insert(row.name.clone()) {
            bail!("{shown}: another photograph is also named {}; use a table with a column \"name\"", row.name);
        }
        rows.push(row);
    }
    Ok(rows)
}

fn row(columns: &[Column], cells: &[String], base: &Path, output: &Path) -> Result<Row> {
    let (mut name, mut images, mut arguments) = (None, Vec::new(), Vec::new());
    for (column, cell) in columns.iter().zip(cells).filter(|(_, cell)| !cell.is_empty()) {
        match column {
            Column::Name => name = Some(cell.to_owned()),
            Column::Image => images.extend(cell.split(';').map(|file| beside(base, file.trim()))),
            Column::Option { flag, takes_value: true, is_file } => {
                let value = if *is_file { beside(base, cell) } else { cell.to_owned() };
                // One argument, because values may start with a minus sign.
                arguments.push(format!("{flag}={value}"));
            }
            Column::Option { flag, .. } => match cell.to_ascii_lowercase().as_str() {
                "yes" | "true" | "1" => arguments.push(flag.clone()),
                "no" | "false" | "0" => (),
                _ => bail!("{flag}: invalid value {cell}; use yes or no"),
            },
        }
    }
    let Some(first) = images.first() else { bail!("the cell of column \"image\" is empty; specify a photograph") };
    let of_image = || Path::new(first).file_stem().map(|s| s.to_string_lossy().into_owned());
    let name = name.or_else(of_image).unwrap_or_default();
    let taken = [OUTCOMES, TABLE, PAGE];
    let plain = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.' | ' ' | '+' | '=');
    if name.is_empty() || name.starts_with('.') || taken.contains(&name.as_str()) || !name.chars().all(plain) {
        bail!("{name:?} is not a valid folder name; use letters, digits, -, _ and .");
    }
    let folder = output.join(&name);
    arguments.push(format!("--output={}", folder.display()));
    arguments.push("--".to_owned());
    arguments.extend(images);
    Ok(Row { name, folder, arguments })
}

/// Resolves a file of the table, relative to the table first.
fn beside(base: &Path, file: &str) -> String {
    let there = base.join(file);
    if there.exists() { there.display().to_string() } else { file.to_owned() }
}
