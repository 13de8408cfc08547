//! Blobs as files of a folder.
//!
//! `object_store` writes and reads them, and makes them appear by a rename. Listing and removing goes by folders: an
//! upload that a killed process left unfinished is a file too, which `object_store` does not list.

use std::fs::Metadata;
use std::io;
use std::path::PathBuf;

use async_trait::async_trait;
use axum::body::Bytes;
use object_store::GetRange;
use object_store::local::LocalFileSystem;
use object_store::path::Path;

use super::{Blob, Blobs, Parts};
use crate::error::{Error, Result};
use crate::service::files::failure::blocking;

/// The blobs in a folder.
#[derive(Debug)]
pub(in crate::service) struct FolderBlobs {
    root: PathBuf,
    files: LocalFileSystem,
}

impl FolderBlobs {
    /// Those below a folder that is there; with `is_kept`, a blob is on the disk when its writing returns.
    pub fn open(root: &std::path::Path, is_kept: bool) -> io::Result<Self> {
        let files = LocalFileSystem::new_with_prefix(root).map_err(io::Error::other)?.with_fsync(is_kept);
        Ok(Self { root: root.to_owned(), files })
    }

    /// The folder or file at a path.
    fn at(&self, path: &Path) -> PathBuf {
        self.root.join(path.as_ref())
    }
}

#[async_trait]
impl Blobs for FolderBlobs {
    async fn put(&self, path: &Path, bytes: Bytes) -> Result<()> {
        Blobs::put(&self.files, path, bytes).await
    }

    async fn start(&self, path: &Path) -> Result<Parts> {
        self.files.start(path).await
    }

    async fn get(&self, path: &Path, range: Option<GetRange>) -> Result<Blob> {
        Blobs::get(&self.files, path, range).await
    }

    async fn names(&self, below: &Path) -> Result<Vec<String>> {
        let (root, folder) = (self.root.clone(), self.at(below));
        blocking(move || match names(&folder) {
            // no blob has such a path, unless the root is away
            Err(error) if error.kind() == io::ErrorKind::NotFound && root.is_dir() => Ok(Vec::new()),
            found => found.map_err(|error| {
                Error::io(format_args!("the data folder cannot be read: {}", folder.display()), error)
            }),
        })
        .await?
    }

    async fn remove(&self, below: &Path) -> Result<u64> {
        let folder = self.at(below);
        blocking(move || {
            let bytes = size(&folder);
            match std::fs::remove_dir_all(&folder) {
                Ok(()) => Ok(bytes),
                // another task removed it, and counted its bytes
                Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(0),
                Err(error) => Err(Error::io(format_args!("a folder cannot be removed: {}", folder.display()), error)),
            }
        })
        .await?
    }
}

fn names(folder: &std::path::Path) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        names.extend(entry?.file_name().into_string());
    }
    Ok(names)
}

/// Bytes of all files in a folder and below it; what disappears meanwhile does not count.
pub(in crate::service) fn size(folder: &std::path::Path) -> u64 {
    let mut size = 0;
    each_below(folder, |_, found| size += bytes(found));
    size
}

/// Bytes of a file; none of a folder.
pub(in crate::service) fn bytes(found: &Metadata) -> u64 {
    if found.is_dir() { 0 } else { found.len() }
}

/// Calls `visit` with every file and folder below a folder; links are not followed.
pub(in crate::service) fn each_below(folder: &std::path::Path, mut visit: impl FnMut(&std::path::Path, &Metadata)) {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let (path, Ok(found)) = (entry.path(), entry.metadata()) else { continue };
            visit(&path, &found);
            if found.is_dir() {
                folders.push(path);
            }
        }
    }
}
