//! Progress of a run: a bar with the time left on a terminal, lines at intervals elsewhere.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressStyle};

/// Progress over a number of equal steps.
pub(crate) struct Progress {
    bar: ProgressBar,
    name: &'static str,
    total: usize,
    start: Instant,
    /// Steps done, and the time at which the last line was printed.
    lines: Mutex<(usize, Instant)>,
}

/// Time between lines if standard error is not a terminal.
const PAUSE: Duration = Duration::from_secs(20);

impl Progress {
    pub(crate) fn new(name: &'static str, total: usize) -> Self {
        let bar = ProgressBar::new(total as u64);
        let style = ProgressStyle::with_template("{msg:24} [{bar:40}] {pos}/{len}  {eta} left");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> "));
        bar.set_message(name);
        let now = Instant::now();
        Self { bar, name, total, start: now, lines: Mutex::new((0, now)) }
    }

    /// Counts one more step as done.
    pub(crate) fn step(&self) {
        self.bar.inc(1);
        let mut lines = self.lines.lock().expect("nothing panics while it is locked");
        lines.0 += 1;
        if self.bar.is_hidden() && lines.1.elapsed() >= PAUSE {
            lines.1 = Instant::now();
            let left = self.start.elapsed().mul_f64((self.total - lines.0.min(self.total)) as f64 / lines.0 as f64);
            eprintln!("{}: {} of {}, {} left", self.name, lines.0, self.total, HumanDuration(left));
        }
    }

    /// Removes the bar and prints the time taken.
    pub(crate) fn finish(self) {
        self.bar.finish_and_clear();
        if self.total > 0 {
            eprintln!("{}: {} in {:.0} s", self.name, self.total, self.start.elapsed().as_secs_f64());
        }
    }
}
