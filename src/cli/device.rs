//! The flags that choose a device, the same for every command that needs one.

use crate::device::Device;
use crate::device::select::{self, DeviceChoice};
use crate::error::Result;

/// Which device a command uses.
#[derive(Debug, clap::Args)]
pub struct DeviceArguments {
    /// Where to cluster; labels do not depend on it
    #[arg(long, env = "TESSERAE_DEVICE", value_enum, default_value_t)]
    pub device: DeviceChoice,

    /// Which gpu: its number, or a part of its name, as `tesserae devices` lists them; no other device will do then
    #[arg(long, env = "TESSERAE_ADAPTER", value_name = "INDEX|NAME")]
    pub adapter: Option<String>,
}

impl DeviceArguments {
    /// What is wrong with the combination of flags, if anything.
    pub fn contradiction(&self) -> Option<String> {
        (self.device == DeviceChoice::Cpu && self.adapter.is_some())
            .then(|| "--adapter chooses among gpus and does not go with --device cpu".to_owned())
    }

    /// Opens the device; `faces` is the size of the only mesh it is for, where there is only one.
    pub fn open(&self, faces: Option<u64>) -> Result<Box<dyn Device>> {
        select::open(self.device, self.adapter.as_deref(), faces)
    }
}
