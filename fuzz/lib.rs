//! Setup shared by the targets.

/// Removes the hook of libFuzzer that ends the process at any panic, so that panics of third-party
/// decoders reach `gonio-io`, which catches them. A panic that escapes from a reader still ends the
/// process.
pub fn let_guards_catch() {
    std::panic::set_hook(Box::new(|_| {}));
}
