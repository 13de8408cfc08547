//! Zip archives, written front to back: files are stored as they are, and dated 1980-01-01, so that equal content gives
//! equal bytes.

use std::io::{self, Write};

use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, DateTime, System, ZipWriter};

/// Bytes from which on a file needs 64-bit lengths.
const LARGE: usize = u32::MAX as usize;

/// An archive in the making; without [`finish`](Self::finish) it cannot be read.
pub struct Archive<'w> {
    zip: ZipWriter<StreamWriter<&'w mut dyn Write>>,
}

impl<'w> Archive<'w> {
    /// An archive without files.
    pub fn new(out: &'w mut dyn Write) -> Self {
        Self { zip: ZipWriter::new_stream(out) }
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
        self.zip.write_all(bytes)
    }

    /// Writes the list of files.
    pub fn finish(self) -> io::Result<()> {
        self.zip.finish()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Read};

    use super::*;

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
