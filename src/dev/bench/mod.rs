//! What a device takes for each stage of a job: on samples of growing size and on mesh files, from the upload's bytes
//! to labels, with the time that a gpu itself measures beside that of the host. Needs nothing but this program.
//!
//! | what | where |
//! |---|---|
//! | what is run: meshes, sizes, algorithms | `work` |
//! | the results as Markdown | `markdown` |
//! | which device suits which size | `calibration` |
//!
//! A gpu's labels are compared with the cpu's, unless that would take too long.

mod calibration;
mod markdown;
mod work;

use serde::Serialize;

pub use calibration::{PATIENCE, calibrated};
pub use work::{Mesh, Work};

use crate::device::cpu::CpuDevice;
use crate::device::{Cancel, Device, DeviceKind, Profile};
use crate::error::{Error, Kind, Result};
use crate::job::{self, Outcome, Prepared};
use crate::report::DeviceInfo;

/// Bytes a face of a closed triangle mesh that a gpu's first fit after new labels reads and writes, in `sums_gather`
/// and `boundary_keep`; labels of neighbours come from the caches.
const SWEEP_BYTES_A_FACE: u64 = 48;

/// How to measure.
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    /// How often each job is run; the fastest run counts.
    pub repeats: u32,
    /// Largest mesh, in faces, whose labels are compared with the cpu's.
    pub compare_up_to: u64,
    /// Meshes of fewer faces are for the cpu.
    pub faces_for_gpu: u64,
}

/// What was measured.
#[derive(Debug, Serialize)]
pub struct Measurements {
    /// Version of this program, and whether its times mean anything.
    pub tesserae: String,
    /// The processor of the machine.
    pub processor: String,
    /// Threads that the cpu device has.
    pub threads: usize,
    /// The device.
    pub device: DeviceInfo,
    /// Bytes a second of copies within the device's memory, those read and those written; none without timestamps.
    pub copy_bytes_a_second: Option<f64>,
    /// The jobs.
    pub rows: Vec<BenchRow>,
}

/// A job, and what it took; times in milliseconds.
#[derive(Debug, Serialize)]
pub struct BenchRow {
    /// The mesh.
    pub mesh: String,
    /// Its faces.
    pub faces: u64,
    /// Algorithm and what else is not as usual.
    pub algorithm: String,
    /// Number of clusters.
    pub clusters: u64,
    /// Whether the cpu clustered it instead of the device.
    pub is_for_cpu: bool,
    /// Why there is no time of clustering: it did not fit on the device, say.
    pub refused: Option<String>,
    /// From bytes to faces and positions.
    pub parse: f64,
    /// Topology, lattice, order, start.
    pub topology: f64,
    /// Bringing it to the device.
    pub upload: f64,
    /// Clustering, as the host sees it.
    pub cluster: f64,
    /// Bringing the labels back, and checking them.
    pub download: f64,
    /// Clustering, as the device sees it: the sum of its stages.
    pub device: Option<f64>,
    /// What the device did; where passes were not timed, `device` is none.
    #[serde(flatten)]
    pub profile: Profile,
    /// Iterations in which something moved.
    pub iterations: u64,
    /// In the end, source units.
    pub energy: Option<f64>,
    /// Over that of a flat tiling by hexagons.
    pub hexagon_ratio: Option<f64>,
    /// Clustering on the cpu device of this machine.
    pub cluster_on_cpu: Option<f64>,
    /// Whether all runs gave the same labels, or the same tree.
    pub same_each_time: bool,
    /// Whether the cpu's were the same.
    pub same_as_cpu: Option<bool>,
    /// Sums and lists from labels.
    pub sweep: Option<Sweep>,
}

/// Sums and lists from labels: a pass over all faces.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Sweep {
    /// Bytes that its kernels read and write.
    pub bytes: u64,
    /// What it took on the device, milliseconds.
    pub milliseconds: f64,
    /// Its bytes a second, over those of a copy.
    pub share_of_copy: f64,
}

/// Runs everything on a device; a gpu should be opened to be timed. Returns what was measured even when something
/// fails, with the error. `on_stage` gets a line about each job.
///
/// A job that does not fit has the reason in its row, and those of larger meshes with the same algorithm are left out.
pub fn run(
    work: &[Work],
    device: &mut dyn Device,
    plan: Plan,
    cancel: &Cancel,
    on_stage: &mut dyn FnMut(String),
) -> (Measurements, Result<()>) {
    let build = if cfg!(debug_assertions) { " (a debug build: its times say nothing)" } else { "" };
    let mut measurements = Measurements {
        tesserae: format!("{}{build}", env!("CARGO_PKG_VERSION")),
        processor: crate::dev::markdown::processor(),
        threads: rayon::current_num_threads(),
        device: device.info().clone(),
        copy_bytes_a_second: None,
        rows: Vec::new(),
    };
    let outcome = measurements.fill(work, device, plan, cancel, on_stage);
    (measurements, outcome)
}

impl Measurements {
    fn fill(
        &mut self,
        work: &[Work],
        device: &mut dyn Device,
        plan: Plan,
        cancel: &Cancel,
        on_stage: &mut dyn FnMut(String),
    ) -> Result<()> {
        self.copy_bytes_a_second = device.copy_bandwidth()?;
        for work in work {
            let is_beyond =
                |row: &BenchRow| row.refused.is_some() && row.algorithm == work.name() && work.is_larger(row.faces);
            if self.rows.iter().any(is_beyond) {
                continue;
            }
            on_stage(format!("{}, {}", work.mesh, work.name()));
            self.rows.push(measure(work, device, plan, self.copy_bytes_a_second, cancel)?);
        }
        Ok(())
    }

    /// As a report in Markdown.
    pub fn markdown(&self) -> String {
        markdown::report(self)
    }

    /// An error when labels were not the cpu's, or not the same each time, and when no job ran.
    pub fn check(&self) -> Result<()> {
        if let Some(BenchRow { mesh, algorithm, clusters, .. }) =
            self.rows.iter().find(|row| row.same_as_cpu == Some(false) || !row.same_each_time)
        {
            return Err(Error::internal(format_args!(
                "the labels are not the cpu's, or not the same each time: {mesh}, {algorithm}, {clusters} clusters"
            )));
        }
        let refusals: Vec<&str> = self.rows.iter().filter_map(|row| row.refused.as_deref()).collect();
        match refusals.first() {
            Some(why) if refusals.len() == self.rows.len() => Err(Error::unsuitable(format_args!("no job ran: {why}"))),
            _ => Ok(()),
        }
    }
}

/// One job: run on the device, on the cpu if it shall be compared, and its sweep.
fn measure(
    work: &Work,
    device: &mut dyn Device,
    plan: Plan,
    copy_bytes_a_second: Option<f64>,
    cancel: &Cancel,
) -> Result<BenchRow> {
    let (faces, prepared) = work.prepare()?;
    let clusters = work.clusters(faces).unwrap_or(prepared.input.components());
    let mut row = BenchRow::new(work, faces, clusters);
    let mut cpu = CpuDevice::new();
    row.is_for_cpu = faces < plan.faces_for_gpu;
    let device = if row.is_for_cpu { &mut cpu } else { device };
    (row.parse, row.topology) = (prepared.timings.parse, prepared.timings.topology);
    let mut best: Option<Outcome> = None;
    for _ in 0..plan.repeats {
        // what earlier jobs left
        device.take_profile()?;
        let outcome = match job::run(&prepared, device, cancel, &mut |_| {}) {
            Ok(outcome) => outcome,
            Err(error) if matches!(error.kind, Kind::DeviceUnsuitable | Kind::TooLarge | Kind::DeviceLost) => {
                return Ok(BenchRow { refused: Some(error.message), ..BenchRow::new(work, faces, clusters) });
            }
            Err(error) => return Err(error),
        };
        let profile = device.take_profile()?;
        let timings = &outcome.report.timings_ms;
        if let Some(best) = &best {
            row.same_each_time &= best.labels == outcome.labels && best.hierarchy == outcome.hierarchy;
            if best.report.timings_ms.cluster <= timings.cluster {
                continue;
            }
        }
        (row.upload, row.cluster, row.download) = (timings.upload, timings.cluster, timings.download);
        if let Some(profile) = profile {
            let sum = profile.stages.iter().map(|stage| stage.milliseconds).sum();
            row.device = (profile.untimed_passes == 0).then_some(sum);
            row.profile = profile;
        }
        best = Some(outcome);
    }
    let Some(best) = best else { return Ok(row) };
    row.iterations = best.report.iterations.iter().filter(|iteration| iteration.moves > 0).count() as u64;
    row.energy = best.report.energy.final_;
    row.hexagon_ratio = best.report.energy.hexagon_ratio;
    if device.info().kind == DeviceKind::Gpu {
        if faces <= plan.compare_up_to {
            let on_cpu = job::run(&prepared, &mut CpuDevice::new(), cancel, &mut |_| {})?;
            row.cluster_on_cpu = Some(on_cpu.report.timings_ms.cluster);
            row.same_as_cpu = Some(on_cpu.labels == best.labels && on_cpu.hierarchy == best.hierarchy);
        }
        if let (Some(labels), Some(copy)) = (&best.labels, copy_bytes_a_second) {
            row.sweep = sweep(device, &prepared, clusters, labels, copy)?;
        }
    }
    Ok(row)
}

/// Times the sums and lists of `labels`.
fn sweep(
    gpu: &mut dyn Device,
    prepared: &Prepared,
    clusters: u64,
    labels: &[u32],
    copy_bytes_a_second: f64,
) -> Result<Option<Sweep>> {
    let Some(surface) = prepared.subject.mesh() else { return Ok(None) };
    let internal: Vec<u32> = surface.upload_face.iter().map(|&face| labels[face as usize]).collect();
    let component_of_cluster = surface.component_of_cluster(&internal, clusters as usize);
    {
        let mut steps = gpu.open(&surface.graph, &component_of_cluster)?;
        steps.set_labels(&internal)?;
        steps.energy()?;
    }
    let profile = gpu.take_profile()?.unwrap_or_default();
    let gather = profile.stages.iter().find(|stage| stage.stage == "gather");
    Ok(gather.filter(|gather| gather.milliseconds > 0.0).map(|gather| {
        let bytes = SWEEP_BYTES_A_FACE * surface.faces() as u64;
        let milliseconds = gather.milliseconds;
        Sweep { bytes, milliseconds, share_of_copy: bytes as f64 / (milliseconds / 1e3) / copy_bytes_a_second }
    }))
}

impl BenchRow {
    fn new(work: &Work, faces: u64, clusters: u64) -> Self {
        Self {
            mesh: work.mesh.to_string(),
            faces,
            algorithm: work.name(),
            clusters,
            is_for_cpu: false,
            refused: None,
            parse: 0.0,
            topology: 0.0,
            upload: 0.0,
            cluster: 0.0,
            download: 0.0,
            device: None,
            profile: Profile::default(),
            iterations: 0,
            energy: None,
            hexagon_ratio: None,
            cluster_on_cpu: None,
            same_each_time: true,
            same_as_cpu: None,
            sweep: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(change: impl FnOnce(&mut BenchRow)) -> Measurements {
        let mut row = BenchRow::new(&Work::flat(Mesh::Knot(100), None, 10), 100, 10);
        row.same_as_cpu = Some(true);
        change(&mut row);
        Measurements {
            tesserae: String::new(),
            processor: String::new(),
            threads: 1,
            device: Device::<crate::energy::Energy>::info(&CpuDevice::new()).clone(),
            copy_bytes_a_second: None,
            rows: vec![row],
        }
    }

    #[test]
    fn labels_that_differ_are_an_error_and_so_is_a_device_on_which_nothing_ran() {
        assert_eq!(measured(|_| {}).check(), Ok(()));
        assert_eq!(measured(|row| row.same_as_cpu = None).check(), Ok(()));
        let differs = measured(|row| row.same_as_cpu = Some(false)).check().expect_err("other labels");
        assert!(differs.message.contains("knot, bb, 10 faces a cluster, 10 clusters"), "{differs}");
        let wavers = measured(|row| row.same_each_time = false).check().expect_err("other labels each time");
        assert_eq!(wavers.kind, Kind::Internal);
        let refused = measured(|row| row.refused = Some("it is too large".to_owned())).check().expect_err("no job");
        assert_eq!((refused.kind, refused.message.as_str()), (Kind::DeviceUnsuitable, "no job ran: it is too large"));
    }
}
