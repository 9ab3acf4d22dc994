//! Being told to end, by Ctrl-C or `kill`: what is unfinished goes first.

#[cfg(unix)]
use signal_hook::consts::{SIGINT, SIGTERM};

/// Removes what is unfinished when the program is told to end, and ends it then as if nobody had
/// listened; told a second time, it ends at once. On systems without signals the next run removes
/// what was left.
pub(crate) fn watch() {
    #[cfg(unix)]
    if let Ok(mut signals) = signal_hook::iterator::Signals::new([SIGINT, SIGTERM]) {
        std::thread::spawn(move || {
            let mut told = signals.forever();
            if let Some(signal) = told.next() {
                std::thread::spawn(move || {
                    gonio_io::atomic::abandon();
                    end(signal);
                });
            }
            if let Some(signal) = told.next() {
                end(signal);
            }
        });
    }
}

/// Ends the program by the signal, so that a shell that runs it in a loop ends the loop, too.
#[cfg(unix)]
fn end(signal: i32) {
    let _ = signal_hook::low_level::emulate_default_handler(signal);
    std::process::exit(128 + signal);
}
