//! A connection to one adapter: wgpu's device and queue, the compiled kernels, and failures so far.
//!
//! wgpu reports failures through callbacks and continues. [`Connection::check`] returns the first one as an error; it
//! is called after every wait for the device. A connection that failed once is not used again: the next surface opens a
//! new one.

use std::collections::{HashMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytemuck::pod_collect_to_vec;

use super::adapter::Found;
use super::clock::{self, Clock};
use super::kernels::{self, KERNELS, Kernel};
use super::pages::{self, Bindings};
use super::pipeline::{Compiled, compile, iteration_layout};
use super::{Fault, FaultPoint, Overrides, Tuning, lock};
use crate::device::adapter::AdapterKind;
use crate::device::{KernelWork, Profile};
use crate::error::{Error, Kind, Result};
use crate::parallel;

/// How long a batch may take before the device counts as lost.
pub(super) const PATIENCE: Duration = Duration::from_secs(120);

/// An open device of wgpu.
#[derive(Debug)]
pub(super) struct Connection {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// The device's limits, lowered by [`Overrides`].
    pub(super) limits: wgpu::Limits,
    /// What it binds.
    pub(super) bindings: Bindings,
    /// The layout of what all kernels bind.
    pub(super) iteration_layout: wgpu::BindGroupLayout,
    /// From [`Overrides`].
    pub(super) tuning: Tuning,
    /// Whether the adapter is a driver that computes on the cpu.
    pub(super) is_software: bool,
    /// Whether chains of kernels are used: they have more storage buffers than portable devices bind.
    pub(super) has_chains: bool,
    /// Compiled kernels, by name, number of axes, and whether buffers have pages.
    pub(super) pipelines: Mutex<HashMap<(&'static str, usize, bool), Compiled>>,
    /// What the self-test of the kernels ended with, by number of axes, and whether buffers have pages.
    pub(super) tested: Mutex<HashMap<(usize, bool), Result<()>>>,
    /// Name of the adapter.
    pub(super) name: String,
    /// What surfaces are uploaded through.
    pub(super) staging: Mutex<Staging>,
    health: Arc<Health>,
    fault: Mutex<Option<Fault>>,
    /// A fault of the next buffer, or of the next numbers that the host reads.
    reached: Mutex<Option<Fault>>,
    /// Where passes are timed.
    clock: Option<Clock>,
}

/// Memory that the host writes and the device copies from. Pieces are used again: wgpu fills new ones with zeros, which
/// takes as long as writing what is to be sent.
#[derive(Debug, Default)]
pub(super) struct Staging {
    /// Mapped.
    pub(super) idle: Vec<wgpu::Buffer>,
    /// In the order of their submissions.
    pub(super) in_flight: VecDeque<InFlight>,
}

/// A piece from which the device copies; it is mapped again after that.
#[derive(Debug)]
pub(super) struct InFlight {
    pub(super) buffer: wgpu::Buffer,
    pub(super) submission: wgpu::SubmissionIndex,
    pub(super) mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
}

/// Failures that callbacks reported.
#[derive(Debug, Default)]
struct Health {
    lost: Mutex<Option<String>>,
    failed: Mutex<Option<Error>>,
}

impl Connection {
    /// Opens a device on the adapter.
    pub(super) fn open(found: &Found, overrides: Overrides) -> Result<Self> {
        let name = found.report.name.clone();
        let mut limits = found.adapter.limits();
        let is_timed = overrides.timed && found.adapter.features().contains(clock::FEATURES);
        let mut features = wgpu::Features::SHADER_INT64;
        features.set(clock::FEATURES, is_timed);
        features.set(pages::FEATURES, found.adapter.features().contains(pages::FEATURES) && !overrides.without_pages);
        let request = found.adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("tesserae"),
            required_features: features,
            required_limits: limits.clone(),
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(request).map_err(|error| {
            Error::new(Kind::DeviceLost, format_args!("cannot open the gpu {name}: {}", one_line(&error.to_string())))
        })?;

        let health = Arc::new(Health::default());
        let callback = Arc::clone(&health);
        device.set_device_lost_callback(move |reason, message| {
            let message = one_line(&message);
            *lock(&callback.lost) =
                Some(if message.is_empty() { format!("{reason:?}").to_lowercase() } else { message });
        });
        let callback = Arc::clone(&health);
        let error_name = name.clone();
        device.on_uncaptured_error(Arc::new(move |error| {
            lock(&callback.failed).get_or_insert_with(|| failure(&error_name, &error));
        }));

        if let Some(groups) = overrides.workgroups_per_dimension {
            limits.max_compute_workgroups_per_dimension = groups;
        }
        if let Some(bytes) = overrides.binding_size {
            limits.max_storage_buffer_binding_size = bytes;
        }
        let binds = |kernel: &&Kernel| kernel.bindings().len() as u32 <= limits.max_storage_buffers_per_shader_stage;
        let has_chains = KERNELS.iter().all(binds);
        let clock = is_timed.then(|| Clock::new(&device, &queue));
        let bindings = Bindings::new(features, &limits, kernels::most_bound());
        let iteration_layout = iteration_layout(&device);
        Ok(Self {
            device,
            queue,
            limits,
            bindings,
            iteration_layout,
            tuning: overrides.tuning,
            is_software: found.report.kind == AdapterKind::Software,
            has_chains,
            pipelines: Mutex::default(),
            tested: Mutex::default(),
            name,
            staging: Mutex::default(),
            health,
            fault: Mutex::new(overrides.fault),
            reached: Mutex::default(),
            clock,
        })
    }

    /// Compiles all kernels for points of so many axes, several at a time.
    pub(super) fn compile(&self, axes: usize, is_paged: bool) -> Result<()> {
        let used = |kernel: &&Kernel| self.has_chains || !kernel.needs_many_buffers();
        let used: Vec<&Kernel> = KERNELS.iter().copied().filter(used).collect();
        let compiled = parallel::map(used.len(), 1, |kernel| {
            ((used[kernel].name, axes, is_paged), self.compiled(used[kernel], axes, is_paged))
        });
        lock(&self.pipelines).extend(compiled);
        self.check()
    }

    /// A kernel for points of so many axes.
    pub(super) fn pipeline(&self, kernel: &Kernel, axes: usize, is_paged: bool) -> Compiled {
        let compiled = || self.compiled(kernel, axes, is_paged);
        lock(&self.pipelines).entry((kernel.name, axes, is_paged)).or_insert_with(compiled).clone()
    }

    fn compiled(&self, kernel: &Kernel, axes: usize, is_paged: bool) -> Compiled {
        let pages = is_paged.then_some(&self.bindings);
        compile((&self.device, &self.iteration_layout), kernel, &self.tuning, axes, pages)
    }

    /// Begins a pass, timed if there is a clock.
    pub(super) fn pass<'e>(&self, encoder: &'e mut wgpu::CommandEncoder, stage: &'static str) -> wgpu::ComputePass<'e> {
        let timestamp_writes = self.clock.as_ref().and_then(|clock| clock.around(stage));
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(stage), timestamp_writes })
    }

    /// Changes the counts of the next profile, if there is a clock.
    fn record(&self, change: impl FnOnce(&mut Profile)) {
        if let Some(clock) = &self.clock {
            clock.record(change);
        }
    }

    /// Counts what a kernel does.
    pub(super) fn count(&self, kernel: &'static str, work: KernelWork) {
        self.record(|profile| *profile.kernels.entry(kernel).or_default() += work);
    }

    /// Submits commands, and what was written to buffers before.
    pub(super) fn submit(&self, encoder: Option<wgpu::CommandEncoder>) -> wgpu::SubmissionIndex {
        self.record(|profile| profile.submits += 1);
        self.queue.submit(encoder.map(wgpu::CommandEncoder::finish))
    }

    /// Takes the profile since the last call; none without a clock. Nothing may be running.
    pub(super) fn take_profile(&self) -> Result<Option<Profile>> {
        let Some(clock) = &self.clock else { return Ok(None) };
        let mut encoder = self.encoder();
        let (done, queries) = clock.take(&mut encoder);
        let submission = self.queue.submit([encoder.finish()]);
        queries.slice(..).map_async(wgpu::MapMode::Read, |_| {});
        self.wait(submission)?;
        let unreadable = |_| self.break_down("its timestamps could not be read");
        let ticks: Vec<[u64; 2]> = pod_collect_to_vec(&queries.slice(..).get_mapped_range().map_err(unreadable)?);
        queries.unmap();
        // without the wait for the profile itself
        self.record(|profile| profile.waits = 0);
        Ok(Some(clock.profile(done, &ticks)))
    }

    /// Bytes a second, read and written, of copies of `bytes` from one buffer to another; none without a clock.
    pub(super) fn copy_bandwidth(&self, bytes: u64) -> Result<Option<f64>> {
        /// Copies that are timed.
        const COPIES: u64 = 8;
        let Some(clock) = &self.clock else { return Ok(None) };
        let usage = wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let (from, to) = (self.buffer("copied", bytes, usage)?, self.buffer("copy", bytes, usage)?);
        let copy = |copies: u64| {
            let mut encoder = self.encoder();
            clock.between_passes(&mut encoder, "copy", |encoder| {
                (0..copies).for_each(|_| encoder.copy_buffer_to_buffer(&from, 0, &to, 0, None));
            });
            self.queue.submit([encoder.finish()]);
        };
        // the first use of a buffer clears it
        copy(1);
        self.take_profile()?;
        copy(COPIES);
        let stages = self.take_profile()?.map(|profile| profile.stages).unwrap_or_default();
        let seconds = stages.first().map_or(0.0, |copies| copies.milliseconds / 1e3);
        Ok((seconds > 0.0).then(|| (2 * COPIES * bytes) as f64 / seconds))
    }

    pub(super) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    /// Creates a buffer, mapped if the host may write it. A failure, such as lack of memory, is an error of this call
    /// and leaves the connection usable.
    pub(super) fn buffer(&self, label: &str, size: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer> {
        if lock(&self.reached).take_if(|fault| matches!(fault, Fault::Exhaust(_))).is_some() {
            return Err(failure(&self.name, &wgpu::Error::OutOfMemory { source: "injected".into() }));
        }
        let kinds = [wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::OutOfMemory];
        let scopes = kinds.map(|kind| self.device.push_error_scope(kind));
        let mapped_at_creation = usage.contains(wgpu::BufferUsages::MAP_WRITE);
        let descriptor = wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation };
        let buffer = self.device.create_buffer(&descriptor);
        // scopes end in reverse order
        let errors: Vec<_> = scopes.into_iter().rev().filter_map(|scope| pollster::block_on(scope.pop())).collect();
        errors.first().map_or(Ok(buffer), |error| Err(failure(&self.name, error)))
    }

    /// The resources of a kernel, in the order of their bindings.
    pub(super) fn bind_group<'a>(
        &self,
        kernel: &str,
        layout: &wgpu::BindGroupLayout,
        resources: impl IntoIterator<Item = wgpu::BindingResource<'a>>,
    ) -> wgpu::BindGroup {
        let entry = |(binding, resource)| wgpu::BindGroupEntry { binding, resource };
        let entries: Vec<_> = (0..).zip(resources).map(entry).collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(kernel), layout, entries: &entries })
    }

    /// The first failure that was reported.
    pub(super) fn check(&self) -> Result<()> {
        if lock(&self.health.failed).is_some() && lock(&self.health.lost).is_none() {
            // A lost device makes other calls fail first; a poll calls its own callback once the queue is empty.
            let _ = self.poll(wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) });
        }
        if let Some(message) = lock(&self.health.lost).as_deref() {
            return Err(self.lost(message));
        }
        lock(&self.health.failed).clone().map_or(Ok(()), Err)
    }

    /// Waits until a submission has completed and the callbacks of its buffers were called.
    pub(super) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<()> {
        self.record(|profile| profile.waits += 1);
        let outcome = self.poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(PATIENCE) });
        self.check()?;
        outcome
    }

    /// Polls. wgpu panics if the device is found lost.
    fn poll(&self, how: wgpu::PollType) -> Result<()> {
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(how))) {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(error)) => Err(self.break_down(&one_line(&error.to_string()))),
            Err(_) => Err(self.break_down("waiting for it failed")),
        }
    }

    /// Marks the device as lost. Returns the error for that.
    pub(super) fn break_down(&self, message: &str) -> Error {
        lock(&self.health.lost).get_or_insert_with(|| message.to_owned());
        self.lost(message)
    }

    fn lost(&self, message: &str) -> Error {
        Error::new(Kind::DeviceLost, format_args!("the gpu {} was lost: {message}", self.name))
    }

    /// Sets the fault to inject.
    pub(super) fn arm(&self, fault: Option<Fault>) {
        *lock(&self.fault) = fault;
    }

    /// The bytes with another last number, if a fault requires that.
    pub(super) fn corrupted(&self, bytes: &[u8]) -> Option<Vec<u8>> {
        let last = bytes.len().checked_sub(4)?;
        lock(&self.reached).take_if(|fault| matches!(fault, Fault::Miscompute(_)))?;
        let mut wrong = bytes.to_vec();
        wrong[last] ^= 1;
        Some(wrong)
    }

    /// Injects the fault that was set for this point.
    pub(super) fn reach(&self, point: FaultPoint) {
        match lock(&self.fault).take_if(|fault| fault.point() == point) {
            Some(fault @ (Fault::Exhaust(_) | Fault::Miscompute(_))) => *lock(&self.reached) = Some(fault),
            Some(Fault::Lose(_)) => self.device.destroy(),
            Some(Fault::Misuse(_)) => {
                // more than any device allows
                let _ = self.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("misuse"),
                    size: u64::MAX - 3,
                    usage: wgpu::BufferUsages::STORAGE,
                    mapped_at_creation: false,
                });
            }
            None => {}
        }
    }
}

/// Converts an error of wgpu.
fn failure(name: &str, error: &wgpu::Error) -> Error {
    match error {
        wgpu::Error::OutOfMemory { .. } => Error::new(
            Kind::DeviceLost,
            format_args!("the gpu ran out of memory, try a smaller mesh or the cpu device: {name}"),
        ),
        wgpu::Error::Validation { description, .. } | wgpu::Error::Internal { description, .. } => {
            Error::internal(format_args!("the gpu {name} refused its work: {}", one_line(description)))
        }
    }
}

/// Joins the lines of a message: wgpu's messages are trees.
fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_wgpu_become_errors_of_the_right_kind() {
        let memory = wgpu::Error::OutOfMemory { source: "none left".into() };
        assert_eq!(failure("x", &memory).kind, Kind::DeviceLost);
        let misuse = wgpu::Error::Validation {
            source: "no".into(),
            description: "In a call\n\n  a buffer is  wrong".to_owned(),
        };
        let error = failure("x", &misuse);
        assert_eq!(error.kind, Kind::Internal);
        assert!(error.message.ends_with("In a call a buffer is wrong"));
    }
}
