//! Whether two names on the command line mean one file, however they are spelled: no result may replace another one, or
//! what it was made from.

use std::collections::HashMap;
use std::fs::{self, Metadata};
use std::io;
use std::path::{Path, PathBuf};

use tesserae_mesh::error::Error;
use tesserae_mesh::mesh::{Beside, Resources};

use super::files::{Source, Target, end_of_links, folder};

/// Somewhere that a result goes, after its flag.
pub type Output<'a> = (&'static str, &'a Target);

/// Refuses outputs that go to one place, and outputs that go where an input (after what it is) comes from.
pub fn check(inputs: &[(&str, &Source)], outputs: &[Output<'_>]) -> Result<(), String> {
    let mut read = Names::default();
    for (what, source) in inputs {
        read.insert(FilePlace::of_source(source), what);
    }
    let mut written = Names::default();
    for (flag, target) in outputs {
        let Some(place) = FilePlace::of_target(target) else { continue };
        if let Some(earlier) = written.get(&place) {
            return Err(match earlier == *flag {
                true => format!("two outputs of {flag} cannot both go to the same place: {target}"),
                false => format!("{earlier} and {flag} cannot both go to the same place: {target}"),
            });
        }
        if let Some(what) = read.get(&place) {
            return Err(format!("{flag} would replace {what}, choose another place: {target}"));
        }
        written.insert(Some(place), flag);
    }
    Ok(())
}

/// What is at each place.
#[derive(Default)]
struct Names<'a> {
    by_path: HashMap<PathBuf, &'a str>,
    by_file: HashMap<FileId, &'a str>,
}

impl<'a> Names<'a> {
    /// Keeps the first name of a place.
    fn insert(&mut self, place: Option<FilePlace>, name: &'a str) {
        let Some(FilePlace { path, file }) = place else { return };
        self.by_path.entry(path).or_insert(name);
        if let Some(file) = file {
            self.by_file.entry(file).or_insert(name);
        }
    }

    fn get(&self, place: &FilePlace) -> Option<&'a str> {
        let of_file = || place.file.as_ref().and_then(|file| self.by_file.get(file));
        self.by_path.get(&place.path).or_else(of_file).copied()
    }
}

/// Buffers beside a mesh, as long as no output would replace them: which they are is known only from the mesh.
pub struct Kept<'a> {
    /// Where they are.
    pub beside: Beside,
    /// Where results go.
    pub outputs: &'a [Output<'a>],
}

impl Resources for Kept<'_> {
    fn load(&self, uri: &str, max_bytes: u64) -> tesserae_mesh::error::Result<Vec<u8>> {
        let bytes = self.beside.load(uri, max_bytes)?;
        let place = FilePlace::of_file(&self.beside.folder.join(uri));
        match self
            .outputs
            .iter()
            .find(|(_, target)| FilePlace::of_target(target).is_some_and(|target| target.is(&place)))
        {
            Some((flag, _)) => Err(Error::parameter(format_args!(
                "{flag} would replace a buffer of the mesh, choose another place: {uri:?}"
            ))),
            None => Ok(bytes),
        }
    }
}

/// Where a name leads.
#[derive(Debug)]
struct FilePlace {
    /// Absolute and without links; `-` for standard streams, which a file of that name never is.
    path: PathBuf,
    /// What the system tells the file by, where there is one already: it may have several names.
    file: Option<FileId>,
}

impl FilePlace {
    fn of_file(path: &Path) -> Self {
        // where a link leads counts, though nothing is there yet
        let beside = || {
            let end = end_of_links(path).ok()?;
            Some(fs::canonicalize(folder(&end)).ok()?.join(end.file_name()?))
        };
        Self {
            path: fs::canonicalize(path).ok().or_else(beside).unwrap_or_else(|| path.to_owned()),
            file: fs::metadata(path).ok().and_then(|metadata| file_id(&metadata)),
        }
    }

    /// None for files that are character devices, such as the null device: several results may go there.
    fn of_target(target: &Target) -> Option<Self> {
        match target {
            Target::Stdout => {
                let file = stdout().ok().filter(|metadata| !is_device(metadata)).as_ref().and_then(file_id);
                Some(Self { path: "-".into(), file })
            }
            Target::File(path) if fs::metadata(path).is_ok_and(|metadata| is_device(&metadata)) => None,
            Target::File(path) => Some(Self::of_file(path)),
        }
    }

    /// None for what cannot be replaced: pipes, terminals and the like, which may well be written to as they are read.
    fn of_source(source: &Source) -> Option<Self> {
        let metadata = match source {
            Source::Stdin => stdin(),
            Source::File(path) => fs::metadata(path),
        };
        let metadata = metadata.ok().filter(Metadata::is_file)?;
        match source {
            Source::Stdin => Some(Self { path: PathBuf::new(), file: file_id(&metadata) }),
            Source::File(path) => Some(Self::of_file(path)),
        }
    }

    fn is(&self, other: &Self) -> bool {
        self.path == other.path || self.file.is_some() && self.file == other.file
    }
}

/// Device and number of a file.
type FileId = (u64, u64);

#[cfg(unix)]
fn file_id(metadata: &Metadata) -> Option<FileId> {
    use std::os::unix::fs::MetadataExt;
    Some((metadata.dev(), metadata.ino()))
}

#[cfg(unix)]
fn is_device(metadata: &Metadata) -> bool {
    std::os::unix::fs::FileTypeExt::is_char_device(&metadata.file_type())
}

#[cfg(not(unix))]
fn is_device(_: &Metadata) -> bool {
    false
}

#[cfg(not(unix))]
fn file_id(_: &Metadata) -> Option<FileId> {
    None
}

#[cfg(unix)]
fn stdin() -> io::Result<Metadata> {
    use std::os::fd::AsFd;
    fs::File::from(io::stdin().as_fd().try_clone_to_owned()?).metadata()
}

#[cfg(unix)]
fn stdout() -> io::Result<Metadata> {
    use std::os::fd::AsFd;
    fs::File::from(io::stdout().as_fd().try_clone_to_owned()?).metadata()
}

#[cfg(not(unix))]
fn stdin() -> io::Result<Metadata> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(not(unix))]
fn stdout() -> io::Result<Metadata> {
    Err(io::ErrorKind::Unsupported.into())
}
