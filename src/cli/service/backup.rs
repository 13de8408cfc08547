//! `tesserae backup`: a copy of a data folder, also while a service works in it.

use std::path::PathBuf;

use crate::{Failure, print_line};
use tesserae_service as service;

/// Arguments of `tesserae backup`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The backup is a data folder: to restore it, start a service on it, or on a copy of it. Ended jobs have their \
results, queued and running ones run. Files of jobs are hard links where the backup is on the same disk: copy it \
to another disk to outlive this one.

Example:
  tesserae backup --data-dir /var/lib/tesserae /backups/2026-11-22
  tesserae serve --data-dir /backups/2026-11-22")]
pub struct Arguments {
    /// Folder that the service works in
    #[arg(long, env = "TESSERAE_DATA_DIR", value_name = "DIR")]
    data_dir: PathBuf,

    /// Folder for the backup: a new one, or an empty one
    #[arg(value_name = "OUT")]
    out: PathBuf,
}

/// Does what the arguments say.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let backup = service::back_up(&arguments.data_dir, &arguments.out)?;
    let service::Backup { jobs, files, left_out } = backup;
    print_line(&format!("jobs: {jobs}, files: {files}, jobs left out that began and ended meanwhile: {left_out}"))
}
