//! `tesserae serve`: the HTTP service in this process.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, mpsc};
use std::time::Duration;

use super::device::DeviceArguments;
use super::{Failure, signals};
use crate::bench;
use crate::device::select::{DeviceChoice, FACES_FOR_GPU};
use crate::device::{Cancel, Device};
use crate::error::{Error, Kind};
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
    // a connection is an open file; where it cannot be raised, the limit is as it is
    match rlimit::increase_nofile_limit(OPEN_FILES) {
        Ok(limit) => tracing::debug!(limit, "open files"),
        Err(error) => tracing::warn!(%error, "the number of open files cannot be raised"),
    }
    let device = arguments.device.open_for_any()?;
    let (device, cpu_below_faces) = match (arguments.device.is_auto(), device.info().kind) {
        (true, DeviceKind::Gpu) => {
            let (device, faces) = calibrated(device, &arguments.device)?;
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

/// More faces than any mesh has.
const NO_MESH: u64 = 1 << 32;

/// How long the measuring of a gpu may take.
const PATIENCE: Duration = Duration::from_secs(20);

/// A gpu, and the smallest mesh, in faces, that it is faster with than the cpu. One that does not answer is opened anew and
/// gets the larger meshes, as does one that fails: it may be well later. One whose labels are wrong gets none.
fn calibrated(mut gpu: Box<dyn Device>, choice: &DeviceArguments) -> Result<(Box<dyn Device>, u64), Error> {
    let (told, outcome) = mpsc::channel();
    let measure = move || {
        let cancel = Cancel::default();
        let faces = catch_unwind(AssertUnwindSafe(|| bench::faces_for_gpu(gpu.as_mut(), &cancel)));
        // nobody listens any more when it took too long
        let _ = told.send((gpu, faces));
    };
    std::thread::Builder::new()
        .name("calibration".to_owned())
        .spawn(measure)
        .map_err(|error| Error::io("a thread cannot be started", error))?;
    let why = match outcome.recv_timeout(PATIENCE) {
        Ok((gpu, Ok(Ok(faces)))) => return Ok((gpu, faces)),
        Ok((gpu, Ok(Err(error)))) if error.kind == Kind::DeviceUnsuitable => {
            tracing::error!(%error, "the gpu is not used");
            return Ok((gpu, NO_MESH));
        }
        Ok((_, Ok(Err(error)))) => error.message,
        Ok((_, Err(_))) => "its driver panicked".to_owned(),
        Err(_) => format!("it did not answer within {PATIENCE:?}"),
    };
    tracing::warn!(why, faces = FACES_FOR_GPU, "the gpu cannot be measured; it gets the larger meshes");
    Ok((choice.open_for_any()?, FACES_FOR_GPU))
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
