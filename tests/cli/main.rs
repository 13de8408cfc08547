//! The program from outside: commands, their messages and files, and the service as a process.

#[path = "../common/mod.rs"]
mod common;

mod bench;
mod cluster;
mod crash_loop;
mod evaluate;
mod export;
mod help;
mod hierarchy;
mod messages;
mod other;
mod outputs;
mod serve;
mod streams;
