//! Time on the device, pass by pass: timestamps that it writes itself, for [`crate::bench`].

use std::collections::BTreeMap;
use std::sync::Mutex;

use serde::Serialize;

use super::connection::lock;

/// Passes that are timed before somebody asks; two queries each are the most that a set has.
const PASSES: u32 = wgpu::QUERY_SET_MAX_QUERIES / 2;

/// The features that a clock needs of the device.
pub(super) const FEATURES: wgpu::Features =
    wgpu::Features::TIMESTAMP_QUERY.union(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);

/// What a device did.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Profile {
    /// What the passes took, each kind in the order in which it came first.
    pub stages: Vec<StageTime>,
    /// Passes beyond those that can be timed.
    pub untimed_passes: u64,
    /// How often each kernel was dispatched, with or without work.
    pub dispatches: BTreeMap<&'static str, u64>,
}

/// What one kind of passes took on the device.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageTime {
    /// What they did: `boundary`, `refine`, …
    pub stage: &'static str,
    /// How many there were.
    pub passes: u64,
    /// What they took together.
    pub milliseconds: f64,
}

/// Timestamps around passes.
#[derive(Debug)]
pub(super) struct Clock {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    mapped: wgpu::Buffer,
    nanoseconds_a_tick: f64,
    done: Mutex<Done>,
}

/// What was done since somebody asked last.
#[derive(Debug, Default)]
pub(super) struct Done {
    /// Each pass that has two queries.
    stages: Vec<&'static str>,
    untimed: u64,
    dispatches: BTreeMap<&'static str, u64>,
}

impl Clock {
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        let size = u64::from(2 * PASSES) * u64::from(wgpu::QUERY_SIZE);
        let buffer = |label, usage| {
            device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
        };
        Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("clock"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * PASSES,
            }),
            resolved: buffer("clock", wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            mapped: buffer("clock for the host", wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST),
            nanoseconds_a_tick: queue.get_timestamp_period().into(),
            done: Mutex::default(),
        }
    }

    /// The number of the first of two queries for a pass, if there are any left.
    fn next(&self, stage: &'static str) -> Option<u32> {
        let mut done = lock(&self.done);
        let number = done.stages.len() as u32;
        if number == PASSES {
            done.untimed += 1;
            return None;
        }
        done.stages.push(stage);
        Some(2 * number)
    }

    /// Notes a dispatch.
    pub fn count(&self, kernel: &'static str) {
        *lock(&self.done).dispatches.entry(kernel).or_default() += 1;
    }

    /// What a pass needs to be timed.
    pub fn around(&self, stage: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        self.next(stage).map(|first| wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// Times what `encode` puts between two passes.
    pub fn between_passes(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        stage: &'static str,
        encode: impl FnOnce(&mut wgpu::CommandEncoder),
    ) {
        let first = self.next(stage);
        if let Some(first) = first {
            encoder.write_timestamp(&self.queries, first);
        }
        encode(encoder);
        if let Some(first) = first {
            encoder.write_timestamp(&self.queries, first + 1);
        }
    }

    /// Encodes the reading of the queries, and starts anew. The buffer is to be mapped, for [`profile`](Self::profile).
    pub fn take(&self, encoder: &mut wgpu::CommandEncoder) -> (Done, &wgpu::Buffer) {
        let done = std::mem::take(&mut *lock(&self.done));
        if !done.stages.is_empty() {
            encoder.resolve_query_set(&self.queries, 0..2 * done.stages.len() as u32, &self.resolved, 0);
        }
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.mapped, 0, None);
        (done, &self.mapped)
    }

    /// What was done, with the ticks at the beginning and the end of each pass.
    pub fn profile(&self, done: Done, ticks: &[[u64; 2]]) -> Profile {
        let mut stages: Vec<StageTime> = Vec::new();
        for (&stage, [begin, end]) in done.stages.iter().zip(ticks) {
            let at = stages.iter().position(|time| time.stage == stage).unwrap_or_else(|| {
                stages.push(StageTime { stage, passes: 0, milliseconds: 0.0 });
                stages.len() - 1
            });
            stages[at].passes += 1;
            stages[at].milliseconds += end.saturating_sub(*begin) as f64 * self.nanoseconds_a_tick / 1e6;
        }
        Profile { stages, untimed_passes: done.untimed, dispatches: done.dispatches }
    }
}
