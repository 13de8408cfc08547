//! Where the files that a mesh refers to may come from.
//!
//! A mesh names its buffers by relative URI. Only files that were given with the mesh are read.

use std::fs::{File, Metadata};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use crate::error::{Error, Quoted, Result};

/// Gives the bytes of the buffers that a mesh refers to by relative URI.
pub trait Resources {
    /// The bytes of `uri`, which is already percent-decoded and is no data URI; at most `max_bytes` of them.
    fn load(&self, uri: &str, max_bytes: u64) -> Result<Vec<u8>>;
}

/// Nothing may be referred to.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoResources;

impl Resources for NoResources {
    fn load(&self, uri: &str, _max_bytes: u64) -> Result<Vec<u8>> {
        Err(Error::mesh(format_args!(
            "the mesh refers to a file, and no files came with it (read the mesh by its file name, or make it a GLB, \
             which holds its buffers): {}",
            Quoted(uri)
        )))
    }
}

/// Files in the folder of the mesh file and below it.
#[derive(Debug, Clone)]
pub struct Beside {
    /// The folder of the mesh file.
    pub folder: PathBuf,
}

impl Resources for Beside {
    fn load(&self, uri: &str, max_bytes: u64) -> Result<Vec<u8>> {
        check_relative(uri)?;
        let folder = match self.folder.as_os_str().is_empty() {
            true => Path::new("."),
            false => &self.folder,
        };
        let failed = |error: std::io::Error| match error.kind() {
            ErrorKind::NotFound | ErrorKind::NotADirectory => Error::mesh(format_args!(
                "the mesh refers to a file that is not beside it (put it into the folder of the mesh): {}",
                Quoted(uri)
            )),
            _ => Error::io(format_args!("cannot read the buffer {}", Quoted(uri)), error),
        };
        let folder = folder.canonicalize().map_err(failed)?;
        let path = folder.join(uri).canonicalize().map_err(failed)?;
        if !path.starts_with(&folder) {
            return Err(Error::mesh(format_args!(
                "the mesh refers to a buffer by a link that leads out of its folder: {}",
                Quoted(uri)
            )));
        }
        // checked before it is opened: to open a pipe would wait until another process writes to it
        check_regular(&path.metadata().map_err(failed)?, uri)?;
        let file = File::open(&path).map_err(failed)?;
        let metadata = file.metadata().map_err(failed)?;
        check_regular(&metadata, uri)?;
        let mut bytes = Vec::new();
        if metadata.len() <= max_bytes {
            bytes.reserve_exact(metadata.len() as usize);
            file.take(max_bytes.saturating_add(1)).read_to_end(&mut bytes).map_err(failed)?;
        }
        if metadata.len().max(bytes.len() as u64) > max_bytes {
            return Err(Error::too_large(format_args!(
                "the mesh and its buffers have more bytes than the limit (raise it with --max-upload-bytes); \
                 the buffer {} may have {max_bytes} and has {}",
                Quoted(uri),
                metadata.len()
            )));
        }
        Ok(bytes)
    }
}

fn check_regular(metadata: &Metadata, uri: &str) -> Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    Err(Error::mesh(format_args!("the mesh refers to a buffer that is not a regular file: {}", Quoted(uri))))
}

/// Refuses a URI that is not a path downwards: absolute, upwards, with a scheme or drive, or with backslashes.
pub(super) fn check_relative(uri: &str) -> Result<()> {
    let refuse = |what: &str| {
        Err(Error::mesh(format_args!(
            "a buffer must be named by a relative path below the folder of the mesh, without {what}: {}",
            Quoted(uri)
        )))
    };
    if uri.is_empty() {
        return Err(Error::mesh("its uri is empty: name a file beside the mesh, or leave uri out in a GLB file"));
    }
    if uri.starts_with('/') {
        return refuse("a leading slash");
    }
    if uri.contains('\\') {
        return refuse("backslashes");
    }
    if uri.contains(char::is_control) {
        return refuse("control characters");
    }
    let mut segments = uri.split('/');
    if segments.clone().any(|segment| segment == "..") {
        return refuse("..");
    }
    if segments.next().is_some_and(|first| first.contains(':')) {
        return refuse("a scheme or a drive");
    }
    Ok(())
}
