//! The choice among gpus: by number or name, or the fastest.

use super::adapter::{Found, enumerate};
use super::{GpuDevice, Overrides};
use crate::device::Device;
use crate::device::adapter::{AdapterKind, AdapterReport, auto_adapter, best};
use crate::error::{Error, Kind, Result};

/// Every adapter of this machine, usable or not. Loads the graphics drivers.
pub fn adapters() -> Vec<AdapterReport> {
    enumerate().into_iter().map(|found| found.report).collect()
}

/// Opens a gpu: the one of that number or name, else the fastest, software where there is no other.
pub fn open(adapter: Option<&str>, is_timed: bool) -> Result<(AdapterKind, Box<dyn Device>)> {
    let found = enumerate();
    let found = choose(&found, adapter)?;
    let device = GpuDevice::with_overrides(found, Overrides { timed: is_timed, ..Overrides::default() })?;
    Ok((found.report.kind, Box::new(device)))
}

/// Opens the fastest gpu that is no software; none if there is no such gpu.
pub fn open_hardware() -> Result<Option<Box<dyn Device>>> {
    let found = enumerate();
    let reports: Vec<AdapterReport> = found.iter().map(|found| found.report.clone()).collect();
    match auto_adapter(&reports).and_then(|report| found.get(report.index)) {
        Some(found) => Ok(Some(Box::new(GpuDevice::new(found)?))),
        None => Ok(None),
    }
}

/// The adapter to open.
fn choose<'a>(found: &'a [Found], adapter: Option<&str>) -> Result<&'a Found> {
    let candidates = matching(found, adapter)?;
    best(candidates.iter().map(|found| &found.report)).and_then(|report| found.get(report.index)).ok_or_else(|| {
        Error::new(
            Kind::DeviceUnsuitable,
            format_args!("no gpu can be used, see `tesserae devices` or take the device cpu; found {}", list(found)),
        )
    })
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
