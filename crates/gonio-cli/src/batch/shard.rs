//! Assigns rows to shards.

use anyhow::{Context, Result, bail};

/// Every `count`-th row, starting with row `index`, counted from zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shard {
    index: usize,
    count: usize,
}

impl Shard {
    /// Whether a row, counted from zero, belongs to the shard.
    pub(super) fn has(self, row: usize) -> bool {
        row % self.count == self.index
    }
}

/// Parses `I/N`, where I counts from one.
pub(super) fn parse(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse::<usize>().ok()?, n.parse::<usize>().ok()?)));
    match parts {
        Some((i, n)) if (1..=n).contains(&i) => Ok(Shard { index: i - 1, count: n }),
        _ => Err("expected I/N with I from 1 to N, such as 3/10".into()),
    }
}

/// Returns the shard of the current Slurm array task; `None` outside of Slurm arrays.
pub(super) fn of_slurm() -> Result<Option<Shard>> {
    of_variables(|name| std::env::var(name).ok())
}

fn of_variables(variable: impl Fn(&str) -> Option<String>) -> Result<Option<Shard>> {
    let number = |name: &str| {
        variable(name)
            .map(|value| {
                value
                    .trim()
                    .parse::<usize>()
                    .ok()
                    .with_context(|| format!("{name}={value}: is not a number; specify --shard I/N"))
            })
            .transpose()
    };
    let Some(id) = number("SLURM_ARRAY_TASK_ID")? else { return Ok(None) };
    let (Some(low), Some(count)) = (number("SLURM_ARRAY_TASK_MIN")?, number("SLURM_ARRAY_TASK_COUNT")?) else {
        bail!(
            "SLURM_ARRAY_TASK_ID is set, but SLURM_ARRAY_TASK_MIN or SLURM_ARRAY_TASK_COUNT is not; specify --shard I/N"
        );
    };
    let step = number("SLURM_ARRAY_TASK_STEP")?.unwrap_or(1).max(1);
    let index = id.checked_sub(low).map(|d| d / step).filter(|i| *i < count && (id - low).is_multiple_of(step));
    match index {
        Some(index) => Ok(Some(Shard { index, count })),
        None => bail!(
            "Slurm task {id} is not in the array of {count} tasks from {low} in steps of {step}; for arrays with gaps, specify --shard I/N"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_belongs_to_one_shard() {
        assert_eq!(parse("2/3"), Ok(Shard { index: 1, count: 3 }));
        let owners = |row: usize| (1..=3).filter(|i| parse(&format!("{i}/3")).unwrap().has(row)).count();
        assert!((0..20).all(|row| owners(row) == 1));
        for wrong in ["", "0/3", "4/3", "1", "1/0", "a/b", "-1/2"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn reads_the_shard_from_slurm_variables() {
        let of = |variables: &[(&str, &str)]| {
            of_variables(|name| variables.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned()))
        };
        let (id, min, count, step) =
            ("SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_MIN", "SLURM_ARRAY_TASK_COUNT", "SLURM_ARRAY_TASK_STEP");
        assert_eq!(of(&[]).unwrap(), None);
        assert_eq!(of(&[(id, "3"), (min, "1"), (count, "4")]).unwrap(), Some(Shard { index: 2, count: 4 }));
        assert_eq!(
            of(&[(id, "8"), (min, "4"), (count, "3"), (step, "4")]).unwrap(),
            Some(Shard { index: 1, count: 3 })
        );
        for wrong in [
            &[(id, "3")][..],
            &[(id, "x"), (min, "1"), (count, "4")],
            &[(id, "9"), (min, "1"), (count, "4")],
            &[(id, "5"), (min, "4"), (count, "3"), (step, "4")],
        ] {
            assert!(of(wrong).is_err(), "{wrong:?}");
        }
    }
}
