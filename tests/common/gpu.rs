//! What the tests of the gpu device share: an adapter, and runs of the driver.

use std::ops::{Deref, DerefMut};
use std::sync::Mutex;
use std::thread;

use tesserae_mesh::cluster::flat::{Clustering, Options};
use tesserae_mesh::cluster::run::Row;
use tesserae_mesh::cluster::{self, seeds::SeedFaces};
use tesserae_mesh::dev::random;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::gpu::adapter::{Found, enumerate};
use tesserae_mesh::device::gpu::{GpuDevice, Overrides, Tuning};
use tesserae_mesh::device::{Cancel, Device};
use tesserae_mesh::error::Result;
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::surface::Surface;

/// The paper's optimisation alone, whatever pieces that leaves.
pub const PLAIN: Options = Options { max_iterations: None, refine: false, allow_disconnected: true };

/// Everything that there is.
pub const ALL: Options = Options { max_iterations: None, refine: true, allow_disconnected: false };

/// The first usable adapter, software or not.
pub fn adapter() -> Found {
    let found = enumerate();
    let all: Vec<String> = found.iter().map(|found| found.report.to_string()).collect();
    found.into_iter().filter(|found| found.report.usable).min_by_key(|found| found.report.kind).unwrap_or_else(|| {
        panic!("these tests need a Vulkan driver, and found {all:?}: install mesa-vulkan-drivers, as `make test` does")
    })
}

/// Devices that no test uses. To open one and to compile its kernels takes longer than most tests do.
static IDLE: Mutex<Vec<GpuDevice>> = Mutex::new(Vec::new());

/// A device that the next test takes over, unless this one fails: a service has one for all jobs, too.
pub struct Borrowed(Option<GpuDevice>);

/// An idle device, else a new one.
pub fn device() -> Borrowed {
    let idle = IDLE.lock().expect("no thread failed here").pop();
    Borrowed(Some(idle.unwrap_or_else(opened)))
}

/// A new device.
pub fn opened() -> GpuDevice {
    GpuDevice::new(&adapter()).expect("the adapter opens")
}

impl Deref for Borrowed {
    type Target = GpuDevice;

    fn deref(&self) -> &GpuDevice {
        self.0.as_ref().expect("it is there until it is dropped")
    }
}

impl DerefMut for Borrowed {
    fn deref_mut(&mut self) -> &mut GpuDevice {
        self.0.as_mut().expect("it is there until it is dropped")
    }
}

impl Drop for Borrowed {
    fn drop(&mut self) {
        if !thread::panicking() {
            IDLE.lock().expect("no thread failed here").extend(self.0.take());
        }
    }
}

pub fn device_with(overrides: Overrides) -> GpuDevice {
    GpuDevice::with_overrides(&adapter(), overrides).expect("the adapter opens")
}

/// The largest binding has so many bytes, and no buffer more.
pub fn without_pages(bytes: u64) -> Overrides {
    Overrides { binding_size: Some(bytes), without_pages: true, ..Overrides::default() }
}

pub fn tuned(tuning: Tuning) -> GpuDevice {
    device_with(Overrides { tuning, ..Overrides::default() })
}

pub fn seeds(surface: &Surface, clusters: u64, kind: &Seeds, seed: u64) -> SeedFaces {
    cluster::seeds::choose(surface, clusters, kind, seed, None).expect("the number is possible")
}

/// Everything a run says.
pub type Run = (Vec<u32>, Vec<u32>, String, Vec<Row>);

/// Runs boundary-based clustering.
pub fn run(device: &mut dyn Device, surface: &Surface, seeds: &SeedFaces, options: Options) -> Result<Run> {
    let mut steps = device.open(surface, &seeds.component_of_cluster)?;
    let mut rows = Vec::new();
    let Clustering { initial, labels, ending, .. } = cluster::flat::boundary_based(
        surface,
        &seeds.labels(surface.faces()),
        options,
        steps.as_mut(),
        &Cancel::default(),
        &mut |row| rows.push(row),
        &mut cluster::record::Record::default(),
    )?;
    Ok((initial, labels, format!("{ending:?}"), rows))
}

/// Numbers of clusters worth trying on a surface.
pub fn cluster_counts(surface: &Surface) -> Vec<u64> {
    let (fewest, most) = (surface.components.len() as u64, surface.faces() as u64);
    let mut counts: Vec<u64> = [fewest, most / 50, most / 7, most].map(|k| k.clamp(fewest, most)).to_vec();
    counts.sort_unstable();
    counts.dedup();
    counts
}

/// A sample as a surface.
pub fn surface(sample: Sample, faces: u64) -> Surface {
    Surface::build(&generate(sample, faces).expect("a sample")).expect("a surface")
}

/// Numbers at random, the same in every run.
pub fn numbers(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut states = random(seed);
    move |bound| (states() >> 20) % bound
}
