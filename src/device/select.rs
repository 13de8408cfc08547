//! The choice of a device: by name, or the one that is likely to be the fastest.

use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::Device;
use super::cpu::CpuDevice;
use super::gpu::adapter::{self, Found};
pub use super::gpu::adapter::{AdapterKind, AdapterReport};
use super::gpu::{GpuDevice, Overrides};
use crate::error::{Error, Kind, Result};

/// Meshes with fewer faces go to the cpu without a look at the adapters: looking costs 20 to 370 ms.
///
/// Provisional: set where one thread of the cpu device needs about that long, with no gpu at hand to measure.
pub const FACES_FOR_GPU: u64 = 200_000;

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
        f.write_str(match self {
            Self::Auto => "auto",
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        })
    }
}

/// Every adapter of this machine, usable or not. Loads the graphics drivers.
pub fn adapters() -> Vec<AdapterReport> {
    adapter::enumerate().into_iter().map(|found| found.report).collect()
}

/// The adapter that `auto` takes for large meshes, if any: the fastest kind that is usable and no software.
pub fn auto_adapter(adapters: &[AdapterReport]) -> Option<&AdapterReport> {
    best(adapters.iter()).filter(|report| report.kind != AdapterKind::Software)
}

/// Opens a device.
///
/// `adapter` narrows the gpus to one, by its number in [`adapters`] or by a part of its name; with it, `auto` takes that
/// gpu or fails, as `gpu` does. `faces` is the size of the mesh, where the device will be used for one mesh only.
pub fn open(choice: DeviceChoice, adapter: Option<&str>, faces: Option<u64>) -> Result<Box<dyn Device>> {
    match (choice, adapter) {
        (DeviceChoice::Cpu, Some(_)) => {
            Err(Error::parameter("an adapter goes with the device gpu or auto, not with cpu"))
        }
        (DeviceChoice::Cpu, None) => Ok(Box::new(CpuDevice::new())),
        (DeviceChoice::Gpu, _) | (DeviceChoice::Auto, Some(_)) => {
            let found = adapter::enumerate();
            Ok(Box::new(GpuDevice::new(choose(&found, adapter)?)?))
        }
        (DeviceChoice::Auto, None) if faces.is_some_and(|faces| faces < FACES_FOR_GPU) => {
            Ok(Box::new(CpuDevice::new()))
        }
        (DeviceChoice::Auto, None) => open_auto(&adapter::enumerate()),
    }
}

/// Opens a gpu to be timed: the one of that number or name, else the fastest, software where there is no other.
pub fn open_timed(adapter: Option<&str>) -> Result<(AdapterKind, GpuDevice)> {
    let found = adapter::enumerate();
    let found = choose(&found, adapter)?;
    let device = GpuDevice::with_overrides(found, Overrides { timed: true, ..Overrides::default() })?;
    Ok((found.report.kind, device))
}

fn open_auto(found: &[Found]) -> Result<Box<dyn Device>> {
    let best = best(found.iter().map(|found| &found.report))
        .filter(|report| report.kind != AdapterKind::Software)
        .and_then(|report| found.get(report.index));
    let Some(best) = best else {
        return Ok(Box::new(CpuDevice::new()));
    };
    match GpuDevice::new(best) {
        Ok(device) => Ok(Box::new(device)),
        Err(error) => {
            tracing::warn!(%error, "taking the cpu instead of the gpu");
            Ok(Box::new(CpuDevice::new()))
        }
    }
}

/// The adapter for the device gpu.
fn choose<'a>(found: &'a [Found], adapter: Option<&str>) -> Result<&'a Found> {
    let candidates = matching(found, adapter)?;
    best(candidates.iter().map(|found| &found.report)).and_then(|report| found.get(report.index)).ok_or_else(|| {
        Error::new(
            Kind::DeviceUnsuitable,
            format_args!("no gpu can be used, see `tesserae devices` or take the device cpu; found {}", list(found)),
        )
    })
}

/// The usable adapter of the fastest kind, the first of several.
fn best<'a>(reports: impl Iterator<Item = &'a AdapterReport>) -> Option<&'a AdapterReport> {
    reports.filter(|report| report.usable).min_by_key(|report| (report.kind, report.index))
}

/// The adapters that `--adapter` means: all without it, never none with it.
fn matching<'a>(found: &'a [Found], adapter: Option<&str>) -> Result<Vec<&'a Found>> {
    let Some(wanted) = adapter else {
        return Ok(found.iter().collect());
    };
    let matches: Vec<&Found> = found.iter().filter(|found| is_meant(&found.report, wanted)).collect();
    if matches.is_empty() {
        return Err(Error::parameter(format_args!(
            "no adapter has this number or name (found {}): {wanted:?}",
            list(found)
        )));
    }
    Ok(matches)
}

/// Whether an adapter has this number or, in any case, this in its name.
fn is_meant(report: &AdapterReport, wanted: &str) -> bool {
    match wanted.parse::<usize>() {
        Ok(index) => report.index == index,
        Err(_) => report.name.to_lowercase().contains(&wanted.trim().to_lowercase()),
    }
}

/// Adapters for an error message.
fn list(found: &[Found]) -> String {
    if found.is_empty() {
        return "no adapter".to_owned();
    }
    let reports: Vec<String> = found.iter().map(|found| found.report.to_string()).collect();
    reports.join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(index: usize, name: &str, kind: AdapterKind, usable: bool) -> AdapterReport {
        AdapterReport {
            index,
            name: name.to_owned(),
            kind,
            backend: "vulkan".to_owned(),
            driver: "driver 1".to_owned(),
            usable,
            reason: (!usable).then(|| "it is old".to_owned()),
        }
    }

    #[test]
    fn hardware_goes_first_and_software_is_none_for_auto() {
        let software = report(0, "llvmpipe", AdapterKind::Software, true);
        let old = report(1, "Old Card", AdapterKind::Discrete, false);
        let chip = report(2, "Chip", AdapterKind::Integrated, true);
        let card = report(3, "Card", AdapterKind::Discrete, true);
        let all = [software, old, chip, card];
        assert_eq!(best(all.iter()).map(|report| report.index), Some(3));
        assert_eq!(auto_adapter(&all).map(|report| report.index), Some(3));
        assert_eq!(auto_adapter(&all[..3]).map(|report| report.index), Some(2));
        assert_eq!(auto_adapter(&all[..2]), None);
        assert_eq!(best(all[..2].iter()).map(|report| report.index), Some(0));
        assert_eq!(best(all[1..2].iter()), None);
    }

    #[test]
    fn an_adapter_is_meant_by_number_or_part_of_its_name() {
        let card = report(3, "GeForce RTX 4090", AdapterKind::Discrete, true);
        for wanted in ["3", "geforce", " rtx 40 "] {
            assert!(is_meant(&card, wanted), "{wanted}");
        }
        for wanted in ["0", "30", "radeon"] {
            assert!(!is_meant(&card, wanted), "{wanted}");
        }
    }

    #[test]
    fn without_adapters_the_gpu_is_an_error_that_says_so_and_auto_is_the_cpu() {
        let error = choose(&[], None).expect_err("there is none");
        assert_eq!(error.kind, Kind::DeviceUnsuitable);
        assert!(error.message.contains("tesserae devices"), "{error}");
        assert!(error.message.ends_with("no adapter"), "{error}");
        let device = open_auto(&[]).expect("the cpu");
        assert_eq!(device.info().backend, "rayon");
        let error = choose(&[], Some("7")).expect_err("there is none");
        assert_eq!(error.kind, Kind::InvalidParameter);
    }

    #[test]
    fn small_meshes_take_the_cpu_and_names_of_choices_are_their_words() {
        let device = open(DeviceChoice::Auto, None, Some(FACES_FOR_GPU - 1)).expect("the cpu");
        assert_eq!(device.info().backend, "rayon");
        assert!(open(DeviceChoice::Cpu, Some("0"), None).is_err());
        for choice in [DeviceChoice::Auto, DeviceChoice::Cpu, DeviceChoice::Gpu] {
            assert_eq!(<DeviceChoice as clap::ValueEnum>::from_str(&choice.to_string(), false), Ok(choice));
        }
    }

    #[test]
    fn a_report_is_one_line() {
        let old = report(1, "Old Card", AdapterKind::Discrete, false);
        assert_eq!(old.to_string(), "1: Old Card (discrete, vulkan, unusable: it is old)");
        let json = serde_json::to_value(&old).expect("JSON");
        assert_eq!(json["kind"], "discrete");
        assert_eq!(json["reason"], "it is old");
    }
}
