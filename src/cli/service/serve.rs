//! `tesserae serve`: the HTTP service in this process.

use std::cell::LazyCell;
use std::collections::BTreeSet;
use std::sync::Arc;

use clap::CommandFactory as _;
use tesserae_mesh::dev::bench;
use tesserae_mesh::device::Device;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::select::{self, DeviceChoice};
use tesserae_mesh::error::{Error, Result};
use tesserae_mesh::report::{DeviceInfo, DeviceKind};
use tesserae_service::{self as service, DeviceDescription, Extras, LogSettings, Settings, Switch};
use tokio::sync::Notify;

use super::signals;
use crate::device::DeviceArguments;
use crate::{Cli, Failure};

/// Arguments of `tesserae serve`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Every setting is a flag or an environment variable. Ctrl-C and SIGTERM stop the service in order, and again during \
--drain-delay end that delay.

Example:
  tesserae serve --listen 127.0.0.1:8080
  curl --data-binary @mesh.glb -H 'Content-Type: model/gltf-binary' \\
    'http://127.0.0.1:8080/v1/jobs?clusters=1000'")]
pub struct Arguments {
    #[command(flatten)]
    settings: Settings,

    #[command(flatten, next_help_heading = "Work")]
    device: DeviceArguments,

    #[command(flatten)]
    log: LogSettings,
}

/// Limit of open files that the process requests from the system.
const OPEN_FILES: u64 = 65_536;

/// What the environment variables of this program begin with.
const PREFIX: &str = "TESSERAE_";

/// Seconds that deploy/compose.yaml and deploy/tesserae.service wait for the end of the process.
const SUPERVISORS_WAIT: u64 = 40;

/// Serves until it is asked to stop.
pub fn run(mut arguments: Arguments) -> Result<(), Failure> {
    if let Some(message) = arguments.device.contradiction() {
        return Err(Failure::Usage("serve", message));
    }
    arguments.settings.check().map_err(|error| Failure::Usage("serve", error.message))?;
    arguments.log.start().map_err(|error| Failure::Usage("serve", error.message))?;
    // what the service writes is for its own user only
    #[cfg(unix)]
    rustix::process::umask(rustix::fs::Mode::from_bits_truncate(0o077));
    // a connection is an open file
    match rlimit::increase_nofile_limit(OPEN_FILES) {
        Ok(limit) => arguments.settings.traffic.constants.fit(limit)?,
        Err(error) => tracing::warn!(%error, "the number of open files cannot be raised"),
    }
    warn_of_unknown_variables();
    let seconds = arguments.settings.seconds_to_stop();
    if seconds > SUPERVISORS_WAIT {
        tracing::warn!(
            seconds,
            "stopping may take longer than supervisors wait: raise TimeoutStopSec of systemd, stop_grace_period of \
             compose"
        );
    }
    let works = arguments.settings.work.work == Switch::On;
    let mut adapters = Vec::new();
    let DeviceArguments { device: choice, adapter } = &arguments.device;
    let device = match works {
        true => select::open_listing(*choice, adapter.as_deref(), None, &mut adapters)?,
        false => Box::new(CpuDevice::new()),
    };
    let (device, cpu_below_faces) = match (arguments.device.choice().is_auto(), device.info().kind) {
        (true, DeviceKind::Gpu) => {
            let (device, faces) = bench::calibrated(device, bench::PATIENCE, || open(&arguments.device))?;
            (device, Some(faces))
        }
        (true, DeviceKind::Cpu) => (device, Some(0)),
        (false, _) => (device, None),
    };
    let description = DeviceDescription {
        chosen: if works { chosen(&arguments.device, device.info()) } else { "none: --work off".to_owned() },
        info: device.info().clone(),
        cpu_below_faces,
        adapters,
    };
    let choice = arguments.device.clone();
    let reopen: service::Reopen = Arc::new(move || open(&choice));
    let stop_again = Arc::<Notify>::default();
    let extras = Extras { reopen: Some(reopen), end_drain_delay: Some(Arc::clone(&stop_again)), ..Extras::default() };
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .map_err(|error| Error::io("cannot start the threads of the service", error))?;
    let served = runtime.block_on(async {
        let cannot = |error| Error::io("cannot listen for signals", error);
        let shutdown = signals::requests_to_stop(stop_again).map_err(cannot)?;
        service::Server::bind(arguments.settings, device, description, extras).await?.run(shutdown).await
    });
    // What still works on a mesh is left behind.
    runtime.shutdown_background();
    Ok(served?)
}

/// Opens the device for meshes that are not known yet.
fn open(device: &DeviceArguments) -> Result<Box<dyn Device>> {
    select::open(device.device, device.adapter.as_deref(), None)
}

/// Warns of environment variables that look like settings and are none: a typing error would otherwise change nothing
/// without a word.
fn warn_of_unknown_variables() {
    let known = LazyCell::new(known_variables);
    for (name, _) in std::env::vars_os() {
        let name = name.to_string_lossy().into_owned();
        if name.starts_with(PREFIX) && !known.contains(&name) {
            match nearest(&name, &known) {
                Some(nearest) => tracing::warn!("there is no setting {name}; is {nearest} meant?"),
                None => tracing::warn!("there is no setting {name}"),
            }
        }
    }
}

/// The variables of all commands, and that of the tests.
fn known_variables() -> BTreeSet<String> {
    let cli = Cli::command();
    let arguments = cli.get_subcommands().flat_map(clap::Command::get_arguments);
    let variables = arguments.filter_map(|argument| Some(argument.get_env()?.to_string_lossy().into_owned()));
    variables.chain(["TESSERAE_TEST_MESHES".to_owned()]).collect()
}

/// The known name that differs least from `name`, if it is near.
fn nearest<'a>(name: &str, known: &'a BTreeSet<String>) -> Option<&'a str> {
    let distance = |other: &String| strsim::damerau_levenshtein(name, other);
    let nearest = known.iter().min_by_key(|other| distance(other))?;
    (distance(nearest) <= name.len().saturating_sub(PREFIX.len()) / 3 + 1).then_some(nearest)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_setting_is_named_for_a_typing_error() {
        let known = known_variables();
        assert!(known.contains("TESSERAE_LISTEN") && known.contains("TESSERAE_DATA_DIR"), "{known:?}");
        assert_eq!(nearest("TESSERAE_MAX_QUEUE_JOBS", &known), Some("TESSERAE_MAX_QUEUED_JOBS"));
        assert_eq!(nearest("TESSERAE_TOKEN", &known), Some("TESSERAE_TOKENS"));
        assert_eq!(nearest("TESSERAE_SOMETHING_ELSE_ALTOGETHER", &known), None);
    }
}
