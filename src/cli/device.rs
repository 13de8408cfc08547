//! The flags that choose a device, the same for every command that needs one.

use crate::device::Device;
use crate::device::select::{self, DeviceChoice, FACES_FOR_GPU};
use crate::error::Result;
use crate::job::Prepared;

/// Bytes of a face in most files, at least.
const BYTES_A_FACE: u64 = 16;

/// Which device a command uses.
#[derive(Debug, Clone, clap::Args)]
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

    /// Whether the choice is left to this program: who names an adapter wants that one.
    pub fn is_auto(&self) -> bool {
        self.device == DeviceChoice::Auto && self.adapter.is_none()
    }

    /// Whether nothing but a gpu will do.
    pub fn wants_gpu(&self) -> bool {
        self.device == DeviceChoice::Gpu || self.adapter.is_some()
    }

    /// Opens a gpu before the mesh is known, if it will be one or, by the bytes of the mesh, probably will: this takes
    /// as long as reading a mesh.
    pub fn open_ahead(&self, bytes: usize) -> Option<Result<Box<dyn Device>>> {
        let is_large = bytes as u64 >= BYTES_A_FACE * FACES_FOR_GPU;
        (self.wants_gpu() || self.is_auto() && is_large)
            .then(|| select::open(self.device, self.adapter.as_deref(), None))
    }

    /// Opens the device for one mesh, if `ahead` is none or not the right one. `auto` takes the cpu for what merges one
    /// pair after the other, as for small meshes.
    pub fn open(&self, prepared: &Prepared, ahead: Option<Result<Box<dyn Device>>>) -> Result<Box<dyn Device>> {
        let faces = match prepared.plan.is_sequential() {
            true => 0,
            false => prepared.input.faces,
        };
        if let Some(ahead) = ahead.filter(|_| self.wants_gpu() || faces >= FACES_FOR_GPU) {
            return ahead;
        }
        select::open(self.device, self.adapter.as_deref(), Some(faces))
    }
}
