//! Modes: folders 0700 and files 0600, whatever the umask is. Meshes are their owners' secrets.

use std::fs::OpenOptions;
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::Path;

/// Makes a folder, and the missing ones above it, for the owner only. A folder that is there keeps its mode.
pub(crate) fn make_folder(path: &Path) -> io::Result<()> {
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(path)
}

/// Options that open a file for reading and writing and create it for the owner only.
pub(crate) fn options() -> OpenOptions {
    OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).clone()
}
