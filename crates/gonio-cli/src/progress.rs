//! Shows progress in a line on standard error.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Number of steps of a bar. A running stage fills at most 99 % of them.
const BAR_STEPS: u64 = 1000;

/// Time after which the line appears; shorter stages show no line.
const PATIENCE: Duration = Duration::from_millis(200);

/// Time between two frames of the spinner.
const TICK: Duration = Duration::from_millis(100);

/// Templates of the line before and after the stage reports a fraction.
const WITHOUT_BAR: &str = "{spinner} {msg} {elapsed}";
const WITH_BAR: &str = "{spinner} {msg} {elapsed} [{bar:30}] {percent:>2} %";

/// Amount of output besides the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Verbosity {
    /// Errors only.
    Quiet,
    /// Warnings and progress as well.
    Usual,
    /// Also the duration of each stage.
    Verbose,
}

static VERBOSITY: OnceLock<Verbosity> = OnceLock::new();

/// Sets the amount of output, once.
pub(crate) fn set_verbosity(verbosity: Verbosity) {
    // The first call takes effect.
    let _ = VERBOSITY.set(verbosity);
}

fn verbosity() -> Verbosity {
    VERBOSITY.get().copied().unwrap_or(Verbosity::Usual)
}

pub(crate) fn is_quiet() -> bool {
    verbosity() == Verbosity::Quiet
}

pub(crate) fn is_verbose() -> bool {
    verbosity() == Verbosity::Verbose
}

/// Whether several inferences run at a time, whose progress lines would overwrite each other.
static SHARED: AtomicBool = AtomicBool::new(false);

/// Disables progress lines if several inferences share the terminal, and enables them otherwise.
pub(crate) fn share_terminal(shared: bool) {
    SHARED.store(shared, Ordering::Relaxed);
}

/// Progress line of successive stages. Hidden at first, and if standard error is not a terminal.
pub(crate) struct ProgressLine {
    bar: ProgressBar,
    /// The present stage and its start.
    now: Mutex<(&'static str, Instant)>,
}

impl ProgressLine {
    /// Starts with a stage.
    pub(crate) fn new(first: &'static str) -> Self {
        let bar = ProgressBar::with_draw_target(Some(BAR_STEPS), ProgressDrawTarget::hidden());
        bar.set_style(style(WITHOUT_BAR));
        bar.set_message(first);
        // The line appears even if the stage reports no progress.
        let line = bar.downgrade();
        thread::spawn(move || {
            thread::sleep(PATIENCE);
            if let Some(bar) =
                line.upgrade().filter(|bar| !bar.is_finished() && !is_quiet() && !SHARED.load(Ordering::Relaxed))
            {
                bar.set_draw_target(ProgressDrawTarget::stderr());
                bar.enable_steady_tick(TICK);
            }
        });
        Self { bar, now: Mutex::new((first, Instant::now())) }
    }

    /// Reports that a fraction (0..=1) of a stage is complete. The first report of a stage ends the
    /// previous stage.
    pub(crate) fn report(&self, stage: &'static str, fraction: f64) {
        let Ok(mut now) = self.now.lock() else { return };
        // The start of the next stage reports the end of this one.
        if fraction >= 1.0 {
            return;
        }
        if now.0 != stage {
            self.end_stage(*now);
            *now = (stage, Instant::now());
            self.bar.set_style(style(WITHOUT_BAR));
            self.bar.set_position(0);
            self.bar.set_message(stage);
        }
        let position = ((fraction.max(0.0) * BAR_STEPS as f64) as u64).min(BAR_STEPS - BAR_STEPS / 100);
        let before = self.bar.position();
        // Several threads report, so a fraction can be smaller than the last one.
        if position > before {
            if before == 0 {
                self.bar.set_style(style(WITH_BAR));
            }
            self.bar.set_position(position);
        }
    }

    /// Removes the line.
    pub(crate) fn finish(self) {
        self.bar.finish_and_clear();
        if let Ok(now) = self.now.lock() {
            self.end_stage(*now);
        }
    }

    /// Prints the duration of a stage that ends now, if verbose.
    fn end_stage(&self, (name, start): (&'static str, Instant)) {
        if is_verbose() {
            self.bar.suspend(|| eprintln!("{name}: {:.2} s", start.elapsed().as_secs_f64()));
        }
    }
}

fn style(template: &str) -> ProgressStyle {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    style.progress_chars("=> ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bar_never_decreases_and_is_never_full() {
        let line = ProgressLine::new("drawing");
        for (fraction, position) in
            [(0.0, 0), (0.5, 500), (0.25, 500), (0.999, 990), (1.0, 990), (f64::NAN, 990), (-1.0, 990)]
        {
            line.report("drawing", fraction);
            assert_eq!(line.bar.position(), position);
        }
    }

    #[test]
    fn a_new_stage_replaces_the_previous_one() {
        let stages = ProgressLine::new("reading");
        stages.report("reading", 0.7);
        stages.report("drawing", 0.0);
        assert_eq!((stages.bar.message(), stages.bar.position()), ("drawing".to_owned(), 0));
        stages.report("reading", 1.0);
        stages.report("drawing", 0.2);
        assert_eq!((stages.bar.message(), stages.bar.position()), ("drawing".to_owned(), 200));
    }
}
