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
    let found = enumerate();
    let mut reports = reports(&found);
    for (report, found) in reports.iter_mut().zip(&found).filter(|(report, _)| report.usable) {
        if let Err(error) = GpuDevice::new(found) {
            report.refuse(error.message);
        }
    }
    reports
}

/// Opens a gpu: the one of that number or name, else the fastest, software where there is no other. One that fails its
/// self-test is passed over. `adapters` is set to all that were found.
pub fn open(
    adapter: Option<&str>,
    overrides: Overrides,
    adapters: &mut Vec<AdapterReport>,
) -> Result<(AdapterKind, Box<dyn Device>)> {
    open_first(overrides, adapters, |reports| choose(reports, adapter))?.ok_or_else(|| none_usable(adapters))
}

/// Opens the fastest gpu that is no software; none if there is no such gpu. Otherwise like [`open`].
pub fn open_hardware(adapters: &mut Vec<AdapterReport>) -> Result<Option<Box<dyn Device>>> {
    let opened = open_first(Overrides::default(), adapters, |reports| Ok(auto_adapter(reports)))?;
    Ok(opened.map(|(_, device)| device))
}

/// Opens the adapter that `choose` takes; the next one if that turns out to be unusable, which its report then says.
fn open_first(
    overrides: Overrides,
    adapters: &mut Vec<AdapterReport>,
    choose: impl Fn(&[AdapterReport]) -> Result<Option<&AdapterReport>>,
) -> Result<Option<(AdapterKind, Box<dyn Device>)>> {
    let found = enumerate();
    *adapters = reports(&found);
    loop {
        let Some(index) = choose(adapters)?.map(|report| report.index) else { return Ok(None) };
        match GpuDevice::with_overrides(&found[index], overrides) {
            Err(error) if error.kind == Kind::DeviceUnsuitable => {
                tracing::error!(%error, "an adapter is passed over");
                adapters[index].refuse(error.message);
            }
            opened => return Ok(Some((adapters[index].kind, Box::new(opened?)))),
        }
    }
}

/// The reports of adapters, each at its index.
pub(super) fn reports(found: &[Found]) -> Vec<AdapterReport> {
    found.iter().map(|found| found.report.clone()).collect()
}

/// The adapter to open: of that number or name, else of all, the usable one of the fastest kind.
pub(super) fn choose<'a>(reports: &'a [AdapterReport], adapter: Option<&str>) -> Result<Option<&'a AdapterReport>> {
    let is_meant = |report: &&AdapterReport| adapter.is_none_or(|wanted| is_meant(report, wanted));
    if let Some(wanted) = adapter
        && !reports.iter().any(|report| is_meant(&report))
    {
        return Err(Error::parameter(format_args!(
            "no adapter has this number or name (found {}): {wanted:?}",
            list(reports)
        )));
    }
    Ok(best(reports.iter().filter(is_meant)))
}

/// The error where no adapter is left to open.
pub(super) fn none_usable(reports: &[AdapterReport]) -> Error {
    Error::unsuitable(format_args!(
        "no gpu can be used, see `tesserae devices` or take the device cpu; found {}",
        list(reports)
    ))
}

/// Whether an adapter has this number or, in any case, this in its name.
fn is_meant(report: &AdapterReport, wanted: &str) -> bool {
    match wanted.parse::<usize>() {
        Ok(index) => report.index == index,
        Err(_) => report.name.to_lowercase().contains(&wanted.trim().to_lowercase()),
    }
}

/// Adapters for an error message.
fn list(reports: &[AdapterReport]) -> String {
    if reports.is_empty() {
        return "no adapter".to_owned();
    }
    reports.iter().map(AdapterReport::to_string).collect::<Vec<_>>().join("; ")
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
        assert_eq!(choose(&[], None), Ok(None));
        let error = none_usable(&[]);
        assert_eq!(error.kind, Kind::DeviceUnsuitable);
        assert!(error.message.contains("tesserae devices"), "{error}");
        assert!(error.message.ends_with("no adapter"), "{error}");
        let error = choose(&[], Some("7")).expect_err("there is none");
        assert_eq!(error.kind, Kind::InvalidParameter);
    }
}
