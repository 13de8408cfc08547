//! From how many faces on a gpu is faster than the processor beside it.
//!
//! Labels are the same on both, so a service may choose for each job. The time of a clustering is close to a + b·faces
//! on either: a gpu has the larger a (dispatches, and waiting for them), the cpu the larger b. Two sizes on each tell
//! both.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use super::{Mesh, Work};
use crate::device::cpu::CpuDevice;
use crate::device::select::FACES_FOR_GPU;
use crate::device::{Cancel, Device};
use crate::error::{Error, Kind, Result};
use crate::job::{self, milliseconds};

/// Faces of the two samples.
const FACES: [u64; 2] = [4_000, 64_000];

/// How often each sample is clustered and timed, after a run that is not: until then a card may idle at a fifth of its
/// clock, and memory is touched for the first time.
const RUNS: u32 = 3;

/// What is said where a gpu never is faster: the most faces that a mesh can have.
const NEVER: u64 = 1 << 31;

/// In place of the smallest mesh for a gpu with wrong labels, to distinguish it from a slow one.
const NO_MESH: u64 = 1 << 32;

/// How long a gpu may take to be measured.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// A gpu, and the smallest mesh, in faces, that it clusters faster than the cpu: 2³¹ where it never does, 2³² where its
/// labels are wrong. One that does not answer in time is left behind and opened anew, as is one that fails: it may be
/// well later, and gets the meshes that gpus get where nothing was measured.
pub fn calibrated(
    mut gpu: Box<dyn Device>,
    patience: Duration,
    reopen: impl FnOnce() -> Result<Box<dyn Device>>,
) -> Result<(Box<dyn Device>, u64)> {
    let (told, outcome) = mpsc::channel();
    let measure = move || {
        let cancel = Cancel::default();
        let faces = catch_unwind(AssertUnwindSafe(|| faces_for_gpu(gpu.as_mut(), &cancel)));
        // the receiver is gone when it took too long
        let _ = told.send((gpu, faces));
    };
    std::thread::Builder::new()
        .name("calibration".to_owned())
        .spawn(measure)
        .map_err(|error| Error::io("a thread cannot be started", error))?;
    let why = match outcome.recv_timeout(patience) {
        Ok((gpu, Ok(Ok(faces)))) => return Ok((gpu, faces)),
        Ok((gpu, Ok(Err(error)))) if error.kind == Kind::DeviceUnsuitable => {
            tracing::error!(%error, "the gpu is not used");
            return Ok((gpu, NO_MESH));
        }
        Ok((_, Ok(Err(error)))) => error.message,
        Ok((_, Err(_))) => "its driver panicked".to_owned(),
        Err(_) => format!("it did not answer within {patience:?}"),
    };
    tracing::warn!(why, faces = FACES_FOR_GPU, "the gpu cannot be measured; it gets the larger meshes");
    Ok((reopen()?, FACES_FOR_GPU))
}

/// The smallest mesh, in faces, that `gpu` clusters faster than the cpu; 2³¹ where it never does. Measured on flat
/// clusterings.
///
/// An error when the gpu fails, or gives other labels than the cpu: then it must not be used.
fn faces_for_gpu(gpu: &mut dyn Device, cancel: &Cancel) -> Result<u64> {
    let mut cpu = CpuDevice::new();
    let (mut on_gpu, mut on_cpu) = ([0.0; 2], [0.0; 2]);
    let started = Instant::now();
    for (at, &faces) in FACES.iter().enumerate() {
        let (_, prepared) = Work::flat(Mesh::Knot(faces), None, 100).prepare()?;
        let fastest = |device: &mut dyn Device| -> Result<(f64, Option<Vec<u32>>)> {
            let (mut fastest, mut labels) = (f64::INFINITY, None);
            for run in 0..=RUNS {
                let started = Instant::now();
                labels = job::run(&prepared, device, cancel, &mut |_| {})?.labels;
                if run > 0 {
                    fastest = fastest.min(milliseconds(started.elapsed()));
                }
            }
            Ok((fastest, labels))
        };
        let (of_gpu, of_cpu) = (fastest(gpu)?, fastest(&mut cpu)?);
        if of_gpu.1 != of_cpu.1 {
            let message = format_args!("the gpu {} gives other labels than the cpu", gpu.info().name);
            return Err(Error::unsuitable(message));
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
    use crate::device::{MergeSteps, Steps};
    use crate::report::DeviceInfo;
    use crate::surface::DualGraph;

    /// What goes wrong in a device that otherwise is the cpu.
    enum Trouble {
        None,
        Fails,
        Panics,
        /// Until the other end of the channel is dropped.
        Hangs(mpsc::Receiver<()>),
        /// Clusters another mesh: this one.
        WrongLabels(Option<DualGraph>),
    }

    struct Troubled(CpuDevice, Trouble);

    impl Device for Troubled {
        fn info(&self) -> &DeviceInfo {
            Device::<crate::energy::Energy>::info(&self.0)
        }

        fn open<'a>(&'a mut self, graph: &'a DualGraph, components: &'a [u32]) -> Result<Box<dyn Steps + 'a>> {
            let Self(cpu, trouble) = self;
            match trouble {
                Trouble::None => cpu.open(graph, components),
                Trouble::Fails => Err(Error::new(Kind::DeviceLost, "lost")),
                Trouble::Panics => panic!("a driver that panics"),
                Trouble::Hangs(end) => {
                    let _ = end.recv();
                    Err(Error::new(Kind::DeviceLost, "lost at last"))
                }
                Trouble::WrongLabels(other) => {
                    let other = other.insert(graph.clone());
                    other.weights.iter_mut().step_by(3).for_each(|weight| *weight = (*weight / 2).max(1));
                    cpu.open(other, components)
                }
            }
        }

        fn open_merging<'a>(
            &'a mut self,
            graph: &'a DualGraph,
            components: &'a [u32],
        ) -> Result<Box<dyn MergeSteps + 'a>> {
            self.0.open_merging(graph, components)
        }
    }

    /// Calibrates a troubled device: whether it was opened anew, and the smallest mesh for it.
    fn outcome(trouble: Trouble, patience: Duration) -> (bool, u64) {
        let mut is_opened_anew = false;
        let reopen = || {
            is_opened_anew = true;
            Ok(Box::new(CpuDevice::new()) as Box<dyn Device>)
        };
        let (_, faces) = calibrated(Box::new(Troubled(CpuDevice::new(), trouble)), patience, reopen).expect("a device");
        (is_opened_anew, faces)
    }

    #[test]
    fn a_gpu_that_works_is_measured_and_kept() {
        let (is_opened_anew, faces) = outcome(Trouble::None, Duration::from_secs(600));
        assert!(!is_opened_anew && faces <= NEVER, "{faces}");
    }

    #[test]
    fn a_gpu_that_cannot_be_measured_is_opened_anew_for_the_larger_meshes() {
        for trouble in [Trouble::Fails, Trouble::Panics] {
            assert_eq!(outcome(trouble, Duration::from_secs(600)), (true, FACES_FOR_GPU));
        }
        let (hold, end) = mpsc::channel();
        assert_eq!(outcome(Trouble::Hangs(end), Duration::from_millis(50)), (true, FACES_FOR_GPU));
        drop(hold);
    }

    #[test]
    fn a_gpu_with_other_labels_is_not_used() {
        assert_eq!(outcome(Trouble::WrongLabels(None), Duration::from_secs(600)), (false, NO_MESH));
    }

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
