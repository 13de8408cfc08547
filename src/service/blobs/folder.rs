//! Blobs as files of a folder.
//!
//! `object_store` writes and reads them, and makes them appear by a rename. Listing and removing goes by folders: an
//! upload that a killed process left unfinished is a file too, which `object_store` does not list.

use std::fs::{File, Metadata};
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use object_store::path::Path as BlobPath;
use tesserae_mesh::error::{Error, Result};
use walkdir::WalkDir;

use crate::ops::blocking;
use crate::ops::private;

/// The next segment of every path below a path.
pub(super) async fn names(root: &Path, below: &BlobPath) -> Result<Vec<String>> {
    let (root, folder) = (root.to_owned(), root.join(below.as_ref()));
    blocking(move || {
        let names = std::fs::read_dir(&folder).and_then(|entries| {
            entries.filter_map(|entry| entry.map(|entry| entry.file_name().into_string().ok()).transpose()).collect()
        });
        match names {
            // no blob has such a path, unless the root is away
            Err(error) if error.kind() == io::ErrorKind::NotFound && root.is_dir() => Ok(Vec::new()),
            found => found.map_err(|error| {
                Error::io(format_args!("the data folder cannot be read: {}", folder.display()), error)
            }),
        }
    })
    .await?
}

/// When the newest file below a path was written, one that is being written included.
pub(super) async fn newest(root: &Path, below: &BlobPath) -> Result<Option<SystemTime>> {
    let folder = root.join(below.as_ref());
    blocking(move || {
        entries_below(&folder).filter(|(_, found)| found.is_file()).filter_map(|(_, found)| found.modified().ok()).max()
    })
    .await
}

pub(super) async fn remove(root: &Path, below: &BlobPath) -> Result<u64> {
    let (root, folder) = (root.to_owned(), root.join(below.as_ref()));
    blocking(move || {
        let bytes = size(&folder);
        match std::fs::remove_dir_all(&folder) {
            Ok(()) => {
                // folders above go while they are empty; those in the root stay, with their modes
                let is_below = |parent: &Path| parent != root && parent.starts_with(&root);
                let above = folder.ancestors().skip(1).take_while(|above| above.parent().is_some_and(is_below));
                let _ = above.map(std::fs::remove_dir).find(io::Result::is_err);
                Ok(bytes)
            }
            // another task removed it, and counted its bytes
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(0),
            Err(error) => Err(Error::io(format_args!("a folder cannot be removed: {}", folder.display()), error)),
        }
    })
    .await?
}

/// The whole files below a path, relative to the root.
pub(crate) fn whole_files(root: &Path, below: &BlobPath) -> Vec<PathBuf> {
    entries_below(&root.join(below.as_ref()))
        .filter(is_whole)
        .filter_map(|(path, _)| path.strip_prefix(root).map(Path::to_owned).ok())
        .collect()
}

/// Whether this is a file, and not one that is being written, which has a `#` in its name.
fn is_whole((path, found): &(PathBuf, Metadata)) -> bool {
    found.is_file() && path.file_name().is_some_and(|name| !name.to_string_lossy().contains('#'))
}

/// Links a file of `from` into `to`, or copies it where that cannot be, unless it is gone, or there already.
pub(crate) fn link(from: &Path, to: &Path, file: &Path) -> io::Result<()> {
    let (source, target) = (from.join(file), to.join(file));
    if target.exists() {
        return Ok(());
    }
    // opened first: a folder without its file would look like one that was taken
    let mut opened = match File::open(&source) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        opened => opened?,
    };
    private::make_folder(target.parent().unwrap_or(to))?;
    if std::fs::hard_link(&source, &target).is_err() {
        io::copy(&mut opened, &mut private::options().open(&target)?)?;
    }
    Ok(())
}

/// Bytes of all whole files in a folder and below it.
pub(crate) fn size(folder: &Path) -> u64 {
    entries_below(folder).filter(is_whole).map(|(_, found)| found.len()).sum()
}

/// Files and folders in a folder and below it, without those that disappear meanwhile.
fn entries_below(folder: &Path) -> impl Iterator<Item = (PathBuf, Metadata)> {
    let entries = WalkDir::new(folder).min_depth(1).into_iter().flatten();
    entries.filter_map(|entry| Some((entry.path().to_owned(), entry.metadata().ok()?)))
}
