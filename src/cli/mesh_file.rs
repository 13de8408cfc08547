//! The mesh that a command reads: its flags, its format, and the files that it may refer to.

use std::path::PathBuf;

use super::Failure;
use super::files::{self, Source};
use super::places::{Kept, Output};
use crate::mesh::{Beside, Format, NoResources, Resources};

/// Which mesh is read.
#[derive(Debug, clap::Args)]
pub struct MeshFile {
    #[arg(value_name = "INPUT", help = format!("The mesh: {}, or - for standard input", Format::choice(".")))]
    input: PathBuf,

    #[arg(long, value_name = "FORMAT", value_parser = Format::from_name, help = format!(
        "Format of the mesh: {}; by file name, then by content when left out", Format::choice("")
    ))]
    format: Option<Format>,
}

impl MeshFile {
    /// Where it is read from.
    pub fn source(&self) -> Source {
        Source::from(self.input.clone())
    }

    /// The format of these bytes, which were read from there.
    pub fn format(&self, bytes: &[u8]) -> Result<Format, Failure> {
        if let Some(format) = self.format {
            return Ok(format);
        }
        let source = self.source();
        let name = match &source {
            Source::Stdin => None,
            Source::File(path) => Some(path.to_string_lossy()),
        };
        let format = Format::recognise(name.as_deref(), bytes, Some(bytes.len() as u64));
        format.map_err(Failure::about(&source))
    }

    /// The files beside it, which no output may replace.
    pub fn resources<'a>(&self, outputs: &'a [Output<'a>]) -> Box<dyn Resources + 'a> {
        match self.source() {
            Source::Stdin => Box::new(NoResources),
            Source::File(path) => {
                Box::new(Kept { beside: Beside { folder: files::folder(&path).to_owned() }, outputs })
            }
        }
    }
}
