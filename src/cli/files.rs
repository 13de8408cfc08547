//! Where bytes come from and go to: files and the standard streams.
//!
//! A regular file is written whole or not at all: a temporary file beside it replaces it in the end. Symbolic links are
//! followed. A file in a folder that takes no new file is written in place. Named pipes, devices and file descriptors
//! (`/dev/fd/3`, `>(…)` of a shell) are opened once, when the content is there, and written in place.

use std::ffi::OsStr;
use std::fmt::{self, Display};
use std::fs::{self, File, FileType};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, TypedValueParser};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::hierarchy::stored::Input;

use super::Failure;
use super::signals::{self, Blocking};

/// A path as messages show it: control characters escaped.
pub struct Shown<'a>(pub &'a Path);

impl Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for character in self.0.to_string_lossy().chars() {
            match character.is_control() {
                true => write!(f, "{}", character.escape_default())?,
                false => write!(f, "{character}")?,
            }
        }
        Ok(())
    }
}

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

impl Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Source::Stdin => f.write_str("standard input"),
            Source::File(path) => Shown(path).fmt(f),
        }
    }
}

impl Source {
    /// The content front to back, and its length. Errors name the source.
    pub fn open(&self) -> Result<(Box<dyn Input>, u64), Failure> {
        match self {
            // only a regular file knows its length
            Source::File(path) if fs::metadata(path).is_ok_and(|file| file.is_file()) => File::open(path)
                .and_then(|file| {
                    let length = file.metadata()?.len();
                    Ok((Box::new(file) as Box<dyn Input>, length))
                })
                .map_err(|error| self.cannot_read(error)),
            Source::Stdin | Source::File(_) => {
                let bytes = self.read(u64::MAX)?;
                let length = bytes.len() as u64;
                Ok((Box::new(io::Cursor::new(bytes)), length))
            }
        }
    }

    /// The whole content, or as much of it as shows that it is more than `max_bytes`. Errors name the source.
    pub fn read(&self, max_bytes: u64) -> Result<Vec<u8>, Failure> {
        self.read_with(max_bytes, &mut |_, _| ())
    }

    /// As [`read`](Self::read). Calls `on_read` with the bytes read so far and the length of the file, 0 where it is
    /// unknown.
    pub fn read_with(&self, max_bytes: u64, on_read: &mut dyn FnMut(u64, u64)) -> Result<Vec<u8>, Failure> {
        match self {
            Source::Stdin => read_all(io::stdin().lock(), 0, max_bytes, on_read),
            Source::File(path) => File::open(path).and_then(|file| {
                let length = file.metadata()?.len();
                read_all(file, length, max_bytes, on_read)
            }),
        }
        .map_err(|error| self.cannot_read(error))
    }

    fn cannot_read(&self, error: io::Error) -> Failure {
        Failure::about(self)(Error::io("cannot read", error))
    }
}

/// Bytes between two calls of `on_read`.
const STEP: u64 = 1 << 22;

/// At most one byte more than `max_bytes`.
fn read_all(
    mut from: impl Read,
    expected: u64,
    max_bytes: u64,
    on_read: &mut dyn FnMut(u64, u64),
) -> io::Result<Vec<u8>> {
    let most = max_bytes.saturating_add(1);
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(usize::try_from(expected.min(most)).unwrap_or(usize::MAX))
        .map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
    while (bytes.len() as u64) < most {
        let step = STEP.min(most - bytes.len() as u64);
        if from.by_ref().take(step).read_to_end(&mut bytes)? == 0 {
            break;
        }
        on_read(bytes.len() as u64, expected);
    }
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
        // Opened by these names, a file behind standard output would have a second position to write at.
        let is_stdout = ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"].iter().any(|name| path == Path::new(name));
        if is_stdout { Target::Stdout } else { Target::File(path) }
    }
}

impl Target {
    /// Whether its name ends in an extension, or in several: `stl.zip`.
    pub fn ends_in(&self, extension: &str) -> bool {
        let Target::File(path) = self else { return false };
        let name = path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase());
        name.is_some_and(|name| name.ends_with(&format!(".{extension}")))
    }

    /// The extension that says the format; none of standard output, and of pipes, devices and descriptors without one.
    pub fn extension(&self) -> Extension<'_> {
        match self {
            Target::Stdout => Extension::None,
            Target::File(path) => match path.extension() {
                Some(extension) => Extension::Is(extension),
                None if is_descriptor(path)
                    || fs::metadata(path).is_ok_and(|file| !file.is_file() && !file.is_dir()) =>
                {
                    Extension::None
                }
                None => Extension::Missing,
            },
        }
    }
}

/// What a target's name says of its format.
pub enum Extension<'a> {
    /// This extension, the last one.
    Is(&'a OsStr),
    /// Nothing, and need not.
    None,
    /// Nothing, as a file's name should.
    Missing,
}

impl Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Target::Stdout => f.write_str("standard output"),
            Target::File(path) => Shown(path).fmt(f),
        }
    }
}

impl Target {
    /// Fails where [`write`](Self::write) would fail for want of a folder or a permission: before the work, not after
    /// it. Opens nothing that could block.
    pub fn check(&self) -> Result<(), Failure> {
        match self {
            Target::Stdout => Ok(()),
            Target::File(path) => check_file(path).map_err(|error| self.cannot_write(error)),
        }
    }

    /// Opens the target and writes it, once.
    pub fn write(&self, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), Failure> {
        let outcome = match self {
            Target::Stdout => Blocking::begin().and_then(|_blocking| {
                let mut out = BufWriter::with_capacity(BUFFER, io::stdout().lock());
                content(&mut out).and_then(|()| out.flush())
            }),
            Target::File(path) => write_file(path, content),
        };
        outcome.map_err(|error| match self {
            _ if signals::is_stopped() => Failure::Stopped,
            Target::Stdout => Failure::stdout(error),
            Target::File(_) => self.cannot_write(error),
        })
    }

    fn cannot_write(&self, error: io::Error) -> Failure {
        if let Target::File(path) = self
            && error.kind() == io::ErrorKind::NotFound
            && !folder(path).exists()
        {
            let message = format_args!("cannot write: the folder {} does not exist", Shown(folder(path)));
            return Failure::about(self)(Error::new(Kind::Io, message));
        }
        Failure::about(self)(Error::io("cannot write", error))
    }
}

/// Bytes that are written at a time.
const BUFFER: usize = 1 << 16;

/// Takes a flag's value as a path, of any bytes, and makes of it what `parse` does.
pub fn path_parser<T: Clone + Send + Sync + 'static>(
    parse: impl Fn(PathBuf) -> std::result::Result<T, String> + Clone + Send + Sync + 'static,
) -> impl TypedValueParser<Value = T> {
    PathBufValueParser::new().try_map(parse)
}

/// How a file is written.
enum Manner {
    /// A regular file, new or old: replaced.
    Beside(PathBuf),
    /// A regular file in a folder that takes no new file: cut to nothing and written.
    Over(PathBuf),
    /// Anything else, which must stay what it is.
    Inside(PathBuf),
}

impl Manner {
    fn of(path: &Path) -> io::Result<Self> {
        match fs::metadata(path) {
            Ok(old) if old.is_dir() => Err(io::ErrorKind::IsADirectory.into()),
            Ok(old) if is_socket(old.file_type()) => Err(io::Error::other("it is a socket")),
            Ok(old) if old.is_file() && !is_descriptor(path) => {
                let path = fs::canonicalize(path)?;
                match tempfile::tempfile_in(folder(&path)).map_err(|error| error.kind()) {
                    Ok(_) => Ok(Self::Beside(path)),
                    Err(io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem) => Ok(Self::Over(path)),
                    Err(kind) => Err(kind.into()),
                }
            }
            Ok(_) => Ok(Self::Inside(path.to_owned())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let path = end_of_links(path)?;
                tempfile::tempfile_in(folder(&path))?;
                Ok(Self::Beside(path))
            }
            Err(error) => Err(error),
        }
    }
}

/// Where symbolic links lead, to a file that is not there yet.
pub(super) fn end_of_links(path: &Path) -> io::Result<PathBuf> {
    const MOST: u32 = 40; // as many as Linux follows
    let mut path = path.to_owned();
    for _ in 0..MOST {
        match fs::read_link(&path) {
            Ok(target) => path = folder(&path).join(target),
            Err(_) => return Ok(path),
        }
    }
    Err(io::Error::other("too many symbolic links"))
}

/// Whether a path names an open file of this process rather than a place in a folder.
fn is_descriptor(path: &Path) -> bool {
    let folders = ["/dev/fd", "/proc/self/fd"].map(Path::new);
    path == Path::new("/dev/stderr") || path.parent().is_some_and(|parent| folders.contains(&parent))
}

#[cfg(unix)]
fn is_socket(kind: FileType) -> bool {
    std::os::unix::fs::FileTypeExt::is_socket(&kind)
}

#[cfg(not(unix))]
fn is_socket(_: FileType) -> bool {
    false
}

/// The folder of a file.
pub fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Fails where [`write_file`] would, as far as can be told without opening what could block.
fn check_file(path: &Path) -> io::Result<()> {
    match Manner::of(path)? {
        Manner::Beside(_) => Ok(()),
        Manner::Over(path) => File::options().append(true).open(path).map(drop),
        Manner::Inside(path) => may_write(&path),
    }
}

#[cfg(unix)]
fn may_write(path: &Path) -> io::Result<()> {
    Ok(rustix::fs::access(path, rustix::fs::Access::WRITE_OK)?)
}

#[cfg(not(unix))]
fn may_write(_: &Path) -> io::Result<()> {
    Ok(())
}

fn write_file(path: &Path, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    match Manner::of(path)? {
        Manner::Inside(path) => {
            let _blocking = Blocking::begin()?;
            write_in_place(File::options().append(true).open(path)?, content)
        }
        Manner::Over(path) => {
            let _blocking = Blocking::begin()?;
            write_in_place(File::options().write(true).truncate(true).open(path)?, content)
        }
        Manner::Beside(path) => {
            let mut builder = tempfile::Builder::new();
            builder.prefix(".tesserae-");
            // As any new file has them: the process's mask still applies.
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
            let file = Stoppable(builder.tempfile_in(folder(&path))?);
            let mut out = BufWriter::with_capacity(BUFFER, file);
            content(&mut out)?;
            let Stoppable(file) = out.into_inner().map_err(io::IntoInnerError::into_error)?;
            if let Ok(old) = fs::metadata(&path) {
                file.as_file().set_permissions(old.permissions())?;
            }
            file.persist(&path).map_err(|error| error.error)?;
            Ok(())
        }
    }
}

fn write_in_place(file: File, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(BUFFER, file);
    content(&mut out)?;
    out.flush()
}

/// A file that takes no more bytes once the command was asked to stop.
struct Stoppable<W>(W);

impl<W: Write> Write for Stoppable<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        signals::check()?;
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}
