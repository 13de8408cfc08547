//! Device time of each pass, from timestamps that the device writes, for [`crate::dev::bench`].

use std::sync::Mutex;

use super::lock;
use crate::device::{Profile, StageTime};

/// Passes that can be timed between two reads: a pass takes two queries of the set.
const PASSES: u32 = wgpu::QUERY_SET_MAX_QUERIES / 2;

/// The features of the device that a clock needs.
pub(super) const FEATURES: wgpu::Features =
    wgpu::Features::TIMESTAMP_QUERY.union(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);

/// Timestamps around passes.
#[derive(Debug)]
pub(super) struct Clock {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    mapped: wgpu::Buffer,
    nanoseconds_a_tick: f64,
    done: Mutex<Done>,
}

/// What was recorded since the last read.
#[derive(Debug, Default)]
pub(super) struct Done {
    /// The stage of each timed pass.
    passes: Vec<&'static str>,
    /// All but the times of stages.
    profile: Profile,
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

    /// Index of the first of two queries for a pass, if any are left.
    fn next(&self, stage: &'static str) -> Option<u32> {
        let mut done = lock(&self.done);
        let number = done.passes.len() as u32;
        if number == PASSES {
            done.profile.untimed_passes += 1;
            return None;
        }
        done.passes.push(stage);
        Some(2 * number)
    }

    /// Changes the counts of the next profile.
    pub fn record(&self, change: impl FnOnce(&mut Profile)) {
        change(&mut lock(&self.done).profile);
    }

    /// The timestamp writes of a pass; none when no queries are left.
    pub fn around(&self, stage: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        self.next(stage).map(|first| wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// Times commands that are encoded between passes.
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

    /// Encodes the read of the queries into a buffer to map for [`profile`](Self::profile), and resets the clock.
    pub fn take(&self, encoder: &mut wgpu::CommandEncoder) -> (Done, &wgpu::Buffer) {
        let done = std::mem::take(&mut *lock(&self.done));
        if !done.passes.is_empty() {
            encoder.resolve_query_set(&self.queries, 0..2 * done.passes.len() as u32, &self.resolved, 0);
        }
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.mapped, 0, None);
        (done, &self.mapped)
    }

    /// The profile, from the ticks at the beginning and the end of each pass.
    pub fn profile(&self, done: Done, ticks: &[[u64; 2]]) -> Profile {
        let Done { passes, mut profile } = done;
        let stages = &mut profile.stages;
        for (&stage, [begin, end]) in passes.iter().zip(ticks) {
            let at = stages.iter().position(|time| time.stage == stage).unwrap_or_else(|| {
                stages.push(StageTime { stage, passes: 0, milliseconds: 0.0 });
                stages.len() - 1
            });
            stages[at].passes += 1;
            stages[at].milliseconds += end.saturating_sub(*begin) as f64 * self.nanoseconds_a_tick / 1e6;
        }
        profile
    }
}
