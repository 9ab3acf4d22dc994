//! What the targets share.

/// Removes the hook of libFuzzer that ends the process at any panic, so that those of third parties' decoders reach `gonio-io`, which catches
/// them. A panic that comes out of a reader still ends the process.
pub fn let_guards_catch() {
    std::panic::set_hook(Box::new(|_| {}));
}
