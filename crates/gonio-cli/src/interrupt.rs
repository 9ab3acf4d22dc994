//! Handles SIGINT and SIGTERM: removes unfinished output, then exits.

#[cfg(unix)]
use signal_hook::consts::{SIGINT, SIGTERM};

/// Installs the signal handlers. The first signal removes unfinished output and then ends the
/// program by the default action; a second signal ends it at once. On systems without signals, the
/// next run removes unfinished output.
pub(crate) fn watch() {
    #[cfg(unix)]
    if let Ok(mut signals) = signal_hook::iterator::Signals::new([SIGINT, SIGTERM]) {
        std::thread::spawn(move || {
            let mut received = signals.forever();
            if let Some(signal) = received.next() {
                std::thread::spawn(move || {
                    gonio_io::atomic::abandon();
                    end(signal);
                });
            }
            if let Some(signal) = received.next() {
                end(signal);
            }
        });
    }
}

/// Ends the program by the signal, so that a shell loop that runs the program ends, too.
#[cfg(unix)]
fn end(signal: i32) {
    let _ = signal_hook::low_level::emulate_default_handler(signal);
    std::process::exit(128 + signal);
}
