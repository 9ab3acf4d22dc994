//! Bars on standard error for work that takes longer than a second.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Progress of one stage; silent during its first second and where standard error is no terminal.
pub(crate) struct Stage {
    bar: ProgressBar,
    start: Instant,
}

/// Steps of a bar.
const STEPS: u64 = 1000;

impl Stage {
    pub(crate) fn new(name: &'static str) -> Self {
        let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::hidden());
        let style = ProgressStyle::with_template("{msg:28} [{bar:40}] {percent:>3} %  {eta} left");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> "));
        bar.set_message(name);
        Self { bar, start: Instant::now() }
    }

    /// Tells that a fraction (0..=1) of the stage is done.
    pub(crate) fn at(&self, fraction: f64) {
        if self.bar.is_hidden() && self.start.elapsed() > Duration::from_secs(1) {
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
        let position = (fraction.clamp(0.0, 1.0) * STEPS as f64) as u64;
        // Several threads report: the bar never goes back.
        self.bar.set_position(position.max(self.bar.position()));
    }

    /// Takes the bar away and says how long the stage took, in seconds.
    pub(crate) fn finish(self) -> f64 {
        self.bar.finish_and_clear();
        self.start.elapsed().as_secs_f64()
    }
}

/// Bars of stages that follow each other.
#[derive(Default)]
pub(crate) struct Bars(Mutex<Option<(&'static str, Stage)>>);

impl Bars {
    /// Tells that a fraction (0..=1) of a stage is done; a stage that is told of for the first time
    /// takes the place of the one before.
    pub(crate) fn at(&self, stage: &'static str, fraction: f64) {
        let Ok(mut on) = self.0.lock() else { return };
        if on.as_ref().is_none_or(|(name, _)| *name != stage) {
            if let Some((_, before)) = on.take() {
                before.finish();
            }
            *on = Some((stage, Stage::new(stage)));
        }
        if let Some((_, bar)) = &*on {
            bar.at(fraction);
        }
    }

    /// Takes the last bar away.
    pub(crate) fn finish(&self) {
        if let Some((_, last)) = self.0.lock().ok().and_then(|mut on| on.take()) {
            last.finish();
        }
    }
}
