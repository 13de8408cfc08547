//! Where bytes come from and go to: files and the standard streams.

use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use super::Failure;
use crate::error::{Error, Result};
use crate::tree::stored::Input;

/// A file to read, or standard input (`-`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// Standard input.
    Stdin,
    /// A file.
    File(PathBuf),
}

impl From<PathBuf> for Source {
    fn from(path: PathBuf) -> Self {
        if path.as_os_str() == "-" { Source::Stdin } else { Source::File(path) }
    }
}

impl Source {
    /// The content front to back, and its length.
    pub fn open(&self) -> Result<(Box<dyn Input>, u64)> {
        match self {
            // only a regular file knows its length
            Source::File(path) if fs::metadata(path).is_ok_and(|file| file.is_file()) => File::open(path)
                .and_then(|file| {
                    let length = file.metadata()?.len();
                    Ok((Box::new(file) as Box<dyn Input>, length))
                })
                .map_err(|error| Error::io(format_args!("cannot read {path:?}"), error)),
            Source::Stdin | Source::File(_) => {
                let bytes = self.read(u64::MAX)?;
                let length = bytes.len() as u64;
                Ok((Box::new(io::Cursor::new(bytes)), length))
            }
        }
    }

    /// The whole content, or as much of it as shows that it is more than `max_bytes`.
    pub fn read(&self, max_bytes: u64) -> Result<Vec<u8>> {
        match self {
            Source::Stdin => read_all(io::stdin().lock(), 0, max_bytes)
                .map_err(|error| Error::io("cannot read standard input", error)),
            Source::File(path) => File::open(path)
                .and_then(|file| {
                    let length = file.metadata()?.len();
                    read_all(file, length, max_bytes)
                })
                .map_err(|error| Error::io(format_args!("cannot read {path:?}"), error)),
        }
    }
}

/// At most one byte more than `max_bytes`.
fn read_all(from: impl Read, expected: u64, max_bytes: u64) -> io::Result<Vec<u8>> {
    let most = max_bytes.saturating_add(1);
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(usize::try_from(expected.min(most)).unwrap_or(usize::MAX))
        .map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
    from.take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// A file to write, or standard output (`-`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// Standard output.
    Stdout,
    /// A file.
    File(PathBuf),
}

impl From<PathBuf> for Target {
    fn from(path: PathBuf) -> Self {
        if path.as_os_str() == "-" { Target::Stdout } else { Target::File(path) }
    }
}

impl Target {
    /// Fails where [`write`](Self::write) would fail for want of a folder: before the work, not after it.
    pub fn check(&self) -> Result<()> {
        match self {
            Target::Stdout => Ok(()),
            Target::File(path) => {
                let place = Place::of(path).map_err(|error| cannot_write(path, error))?;
                match place {
                    Place::Beside(path) => tempfile::tempfile_in(folder(&path)).map(drop),
                    Place::Inside(path) => File::options().append(true).open(path).map(drop),
                }
                .map_err(|error| cannot_write(path, error))
            }
        }
    }

    /// Writes a file whole or not at all: beside its place first, then into it. Devices and pipes are written in place.
    pub fn write(&self, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> std::result::Result<(), Failure> {
        match self {
            Target::Stdout => {
                let mut out = BufWriter::with_capacity(1 << 16, io::stdout().lock());
                content(&mut out).and_then(|()| out.flush()).map_err(Failure::stdout)
            }
            Target::File(path) => write_file(path, content).map_err(|error| cannot_write(path, error).into()),
        }
    }
}

fn cannot_write(path: &Path, error: io::Error) -> Error {
    Error::io(format_args!("cannot write {path:?}"), error)
}

/// How a file is written.
enum Place {
    /// A regular file, new or old: replaced. Symbolic links are followed.
    Beside(PathBuf),
    /// Anything else, which must stay what it is.
    Inside(PathBuf),
}

impl Place {
    fn of(path: &Path) -> io::Result<Self> {
        match fs::metadata(path) {
            Ok(old) if old.is_dir() => Err(io::ErrorKind::IsADirectory.into()),
            Ok(old) if old.is_file() => Ok(Place::Beside(fs::canonicalize(path)?)),
            Ok(_) => Ok(Place::Inside(path.to_owned())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Place::Beside(path.to_owned())),
            Err(error) => Err(error),
        }
    }
}

/// The folder of a file.
pub fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn write_file(path: &Path, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    match Place::of(path)? {
        Place::Inside(path) => {
            let mut out = BufWriter::with_capacity(1 << 16, File::options().append(true).open(path)?);
            content(&mut out)?;
            out.flush()
        }
        Place::Beside(path) => {
            let mut builder = tempfile::Builder::new();
            builder.prefix(".tesserae-");
            // As any new file has them: the process's mask still applies.
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
            let mut out = BufWriter::with_capacity(1 << 16, builder.tempfile_in(folder(&path))?);
            content(&mut out)?;
            let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
            if let Ok(old) = fs::metadata(&path) {
                file.as_file().set_permissions(old.permissions())?;
            }
            file.persist(&path).map_err(|error| error.error)?;
            Ok(())
        }
    }
}
