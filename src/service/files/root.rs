//! The data folder: locked by one process, private to its owner, and checked to be the same folder as at the start.
//!
//! A temporary folder has a lock, too: a free lock marks the folder of a process that was killed, which a later process
//! removes. Folders of builds that made no lock are removed when no other process of this program runs.

use std::fs::{File, TryLockError};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::TempDir;

use super::ballast::BALLAST;
use super::failure::cannot_make;
use crate::error::{Error, Kind, Result};
use crate::service::private;

/// Start of the names of temporary folders.
const PREFIX: &str = "tesserae-jobs-";

/// Name of the lock in either kind of folder.
pub(super) const LOCK: &str = "lock";

/// Name of the file that says where the blobs lie, if elsewhere.
pub(in crate::service) const BLOBS: &str = "blobs";

/// Files of the store of jobs.
pub(super) const STORE: [&str; 3] = ["jobs.sqlite3", "jobs.sqlite3-wal", "jobs.sqlite3-shm"];

/// The folder.
#[derive(Debug)]
pub(super) enum Root {
    /// `--data-dir`: everything stays.
    Kept { path: PathBuf, lock: File },
    /// Among the system's temporary files, for as long as the process.
    Temporary { folder: TempDir, lock: File },
}

impl Root {
    /// Takes the folder at `path`, which is made if need be. [`Kind::Conflict`] when another process works in it.
    ///
    /// The mode of a folder that is there already stays, because it may hold more than jobs; what the service keeps in
    /// it is for the owner only in any case.
    pub fn keep(path: &Path) -> Result<Self> {
        private::make_folder(path).map_err(|error| cannot_make(path, error))?;
        let name = path.join(LOCK);
        let mut lock = private::options().open(&name).map_err(|error| cannot_make(&name, error))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let holder = std::fs::read_to_string(&name).unwrap_or_default();
                return Err(Error::new(
                    Kind::Conflict,
                    format_args!(
                        "another process ({}) works in the data folder; stop it, or give this one another --data-dir: \
                         {}",
                        holder.trim(),
                        path.display()
                    ),
                ));
            }
            Err(TryLockError::Error(error)) => return Err(cannot_make(&name, error)),
        }
        match note_holder(&mut lock) {
            // the number is for messages only
            Err(error) if error.kind() != io::ErrorKind::StorageFull => return Err(cannot_make(&name, error)),
            Ok(()) | Err(_) => {}
        }
        let path = path.canonicalize().map_err(|error| cannot_make(path, error))?;
        if let Some(mode) = private::open_mode(&path) {
            let (folder, mode) = (path.display(), format!("{mode:04o}"));
            tracing::warn!(%folder, mode, "other users may enter the data folder; `chmod 700` takes that away");
        }
        for name in STORE.into_iter().chain([LOCK, BALLAST, BLOBS]) {
            let file = path.join(name);
            private::tighten(&file).map_err(|error| cannot_make(&file, error))?;
        }
        Ok(Self::Kept { path, lock })
    }

    /// Makes a temporary folder in `among`, and removes those there whose process was killed.
    pub fn temporary(among: &Path) -> Result<Self> {
        static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
        // a folder of this process has a lock before another of its threads sweeps
        let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let cannot = |error| cannot_make(among, error);
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX);
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
        let folder = builder.tempdir_in(among).map_err(cannot)?;
        // Locked before it has its name, so an unlocked `lock` file means that its process has ended.
        let (new, name) = (folder.path().join("lock.new"), folder.path().join(LOCK));
        let lock_it = || {
            let mut lock = private::options().open(&new)?;
            lock.lock()?;
            note_holder(&mut lock)?;
            std::fs::rename(&new, &name)?;
            io::Result::Ok(lock)
        };
        let lock = lock_it().map_err(cannot)?;
        sweep_temporary(among, folder.path(), Path::new("/proc"));
        Ok(Self::Temporary { folder, lock })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        match self {
            Root::Kept { path, .. } => path,
            Root::Temporary { folder, .. } => folder.path(),
        }
    }

    /// Whether the folder outlasts the process.
    pub fn is_kept(&self) -> bool {
        matches!(self, Root::Kept { .. })
    }

    /// Whether the folder is still the one that was opened: not removed, unmounted, or mounted over.
    pub fn check(&self) -> io::Result<()> {
        let (Root::Kept { lock, .. } | Root::Temporary { lock, .. }) = self;
        let (there, held) = (self.path().join(LOCK).metadata()?, lock.metadata()?);
        if same_file(&there, &held) { Ok(()) } else { Err(io::Error::other("it was replaced by another")) }
    }
}

/// Writes the number of this process into its lock.
fn note_holder(lock: &mut File) -> io::Result<()> {
    lock.set_len(0)?;
    lock.write_all(format!("{}\n", std::process::id()).as_bytes())
}

/// Removes temporary folders of processes that were killed: those with a lock that is free, and those without a lock
/// while no other process of this program runs. Another user's folders stay.
fn sweep_temporary(among: &Path, own: &Path, processes: &Path) {
    // all folders before the first process: a process starts before it makes its folder
    let folders: Vec<_> = std::fs::read_dir(among).into_iter().flatten().flatten().collect();
    for entry in folders {
        let path = entry.path();
        let is_one = entry.file_name().to_str().is_some_and(|name| name.starts_with(PREFIX)) && path != own;
        if !is_one || !is_folder_of_same_owner(&path, own) {
            continue;
        }
        let is_dead = match File::options().write(true).open(path.join(LOCK)) {
            Ok(lock) => lock.try_lock().is_ok(),
            Err(error) => error.kind() == io::ErrorKind::NotFound && is_alone(processes).unwrap_or(false),
        };
        if is_dead {
            match std::fs::remove_dir_all(&path) {
                Ok(()) => tracing::info!(folder = %path.display(), "removed the temporary folder of a killed process"),
                Err(error) => tracing::warn!(folder = %path.display(), %error, "a folder cannot be removed"),
            }
        }
    }
}

/// Whether this process is the only one of this program, known by its name, as Linux shows it in `/proc`. Fails where
/// not every process is shown: outside of the first namespace of processes, and on other systems.
fn is_alone(processes: &Path) -> io::Result<bool> {
    const FIRST: &str = "pid:[4026531836]";
    if std::fs::read_link(processes.join("self/ns/pid"))? != Path::new(FIRST) {
        return Err(io::ErrorKind::Unsupported.into());
    }
    let name = std::fs::read_to_string(processes.join("self/comm"))?;
    for entry in std::fs::read_dir(processes)? {
        let entry = entry?;
        let number = entry.file_name().to_str().and_then(|number| number.parse().ok());
        let is_other = number.is_some_and(|number: u32| number != std::process::id());
        // one that ends meanwhile has no name any more
        let other = is_other.then(|| std::fs::read_to_string(entry.path().join("comm")).unwrap_or_default());
        if other.is_some_and(|other| other == name || other.contains("tesserae")) {
            return Ok(false);
        }
    }
    Ok(true)
}

#[cfg(unix)]
fn is_folder_of_same_owner(path: &Path, own: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let (Ok(theirs), Ok(ours)) = (path.symlink_metadata(), own.symlink_metadata()) else { return false };
    theirs.is_dir() && theirs.uid() == ours.uid()
}

#[cfg(not(unix))]
fn is_folder_of_same_owner(path: &Path, _: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|found| found.is_dir())
}

#[cfg(unix)]
fn same_file(one: &std::fs::Metadata, other: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

#[cfg(not(unix))]
fn same_file(one: &std::fs::Metadata, other: &std::fs::Metadata) -> bool {
    one.created().ok() == other.created().ok()
}

#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests {
    use super::*;

    /// A folder like `/proc`, of a process of this number and one with another.
    fn processes(namespace: &str, other: &str) -> TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for (number, name) in [("self", "tesserae\n"), (&std::process::id().to_string(), "tesserae\n"), ("1", other)] {
            std::fs::create_dir_all(folder.path().join(number).join("ns")).expect("made");
            std::fs::write(folder.path().join(number).join("comm"), name).expect("written");
        }
        std::os::unix::fs::symlink(namespace, folder.path().join("self/ns/pid")).expect("a link");
        folder
    }

    #[test]
    fn a_folder_without_a_lock_goes_when_no_process_can_be_its_owner() {
        let all = "pid:[4026531836]";
        for (namespace, other, is_swept) in [
            (all, "init\n", true),
            (all, "tesserae\n", false),
            (all, "tesserae-0.1\n", false),
            ("pid:[4026532000]", "init\n", false),
        ] {
            let among = tempfile::tempdir().expect("a folder");
            let [own, old, foreign] = [format!("{PREFIX}own"), format!("{PREFIX}old"), "other".to_owned()]
                .map(|name| among.path().join(name));
            for folder in [&own, &old, &foreign] {
                std::fs::create_dir_all(folder.join("uploads")).expect("made");
            }
            sweep_temporary(among.path(), &own, processes(namespace, other).path());
            assert_eq!(!old.exists(), is_swept, "{namespace} {other}");
            assert!(own.exists() && foreign.exists());
        }
        assert!(is_alone(Path::new("/nothing/like/proc")).is_err());
    }
}
