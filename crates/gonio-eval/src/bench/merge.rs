//! `gonio-eval merge`: merges the output folders of an array of jobs into one report.

use std::path::PathBuf;

use anyhow::{Result, bail};

use super::report;
use super::store::Store;

/// Options of `gonio-eval merge`.
#[derive(clap::Args)]
pub(crate) struct MergeOptions {
    /// Output folders of `gonio-eval bench --shard`
    #[arg(required = true)]
    folders: Vec<PathBuf>,
    /// Output folder of the merged results
    #[arg(short, long)]
    output: PathBuf,
}

/// Copies the finished cells of all folders into one and writes the report.
pub(crate) fn merge(options: &MergeOptions) -> Result<()> {
    let conditions = Store::conditions(&options.folders[0])?;
    for folder in &options.folders[1..] {
        if Store::conditions(folder)? != conditions {
            let first = options.folders[0].display();
            bail!("{}: ran under other conditions than {first} (see conditions.json in both)", folder.display());
        }
    }
    let whole = Store::open(&options.output, &conditions)?;
    let mut records = whole.records()?;
    for folder in &options.folders {
        for (at, record) in Store::open(folder, &conditions)?.records()? {
            match records.get(&at) {
                Some(there) if there.key == record.key => {}
                Some(_) => bail!(
                    "{}: {} was computed from other data than in the preceding folders",
                    folder.display(),
                    record.file()
                ),
                None => {
                    whole.put(&record)?;
                    records.insert(at, record);
                }
            }
        }
    }
    eprintln!("{} cells", records.len());
    report::write(&options.output, &conditions, &records)
}
