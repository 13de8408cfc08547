//! Which device a command uses.

use crate::device::Device;
use crate::device::cpu::CpuDevice;
use crate::error::{Error, Kind, Result};

/// The flags that choose a device.
#[derive(Debug, clap::Args)]
pub struct DeviceArguments {
    /// Where to cluster: auto takes what finishes sooner
    #[arg(long, env = "TESSERAE_DEVICE", default_value = "auto", value_name = "auto|cpu|gpu")]
    device: String,

    /// Which GPU: its number or a part of its name, as `tesserae devices` lists them
    #[arg(long, env = "TESSERAE_ADAPTER", value_name = "INDEX|NAME")]
    adapter: Option<String>,
}

impl DeviceArguments {
    /// Opens the device for a mesh of `faces` faces.
    pub fn open(&self, faces: u64) -> Result<Box<dyn Device>> {
        if self.device == "gpu" {
            return Err(Error::new(Kind::Internal, format!("{self:?} {faces}")));
        }
        Ok(Box::new(CpuDevice::new()))
    }
}
