//! The constants of the gpu device, and of its choice, that decide how long a job takes and no result, so that one
//! binary can try them all (`make gpu-check`).

use crate::error::{Error, Result};

macro_rules! tuning {
    ($($(#[$doc:meta])* $name:ident = $value:literal, $range:expr;)*) => {
        /// The constants; `docs/gpu.md` says which of them a card has decided.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub struct Tuning { $($(#[$doc])* pub $name: u32,)* }

        impl Default for Tuning {
            fn default() -> Self {
                Self::DEFAULT
            }
        }

        impl Tuning {
            /// What is in use.
            pub const DEFAULT: Self = Self { $($name: $value,)* };

            /// Name and value of each.
            pub fn list(&self) -> impl Iterator<Item = (&'static str, u32)> {
                [$((stringify!($name), self.$name)),*].into_iter()
            }

            /// Sets the constant of that name.
            fn set(&mut self, name: &str, value: u32) -> Result<()> {
                match name {
                    $(stringify!($name) => {
                        if !$range.contains(&value) {
                            return Err(Error::parameter(format_args!("{name} must be in {:?}: {value}", $range)));
                        }
                        self.$name = value;
                    })*
                    _ => {
                        let names = [$(stringify!($name)),*].join(", ");
                        return Err(Error::parameter(format_args!("constants are {names}: {name:?}")));
                    }
                }
                Ok(())
            }
        }
    };
}

tuning! {
    /// Threads in a workgroup of every kernel that has one thread an item: a power of two.
    workgroup = 256, (32..=1024);
    /// Faces that one thread takes in kernels with `Threads::FaceRuns`.
    run = 8, (1..=64);
    /// Iterations in the first batch of a phase.
    first_batch = 12, (1..=64);
    /// Iterations in a further batch, at least.
    least_batch = 4, (1..=64);
    /// The same, at most.
    largest_batch = 32, (1..=64);
    /// Milliseconds that a batch should not exceed: a job that is cancelled ends with the batch.
    batch_ms = 200, (1..=1_000_000);
    /// Passes of the growth after a repair, and iterations of the phases after that, in the first batch.
    batch_after_repair = 2, (1..=64);
    /// The boundary list is made anew, before the next batch, when one face in so many was added.
    compact_part = 16, (1..=1_000_000);
    /// Movers and clusters up to which an iteration takes them in one workgroup: one dispatch instead of two or four.
    chain_items = 2048, (0..=1_000_000_000);
    /// Faces of a coarse graph up to which it is clustered on the cpu; four times as many beside a software gpu. On a
    /// gpu a start takes some 200 dispatches and 14 waits, whatever the graph.
    start_on_cpu = 16_384, (0..=u32::MAX / 4);
    /// Faces up to which a gpu makes the merges of a hierarchy that come before the first phase: for them it has a
    /// cluster a face, and 240 bytes for each. Beyond, the cpu makes them.
    merges_up_to = 4_194_304, (0..=u32::MAX);
    /// Clusters up to which their sums come with their best dual edges: 36 bytes each, instead of a wait for those
    /// that merge.
    sums_along = 16_384, (0..=1_000_000_000);
    /// Faces up to which the labels come with the search for pieces at the end of a run, instead of a wait: 4 bytes
    /// each, in vain where pieces are cut off.
    labels_along = 262_144, (0..=1_000_000_000);
    /// Faces times clusters up to which a software gpu merges one pair at a time. Each merge searches all listed faces,
    /// in dispatches that have a fixed cost.
    software_limit = 16_777_216, (0..=u32::MAX);
    /// Faces from which on a gpu clusters where the program chooses the device: looking for one costs 20 to 370 ms.
    /// About where one thread of the cpu device needs that long.
    faces_for_gpu = 200_000, (0..=u32::MAX);
}

impl std::str::FromStr for Tuning {
    type Err = Error;

    /// From `name=value,…`; what is not named keeps its default.
    fn from_str(text: &str) -> Result<Self> {
        let mut tuning = Self::default();
        for part in text.split(',').filter(|part| !part.is_empty()) {
            let apart = part.split_once('=').and_then(|(name, value)| Some((name, value.parse().ok()?)));
            let (name, value) =
                apart.ok_or_else(|| Error::parameter(format_args!("constants are name=value,…: {part:?}")))?;
            tuning.set(name, value)?;
        }
        if !tuning.workgroup.is_power_of_two() {
            return Err(Error::parameter(format_args!("workgroup must be a power of two: {}", tuning.workgroup)));
        }
        if tuning.least_batch > tuning.largest_batch {
            let least = tuning.least_batch;
            return Err(Error::parameter(format_args!("least_batch must not be above largest_batch: {least}")));
        }
        Ok(tuning)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_are_set_by_name_and_refused_outside_their_range() {
        let tuning: Tuning = "workgroup=64,run=4".parse().expect("two of them");
        assert_eq!(tuning, Tuning { workgroup: 64, run: 4, ..Tuning::default() });
        assert_eq!("".parse(), Ok(Tuning::default()));
        for wrong in
            ["workgroup=48", "workgroup=16", "run=0", "run", "run=x", "size=3", "least_batch=64,largest_batch=63"]
        {
            assert!(wrong.parse::<Tuning>().is_err(), "{wrong}");
        }
        assert_eq!(tuning.list().find(|(name, _)| *name == "run"), Some(("run", 4)));
    }
}
