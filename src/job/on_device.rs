//! A job on a device that is opened for it.

use super::{Outcome, Prepared, run};
use crate::device::cpu::CpuDevice;
use crate::device::select::{self, DeviceChoice};
use crate::device::{Cancel, Device};
use crate::error::{Kind, Result};
use crate::report::Row;

/// The device of one job.
#[derive(Debug, Clone, Copy, Default)]
pub struct DeviceFor<'a> {
    /// Which kind.
    pub choice: DeviceChoice,
    /// Which gpu: its number or a part of its name; no other device will do then.
    pub adapter: Option<&'a str>,
}

impl DeviceFor<'_> {
    /// Opens the device for one mesh. `auto` takes the cpu for what merges one pair after the other, as for small
    /// meshes.
    fn open(&self, prepared: &Prepared) -> Result<Box<dyn Device>> {
        let faces = match prepared.plan.is_sequential() {
            true => 0,
            false => prepared.input.faces,
        };
        select::open(self.choice, self.adapter, Some(faces))
    }
}

/// Opens the device and does what [`run`] does. With `auto`, the cpu does what a gpu cannot.
pub fn run_on(
    device: DeviceFor<'_>,
    prepared: &Prepared,
    cancel: &Cancel,
    on_row: &mut (dyn FnMut(Row) + Send),
) -> Result<Outcome> {
    let is_auto = device.choice == DeviceChoice::Auto && device.adapter.is_none();
    match run(prepared, device.open(prepared)?.as_mut(), cancel, on_row) {
        Err(error) if error.kind == Kind::DeviceUnsuitable && is_auto => {
            tracing::warn!(%error, "taking the cpu instead of the gpu");
            run(prepared, &mut CpuDevice::new(), cancel, on_row)
        }
        outcome => outcome,
    }
}
