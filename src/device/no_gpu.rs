//! `device::gpu` of a build without the feature `gpu`: no adapters, and an error where a gpu is required.

use super::adapter::{AdapterKind, AdapterReport};
use super::tuning::Tuning;
use super::{Device, DeviceInfo, MergeSteps};
use crate::energy::Functional;
use crate::error::{Error, Result};
use crate::surface::DualGraph;

/// Nothing that could be changed about a gpu.
#[derive(Debug, Clone, Copy, Default)]
pub struct Overrides {}

impl Overrides {
    /// Nothing.
    pub fn timed(_: Tuning) -> Self {
        Self {}
    }
}

/// There is none.
#[derive(Debug)]
pub enum GpuDevice {}

impl<E: Functional> Device<E> for GpuDevice {
    fn info(&self) -> &DeviceInfo {
        match *self {}
    }

    fn open_merging<'a>(&'a mut self, _: &'a DualGraph<E>, _: &'a [u32]) -> Result<Box<dyn MergeSteps<E> + 'a>> {
        match *self {}
    }
}

/// No adapters.
pub fn adapters() -> Vec<AdapterReport> {
    Vec::new()
}

/// No adapters.
pub fn tested_adapters() -> Vec<AdapterReport> {
    Vec::new()
}

/// The error.
pub fn open(_: Option<&str>, _: Overrides, _: &mut Vec<AdapterReport>) -> Result<(AdapterKind, Box<dyn Device>)> {
    Err(Error::unsuitable("this build has no gpu: take the device cpu, or build tesserae with the feature gpu"))
}

/// The error.
pub fn probe(adapter: Option<&str>) -> Result<Vec<(&'static str, f64)>> {
    open(adapter, Overrides::default(), &mut Vec::new()).map(|_| Vec::new())
}

/// No gpu.
pub fn open_hardware(_: &mut Vec<AdapterReport>) -> Result<Option<Box<dyn Device>>> {
    Ok(None)
}

#[cfg(test)]
mod tests {
    use crate::device::select::{DeviceChoice, adapters, open};

    #[test]
    fn the_device_gpu_is_an_error_that_names_the_feature_and_auto_is_the_cpu() {
        for (choice, adapter) in [(DeviceChoice::Gpu, None), (DeviceChoice::Auto, Some("0"))] {
            let error = open(choice, adapter, None).err().expect("no gpu");
            assert!(error.message.contains("the feature gpu"), "{error}");
        }
        assert_eq!(open(DeviceChoice::Auto, None, None).expect("the cpu").info().backend, "rayon");
        assert_eq!(adapters(), []);
    }
}
