//! From how many faces on a gpu is faster than the processor beside it.
//!
//! Labels are the same on both, so a service may choose for each job. The time of a clustering is close to a + b·faces on
//! either: a gpu has the larger a (dispatches, and waiting for them), the cpu the larger b. Two sizes on each tell both.

use std::time::Instant;

use super::{Mesh, Work};
use crate::device::cpu::CpuDevice;
use crate::device::{Cancel, Device};
use crate::error::Result;
use crate::job::{self, milliseconds};

/// Faces of the two samples.
const FACES: [u64; 2] = [4_000, 64_000];

/// How often each sample is clustered: the first time may compile, or touch memory for the first time.
const RUNS: u32 = 2;

/// The smallest mesh, in faces, that `gpu` clusters faster than the cpu; more than any mesh has where it never does.
///
/// Takes some tenths of a second on a gpu, and as long as it takes on anything slower.
pub fn faces_for_gpu(gpu: &mut dyn Device, cancel: &Cancel) -> Result<u64> {
    let mut cpu = CpuDevice::new();
    let (mut on_gpu, mut on_cpu) = ([0.0; 2], [0.0; 2]);
    let started = Instant::now();
    for (at, &faces) in FACES.iter().enumerate() {
        let (_, prepared) = Work::flat(Mesh::Knot(faces), None, 100).prepare()?;
        let fastest = |device: &mut dyn Device| -> Result<f64> {
            let mut fastest = f64::INFINITY;
            for _ in 0..RUNS {
                let started = Instant::now();
                job::run(&prepared, device, cancel, &mut |_| {})?;
                fastest = fastest.min(milliseconds(started.elapsed()));
            }
            Ok(fastest)
        };
        on_gpu[at] = fastest(gpu)?;
        on_cpu[at] = fastest(&mut cpu)?;
    }
    let faces = crossover(FACES.map(|faces| faces as f64), on_gpu, on_cpu);
    tracing::info!(?on_gpu, ?on_cpu, faces, took_ms = milliseconds(started.elapsed()), "calibrated");
    Ok(faces)
}

/// Where the line through the points of the first device sinks below that of the second.
fn crossover(faces: [f64; 2], first: [f64; 2], second: [f64; 2]) -> u64 {
    let slope = |times: [f64; 2]| (times[1] - times[0]) / (faces[1] - faces[0]);
    let gain_a_face = slope(second) - slope(first);
    let lead = first[1] - second[1];
    match gain_a_face > 0.0 {
        // saturates, also at 0
        true => (faces[1] + lead / gain_a_face).ceil() as u64,
        false if lead < 0.0 => 0,
        false => u64::MAX,
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
        assert_eq!(crossover(faces, [8.0, 16.0], [4.0, 8.0]), u64::MAX);
        assert_eq!(crossover(faces, [4.0, 8.0], [4.0, 8.0]), u64::MAX);
        assert_eq!(crossover(faces, [2.0, 4.0], [4.0, 8.0]), 0);
        assert_eq!(crossover(faces, [2.0, 7.0], [4.0, 8.0]), 0);
    }
}
