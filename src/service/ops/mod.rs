//! Health, traces, named faults, and small parts that many rooms use.

pub mod blocking;
pub mod faults;
pub mod health;
pub mod private;
pub mod timestamp;
pub mod trace;
