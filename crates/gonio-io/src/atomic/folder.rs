//! Output folder whose files appear atomically.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::{Component, Path, PathBuf};

use tempfile::TempDir;

use super::unfinished::{self, Unfinished, own, writing};
use super::{folder_of, sync_folder, temporary};
use crate::Error;

/// Output files collected in a hidden folder and moved to the target at the end.
///
/// The hidden folder is on the same file system as the target. Dropping the value without
/// [`commit`](Self::commit) removes the files and every folder that was created for them.
#[derive(Debug)]
pub struct StagedFolder {
    target: PathBuf,
    staging: TempDir,
    /// Removes the created parents after `staging`: fields are dropped in order.
    parents: MadeFolders,
    /// Files and folders of the target to be removed on commit.
    stale: Vec<PathBuf>,
    /// Lock that marks the hidden folder as in use. `None` if the system cannot lock folders.
    _lock: Option<File>,
    _unfinished: Unfinished,
}

impl StagedFolder {
    /// Prepares to fill the folder `dir`, which may exist; missing parents are created.
    ///
    /// # Errors
    /// If there is a file of that name, or the folder (or the hidden one for its content) cannot be
    /// created.
    pub fn create(dir: impl AsRef<Path>) -> Result<Self, Error> {
        let target = dir.as_ref().to_owned();
        let failed = |e| Error::io(&target, "create the folder", e);
        let exists = match fs::metadata(&target) {
            Ok(meta) if meta.is_dir() => true,
            Ok(_) => return Err(failed(io::Error::new(io::ErrorKind::AlreadyExists, "a file with this name exists"))),
            Err(e) if e.kind() == io::ErrorKind::NotFound => false,
            Err(e) => return Err(failed(e)),
        };
        let mut parents = MadeFolders::default();
        // The hidden folder is next to a new target, so that one rename makes the target appear. It
        // is inside an existing target, which may be a mount point or a link and whose parent may
        // not be writable.
        let beside = if exists { target.clone() } else { folder_of(&target) };
        let writing = writing();
        parents.make(&beside).map_err(failed)?;
        unfinished::sweep(&beside);
        if exists {
            // An earlier process may have staged its output there, before the target existed.
            unfinished::sweep(&folder_of(&target));
        }
        let (staging, lock) = hidden(&beside).map_err(failed)?;
        let unfinished = Unfinished::folder(staging.path());
        drop(writing);
        Ok(Self { target, staging, parents, stale: Vec::new(), _lock: lock, _unfinished: unfinished })
    }

    /// Marks files of the target for removal on commit, unless new files replace them. A folder is
    /// removed only if it is empty by then. Names are relative to the target; other paths and
    /// missing files are ignored.
    pub fn discard(&mut self, names: impl IntoIterator<Item = PathBuf>) {
        let below = |name: &PathBuf| name.components().all(|part| matches!(part, Component::Normal(_)));
        self.stale.extend(names.into_iter().filter(below));
    }

    /// Returns the temporary path of the output file `name`.
    ///
    /// # Panics
    /// If `name` is neither a plain file name nor of the form `folder/file`.
    pub fn path(&self, name: &str) -> PathBuf {
        let plain = |name: &str| Path::new(name).file_name().is_some_and(|n| n == name);
        let (folder, file) = name.split_once('/').map_or((None, name), |(folder, file)| (Some(folder), file));
        assert!(plain(file) && folder.is_none_or(plain), "`{name}` must be a plain file name or `folder/file`");
        self.staging.path().join(name)
    }

    /// Writes the output file `name` to its temporary path.
    ///
    /// # Errors
    /// If it cannot be written; the error names the file in the folder to be filled.
    ///
    /// # Panics
    /// See [`Self::path`].
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), Error> {
        if let Some((folder, _)) = name.split_once('/') {
            let made = fs::create_dir_all(self.path(folder));
            made.map_err(|e| Error::io(&self.target.join(folder), "create the folder", e))?;
        }
        super::write(&self.path(name), bytes).map_err(|e| Error::io(&self.target.join(name), "write", e))
    }

    /// Writes files, given as names and contents, and [commits](Self::commit) them.
    ///
    /// # Errors
    /// See [`Self::write`] and [`Self::commit`].
    ///
    /// # Panics
    /// See [`Self::path`].
    pub fn fill(self, files: &[(String, Vec<u8>)]) -> Result<(), Error> {
        files.iter().try_for_each(|(name, bytes)| self.write(name, bytes))?;
        self.commit()
    }

    /// Returns the folder to be filled.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Moves the files to the target.
    ///
    /// A new folder appears in one step. In an existing folder, each file replaces the one of the
    /// same name after all files have been synced to the disk, and [discarded](Self::discard) files
    /// are removed. Other files stay.
    ///
    /// # Errors
    /// If the files cannot be synced to the disk (it may be full), a folder has the name of a file
    /// to be written, or renaming fails. In these cases nothing was replaced, unless renaming
    /// failed halfway. It also fails if discarded files cannot be removed; the new files are then
    /// in place.
    pub fn commit(mut self) -> Result<(), Error> {
        let _writing = writing();
        let staging = self.staging.path();
        let names = self.sync()?;
        let failed = |e| Error::io(&self.target, "move the files to the folder", e);
        let exists = self.target.is_dir();
        if !exists && fs::rename(staging, &self.target).is_ok() {
            // The staging folder was renamed, so nothing is left to clean up.
            self.staging.disable_cleanup(true);
        } else {
            if !exists {
                // Another process created it in the meantime, or renaming failed for a reason that
                // this call will report.
                fs::create_dir(&self.target)
                    .or_else(|e| if self.target.is_dir() { Ok(()) } else { Err(e) })
                    .map_err(failed)?;
            }
            for name in &names {
                let twin = self.target.join(name);
                if twin.is_dir() {
                    return Err(Error::io(&twin, "replace", io::ErrorKind::IsADirectory.into()));
                }
            }
            let folders: BTreeSet<&Path> = names.iter().filter_map(|name| name.parent()).collect();
            for folder in &folders {
                fs::create_dir_all(self.target.join(folder)).map_err(failed)?;
            }
            for name in &names {
                fs::rename(staging.join(name), self.target.join(name)).map_err(failed)?;
            }
            folders.iter().for_each(|folder| sync_folder(&self.target.join(folder)));
            self.remove_stale(&names)?;
            sync_folder(&self.target);
        }
        self.parents.keep();
        sync_folder(&folder_of(&self.target));
        Ok(())
    }

    /// Removes the files that were discarded and not replaced, then the empty folders.
    fn remove_stale(&self, names: &[PathBuf]) -> Result<(), Error> {
        let mut folders = Vec::new();
        for path in self.stale.iter().filter(|name| !names.contains(name)).map(|name| self.target.join(name)) {
            if fs::symlink_metadata(&path).is_ok_and(|meta| meta.is_dir()) {
                folders.push(path);
                continue;
            }
            match fs::remove_file(&path) {
                // A missing folder in the path also means that the file is absent.
                Err(e) if !matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
                    return Err(Error::io(&path, "remove earlier results", e));
                }
                _ => (),
            }
        }
        folders.sort();
        for folder in folders.iter().rev() {
            // Fails, as intended, if the folder contains anything else.
            let _ = fs::remove_dir(folder);
        }
        Ok(())
    }

    /// Syncs all staged files to the disk and returns their paths relative to the staging folder.
    /// On a full disk, the error may not occur until this sync.
    fn sync(&self) -> Result<Vec<PathBuf>, Error> {
        let mut names = Vec::new();
        let mut folders = vec![PathBuf::new()];
        while let Some(folder) = folders.pop() {
            let failed = |name: &Path, e| Error::io(&self.target.join(name), "write", e);
            let path = self.staging.path().join(&folder);
            for entry in fs::read_dir(&path).map_err(|e| failed(&folder, e))? {
                let name = folder.join(entry.map_err(|e| failed(&folder, e))?.file_name());
                let path = self.staging.path().join(&name);
                if path.is_dir() {
                    folders.push(name);
                    continue;
                }
                if path.is_file() {
                    File::open(path).and_then(|f| f.sync_all()).map_err(|e| failed(&name, e))?;
                }
                names.push(name);
            }
            sync_folder(&path);
        }
        names.sort();
        Ok(names)
    }
}

/// Creates a hidden folder and locks it.
fn hidden(beside: &Path) -> io::Result<(TempDir, Option<File>)> {
    loop {
        let staging = temporary(0o777).suffix(unfinished::SUFFIX).tempdir_in(beside)?;
        match own(staging.path()) {
            unfinished::Owner::Us(lock) => return Ok((staging, Some(lock))),
            unfinished::Owner::Nobody => return Ok((staging, None)),
            // Another process treated the folder as a leftover before it was locked.
            unfinished::Owner::Another => (),
        }
    }
}

/// Parent folders that were created, removed on drop if they are still empty.
#[derive(Debug, Default)]
struct MadeFolders(Vec<(PathBuf, Unfinished)>);

impl MadeFolders {
    /// Creates `dir` and its missing parents.
    fn make(&mut self, dir: &Path) -> io::Result<()> {
        if dir.is_dir() {
            return Ok(());
        }
        let parent = folder_of(dir);
        if parent != dir {
            self.make(&parent)?;
        }
        match fs::create_dir(dir) {
            Ok(()) => self.0.push((dir.to_owned(), Unfinished::parent(dir))),
            // Another process created the folder first, so this process must not remove it.
            Err(_) if dir.is_dir() => {}
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {
                return Err(io::Error::new(io::ErrorKind::NotADirectory, format!("{} is a file", dir.display())));
            }
            Err(e) => return Err(e),
        }
        Ok(())
    }

    fn keep(&mut self) {
        self.0.clear();
    }
}

impl Drop for MadeFolders {
    fn drop(&mut self) {
        for (dir, _) in self.0.iter().rev() {
            // Fails, as intended, if another process has written to the folder.
            let _ = fs::remove_dir(dir);
        }
    }
}

#[cfg(test)]
mod tests;
