//! Graphics adapters as they are reported, whether this build can use them or not.

use std::fmt;

use serde::Serialize;
use utoipa::ToSchema;

/// An adapter as it is reported: in `tesserae devices` and `GET /v1/device`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct AdapterReport {
    /// Number that `--adapter` takes.
    pub index: usize,
    /// Name; a part of it is what `--adapter` takes, too.
    pub name: String,
    /// What kind of processor it is.
    pub kind: AdapterKind,
    /// `vulkan`, `metal` or `dx12`.
    pub backend: String,
    /// Driver and its version.
    pub driver: String,
    /// Whether it can cluster.
    pub usable: bool,
    /// Why it cannot; null when it can.
    pub reason: Option<String>,
    /// The largest meshes that its buffers hold.
    pub largest: LargestMeshes,
}

/// The largest closed triangle meshes that fit, in faces; the memory of the adapter may hold less.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
pub struct LargestMeshes {
    /// Flat clusterings into a quarter as many clusters.
    #[schema(example = 1_073_741_823_u64)]
    pub flat: u64,
    /// Parallel hierarchies that are optimised once clusters have four faces on average, as they are by default; others
    /// may have a quarter of the faces.
    #[schema(example = 1_073_741_823_u64)]
    pub hierarchy: u64,
}

impl AdapterReport {
    /// Notes why it cannot cluster.
    #[cfg(feature = "gpu")]
    pub(super) fn refuse(&mut self, reason: String) {
        self.usable = false;
        self.reason = Some(reason);
    }
}

impl fmt::Display for AdapterReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { index, name, kind, backend, .. } = self;
        write!(f, "{index}: {name} ({kind}, {backend}")?;
        match &self.reason {
            Some(reason) => write!(f, ", unusable: {reason})"),
            None => f.write_str(")"),
        }
    }
}

/// Kinds of adapters, the fastest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum AdapterKind {
    /// A graphics processor with its own memory.
    Discrete,
    /// A graphics processor that shares memory with the cpu.
    Integrated,
    /// A share of a graphics processor, passed to a virtual machine.
    Virtual,
    /// The driver does not say.
    Other,
    /// No graphics processor: a driver that computes on the cpu.
    Software,
}

impl fmt::Display for AdapterKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// The adapter that `auto` takes for large meshes, if any: the fastest kind that is usable and no software.
pub fn auto_adapter(adapters: &[AdapterReport]) -> Option<&AdapterReport> {
    best(adapters.iter()).filter(|report| report.kind != AdapterKind::Software)
}

/// The usable adapter of the fastest kind, the first of several.
pub(super) fn best<'a>(reports: impl Iterator<Item = &'a AdapterReport>) -> Option<&'a AdapterReport> {
    reports.filter(|report| report.usable).min_by_key(|report| (report.kind, report.index))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn report(index: usize, name: &str, kind: AdapterKind, usable: bool) -> AdapterReport {
        AdapterReport {
            index,
            name: name.to_owned(),
            kind,
            backend: "vulkan".to_owned(),
            driver: "driver 1".to_owned(),
            usable,
            reason: (!usable).then(|| "it is old".to_owned()),
            largest: LargestMeshes { flat: 400, hierarchy: 100 },
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
    fn a_report_is_one_line() {
        let old = report(1, "Old Card", AdapterKind::Discrete, false);
        assert_eq!(old.to_string(), "1: Old Card (discrete, vulkan, unusable: it is old)");
        let json = serde_json::to_value(&old).expect("JSON");
        assert_eq!(json["kind"], "discrete");
        assert_eq!(json["reason"], "it is old");
    }
}
