//! Registry of unfinished output, which the process removes on a signal, or the next process.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, RwLock, RwLockReadGuard};
use std::thread;
use std::time::Duration;

use super::PREFIX;

/// End of the names of hidden folders. By it they are known for ours, and removed.
pub(super) const SUFFIX: &str = ".unfinished";

/// Attempts to remove a folder that another thread is still writing to.
const ATTEMPTS: usize = 20;

/// All that is unfinished in this process.
static ALL: Mutex<Vec<Entry>> = Mutex::new(Vec::new());

/// Read by whoever writes; written to by [`abandon`], for good.
static GATE: RwLock<()> = RwLock::new(());

#[derive(Clone, Debug, PartialEq)]
enum Entry {
    File(PathBuf),
    /// A hidden folder, with all that is in it.
    Folder(PathBuf),
    /// A folder that was made on the way, if it is empty.
    Parent(PathBuf),
}

/// Something that is unfinished until this is dropped.
#[derive(Debug)]
pub(super) struct Unfinished(Entry);

impl Unfinished {
    pub(super) fn file(path: &Path) -> Self {
        Self::new(Entry::File(path.to_owned()))
    }

    pub(super) fn folder(path: &Path) -> Self {
        Self::new(Entry::Folder(path.to_owned()))
    }

    pub(super) fn parent(path: &Path) -> Self {
        Self::new(Entry::Parent(path.to_owned()))
    }

    fn new(entry: Entry) -> Self {
        ALL.lock().unwrap_or_else(PoisonError::into_inner).push(entry.clone());
        Self(entry)
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        let mut all = ALL.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = all.iter().rposition(|entry| *entry == self.0) {
            all.remove(at);
        }
    }
}

/// Keeps [`abandon`] waiting: for steps that end quickly and are not to be cut in two.
pub(super) fn writing() -> RwLockReadGuard<'static, ()> {
    GATE.read().unwrap_or_else(PoisonError::into_inner)
}

/// Removes every hidden file and folder that this process has not finished, and the folders that
/// were made for them. What is just being put into its place is finished first. Nothing can be
/// written afterwards: whoever tries waits for ever. For a process that was told to end.
pub fn abandon() {
    std::mem::forget(GATE.write().unwrap_or_else(PoisonError::into_inner));
    let all = ALL.lock().unwrap_or_else(PoisonError::into_inner).clone();
    // Parents come before what is in them.
    for entry in all.iter().rev() {
        // There is nobody left to tell that something cannot be removed.
        let _ = match entry {
            Entry::File(path) => fs::remove_file(path),
            Entry::Folder(path) => remove(path),
            Entry::Parent(path) => fs::remove_dir(path),
        };
    }
}

/// Removes a folder that another thread may be writing to.
fn remove(path: &Path) -> std::io::Result<()> {
    for _ in 1..ATTEMPTS {
        if fs::remove_dir_all(path).is_ok() || !path.exists() {
            return Ok(());
        }
        thread::sleep(Duration::from_millis(5));
    }
    fs::remove_dir_all(path)
}

/// Whose a hidden folder is.
pub(super) enum Owner {
    /// This process, as long as it holds the lock.
    Us(File),
    /// Another process.
    Another,
    /// The system does not lock folders.
    Nobody,
}

/// Locks a hidden folder. The lock ends with the process, however that ends.
pub(super) fn own(folder: &Path) -> Owner {
    let Ok(file) = File::open(folder) else {
        return if folder.exists() { Owner::Nobody } else { Owner::Another };
    };
    match file.try_lock() {
        // Whoever held the lock before may have removed the folder.
        Ok(()) if folder.exists() => Owner::Us(file),
        Ok(()) | Err(TryLockError::WouldBlock) => Owner::Another,
        Err(TryLockError::Error(_)) => Owner::Nobody,
    }
}

/// Removes the hidden folders that processes which were killed have left in `dir`.
pub(super) fn sweep(dir: &Path) {
    // Files that cannot be listed or removed are harmless.
    let Ok(entries) = fs::read_dir(dir) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let is_hidden = name.to_str().is_some_and(|name| name.starts_with(PREFIX) && name.ends_with(SUFFIX));
        if is_hidden
            && entry.file_type().is_ok_and(|kind| kind.is_dir())
            && let Owner::Us(_lock) = own(&entry.path())
        {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}
