//! `tesserae serve`: the HTTP service in this process.

use std::sync::Arc;

use super::device::DeviceArguments;
use super::{Failure, signals};
use crate::bench;
use crate::device::select::DeviceChoice;
use crate::error::Error;
use crate::report::{DeviceInfo, DeviceKind};
use crate::service::{self, DeviceDescription, Extras, LogSettings, Settings};

/// Arguments of `tesserae serve`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Every setting is a flag or an environment variable. Ctrl-C and SIGTERM stop the service in order.

Example:
  tesserae serve --listen 127.0.0.1:8080
  curl --data-binary @mesh.glb -H 'Content-Type: model/gltf-binary' 'http://127.0.0.1:8080/v1/jobs?clusters=1000'")]
pub struct Arguments {
    #[command(flatten)]
    settings: Settings,

    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    log: LogSettings,
}

/// Open files that the process asks for, of those that the system lets it have.
const OPEN_FILES: u64 = 65_536;

/// Serves until it is asked to stop.
pub fn run(arguments: Arguments) -> Result<(), Failure> {
    if let Some(message) = arguments.device.contradiction() {
        return Err(Failure::Usage("serve", message));
    }
    arguments.settings.check().map_err(|error| Failure::Usage("serve", error.message))?;
    let logging = arguments.log.start().map_err(|error| Failure::Usage("serve", error.message))?;
    // what the service writes is for its own user only
    #[cfg(unix)]
    nix::sys::stat::umask(nix::sys::stat::Mode::from_bits_truncate(0o077));
    // a connection is an open file; where it cannot be raised, the limit is as it is
    match rlimit::increase_nofile_limit(OPEN_FILES) {
        Ok(limit) => tracing::debug!(limit, "open files"),
        Err(error) => tracing::warn!(%error, "the number of open files cannot be raised"),
    }
    let device = arguments.device.open_for_any()?;
    let (device, cpu_below_faces) = match (arguments.device.is_auto(), device.info().kind) {
        (true, DeviceKind::Gpu) => {
            let (device, faces) = bench::calibrated(device, bench::PATIENCE, || arguments.device.open_for_any())?;
            (device, Some(faces))
        }
        (true, DeviceKind::Cpu) => (device, Some(0)),
        (false, _) => (device, None),
    };
    let description = DeviceDescription {
        chosen: chosen(&arguments.device, device.info()),
        info: device.info().clone(),
        cpu_below_faces,
    };
    let choice = arguments.device.clone();
    let reopen: service::Reopen = Arc::new(move || choice.open_for_any());
    let extras = Extras { reopen: Some(reopen), ..Extras::default() };
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .map_err(|error| Error::io("cannot start the threads of the service", error))?;
    let served = runtime.block_on(async {
        let shutdown = signals::requests_to_stop().map_err(|error| Error::io("cannot listen for signals", error))?;
        service::serve(arguments.settings, device, description, extras, shutdown).await
    });
    // What still works on a mesh is left behind.
    runtime.shutdown_background();
    drop(logging);
    Ok(served?)
}

/// Why it is this device, for people.
fn chosen(arguments: &DeviceArguments, info: &DeviceInfo) -> String {
    match (arguments.device, &arguments.adapter, info.kind) {
        (choice, Some(adapter), _) => format!("asked for: {choice}, adapter {adapter:?}"),
        (DeviceChoice::Auto, None, DeviceKind::Cpu) => "auto: no graphics processor can be used".to_owned(),
        (DeviceChoice::Auto, None, DeviceKind::Gpu) => "auto: the fastest kind of graphics processor here".to_owned(),
        (choice @ (DeviceChoice::Cpu | DeviceChoice::Gpu), None, _) => format!("asked for: {choice}"),
    }
}
