//! Setup shared by the targets.

use std::fs;
use std::path::{Path, PathBuf};

/// Removes the hook of libFuzzer that ends the process at any panic, so that panics of third-party
/// decoders reach `gonio-io`, which catches them. A panic that escapes from a reader still ends the
/// process.
pub fn let_guards_catch() {
    std::panic::set_hook(Box::new(|_| {}));
}

/// A folder of this process in memory, empty, for readers of folders.
pub struct Scratch(PathBuf);

impl Scratch {
    /// Makes the folder; `name` tells it from others of the process.
    ///
    /// # Panics
    /// If it cannot be made.
    pub fn folder(name: &str) -> Self {
        let memory = Path::new("/dev/shm");
        let parent = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let folder = parent.join(format!("gonio-fuzz-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}
