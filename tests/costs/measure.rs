//! Processor time of inputs of two sizes, and what it may be.

use std::hint::black_box;
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::Duration;

use rustix::time::{ClockId, Timespec, clock_gettime};

/// Sizes of the inputs that are compared, in bytes.
pub const SIZES: [usize; 2] = [64 << 10, 1 << 20];

/// How many times as long the larger input, of 16 times the bytes, may take.
const MOST_TIMES: u32 = 24;

/// Time that is too short to be compared.
const FLOOR: Duration = Duration::from_millis(1);

/// Times that the smaller input is measured for one of the larger. The shortest counts: other work only adds.
const SMALLER_TIMES: usize = 3;

/// Processor time after which an input at fault is not measured again.
const ENOUGH: Duration = Duration::from_secs(6);

/// What an input may take, in code with the optimisation of the debug binary.
#[derive(Debug, Clone, Copy)]
pub struct Bound {
    pub for_each_mib: Duration,
}

/// What every input may take: about twice what the slowest takes on a slow machine.
pub const BOUND: Bound = Bound { for_each_mib: Duration::from_millis(200) };

/// Processor time of two inputs.
#[derive(Debug, Clone, Copy)]
pub struct Cost {
    pub times: [Duration; 2],
    pub bytes: [usize; 2],
}

impl Cost {
    /// What `measured` takes for inputs of two sizes, measured in turns.
    pub fn of(
        sizes: [usize; 2],
        bound: Bound,
        make: impl Fn(usize) -> Vec<u8>,
        measured: impl Fn(&[u8]) -> Duration,
    ) -> Self {
        let inputs = sizes.map(make);
        let mut cost = Self { times: [Duration::MAX; 2], bytes: inputs.each_ref().map(Vec::len) };
        keep_memory();
        let mut spent = Duration::ZERO;
        loop {
            // the larger one, which takes most of the time, once if that is short enough
            for (input, times) in [(0, SMALLER_TIMES), (1, 1)] {
                for _ in 0..times {
                    let time = measured(&inputs[input]);
                    cost.times[input] = time.min(cost.times[input]);
                    spent += time;
                }
            }
            if spent >= ENOUGH || cost.fault(bound).is_none() {
                break;
            }
        }
        cost
    }

    /// What is wrong with it.
    pub fn fault(&self, bound: Bound) -> Option<String> {
        let [small, large] = self.times;
        let most = small.max(FLOOR) * MOST_TIMES;
        if large > most {
            return Some(format!("not linear: {small:?}, then {large:?} for 16 times the bytes"));
        }
        let mebibytes = self.bytes[1] as f64 / f64::from(1 << 20);
        let most = bound.for_each_mib.mul_f64(mebibytes) + FLOOR;
        (large > most).then(|| format!("{large:?}, more than {most:?} for {mebibytes:.2} MiB"))
    }
}

/// Lets glibc keep freed blocks of up to 32 MiB, as the service does: it takes the largest block that was freed for its
/// threshold. Otherwise the kernel clears pages for large inputs only, which is up to a quarter of their time.
fn keep_memory() {
    drop(black_box(Vec::<u8>::with_capacity(31 << 20)));
}

static PROCESS: RwLock<()> = RwLock::new(());

/// Keeps tests away that measure the time of the process.
pub fn with_others() -> RwLockReadGuard<'static, ()> {
    PROCESS.read().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps all other tests of this process away.
pub fn alone() -> RwLockWriteGuard<'static, ()> {
    PROCESS.write().unwrap_or_else(PoisonError::into_inner)
}

/// Processor time of this thread while it does something.
pub fn of_thread(work: impl FnOnce()) -> Duration {
    elapsed(ClockId::ThreadCPUTime, work)
}

/// Processor time of this process while it does something.
pub fn of_process(work: impl FnOnce()) -> Duration {
    elapsed(ClockId::ProcessCPUTime, work)
}

fn elapsed(clock: ClockId, work: impl FnOnce()) -> Duration {
    let now = || {
        let Timespec { tv_sec, tv_nsec } = clock_gettime(clock);
        Duration::new(tv_sec as u64, tv_nsec as u32)
    };
    let before = now();
    work();
    now().saturating_sub(before)
}

/// The faults of all costs, as one message.
#[track_caller]
pub fn check(costs: impl IntoIterator<Item = (String, Cost)>, bound: Bound) {
    let mut faults = Vec::new();
    for (name, cost) in costs {
        if std::env::var_os("SHOW_COSTS").is_some() {
            println!("{name:60} {:>12.3?} {:>12.3?}", cost.times[0], cost.times[1]);
        }
        faults.extend(cost.fault(bound).map(|fault| format!("{name}: {fault}")));
    }
    assert!(faults.is_empty(), "costs out of proportion:\n{}", faults.join("\n"));
}

#[test]
fn a_quadratic_function_and_a_slow_one_are_found() {
    let quadratic = |input: &[u8]| {
        of_thread(|| {
            let words: Vec<&[u8]> = input.chunks(64).collect();
            let twice = words.iter().enumerate().filter(|(at, word)| words[..*at].contains(word)).count();
            assert_eq!(black_box(twice), 0);
        })
    };
    let words = |bytes: usize| (0..bytes / 64).flat_map(|word| format!("{word:064}").into_bytes()).collect::<Vec<_>>();
    let cost = Cost::of(SIZES, BOUND, words, quadratic);
    assert!(cost.fault(BOUND).is_some_and(|fault| fault.starts_with("not linear")), "{cost:?}");

    let linear = |input: &[u8]| of_thread(|| assert!(black_box(input.iter().all(|&byte| byte < 128))));
    let cost = Cost::of(SIZES, BOUND, words, linear);
    assert_eq!(cost.fault(BOUND), None, "{cost:?}");
    let nothing = Bound { for_each_mib: Duration::ZERO };
    let slow = Cost { times: [Duration::from_millis(1), Duration::from_millis(16)], bytes: SIZES };
    assert!(slow.fault(nothing).is_some_and(|fault| fault.contains("more than")), "{cost:?}");
}
