//! The choice among gpus: by number or name, or the fastest.

use super::adapter::{Found, enumerate};
use super::{GpuDevice, Overrides};
use crate::device::Device;
use crate::device::adapter::{AdapterKind, AdapterReport, auto_adapter, best};
use crate::error::{Error, Kind, Result};

/// Every adapter of this machine, usable or not. Loads the graphics drivers.
pub fn adapters() -> Vec<AdapterReport> {
    reports(&enumerate())
}

/// The same after a self-test of each that may be usable: opens them, which compiles the kernels.
pub fn tested_adapters() -> Vec<AdapterReport> {
    let mut found = enumerate();
    for found in found.iter_mut().filter(|found| found.report.usable) {
        if let Err(error) = GpuDevice::new(found) {
            found.report.refuse(error.message);
        }
    }
    reports(&found)
}

/// Opens a gpu: the one of that number or name, else the fastest, software where there is no other. One that fails its
/// self-test is passed over. `adapters` is set to all that were found.
pub fn open(
    adapter: Option<&str>,
    overrides: Overrides,
    adapters: &mut Vec<AdapterReport>,
) -> Result<(AdapterKind, Box<dyn Device>)> {
    let mut found = enumerate();
    let opened = loop {
        let chosen = choose(&found, adapter).map(|chosen| chosen.report.index);
        let Some(opened) = chosen.and_then(|index| open_or_refuse(&mut found[index], overrides)).transpose() else {
            continue;
        };
        break opened;
    };
    *adapters = reports(&found);
    opened
}

/// Opens the fastest gpu that is no software; none if there is no such gpu. Otherwise like [`open`].
pub fn open_hardware(adapters: &mut Vec<AdapterReport>) -> Result<Option<Box<dyn Device>>> {
    let mut found = enumerate();
    let opened = loop {
        let Some(index) = auto_adapter(&reports(&found)).map(|report| report.index) else { break Ok(None) };
        let opened = open_or_refuse(&mut found[index], Overrides::default()).transpose();
        if let Some(opened) = opened {
            break opened.map(|(_, device)| Some(device));
        }
    };
    *adapters = reports(&found);
    opened
}

/// Opens an adapter; none if it turns out to be unusable, which its report then says.
fn open_or_refuse(found: &mut Found, overrides: Overrides) -> Result<Option<(AdapterKind, Box<dyn Device>)>> {
    match GpuDevice::with_overrides(found, overrides) {
        Err(error) if error.kind == Kind::DeviceUnsuitable => {
            tracing::error!(%error, "an adapter is passed over");
            found.report.refuse(error.message);
            Ok(None)
        }
        opened => Ok(Some((found.report.kind, Box::new(opened?)))),
    }
}

fn reports(found: &[Found]) -> Vec<AdapterReport> {
    found.iter().map(|found| found.report.clone()).collect()
}

/// The adapter to open.
pub(super) fn choose<'a>(found: &'a [Found], adapter: Option<&str>) -> Result<&'a Found> {
    let is_candidate = |report: &&AdapterReport| adapter.is_none_or(|wanted| is_meant(report, wanted));
    let candidates: Vec<_> = found.iter().map(|found| &found.report).filter(is_candidate).collect();
    if let Some(wanted) = adapter
        && candidates.is_empty()
    {
        return Err(Error::parameter(format_args!(
            "no adapter has this number or name (found {}): {wanted:?}",
            list(found)
        )));
    }
    best(candidates.into_iter()).and_then(|report| found.get(report.index)).ok_or_else(|| {
        Error::unsuitable(format_args!(
            "no gpu can be used, see `tesserae devices` or take the device cpu; found {}",
            list(found)
        ))
    })
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
    use crate::device::adapter::tests::report;

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
    fn without_adapters_the_gpu_is_an_error_that_says_so() {
        let error = choose(&[], None).expect_err("there is none");
        assert_eq!(error.kind, Kind::DeviceUnsuitable);
        assert!(error.message.contains("tesserae devices"), "{error}");
        assert!(error.message.ends_with("no adapter"), "{error}");
        let error = choose(&[], Some("7")).expect_err("there is none");
        assert_eq!(error.kind, Kind::InvalidParameter);
    }
}
