//! The choice of a device: by name, or the one that is likely to be the fastest.

use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use super::adapter::{AdapterKind, AdapterReport, auto_adapter};
use super::cpu::CpuDevice;
use super::gpu::Overrides;
pub use super::gpu::{adapters, probe, tested_adapters};
pub use super::tuning::Tuning;
use super::{Device, gpu};
use crate::error::{Error, Result};

/// Meshes with fewer faces go to the cpu without a look at the adapters.
pub const FACES_FOR_GPU: u64 = Tuning::DEFAULT.faces_for_gpu as u64;

/// A choice of device.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum DeviceChoice {
    /// A gpu where there is one and the mesh is large enough, else the cpu; with an adapter, that one
    #[default]
    Auto,
    /// The threads of this machine
    Cpu,
    /// A gpu; a software driver where there is no other
    Gpu,
}

impl fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// Opens a device.
///
/// `adapter` narrows the gpus to one, by its number in [`adapters`] or by a part of its name; with it, `auto` takes
/// that gpu or fails, as `gpu` does. `faces` is the size of the mesh, where the device will be used for one mesh only.
pub fn open(choice: DeviceChoice, adapter: Option<&str>, faces: Option<u64>) -> Result<Box<dyn Device>> {
    open_listing(choice, adapter, faces, &mut Vec::new())
}

/// The same; sets `adapters` to the gpus that were looked at, with those that failed their self-test as unusable.
pub fn open_listing(
    choice: DeviceChoice,
    adapter: Option<&str>,
    faces: Option<u64>,
    adapters: &mut Vec<AdapterReport>,
) -> Result<Box<dyn Device>> {
    match (choice, adapter) {
        (DeviceChoice::Cpu, Some(_)) => {
            Err(Error::parameter("an adapter goes with the device gpu or auto, not with cpu"))
        }
        (DeviceChoice::Gpu, _) | (DeviceChoice::Auto, Some(_)) => {
            Ok(gpu::open(adapter, Overrides::default(), adapters)?.1)
        }
        (DeviceChoice::Auto, None) if faces.is_none_or(|faces| faces >= FACES_FOR_GPU) => Ok(open_auto(adapters)),
        (DeviceChoice::Cpu | DeviceChoice::Auto, None) => Ok(Box::new(CpuDevice::new())),
    }
}

/// Opens a gpu to be timed, with other constants: the one of that number or name, else the fastest, software where
/// there is no other.
pub fn open_timed(adapter: Option<&str>, tuning: Tuning) -> Result<(AdapterKind, Box<dyn Device>)> {
    gpu::open(adapter, Overrides::timed(tuning), &mut Vec::new())
}

fn open_auto(adapters: &mut Vec<AdapterReport>) -> Box<dyn Device> {
    let gpu = gpu::open_hardware(adapters).unwrap_or_else(|error| {
        tracing::warn!(%error, "taking the cpu instead of the gpu");
        None
    });
    gpu.unwrap_or_else(|| Box::new(CpuDevice::new()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_meshes_take_the_cpu_and_names_of_choices_are_their_words() {
        let device = open(DeviceChoice::Auto, None, Some(FACES_FOR_GPU - 1)).expect("the cpu");
        assert_eq!(device.info().backend, "rayon");
        assert!(open(DeviceChoice::Cpu, Some("0"), None).is_err());
        for choice in [DeviceChoice::Auto, DeviceChoice::Cpu, DeviceChoice::Gpu] {
            assert_eq!(<DeviceChoice as clap::ValueEnum>::from_str(&choice.to_string(), false), Ok(choice));
        }
    }
}
