//! Zip archives, written front to back: files are stored as they are, and dated 1980-01-01, so that equal content gives
//! equal bytes.

use std::cell::Cell;
use std::io::{self, Write};
use std::rc::Rc;

use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, DateTime, System, ZipWriter};

/// Bytes from which on a file needs 64-bit lengths.
const LARGE: usize = u32::MAX as usize;

/// An archive in the making; without [`finish`](Self::finish) it cannot be read.
pub struct Archive<'w> {
    zip: ZipWriter<StreamWriter<Out<'w>>>,
    failed: Failure,
}

/// Why a write failed.
type Failure = Rc<Cell<Option<io::Error>>>;

/// Where the archive goes. The library writes the list of files when it is dropped, and prints an error if that fails:
/// so it never sees one, and what it writes after a failure is lost.
struct Out<'w> {
    out: &'w mut dyn Write,
    has_failed: bool,
    failed: Failure,
}

impl Write for Out<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if !self.has_failed
            && let Err(error) = self.out.write_all(bytes)
        {
            self.has_failed = true;
            self.failed.set(Some(error));
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<'w> Archive<'w> {
    /// An archive without files.
    pub fn new(out: &'w mut dyn Write) -> Self {
        let failed = Failure::default();
        let out = Out { out, has_failed: false, failed: Rc::clone(&failed) };
        Self { zip: ZipWriter::new_stream(out), failed }
    }

    /// Adds a file.
    pub fn add(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .last_modified_time(DateTime::DEFAULT)
            .system(System::Unix)
            .unix_permissions(0o644)
            .large_file(bytes.len() >= LARGE);
        self.zip.start_file(name, options)?;
        self.zip.write_all(bytes)?;
        self.failed.take().map_or(Ok(()), Err)
    }

    /// Writes the list of files.
    pub fn finish(self) -> io::Result<()> {
        self.zip.finish()?;
        self.failed.take().map_or(Ok(()), Err)
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Read};

    use super::*;

    #[test]
    fn a_failed_write_is_an_error_of_the_archive() {
        let mut room = [0; 60];
        let mut full = &mut room[..];
        let mut archive = Archive::new(&mut full);
        archive.add("a.txt", b"12345").expect("there is room");
        assert_eq!(archive.add("b.txt", b"12345").expect_err("full").kind(), io::ErrorKind::WriteZero);
        drop(archive);
        let mut full = &mut room[..50];
        let mut archive = Archive::new(&mut full);
        archive.add("a.txt", b"12345").expect("there is room");
        assert!(archive.finish().is_err(), "there is no room for the list of files");
    }

    #[test]
    fn an_archive_has_its_files_stored_and_dated_the_same_every_time() {
        let written = || {
            let mut bytes = Vec::new();
            let mut archive = Archive::new(&mut bytes);
            archive.add("a.txt", b"first").expect("added");
            archive.add("b/c.txt", b"").expect("added");
            archive.finish().expect("finished");
            bytes
        };
        assert_eq!(written(), written());
        let mut archive = zip::ZipArchive::new(Cursor::new(written())).expect("an archive");
        let names: Vec<String> = archive.file_names().map(str::to_owned).collect();
        assert_eq!(names, ["a.txt", "b/c.txt"]);
        let mut file = archive.by_name("a.txt").expect("there");
        assert_eq!(file.compression(), CompressionMethod::Stored);
        assert_eq!(file.last_modified(), Some(DateTime::DEFAULT));
        let mut text = String::new();
        file.read_to_string(&mut text).expect("text");
        assert_eq!(text, "first");
    }
}
