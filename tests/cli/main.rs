//! The program from outside: commands, their messages and files, and the service as a process.

#[allow(dead_code, reason = "every test binary uses its own part")]
#[path = "../common/command.rs"]
mod command;

mod bench;
mod cluster;
mod crash_loop;
mod evaluate;
mod export;
mod help;
mod hierarchy;
mod messages;
mod names;
mod other;
mod outputs;
mod points;
mod running;
mod serve;
mod shapes;
mod streams;
