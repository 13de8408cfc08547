//! A connection to one adapter: wgpu's device and queue, the compiled kernels, and what has gone wrong so far.
//!
//! wgpu tells of failures through callbacks, and goes on. [`Connection::check`] turns what they said into an error; whoever
//! waits for the device checks. A connection that failed once is not used again: the next surface opens another one.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use super::adapter::Found;
use super::clock::{self, Clock, Profile};
use super::kernels::{self, Access, Kernel};
use super::{Fault, FaultPoint, Overrides};
use crate::error::{Error, Kind, Result};

/// How long a batch may take before the device counts as lost.
pub(super) const PATIENCE: Duration = Duration::from_secs(120);

/// An open device of wgpu.
#[derive(Debug)]
pub(super) struct Connection {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// The device's limits, lowered by [`Overrides`].
    pub(super) limits: wgpu::Limits,
    pub(super) kernels: Kernels,
    merge_kernels: OnceLock<MergeKernels>,
    name: String,
    health: Arc<Health>,
    fault: Mutex<Option<Fault>>,
    /// Whether a fault leaves no memory for the next buffer.
    is_exhausted: AtomicBool,
    /// Where passes are timed.
    clock: Option<Clock>,
}

/// The compiled kernels.
#[derive(Debug)]
pub(super) struct Kernels {
    pub(super) grow: Compiled,
    pub(super) settle: Compiled,
    pub(super) enlist: Compiled,
    pub(super) weed: Compiled,
    pub(super) line_up: Compiled,
    pub(super) gather: Compiled,
    pub(super) propose: Compiled,
    pub(super) apply: Compiled,
    pub(super) fit: Compiled,
    pub(super) bid: Compiled,
    pub(super) choose: Compiled,
    pub(super) join: Compiled,
    pub(super) judge: Compiled,
    pub(super) deal: Compiled,
    pub(super) link: Compiled,
    pub(super) hook: Compiled,
    pub(super) weigh: Compiled,
    pub(super) elect: Compiled,
    pub(super) cut: Compiled,
}

/// The compiled kernels of hierarchies.
#[derive(Debug)]
pub(super) struct MergeKernels {
    pub(super) price: Compiled,
    pub(super) break_ties: Compiled,
    pub(super) prefer: Compiled,
    pub(super) list_choices: Compiled,
    pub(super) search: Compiled,
    pub(super) reduce: Compiled,
    pub(super) unite: Compiled,
    pub(super) relabel: Compiled,
    pub(super) list_moves: Compiled,
    pub(super) pick_sums: Compiled,
}

/// A compiled kernel.
#[derive(Debug)]
pub(super) struct Compiled {
    pub(super) kernel: &'static Kernel,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) pipeline: wgpu::ComputePipeline,
}

/// What the callbacks said.
#[derive(Debug, Default)]
struct Health {
    lost: Mutex<Option<String>>,
    failed: Mutex<Option<Error>>,
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Connection {
    /// Opens a device on the adapter and compiles the kernels.
    pub(super) fn open(found: &Found, overrides: Overrides) -> Result<Self> {
        let name = found.report.name.clone();
        let mut limits = found.adapter.limits();
        const NONE: wgpu::Features = wgpu::Features::empty();
        let is_timed = overrides.timed && found.adapter.features().contains(clock::FEATURES);
        let request = found.adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("tesserae"),
            required_features: wgpu::Features::SHADER_INT64 | if is_timed { clock::FEATURES } else { NONE },
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
        let kernels = Kernels {
            grow: compile(&device, &kernels::GROW),
            settle: compile(&device, &kernels::SETTLE),
            enlist: compile(&device, &kernels::ENLIST),
            weed: compile(&device, &kernels::WEED),
            line_up: compile(&device, &kernels::LINE_UP),
            gather: compile(&device, &kernels::GATHER),
            propose: compile(&device, &kernels::PROPOSE),
            apply: compile(&device, &kernels::APPLY),
            fit: compile(&device, &kernels::FIT),
            bid: compile(&device, &kernels::BID),
            choose: compile(&device, &kernels::CHOOSE),
            join: compile(&device, &kernels::JOIN),
            judge: compile(&device, &kernels::JUDGE),
            deal: compile(&device, &kernels::DEAL),
            link: compile(&device, &kernels::LINK),
            hook: compile(&device, &kernels::HOOK),
            weigh: compile(&device, &kernels::WEIGH),
            elect: compile(&device, &kernels::ELECT),
            cut: compile(&device, &kernels::CUT),
        };
        let clock = is_timed.then(|| Clock::new(&device, &queue));
        let connection = Self {
            device,
            queue,
            limits,
            kernels,
            merge_kernels: OnceLock::new(),
            name,
            health,
            fault: Mutex::default(),
            is_exhausted: AtomicBool::default(),
            clock,
        };
        connection.check()?;
        Ok(connection)
    }

    /// Name of the adapter.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// The kernels of hierarchies, which are compiled when the first one is asked for.
    pub(super) fn merge_kernels(&self) -> Result<&MergeKernels> {
        let kernels = self.merge_kernels.get_or_init(|| MergeKernels {
            price: compile(&self.device, &kernels::PRICE),
            break_ties: compile(&self.device, &kernels::BREAK_TIES),
            prefer: compile(&self.device, &kernels::PREFER),
            list_choices: compile(&self.device, &kernels::LIST_CHOICES),
            search: compile(&self.device, &kernels::SEARCH),
            reduce: compile(&self.device, &kernels::REDUCE),
            unite: compile(&self.device, &kernels::UNITE),
            relabel: compile(&self.device, &kernels::RELABEL),
            list_moves: compile(&self.device, &kernels::LIST_MOVES),
            pick_sums: compile(&self.device, &kernels::PICK_SUMS),
        });
        self.check()?;
        Ok(kernels)
    }

    /// Begins a pass, timed where there is a clock.
    pub(super) fn pass<'e>(&self, encoder: &'e mut wgpu::CommandEncoder, stage: &'static str) -> wgpu::ComputePass<'e> {
        let timestamp_writes = self.clock.as_ref().and_then(|clock| clock.around(stage));
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(stage), timestamp_writes })
    }

    /// Notes a dispatch, where there is a clock.
    pub(super) fn count(&self, kernel: &Kernel) {
        if let Some(clock) = &self.clock {
            clock.count(kernel.name);
        }
    }

    /// What was done since somebody asked last, where there is a clock. To be asked while nothing runs.
    pub(super) fn take_profile(&self) -> Result<Option<Profile>> {
        let Some(clock) = &self.clock else { return Ok(None) };
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let (done, queries) = clock.take(&mut encoder);
        let submission = self.queue.submit([encoder.finish()]);
        queries.slice(..).map_async(wgpu::MapMode::Read, |_| {});
        self.wait(submission)?;
        let ticks: Vec<[u64; 2]> = match queries.slice(..).get_mapped_range() {
            Ok(view) => bytemuck::pod_collect_to_vec(&view),
            Err(_) => return Err(self.break_down("its timestamps could not be read")),
        };
        queries.unmap();
        Ok(Some(clock.profile(done, &ticks)))
    }

    /// Bytes a second, read and written, of copies of `bytes` from one buffer to another; none without a clock.
    pub(super) fn copy_bandwidth(&self, bytes: u64) -> Result<Option<f64>> {
        /// Copies that are timed.
        const COPIES: u64 = 8;
        let Some(clock) = &self.clock else { return Ok(None) };
        let buffer = |label| {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes,
                usage: wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let (from, to) = (buffer("copied"), buffer("copy"));
        let copy = |copies: u64| {
            let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
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

    /// Creates a buffer. A failure, such as lack of memory, is an error of this call and leaves the connection usable.
    pub(super) fn buffer(&self, descriptor: &wgpu::BufferDescriptor<'_>) -> Result<wgpu::Buffer> {
        if self.is_exhausted.swap(false, Ordering::SeqCst) {
            return Err(failure(&self.name, &wgpu::Error::OutOfMemory { source: "injected".into() }));
        }
        let kinds = [wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::OutOfMemory];
        let scopes = kinds.map(|kind| self.device.push_error_scope(kind));
        let buffer = self.device.create_buffer(descriptor);
        // scopes end in reverse order
        let errors: Vec<_> = scopes.into_iter().rev().filter_map(|scope| pollster::block_on(scope.pop())).collect();
        errors.first().map_or(Ok(buffer), |error| Err(failure(&self.name, error)))
    }

    /// Whether something has gone wrong.
    pub(super) fn is_broken(&self) -> bool {
        self.check().is_err()
    }

    /// An error when something has gone wrong.
    pub(super) fn check(&self) -> Result<()> {
        if lock(&self.health.failed).is_some() && lock(&self.health.lost).is_none() {
            // A lost device makes other calls fail first; its own callback needs a poll to be called.
            let _ = self.poll(wgpu::PollType::Poll);
        }
        if let Some(message) = lock(&self.health.lost).as_deref() {
            return Err(self.lost(message));
        }
        match lock(&self.health.failed).clone() {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// Waits until a submission has been carried out and the callbacks of its buffers were called.
    pub(super) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<()> {
        let outcome = self.poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(PATIENCE) });
        self.check()?;
        outcome
    }

    /// Polls. wgpu panics when that finds the device lost.
    fn poll(&self, how: wgpu::PollType) -> Result<()> {
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(how))) {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(error)) => Err(self.break_down(&one_line(&error.to_string()))),
            Err(_) => Err(self.break_down("waiting for it failed")),
        }
    }

    /// Notes that the device is lost; the error that says so.
    pub(super) fn break_down(&self, message: &str) -> Error {
        lock(&self.health.lost).get_or_insert_with(|| message.to_owned());
        self.lost(message)
    }

    fn lost(&self, message: &str) -> Error {
        Error::new(Kind::DeviceLost, format_args!("the gpu {} was lost: {message}", self.name))
    }

    /// Arms a fault.
    pub(super) fn arm(&self, fault: Option<Fault>) {
        *lock(&self.fault) = fault;
    }

    /// Where faults are injected.
    pub(super) fn reach(&self, point: FaultPoint) {
        match lock(&self.fault).take_if(|fault| fault.point() == point) {
            Some(Fault::Exhaust(_)) => self.is_exhausted.store(true, Ordering::SeqCst),
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

/// The error that stands for one of wgpu's.
fn failure(name: &str, error: &wgpu::Error) -> Error {
    match error {
        wgpu::Error::OutOfMemory { .. } => Error::new(
            Kind::DeviceLost,
            format_args!("the gpu ran out of memory, try a smaller mesh or the cpu device: {name}"),
        ),
        wgpu::Error::Validation { description, .. } | wgpu::Error::Internal { description, .. } => {
            Error::new(Kind::Internal, format_args!("the gpu {name} refused its work: {}", one_line(description)))
        }
    }
}

/// wgpu's messages are trees over several lines.
fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn compile(device: &wgpu::Device, kernel: &'static Kernel) -> Compiled {
    let entries: Vec<_> = (0..)
        .zip(kernel.bindings)
        .map(|(at, binding)| wgpu::BindGroupLayoutEntry {
            binding: at,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: match binding.access {
                    Access::Turn => wgpu::BufferBindingType::Uniform,
                    Access::Read => wgpu::BufferBindingType::Storage { read_only: true },
                    Access::Write => wgpu::BufferBindingType::Storage { read_only: false },
                },
                has_dynamic_offset: binding.access == Access::Turn,
                min_binding_size: wgpu::BufferSize::new(binding.stride as u64),
            },
            count: None,
        })
        .collect();
    let layout = device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(kernel.name), entries: &entries });
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(kernel.name),
        source: wgpu::ShaderSource::Wgsl(kernel.source().into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(kernel.name),
        layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(kernel.name),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        })),
        module: &module,
        entry_point: Some(kernel.name),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    Compiled { kernel, layout, pipeline }
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
