//! Jobs in PostgreSQL: for several services at once, any of which answers for any job.
//!
//! Every change is a transaction, which returns when the server has it on the disk. Only the clock of the database
//! counts. A worker writes with the fence of its claim (`attempt`), and jobs are taken from it only when its leases are
//! over: nothing happens to running jobs because a service starts. The driver is `tokio-postgres` rather than `sqlx`:
//! it needs no macros that look at a database during the build, and brings half as many crates, TLS by rustls included.
//!
//! # Claims
//!
//! One claim at a time decides (`claim_2` in the tables), under an advisory lock, so that fairness is exact over all
//! services; a worker with several free places claims for all of them at once. Counters in a row for each tenant,
//! locked by every change, would make the changes of a tenant wait for the disk one after the other; so running and
//! waiting jobs are counted by index, and creations and ends of jobs wait for nothing. The lock is held for the
//! statement, not for the disk: the commit of the claim is asynchronous, and the worker waits for the disk by a change
//! of its own row before it gets the tickets. Both are in one log, so the second commit is on the disk only if the
//! first is.
//!
//! # Lost workers
//!
//! A worker whose leases are all over is lost, with all its jobs, and they are judged together, by the rules of the
//! [store](super) for jobs that ran during a crash. Suspects run alone on one worker; the others go on. A job whose
//! lease is over although its worker lives was given up by that worker.
//!
//! # When the answer to a commit is lost
//!
//! An end that was committed is recognised when it is repeated, and so are events, by their numbers. A claim that may
//! have been committed is given back before the next one. An upload stays until the sweep when the creation of its job
//! may have been committed.

mod address;
mod claim;
mod connections;
mod events;
mod hints;
mod live;
mod lost;
mod maintenance;
mod notices;
mod queue;
mod replica;
mod rows;
mod schema;
#[cfg(test)]
mod tests;
mod workers;

pub(in crate::service) use self::address::Address;
pub(in crate::service) use self::replica::PostgresStore;
