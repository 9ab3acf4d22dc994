//! Records panics instead of printing them.
//!
//! Third-party decoders panic on damaged files. `gonio-io` catches these panics and reports errors
//! of one line.

use std::panic::set_hook;
use std::sync::Mutex;

/// Message of the last panic.
static MESSAGE: Mutex<String> = Mutex::new(String::new());

/// Sets a panic hook that records the message and prints nothing.
pub fn record() {
    set_hook(Box::new(|panic| {
        if let Ok(mut message) = MESSAGE.lock() {
            *message = panic.to_string();
        }
    }));
}

/// Returns the message of the last panic.
pub fn message() -> String {
    MESSAGE.lock().map(|message| message.clone()).unwrap_or_default()
}
