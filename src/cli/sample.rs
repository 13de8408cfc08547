//! `tesserae sample`: a mesh made from nothing.

use std::path::PathBuf;

use tesserae_mesh::artifacts::{Content, LABELS_NPY, Labels};
use tesserae_mesh::dev::sample::{Sample, generate, generate_part, write_glb, write_obj};
use tesserae_mesh::error::Error;
use tesserae_mesh::mesh::Format;

use super::files::{Extension, Shown, Target};
use super::summary::count;
use super::{Failure, Quiet, print_line, signals};

/// Arguments of `tesserae sample`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  tesserae sample knot --faces 100000 knot.glb
  tesserae sample quads --faces 5000 - | tesserae cluster - -k 50 -o q.npy")]
pub struct Arguments {
    /// The shape
    #[arg(value_enum)]
    name: Sample,

    /// Number of faces; the mesh has close to as many (see the shape for which numbers are possible)
    #[arg(long, value_name = "N")]
    faces: u64,

    /// Where to write it: OUT.obj, OUT.glb (polygons are cut into triangles), or - for OBJ on standard output; a pipe
    /// or device whose name says no format gets OBJ
    #[arg(value_name = "OUT")]
    out: PathBuf,

    /// part: move every corner by normal noise, so many percent of the diagonal a coordinate, from 0 to 10
    #[arg(long, value_name = "P", default_value_t = 0.0, allow_negative_numbers = true)]
    noise: f64,

    /// part: where to write the patch of each face, as an npy
    #[arg(long, value_name = "OUT.npy")]
    truth: Option<PathBuf>,

    #[command(flatten)]
    quiet: Quiet,
}

/// Writes the mesh and says what was written.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let target = Target::from(arguments.out.clone());
    let format = match target.extension() {
        Extension::None => Format::Obj,
        Extension::Is(extension) if extension.eq_ignore_ascii_case("obj") => Format::Obj,
        Extension::Is(extension) if extension.eq_ignore_ascii_case("glb") => Format::Glb,
        Extension::Is(_) | Extension::Missing => {
            let out = &arguments.out;
            return Err(Failure::Usage("sample", format!("the file to write must end in .obj or .glb, not {out:?}")));
        }
    };
    target.check()?;
    let truth = arguments.truth.clone().map(Target::from);
    truth.iter().try_for_each(Target::check)?;
    if arguments.truth.as_ref().is_some_and(|truth| *truth == arguments.out) {
        return Err(Failure::Usage("sample", "--truth must be another file than the mesh".to_owned()));
    }
    let usage = |error: Error| Failure::Usage("sample", error.message);
    let (mesh, patches) = match arguments.name {
        Sample::Part => generate_part(arguments.faces, arguments.noise).map_err(usage)?,
        name if truth.is_none() && arguments.noise == 0.0 => {
            (generate(name, arguments.faces).map_err(usage)?, Vec::new())
        }
        name => {
            let message = format!("--noise and --truth go with the sample part, not with {}", name.name());
            return Err(Failure::Usage("sample", message));
        }
    };
    signals::cancel_when_asked();
    if let Some(truth) = truth {
        let clusters = patches.iter().max().map_or(0, |&most| u64::from(most) + 1);
        let content = Content { labels: Some(Labels::new(clusters, &patches)), ..Content::default() };
        truth.write((LABELS_NPY.encode)(&content).map_err(Failure::from)?)?;
    }
    target.write(|out| match format {
        Format::Obj | Format::Gltf | Format::Ply | Format::Stl | Format::Off => write_obj(out, &mesh),
        Format::Glb => write_glb(out, &mesh),
    })?;
    let Target::File(path) = &target else { return Ok(()) };
    if arguments.quiet.quiet {
        return Ok(());
    }
    let triangles = if format == Format::Glb && mesh.faces.triangles() != mesh.faces.len() as u64 {
        format!(", written as {} triangles", count(mesh.faces.triangles()))
    } else {
        String::new()
    };
    print_line(&format!(
        "{}: {}, {} faces{triangles}, {} vertices",
        Shown(path),
        arguments.name.name(),
        count(mesh.faces.len() as u64),
        count(mesh.positions.len() as u64)
    ))
}
