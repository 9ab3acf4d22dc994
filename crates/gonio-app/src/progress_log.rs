//! Records the progress and the duration of each stage.

use std::sync::Mutex;
use std::time::Instant;

/// Reports the progress of each stage to a front end and records the duration of each stage.
pub struct ProgressLog<'a> {
    listener: &'a (dyn Fn(&'static str, f64) + Sync),
    begun: Mutex<Vec<(&'static str, Instant)>>,
}

impl<'a> ProgressLog<'a> {
    /// Creates a log and begins its first stage. `listener` receives the name of the stage
    /// and the completed fraction of it, in 0..=1.
    pub fn new(stage: &'static str, listener: &'a (dyn Fn(&'static str, f64) + Sync)) -> Self {
        Self { listener, begun: Mutex::new(vec![(stage, Instant::now())]) }
    }

    /// Reports the completed fraction of a stage. The first report of a stage ends the one before.
    pub fn report(&self, stage: &'static str, fraction: f64) {
        let ended = self.begun.lock().ok().and_then(|mut begun| {
            let last = begun.last().map(|(last, _)| *last);
            if last == Some(stage) {
                return None;
            }
            begun.push((stage, Instant::now()));
            last
        });
        if let Some(ended) = ended {
            (self.listener)(ended, 1.0);
        }
        (self.listener)(stage, fraction);
    }

    /// Returns the seconds of each stage until now, in the order in which the stages began. Their
    /// sum is the time since [`Self::new`].
    pub fn seconds(&self) -> Vec<(&'static str, f64)> {
        let end = Instant::now();
        let begun = self.begun.lock().map(|begun| begun.clone()).unwrap_or_default();
        let ends = begun.iter().skip(1).map(|(_, begin)| *begin).chain([end]);
        let mut seconds: Vec<(&'static str, f64)> = Vec::new();
        for ((stage, begin), end) in begun.iter().zip(ends) {
            let took = (end - *begin).as_secs_f64();
            match seconds.iter_mut().find(|(known, _)| known == stage) {
                Some((_, sum)) => *sum += took,
                None => seconds.push((stage, took)),
            }
        }
        seconds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_stage_ends_where_the_next_begins() {
        let start = Instant::now();
        let heard = Mutex::new(Vec::new());
        let listener = |stage: &'static str, x: f64| heard.lock().unwrap().push((stage, x));
        let progress_log = ProgressLog::new("reading", &listener);
        progress_log.report("light", 0.0);
        progress_log.report("light", 0.5);
        progress_log.report("reading", 0.2);
        let seconds = progress_log.seconds();
        assert_eq!(seconds.iter().map(|s| s.0).collect::<Vec<_>>(), ["reading", "light"]);
        let total: f64 = seconds.iter().map(|s| s.1).sum();
        assert!(total > 0.0 && total <= start.elapsed().as_secs_f64());
        let want = [("reading", 1.0), ("light", 0.0), ("light", 0.5), ("light", 1.0), ("reading", 0.2)];
        assert_eq!(*heard.lock().unwrap(), want);
    }
}
