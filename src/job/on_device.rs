//! A job on a device that is opened for it.

use super::{Outcome, Prepared, run};
use crate::device::cpu::CpuDevice;
use crate::device::select::{self, DeviceChoice, FACES_FOR_GPU};
use crate::device::{Cancel, Device};
use crate::error::{Kind, Result};
use crate::report::Row;

/// Bytes of a face in most files, at least.
const BYTES_A_FACE: u64 = 16;

/// The device of one job.
#[derive(Debug, Clone, Copy, Default)]
pub struct DeviceFor<'a> {
    /// Which kind.
    pub choice: DeviceChoice,
    /// Which gpu: its number or a part of its name; no other device will do then.
    pub adapter: Option<&'a str>,
}

/// A gpu that was opened before the mesh was known.
pub type Ahead = Option<Result<Box<dyn Device>>>;

impl DeviceFor<'_> {
    /// Whether the program chooses.
    pub fn is_auto(&self) -> bool {
        self.choice == DeviceChoice::Auto && self.adapter.is_none()
    }

    /// Whether nothing but a gpu will do.
    pub fn wants_gpu(&self) -> bool {
        self.choice == DeviceChoice::Gpu || self.adapter.is_some()
    }

    /// Opens a gpu before the mesh is known, if it will be one or, by the bytes of the mesh, probably will: this takes
    /// as long as reading a mesh.
    pub fn open_ahead(&self, bytes: usize) -> Ahead {
        let is_large = bytes as u64 >= BYTES_A_FACE * FACES_FOR_GPU;
        (self.wants_gpu() || self.is_auto() && is_large).then(|| select::open(self.choice, self.adapter, None))
    }

    /// Opens the device for one mesh, unless `ahead` is the right one. `auto` takes the cpu for what merges one pair
    /// after the other and for points that no gpu has code for, as for small meshes.
    fn open(&self, ahead: Ahead, prepared: &Prepared) -> Result<Box<dyn Device>> {
        let faces = match prepared.wants_cpu() {
            true => 0,
            false => prepared.input.items(),
        };
        match ahead.filter(|_| self.wants_gpu() || faces >= FACES_FOR_GPU) {
            Some(ahead) => ahead,
            None => select::open(self.choice, self.adapter, Some(faces)),
        }
    }
}

/// Opens the device and does what [`run()`] does. The cpu does what a gpu computed wrongly, and with `auto` what a gpu
/// cannot.
pub fn run_on(
    device: DeviceFor<'_>,
    ahead: Ahead,
    prepared: &Prepared,
    cancel: &Cancel,
    on_row: &mut (dyn FnMut(Row) + Send),
) -> Result<Outcome> {
    OnDevice::open(device, ahead, prepared)?.run(prepared, cancel, on_row)
}

/// A device that was opened for a mesh, for one job on it or several.
pub struct OnDevice {
    device: Box<dyn Device>,
    is_auto: bool,
}

impl OnDevice {
    /// Opens the device for this mesh, unless `ahead` is the right one.
    pub fn open(device: DeviceFor<'_>, ahead: Ahead, prepared: &Prepared) -> Result<Self> {
        Ok(Self { device: device.open(ahead, prepared)?, is_auto: device.is_auto() })
    }

    /// As [`run_on`].
    pub fn run(
        &mut self,
        prepared: &Prepared,
        cancel: &Cancel,
        on_row: &mut (dyn FnMut(Row) + Send),
    ) -> Result<Outcome> {
        match run(prepared, self.device.as_mut(), cancel, on_row) {
            Err(error) if error.kind == Kind::DeviceWrong || error.kind == Kind::DeviceUnsuitable && self.is_auto => {
                let mut outcome = run(prepared, &mut CpuDevice::new(), cancel, on_row)?;
                outcome.report.warnings.push(instead_of_gpu(&error.message));
                Ok(outcome)
            }
            outcome => outcome,
        }
    }
}

/// The warning that the cpu clustered a mesh in place of a gpu.
pub fn instead_of_gpu(why: &str) -> String {
    format!("the cpu clustered the mesh, since {why}")
}
