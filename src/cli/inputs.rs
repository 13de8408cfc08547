//! The mesh that a command reads: its flags, its format, its limits, and the files that it may refer to.

use std::ffi::OsStr;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;
use tesserae_mesh::error::Error;
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::mesh::{Beside, Format, Limits, NoResources, Resources};
use tesserae_mesh::parameters::heading;

use super::Failure;
use super::files::{self, Source};
use super::places::{Kept, Output};

/// Times as many bytes as were compressed that may come of them, as over HTTP,
const INFLATION: u64 = 100;
/// beyond these: small meshes may be very regular.
const ANY_INFLATION: u64 = 1 << 20;

/// First bytes of a gzip file.
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Which mesh is read.
#[derive(Debug, clap::Args)]
pub struct OneMesh {
    #[arg(value_name = "INPUT", help = help("The mesh"), help_heading = heading::INPUT, display_order = 0)]
    input: PathBuf,

    #[command(flatten)]
    format: FormatFlag,
}

/// Which meshes are read.
#[derive(Debug, clap::Args)]
pub struct Meshes {
    #[arg(value_name = "INPUT", id = "input", required = true, num_args = 1.., help = help_of_points(),
          help_heading = heading::INPUT, display_order = 0)]
    inputs: Vec<PathBuf>,

    #[command(flatten)]
    format: FormatFlag,
}

/// Which format a mesh has.
#[derive(Debug, Clone, Copy, clap::Args)]
struct FormatFlag {
    #[arg(long, value_name = "FORMAT", value_parser = Format::from_name, help_heading = heading::INPUT,
          hide_short_help = true, help = format!(
        "Format of the mesh: {}; by file name, then by content when left out", Format::choice("")
    ))]
    format: Option<Format>,
}

/// What a mesh may cost.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct LimitFlags {
    /// Largest number of faces that is accepted
    #[arg(long, env = "TESSERAE_MAX_FACES", value_name = "N", default_value_t = Limits::default().max_faces,
          help_heading = heading::LIMITS, hide_short_help = true)]
    pub max_faces: u64,

    /// Largest number of bytes that is accepted, the mesh (unpacked) and its buffers together
    #[arg(long, env = "TESSERAE_MAX_UPLOAD_BYTES", value_name = "BYTES", default_value_t = Limits::default().max_bytes,
          help_heading = heading::LIMITS, hide_short_help = true)]
    max_upload_bytes: u64,
}

impl LimitFlags {
    /// As readers take them, without a limit of faces a byte.
    pub fn limits(&self) -> Limits {
        Limits { max_bytes: self.max_upload_bytes, max_faces: self.max_faces, max_faces_per_byte: None }
    }
}

/// What is said about meshes or points.
fn help_of_points() -> String {
    format!("{}; or points with neighbours: .npy, .npz, .png or .jpg", help("The mesh, or several"))
}

/// What is said about a mesh.
fn help(what: &str) -> String {
    format!("{what}: {}, or - for standard input; also with .gz", Format::choice("."))
}

impl OneMesh {
    /// The file.
    pub fn file(&self) -> MeshFile {
        MeshFile::new(&self.input, self.format)
    }
}

impl Meshes {
    /// The files, at least one.
    pub fn files(&self) -> Vec<MeshFile> {
        self.inputs.iter().map(|path| MeshFile::new(path, self.format)).collect()
    }
}

/// A mesh file, or standard input.
#[derive(Debug)]
pub struct MeshFile {
    /// Where it is read from.
    pub source: Source,
    format: Option<Format>,
}

impl MeshFile {
    fn new(path: &Path, FormatFlag { format }: FormatFlag) -> Self {
        Self { source: Source::from(path.to_owned()), format }
    }

    /// A file whose format its name or content says.
    pub fn at(path: &Path) -> Self {
        Self::new(path, FormatFlag { format: None })
    }

    /// Its name without folder and extensions; `stdin` for standard input.
    pub fn stem(&self) -> &OsStr {
        match &self.source {
            Source::Stdin => OsStr::new("stdin"),
            Source::File(path) => {
                let path = without_gz(path);
                path.file_stem().unwrap_or(path.as_os_str())
            }
        }
    }

    /// The bytes of a mesh, unpacked, and its format. Refuses points.
    pub fn read_mesh(&self, limits: &Limits) -> Result<(Vec<u8>, Format), Failure> {
        match self.read(limits, &mut |_, _| ())? {
            (bytes, InputFormat::Mesh(format)) => Ok((bytes, format)),
            (_, InputFormat::Points(format)) => Err(Failure::about(&self.source)(Error::parameter(format_args!(
                "these are points, not a mesh: tesserae cluster takes them; their format is {}",
                format.name()
            )))),
        }
    }

    /// The bytes of the file, unpacked, and its format. `on_read` is called with the bytes read so far and the length
    /// of the file, 0 where it is unknown.
    pub fn read(&self, limits: &Limits, on_read: &mut dyn FnMut(u64, u64)) -> Result<(Vec<u8>, InputFormat), Failure> {
        let about = || Failure::about(&self.source);
        let mut bytes = self.source.read_with(limits.max_bytes, on_read)?;
        if bytes.starts_with(&GZIP) {
            bytes = unpack(&bytes, limits.max_bytes).map_err(about())?;
        }
        limits.check_bytes(bytes.len() as u64).map_err(about())?;
        if let Some(format) = self.format {
            return Ok((bytes, InputFormat::Mesh(format)));
        }
        let name = match &self.source {
            Source::Stdin => None,
            Source::File(path) => Some(without_gz(path).to_string_lossy()),
        };
        let format = InputFormat::recognise(name.as_deref(), &bytes, Some(bytes.len() as u64)).map_err(about())?;
        Ok((bytes, format))
    }

    /// The files beside it, which no output may replace.
    pub fn resources<'a>(&self, outputs: &'a [Output<'a>]) -> Box<dyn Resources + 'a> {
        match &self.source {
            Source::Stdin => Box::new(NoResources),
            Source::File(path) => Box::new(Kept { beside: Beside { folder: files::folder(path).to_owned() }, outputs }),
        }
    }
}

/// The path without a last extension `.gz`.
fn without_gz(path: &Path) -> &Path {
    match path.extension() {
        Some(extension) if extension.eq_ignore_ascii_case("gz") => path.file_stem().map_or(path, Path::new),
        _ => path,
    }
}

/// The content of a gzip file, of one member or several, or as much of it as shows that it is more than `max_bytes`.
fn unpack(packed: &[u8], max_bytes: u64) -> tesserae_mesh::error::Result<Vec<u8>> {
    let inflated = ANY_INFLATION.saturating_add(INFLATION.saturating_mul(packed.len() as u64));
    let mut bytes = Vec::new();
    // one byte more shows that it is too much
    let most = max_bytes.min(inflated).saturating_add(1);
    MultiGzDecoder::new(packed).take(most).read_to_end(&mut bytes).map_err(damaged)?;
    if bytes.len() as u64 > inflated {
        return Err(Error::too_large(format_args!(
            "the gzip file becomes more than {INFLATION} times as large: unpack it first, with gunzip; it has {} bytes",
            packed.len()
        )));
    }
    Ok(bytes)
}

fn damaged(error: io::Error) -> Error {
    Error::mesh(format_args!("the gzip file is damaged or truncated: {error}"))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::*;
    use tesserae_mesh::error::Kind;

    fn packed(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(bytes).expect("a vector takes everything");
        encoder.finish().expect("a vector takes everything")
    }

    #[test]
    fn members_follow_each_other_and_a_cut_file_is_refused() {
        let two = [packed(b"v 0 0 0\n"), packed(b"f 1 1 1\n")].concat();
        assert_eq!(unpack(&two, 1 << 20).expect("text"), b"v 0 0 0\nf 1 1 1\n");
        for cut in [5, two.len() - 1] {
            let error = unpack(&two[..cut], 1 << 20).expect_err("cut");
            assert!(error.message.contains("damaged or truncated"), "{error}");
        }
    }

    #[test]
    fn unpacking_stops_at_the_limits() {
        let zeros = packed(&vec![0; 8 << 20]);
        assert!((zeros.len() as u64) < (8 << 20) / INFLATION - ANY_INFLATION / INFLATION, "{}", zeros.len());
        let error = unpack(&zeros, u64::MAX).expect_err("too much");
        assert_eq!(error.kind, Kind::TooLarge);
        assert!(error.message.contains("gunzip"), "{error}");
        assert_eq!(unpack(&zeros, 1000).expect("as much as shows that it is too much").len(), 1001);
        assert_eq!(unpack(&packed(&vec![0; 1 << 20]), u64::MAX).expect("a small file").len(), 1 << 20);
    }

    #[test]
    fn names_lose_folder_and_extensions() {
        let stem = |path: &str| MeshFile::new(Path::new(path), FormatFlag { format: None }).stem().to_owned();
        for (path, name) in
            [("a/horse.obj", "horse"), ("horse.v2.obj.GZ", "horse.v2"), ("horse", "horse"), ("-", "stdin")]
        {
            assert_eq!(stem(path), name);
        }
    }
}
