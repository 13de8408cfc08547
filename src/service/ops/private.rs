//! Modes: folders 0700 and files 0600, whatever the umask is. Meshes are their owners' secrets.

use std::fs::OpenOptions;
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::Path;

/// Makes a folder, and the missing ones above it, for the owner only. A folder that is there keeps its mode.
pub(crate) fn make_folder(path: &Path) -> io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    builder.mode(0o700).create(path)
}

/// Options that open a file for reading and writing and create it for the owner only.
pub(crate) fn options() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false).mode(0o600);
    options
}

/// Takes the access of group and others away from a file or folder, if it is there; links are not followed.
pub(crate) fn tighten(path: &Path) -> io::Result<()> {
    let found = match path.symlink_metadata() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        found => found?,
    };
    let mode = found.permissions().mode();
    match mode & 0o077 {
        0 => Ok(()),
        _ if found.is_symlink() => Ok(()),
        _ => std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode & 0o700)),
    }
}

/// The mode of a folder that group or others may enter or list; none when only its owner may.
pub(crate) fn open_mode(path: &Path) -> Option<u32> {
    let mode = path.metadata().ok()?.permissions().mode() & 0o777;
    (mode & 0o077 != 0).then_some(mode)
}
