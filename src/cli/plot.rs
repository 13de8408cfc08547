//! `tesserae plot`: the energies of reports as a picture.

use std::path::PathBuf;

use tesserae_mesh::dev::plot::{Curve, draw};

use super::files::{Extension, Source, Target};
use super::results::check_places;
use super::{Failure, signals};

/// Arguments of `tesserae plot`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Hierarchies are drawn as energy against the number of clusters, flat clusterings as energy per iteration; of both \
kinds, each gets a panel, with the flat ones as points in the first.

Example:
  tesserae plot pml.json hr.json bb.json energies.svg")]
pub struct Arguments {
    /// Reports, as `--report` wrote them, of any number of runs
    #[arg(value_name = "REPORT.json", required = true, num_args = 1..)]
    reports: Vec<PathBuf>,

    /// Where to draw: OUT.svg, a pipe or device, or - for standard output
    #[arg(value_name = "OUT.svg", required = true)]
    out: PathBuf,
}

/// Reads the reports and draws them.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let target = Target::from(arguments.out.clone());
    let is_svg = match target.extension() {
        Extension::None => true,
        Extension::Is(extension) => extension.eq_ignore_ascii_case("svg"),
        Extension::Missing => false,
    };
    if !is_svg {
        return Err(Failure::Usage("plot", format!("the file to write must end in .svg, not {:?}", arguments.out)));
    }
    let inputs: Vec<_> = arguments.reports.iter().map(|path| ("a report", Source::from(path.clone()))).collect();
    check_places("plot", &inputs, &[("OUT.svg", &target)])?;
    let mut curves = Vec::with_capacity(arguments.reports.len());
    for path in &arguments.reports {
        let source = Source::from(path.clone());
        let json = source.read(u64::MAX)?;
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        curves.push(Curve::read(&name, &json).map_err(Failure::about(&source))?);
    }
    let svg = draw(&curves)?;
    signals::cancel_when_asked();
    target.write(|out| out.write_all(svg.as_bytes()))
}
