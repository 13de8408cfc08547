//! Where the files that a mesh refers to may come from.

use std::path::PathBuf;

use crate::error::{Error, Result};

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
        Err(Error::mesh(format_args!("the mesh refers to an external buffer, which was not sent with it: {uri:?}")))
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
        let _ = (uri, max_bytes, &self.folder);
        Err(Error::mesh("not yet"))
    }
}
