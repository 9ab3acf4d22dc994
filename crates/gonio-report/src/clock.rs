//! How long the stages of an estimate take.

use std::sync::Mutex;
use std::time::Instant;

use gonio::estimate::Stage;

/// When each stage began, of those that [`estimate`](gonio::estimate::estimate) told of.
#[derive(Default)]
pub struct StageClock(Mutex<Vec<(Stage, Instant)>>);

impl StageClock {
    /// A stage begins, and with it the one before ends, which is given back.
    pub fn begin(&self, stage: Stage) -> Option<Stage> {
        let mut begun = self.0.lock().ok()?;
        let last = begun.last().map(|(last, _)| *last);
        begun.push((stage, Instant::now()));
        last
    }

    /// The last stage ends: the seconds of each, by [`Stage::name`].
    pub fn finish(self) -> Vec<(&'static str, f64)> {
        let end = Instant::now();
        let begun = self.0.into_inner().unwrap_or_default();
        let ends = begun.iter().skip(1).map(|(_, begin)| *begin).chain([end]);
        begun.iter().zip(ends).map(|((stage, begin), end)| (stage.name(), (end - *begin).as_secs_f64())).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_stage_ends_where_the_next_begins() {
        let clock = StageClock::default();
        assert_eq!(clock.begin(Stage::Material), None);
        assert_eq!(clock.begin(Stage::Transfer), Some(Stage::Material));
        let seconds = clock.finish();
        assert_eq!(seconds.iter().map(|s| s.0).collect::<Vec<_>>(), ["posterior", "transfer"]);
        assert!(seconds.iter().all(|s| s.1 >= 0.0));
        assert!(StageClock::default().finish().is_empty());
    }
}
