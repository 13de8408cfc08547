//! What dispatches, round trips and transfers cost on an adapter, for `make gpu-check`: what decides the constants of
//! [`Tuning`](super::Tuning) and the shape of the kernels, measured apart from them.
//!
//! A chain is a thousand dispatches that depend on each other, as the kernels do: each has bindings that the next one
//! has too, and reads in a row of dependent loads.

use std::time::Instant;

use super::Overrides;
use super::adapter::enumerate;
use super::choice::{choose, none_usable, reports};
use super::connection::Connection;
use super::memory::storage;
use super::pages::Pages;
use super::pipeline::with_own_layout;
use super::upload::{upload, upload_staged};
use crate::energy::{Energy, Words as _};
use crate::error::Result;

/// Dispatches of a chain, and on a software gpu, whose times say nothing.
const DISPATCHES: [u32; 2] = [1000, 10];

/// How often a chain or a transfer is timed; the fastest counts.
const REPEATS: u32 = 5;

/// Round trips, whose median counts.
const ROUND_TRIPS: usize = 200;

/// Words of a buffer of a chain: a power of two.
const WORDS: u32 = 1 << 16;

/// Bytes of a transfer.
const TRANSFER: usize = 64 << 20;

/// A chain.
struct Chain {
    name: &'static str,
    bindings: u32,
    is_written: bool,
    loads: u32,
    groups: u32,
}

/// The chains, in microseconds a dispatch.
const CHAINS: [Chain; 6] = [
    Chain { name: "direct_read", bindings: 8, is_written: false, loads: 0, groups: 1 },
    Chain { name: "direct_written_1", bindings: 1, is_written: true, loads: 0, groups: 1 },
    Chain { name: "direct_written_8", bindings: 8, is_written: true, loads: 0, groups: 1 },
    Chain { name: "direct_132_groups", bindings: 8, is_written: true, loads: 0, groups: 132 },
    Chain { name: "direct_132_groups_6_loads", bindings: 8, is_written: true, loads: 6, groups: 132 },
    Chain { name: "direct_528_groups_6_loads", bindings: 8, is_written: true, loads: 6, groups: 528 },
];

/// Measures the adapter of that number or name, else the fastest. Name and figure of each: chains in microseconds a
/// dispatch, `round_trip` in microseconds, transfers in GB/s, `open` (device and kernels) in milliseconds.
pub fn probe(adapter: Option<&str>) -> Result<Vec<(&'static str, f64)>> {
    let found = enumerate();
    let started = Instant::now();
    let reports = reports(&found);
    let chosen = choose(&reports, adapter)?.ok_or_else(|| none_usable(&reports))?;
    let connection = Connection::open(&found[chosen.index], Overrides::default())?;
    connection.compile(Energy::AXES, false)?;
    let mut figures = vec![("open", started.elapsed().as_secs_f64() * 1e3)];
    for chain in &CHAINS {
        figures.push((chain.name, chain.microseconds(&connection)?));
    }
    figures.push(("round_trip", round_trip(&connection)?));
    figures.extend(transfers(&connection)?);
    Ok(figures)
}

impl Chain {
    fn wgsl(&self) -> String {
        let access = if self.is_written { "read_write" } else { "read" };
        let declared = (0..self.bindings)
            .map(|at| format!("@group(0) @binding({at}) var<storage, {access}> b{at}: array<u32>;\n"))
            .collect::<String>();
        let loads = format!("at = (b0[at] + at * 17u + 1u) & {:#x}u;\n", WORDS - 1).repeat(self.loads as usize);
        // never true, which no compiler can tell
        let uses = (0..self.bindings)
            .map(|at| if self.is_written { format!("b{at}[at] = at;\n") } else { format!("at += b{at}[at];\n") })
            .collect::<String>();
        format!(
            "{declared}@compute @workgroup_size(256)\n\
             fn main(@builtin(global_invocation_id) id: vec3<u32>) {{\n\
             var at = id.x & {:#x}u;\n{loads}if at + b0[0] == 0x12345678u {{\n{uses}}}\n}}\n",
            WORDS - 1
        )
    }

    fn microseconds(&self, connection: &Connection) -> Result<f64> {
        let (layout, pipeline) = &with_own_layout(&connection.device, self.name, &self.wgsl());
        let buffers = (0..self.bindings).map(|_| storage(connection, self.name, 4 * u64::from(WORDS)));
        let buffers = buffers.collect::<Result<Vec<_>>>()?;
        let bind_group = connection.bind_group(self.name, layout, buffers.iter().map(wgpu::Buffer::as_entire_binding));
        let dispatches = DISPATCHES[usize::from(connection.is_software)];
        let mut fastest = f64::MAX;
        for _ in 0..REPEATS {
            let mut encoder = connection.encoder();
            {
                let mut pass = connection.pass(&mut encoder, self.name);
                for _ in 0..dispatches {
                    pass.set_pipeline(pipeline);
                    pass.set_bind_group(0, &bind_group, &[]);
                    pass.dispatch_workgroups(self.groups, 1, 1);
                }
            }
            let commands = encoder.finish();
            let started = Instant::now();
            connection.wait(connection.queue.submit([commands]))?;
            fastest = fastest.min(started.elapsed().as_secs_f64() * 1e6 / f64::from(dispatches));
        }
        Ok(fastest)
    }
}

/// From a submission of a small copy to its bytes on the host, in microseconds.
fn round_trip(connection: &Connection) -> Result<f64> {
    let from = storage(connection, "round trip", 16)?;
    let mut times = (0..ROUND_TRIPS).map(|_| download(connection, &from, 16)).collect::<Result<Vec<_>>>()?;
    times.sort_by(f64::total_cmp);
    Ok(times[ROUND_TRIPS / 2] * 1e6)
}

/// Seconds from the submission of a copy to the bytes on the host.
fn download(connection: &Connection, from: &wgpu::Buffer, bytes: u64) -> Result<f64> {
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
    let to = connection.buffer("download", bytes, usage)?;
    let started = Instant::now();
    let mut encoder = connection.encoder();
    encoder.copy_buffer_to_buffer(from, 0, &to, 0, bytes);
    let submission = connection.queue.submit([encoder.finish()]);
    to.map_async(wgpu::MapMode::Read, .., |_| {});
    connection.wait(submission)?;
    let seen = to.get_mapped_range(..).map_err(|_| connection.break_down("its memory could not be read"))?.to_vec();
    let seconds = started.elapsed().as_secs_f64();
    std::hint::black_box(seen);
    Ok(seconds)
}

/// Transfers of [`TRANSFER`] bytes, in GB/s.
fn transfers(connection: &Connection) -> Result<[(&'static str, f64); 3]> {
    let data = vec![7u32; TRANSFER / size_of::<u32>()];
    let target = Pages::from(storage(connection, "transfer", TRANSFER as u64)?);
    let speed = |seconds: f64| TRANSFER as f64 / seconds / 1e9;
    let finish = || connection.wait(connection.queue.submit([]));
    let mut fastest = [f64::MAX; 3];
    for _ in 0..REPEATS {
        let mut times = [0.0; 3];
        let started = Instant::now();
        upload_staged(connection, &target, 0, &data)?;
        finish()?;
        times[0] = started.elapsed().as_secs_f64();
        let started = Instant::now();
        upload(connection, &target, &data);
        finish()?;
        times[1] = started.elapsed().as_secs_f64();
        times[2] = download(connection, target.first(), TRANSFER as u64)?;
        fastest = std::array::from_fn(|at| fastest[at].min(times[at]));
    }
    Ok([("upload_staged", speed(fastest[0])), ("upload_written", speed(fastest[1])), ("download", speed(fastest[2]))])
}
