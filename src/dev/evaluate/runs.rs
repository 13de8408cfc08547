//! Meshes, devices and timed runs.

use std::path::{Path, PathBuf};

use super::printed::MODELS;
use crate::device::cpu::CpuDevice;
use crate::device::{Cancel, Device};
use crate::error::{Error, Result};
use crate::job::{self, Request};
use crate::mesh::{Beside, Format};
use crate::parameters::Parameters;
use crate::report::{DeviceInfo, Report};

/// Where to run: the cpu first, then a gpu if there is one.
pub struct Devices(Vec<Box<dyn Device>>);

impl Devices {
    /// The cpu, and maybe a gpu.
    pub fn new(gpu: Option<Box<dyn Device>>) -> Self {
        let mut devices: Vec<Box<dyn Device>> = vec![Box::new(CpuDevice::new())];
        devices.extend(gpu);
        Self(devices)
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    /// What they are.
    pub(super) fn infos(&self) -> Vec<DeviceInfo> {
        self.0.iter().map(|device| device.info().clone()).collect()
    }
}

/// A mesh of the paper, as a file here.
pub(super) struct MeshFile {
    /// Its name in the paper.
    pub model: &'static str,
    pub path: PathBuf,
    pub format: Format,
    pub bytes: Vec<u8>,
}

impl MeshFile {
    /// The file's name.
    pub fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }
}

/// The file of each of [`MODELS`] in a folder, if there is one: of several, OBJ before GLB before glTF, then by name.
pub(super) fn find(folder: &Path) -> Result<Vec<Option<MeshFile>>> {
    let cannot = |error| Error::io(format_args!("the folder with the meshes cannot be read, {folder:?}"), error);
    let mut paths: Vec<(usize, PathBuf)> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(cannot)? {
        let path = entry.map_err(cannot)?.path();
        let format = path.file_name().and_then(|name| Format::from_file_name(&name.to_string_lossy()));
        let rank = Format::ALL.iter().position(|&known| format == Some(known));
        paths.extend(rank.map(|rank| (rank, path)));
    }
    paths.sort();
    MODELS
        .iter()
        .map(|model| {
            let is_it = |path: &Path| {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
                stem.contains(&model.name.to_lowercase())
            };
            let Some((_, path)) = paths.iter().find(|(_, path)| is_it(path)) else { return Ok(None) };
            let bytes = std::fs::read(path).map_err(|error| Error::io(format_args!("cannot read {path:?}"), error))?;
            let format = Format::recognise(path.to_str(), &bytes, Some(bytes.len() as u64))?;
            Ok(Some(MeshFile { model: model.name, path: path.clone(), format, bytes }))
        })
        .collect()
}

/// A run, and what it took.
pub(super) struct Timed {
    /// Clustering alone, in milliseconds: the least of the repeats.
    pub ms: f64,
    /// The report of the last repeat.
    pub report: Report,
}

/// Runs jobs.
pub(super) struct Runner<'a> {
    pub devices: &'a mut Devices,
    /// How often to measure a time.
    pub repeats: u32,
    pub cancel: &'a Cancel,
    /// Receives the name of each stage.
    pub on_stage: &'a mut dyn FnMut(String),
}

impl Runner<'_> {
    /// Runs a job on the device of that number.
    pub fn run(&mut self, mesh: &MeshFile, parameters: &Parameters, device: usize, repeats: u32) -> Result<Timed> {
        let clusters = parameters.clusters.map_or_else(String::new, |clusters| format!(", {clusters} clusters"));
        (self.on_stage)(format!("{}{clusters}, {}", mesh.model, parameters.algorithm.name()));
        let folder = mesh.path.parent().unwrap_or(Path::new(".")).to_owned();
        let prepared = job::prepare(&Request {
            resources: &Beside { folder },
            ..Request::new(&mesh.bytes, mesh.format, parameters)
        })?;
        let mut run = || -> Result<Report> {
            Ok(job::run(&prepared, self.devices.0[device].as_mut(), self.cancel, &mut |_| {})?.report)
        };
        let mut report = run()?;
        let mut ms = report.timings_ms.cluster;
        for _ in 1..repeats {
            report = run()?;
            ms = ms.min(report.timings_ms.cluster);
        }
        Ok(Timed { ms, report })
    }
}
