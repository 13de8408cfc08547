//! From how many faces on a gpu is faster than the processor beside it.
//!
//! Labels are the same on both, so a service may choose for each job. The time of a clustering is close to a + b·faces on
//! either: a gpu has the larger a (dispatches, and waiting for them), the cpu the larger b. Two sizes on each tell both.

use std::time::Instant;

use super::{Mesh, Work};
use crate::device::cpu::CpuDevice;
use crate::device::{Cancel, Device};
use crate::error::{Error, Kind, Result};
use crate::job::{self, milliseconds};

/// Faces of the two samples.
const FACES: [u64; 2] = [4_000, 64_000];

/// How often each sample is clustered: the first time may compile, or touch memory for the first time.
const RUNS: u32 = 3;

/// What is said where a gpu never is faster: the most faces that a mesh can have.
const NEVER: u64 = 1 << 31;

/// The smallest mesh, in faces, that `gpu` clusters faster than the cpu; 2³¹ where it never does. Measured on flat clusterings.
///
/// An error when the gpu fails, or gives other labels than the cpu: then it must not be used.
pub fn faces_for_gpu(gpu: &mut dyn Device, cancel: &Cancel) -> Result<u64> {
    let mut cpu = CpuDevice::new();
    let (mut on_gpu, mut on_cpu) = ([0.0; 2], [0.0; 2]);
    let started = Instant::now();
    for (at, &faces) in FACES.iter().enumerate() {
        let (_, prepared) = Work::flat(Mesh::Knot(faces), None, 100).prepare()?;
        let fastest = |device: &mut dyn Device| -> Result<(f64, Option<Vec<u32>>)> {
            let (mut fastest, mut labels) = (f64::INFINITY, None);
            for _ in 0..RUNS {
                let started = Instant::now();
                labels = job::run(&prepared, device, cancel, &mut |_| {})?.labels;
                fastest = fastest.min(milliseconds(started.elapsed()));
            }
            Ok((fastest, labels))
        };
        let (of_gpu, of_cpu) = (fastest(gpu)?, fastest(&mut cpu)?);
        if of_gpu.1 != of_cpu.1 {
            let message = format_args!("the gpu {} gives other labels than the cpu", gpu.info().name);
            return Err(Error::new(Kind::DeviceUnsuitable, message));
        }
        (on_gpu[at], on_cpu[at]) = (of_gpu.0, of_cpu.0);
    }
    let faces = crossover(FACES.map(|faces| faces as f64), on_gpu, on_cpu);
    tracing::info!(?on_gpu, ?on_cpu, faces, took_ms = milliseconds(started.elapsed()), "calibrated");
    Ok(faces)
}

/// Where the line through the points of the first device sinks below that of the second, at most [`NEVER`].
fn crossover(faces: [f64; 2], first: [f64; 2], second: [f64; 2]) -> u64 {
    let slope = |times: [f64; 2]| (times[1] - times[0]) / (faces[1] - faces[0]);
    let gain_a_face = slope(second) - slope(first);
    let lead = first[1] - second[1];
    match gain_a_face > 0.0 {
        // saturates, also at 0
        true => ((faces[1] + lead / gain_a_face).ceil() as u64).min(NEVER),
        // ahead at both sizes, or at the larger one: it keeps the lead for what counts
        false if lead < 0.0 => 0,
        false => NEVER,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lines_cross_where_they_do() {
        let faces = [1000.0, 2000.0];
        // 5 + 1 a thousand against 4 a thousand
        assert_eq!(crossover(faces, [6.0, 7.0], [4.0, 8.0]), 1667);
        // beyond both samples: 20 + 1 against 4
        assert_eq!(crossover(faces, [21.0, 22.0], [4.0, 8.0]), 6667);
    }

    #[test]
    fn a_device_that_is_never_faster_or_always_is_told_as_such() {
        let faces = [1000.0, 2000.0];
        assert_eq!(crossover(faces, [8.0, 16.0], [4.0, 8.0]), NEVER);
        assert_eq!(crossover(faces, [4.0, 8.0], [4.0, 8.0]), NEVER);
        assert_eq!(crossover(faces, [2.0, 4.0], [4.0, 8.0]), 0);
        assert_eq!(crossover(faces, [2.0, 7.0], [4.0, 8.0]), 0);
    }
}
