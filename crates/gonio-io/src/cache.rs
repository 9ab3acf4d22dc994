//! Cache of long computations in the user's cache folder.
//!
//! An entry is a file `KEY.plan`: a header with the length and the BLAKE3 hash of the content, then
//! the content. An entry that does not match its header counts as absent and is removed. Writes
//! therefore need no sync, and a damaged entry costs time but never causes a wrong result. Entries
//! are renamed into place, so concurrent readers see a complete entry or none.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use etcetera::BaseStrategy;

use crate::Error;

/// Environment variable with the cache folder, which replaces the platform's. An empty value
/// disables the cache.
pub const DIR_VARIABLE: &str = "GONIO_CACHE_DIR";
/// Default budget in bytes: 2 GiB.
pub const DEFAULT_BUDGET: u64 = 2 << 30;

const MAGIC: &[u8; 8] = b"gonioPLN";
const VERSION: u32 = 1;
/// Magic, version, a reserved word, length, hash.
const HEADER: usize = 8 + 4 + 4 + 8 + 32;
const EXTENSION: &str = "plan";
const UNFINISHED: &str = ".gonio-";
/// Age above which an unfinished file belongs to no running process.
const STALE: Duration = Duration::from_secs(3600);

/// A cache folder with a size budget.
#[derive(Clone, Debug)]
pub struct Cache {
    dir: PathBuf,
    budget: u64,
}

impl Cache {
    /// Returns the user's cache.
    ///
    /// Its folder is that in [`GONIO_CACHE_DIR`](DIR_VARIABLE), else `gonio` in the platform's
    /// cache folder. `None` if the variable is empty or there is no home.
    pub fn user() -> Option<Self> {
        Self::user_or(std::env::var_os(DIR_VARIABLE))
    }

    fn user_or(variable: Option<OsString>) -> Option<Self> {
        match variable {
            Some(dir) if dir.is_empty() => None,
            Some(dir) => Some(Self::at(dir)),
            None => Some(Self::at(etcetera::choose_base_strategy().ok()?.cache_dir().join("gonio"))),
        }
    }

    /// Returns the cache in `dir`, which is created when something is first stored.
    pub fn at(dir: impl Into<PathBuf>) -> Self {
        Self { dir: dir.into(), budget: DEFAULT_BUDGET }
    }

    /// Sets the budget of the cache to `bytes`.
    pub fn with_budget(self, bytes: u64) -> Self {
        Self { budget: bytes, ..self }
    }

    /// Returns the folder of the entries.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Returns the content stored under `key`, if it exists and is undamaged.
    pub fn load(&self, key: &str) -> Option<Vec<u8>> {
        let path = self.entry(key);
        let mut file = File::open(&path).ok()?;
        let content = match read_entry(&mut file) {
            Ok(Some(content)) => content,
            Ok(None) => {
                // At worst this removes a good entry that has just replaced the bad one.
                let _ = fs::remove_file(&path);
                return None;
            }
            Err(_) => return None,
        };
        // Marks the entry as recently used. Without write permission, the entry keeps its old time.
        let _ = file.set_modified(SystemTime::now());
        Some(content)
    }

    /// Stores `content` under `key`, replacing an existing entry.
    ///
    /// Then removes the least recently used entries until the size is within the budget.
    ///
    /// # Errors
    /// If the folder cannot be created or written, the disk is full, or the content alone exceeds
    /// the budget. The caller can continue without the cache.
    pub fn store(&self, key: &str, content: &[u8]) -> Result<(), Error> {
        let path = self.entry(key);
        if (content.len() + HEADER) as u64 > self.budget {
            let problem = format!("requires {} bytes, more than the size limit of the cache", content.len());
            return Err(Error::limits(&path, problem, "increase the limit"));
        }
        fs::create_dir_all(&self.dir).map_err(|e| Error::io(&self.dir, "create the cache folder", e))?;
        let write = || {
            let mut file = tempfile::Builder::new().prefix(UNFINISHED).tempfile_in(&self.dir)?;
            file.write_all(&header(content))?;
            file.write_all(content)?;
            file.persist(&path).map_err(|e| e.error)
        };
        write().map_err(|e| Error::io(&path, "write", e))?;
        self.trim(&path);
        Ok(())
    }

    /// Returns the path of an entry. Keys become file names, so those with unusual characters are
    /// hashed.
    fn entry(&self, key: &str) -> PathBuf {
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        let fits = !key.is_empty() && key.len() <= 100 && key.chars().all(plain);
        let stem = if fits { key.to_owned() } else { blake3::hash(key.as_bytes()).to_hex().to_string() };
        self.dir.join(format!("{stem}.{EXTENSION}"))
    }

    /// Removes the oldest entries beyond the budget, except `newest`, and stale unfinished files.
    fn trim(&self, newest: &Path) {
        let Ok(files) = fs::read_dir(&self.dir) else { return };
        let now = SystemTime::now();
        let mut total = 0;
        let mut entries = Vec::new();
        for file in files.flatten() {
            let (path, Ok(meta)) = (file.path(), file.metadata()) else { continue };
            let modified = meta.modified().unwrap_or(SystemTime::UNIX_EPOCH);
            if path.extension().is_some_and(|e| e == EXTENSION) {
                total += meta.len();
                entries.push((modified, meta.len(), path));
            } else if file.file_name().to_string_lossy().starts_with(UNFINISHED)
                && now.duration_since(modified).is_ok_and(|age| age > STALE)
            {
                let _ = fs::remove_file(path);
            }
        }
        entries.sort();
        for (_, length, path) in entries {
            if total <= self.budget {
                break;
            }
            if path != newest && fs::remove_file(path).is_ok() {
                total -= length;
            }
        }
    }
}

fn header(content: &[u8]) -> Vec<u8> {
    let mut header = Vec::with_capacity(HEADER);
    header.extend(MAGIC);
    header.extend(VERSION.to_le_bytes());
    header.extend([0; 4]);
    header.extend((content.len() as u64).to_le_bytes());
    header.extend(hash(content).as_bytes());
    header
}

/// Computes the hash on all cores, because hashing takes half the time of loading.
fn hash(content: &[u8]) -> blake3::Hash {
    blake3::Hasher::new().update_rayon(content).finalize()
}

/// Returns the content, or `None` if it does not match its header.
fn read_entry(file: &mut File) -> std::io::Result<Option<Vec<u8>>> {
    let length = file.metadata()?.len();
    if length < HEADER as u64 {
        return Ok(None);
    }
    let mut found = [0; HEADER];
    file.read_exact(&mut found)?;
    let content_length = length - HEADER as u64;
    if found[..8] != MAGIC[..] || found[8..12] != VERSION.to_le_bytes() || found[16..24] != content_length.to_le_bytes()
    {
        return Ok(None);
    }
    let mut content = Vec::new();
    // The length is that of the file, so this allocates no more than the file holds. Running out of
    // memory must not abort the process.
    if content.try_reserve_exact(usize::try_from(content_length).unwrap_or(usize::MAX)).is_err() {
        return Err(std::io::ErrorKind::OutOfMemory.into());
    }
    file.take(content_length).read_to_end(&mut content)?;
    Ok((header(&content) == found).then_some(content))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cache() -> (tempfile::TempDir, Cache) {
        let dir = tempfile::tempdir().unwrap();
        let cache = Cache::at(dir.path().join("deep/down"));
        (dir, cache)
    }

    fn content(n: usize) -> Vec<u8> {
        (0..n).map(|i| (i * i / 7) as u8).collect()
    }

    #[test]
    fn stored_entries_can_be_loaded() {
        let (_dir, cache) = cache();
        for (key, n) in [("a-b_9", 100_000), ("empty", 0), ("odd key/../\u{e9}", 3), ("a-b_9", 5)] {
            assert!(cache.load("never stored").is_none());
            cache.store(key, &content(n)).unwrap();
            assert_eq!(cache.load(key).unwrap(), content(n));
        }
        assert_eq!(fs::read_dir(cache.dir()).unwrap().count(), 3);
    }

    #[test]
    fn damaged_entries_are_detected_and_removed() {
        let (_dir, cache) = cache();
        cache.store("k", &content(1000)).unwrap();
        let path = cache.entry("k");
        let good = fs::read(&path).unwrap();
        let bad = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            assert!(cache.load("k").is_none());
            assert!(!path.exists());
        };
        for cut in (0..good.len()).step_by(13) {
            bad(&good[..cut]);
        }
        for at in (0..good.len()).step_by(7) {
            let mut flipped = good.clone();
            flipped[at] ^= 1;
            bad(&flipped);
        }
        bad(&[&good[..], b"x"].concat());
        fs::write(&path, good).unwrap();
        assert_eq!(cache.load("k").unwrap(), content(1000));
    }

    #[test]
    fn readers_never_get_a_partial_entry() {
        let (_dir, cache) = cache();
        let versions = [content(300_000), vec![7; 200_000]];
        cache.store("k", &versions[0]).unwrap();
        std::thread::scope(|s| {
            for version in &versions {
                s.spawn(|| (0..40).for_each(|_| cache.store("k", version).unwrap()));
            }
            for _ in 0..2 {
                s.spawn(|| {
                    for _ in 0..80 {
                        let got = cache.load("k").expect("an entry is always there");
                        assert!(versions.contains(&got));
                    }
                });
            }
        });
        assert_eq!(fs::read_dir(cache.dir()).unwrap().count(), 1, "no unfinished files are left");
    }

    #[test]
    fn least_recently_used_entries_are_removed_first() {
        let (_dir, cache) = cache();
        let cache = cache.with_budget(2500);
        let age = |key: &str, seconds| {
            let file = File::options().write(true).open(cache.entry(key)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(seconds)).unwrap();
        };
        cache.store("a", &content(1000)).unwrap();
        cache.store("b", &content(1000)).unwrap();
        age("a", 200);
        age("b", 100);
        assert!(cache.load("a").is_some(), "loading marks the entry as recently used");
        cache.store("c", &content(1000)).unwrap();
        assert!(cache.load("b").is_none());
        assert!(cache.load("a").is_some() && cache.load("c").is_some());
        assert_eq!(cache.store("d", &content(2500)).unwrap_err().kind(), crate::Kind::Limits);
    }

    #[test]
    fn stale_unfinished_files_are_removed() {
        let (_dir, cache) = cache();
        cache.store("a", b"x").unwrap();
        let (old, new) = (cache.dir().join(".gonio-old"), cache.dir().join(".gonio-new"));
        let file = File::create(&old).unwrap();
        file.set_modified(SystemTime::now() - 2 * STALE).unwrap();
        File::create(&new).unwrap();
        cache.store("b", b"x").unwrap();
        assert!(!old.exists() && new.exists());
    }

    #[test]
    fn folders_that_cannot_be_created_are_errors() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        fs::write(&file, "").unwrap();
        let cache = Cache::at(file.join("cache"));
        assert_eq!(cache.store("k", b"x").unwrap_err().kind(), crate::Kind::Io);
        assert!(cache.load("k").is_none());
    }

    #[test]
    fn the_variable_sets_the_cache_folder() {
        assert!(Cache::user_or(Some("".into())).is_none());
        assert_eq!(Cache::user_or(Some("/x".into())).unwrap().dir(), Path::new("/x"));
        if let Some(cache) = Cache::user_or(None) {
            assert!(cache.dir().ends_with("gonio"));
        }
    }
}
