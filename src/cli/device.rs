//! The flags that choose a device, the same for every command that needs one.

use tesserae_mesh::device::select::DeviceChoice;
use tesserae_mesh::job;

/// Which device a command uses.
#[derive(Debug, Clone, clap::Args)]
pub struct DeviceArguments {
    /// Where to cluster; labels do not depend on it
    #[arg(long, env = "TESSERAE_DEVICE", value_enum, default_value_t)]
    pub device: DeviceChoice,

    /// Which gpu: its number, or a part of its name, as `tesserae devices` lists them; no other device will do then
    #[arg(long, env = "TESSERAE_ADAPTER", value_name = "INDEX|NAME", hide_short_help = true)]
    pub adapter: Option<String>,
}

impl DeviceArguments {
    /// What is wrong with the combination of flags, if anything.
    pub fn contradiction(&self) -> Option<String> {
        (self.device == DeviceChoice::Cpu && self.adapter.is_some())
            .then(|| "--adapter chooses among gpus and does not go with --device cpu".to_owned())
    }

    /// The choice, for a job.
    pub fn choice(&self) -> job::DeviceFor<'_> {
        job::DeviceFor { choice: self.device, adapter: self.adapter.as_deref() }
    }
}
