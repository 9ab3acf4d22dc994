//! Setup shared by the targets.

use std::fs;
use std::path::{Path, PathBuf};

/// Removes the hook of libFuzzer that aborts the process at any panic. Panics of third-party
/// decoders then reach `gonio-io`, which catches them. A panic that escapes from a reader still
/// aborts the process.
pub fn let_guards_catch() {
    std::panic::set_hook(Box::new(|_| {}));
}

/// An empty folder in memory for readers of folders, unique to this process.
pub struct Scratch(PathBuf);

impl Scratch {
    /// Creates the folder; `name` distinguishes it from other folders of the process.
    ///
    /// # Panics
    /// If it cannot be created.
    pub fn folder(name: &str) -> Self {
        let memory = Path::new("/dev/shm");
        let parent = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let folder = parent.join(format!("gonio-fuzz-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    /// Returns the path of the folder.
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}
