//! Registry of unfinished output, which this process removes on a signal, or else the next process.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError, RwLock, RwLockReadGuard};
use std::thread;
use std::time::Duration;

use super::PREFIX;

/// Suffix of the names of hidden folders, by which [`sweep`] recognises leftovers.
pub(super) const SUFFIX: &str = ".unfinished";

/// Attempts to remove a folder that another thread is still writing to.
const ATTEMPTS: usize = 20;

/// All unfinished output of this process.
static ALL: Mutex<Vec<Entry>> = Mutex::new(Vec::new());

/// Writers hold the read lock; [`abandon`] takes the write lock and never releases it.
static GATE: RwLock<()> = RwLock::new(());

#[derive(Clone, Debug, PartialEq)]
enum Entry {
    File(PathBuf),
    /// A hidden folder and its content.
    Folder(PathBuf),
    /// A created parent folder, removed only if it is empty.
    Parent(PathBuf),
}

/// Registration of unfinished output, which ends on drop.
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

/// Makes [`abandon`] wait until the guard is dropped. For short steps that must not be interrupted.
pub(super) fn writing() -> RwLockReadGuard<'static, ()> {
    GATE.read().unwrap_or_else(PoisonError::into_inner)
}

/// Removes all unfinished output of this process and the folders created for it.
///
/// Waits for files that are being moved into place. Afterwards no output can be written: callers
/// that try block forever. For a process that is about to exit.
pub fn abandon() {
    std::mem::forget(GATE.write().unwrap_or_else(PoisonError::into_inner));
    let all = ALL.lock().unwrap_or_else(PoisonError::into_inner).clone();
    // Parents are registered before their content.
    for entry in all.iter().rev() {
        // The process is about to exit, so errors cannot be reported.
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

/// Owner of a hidden folder.
pub(super) enum Owner {
    /// This process, as long as it holds the lock.
    Us(File),
    /// Another process.
    Another,
    /// Unknown, because the system cannot lock folders.
    Nobody,
}

/// Locks a hidden folder. The lock ends with the process, even if it is killed.
pub(super) fn own(folder: &Path) -> Owner {
    let Ok(file) = File::open(folder) else {
        return if folder.exists() { Owner::Nobody } else { Owner::Another };
    };
    match file.try_lock() {
        // A previous owner of the lock may have removed the folder.
        Ok(()) if folder.exists() => Owner::Us(file),
        Ok(()) | Err(TryLockError::WouldBlock) => Owner::Another,
        Err(TryLockError::Error(_)) => Owner::Nobody,
    }
}

/// Removes the hidden folders that killed processes left in `dir`.
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
