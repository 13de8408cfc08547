//! The HTTP service: jobs in, labels and live energies out.
//!
//! ```text
//! POST ─ upload ─→ folder + Spec ─ store ─→ queue ─ pipeline ─→ result folder ─ results ─→ GET
//!                                   └── events, pulses ─→ events (SSE), Prefer: wait
//! ```
//!
//! A room imports only rooms below it in this table; `tests/architecture` checks that.
//!
//! | room | what is there |
//! |---|---|
//! | `server`, `backup` | start and stop; a copy of everything |
//! | [`http`] | routes, layers and the access log, handlers (`api`), results, the OpenAPI document, the page |
//! | [`work`] | what happens to a claimed job (`pipeline`), webhooks |
//! | [`ingest`] | how bodies and parameters come in, repeated requests |
//! | [`guard`] | tokens and tenants, limits of traffic, what errors look like |
//! | [`metrics`] | what is counted and timed |
//! | [`settings`] | settings and constants, and the log's |
//! | [`files`] | files of jobs, how long they are kept, what happens when the disk fails |
//! | [`store`] | how jobs and events are kept, in SQLite or PostgreSQL |
//! | [`blobs`] | where files lie: a folder or a bucket |
//! | [`queue`] | which job is next, what follows from what: rules without I/O |
//! | [`ops`] | health, traces, faults for tests, and small parts that many rooms use |
//!
//! | to add | touch |
//! |---|---|
//! | a route | a function in `http/api`, a line in `http/api/mod.rs` |
//! | a setting | its group in `settings`, and what reads it |
//! | a parameter of jobs | the engine's `parameters`; `ingest/request.rs` takes all of them |
//! | a database | a folder in `store/database`, which passes `store/conformance` |
//!
//! Handlers return errors of the crate; one layer makes problem documents of them. Nothing here blocks the runtime:
//! meshes are read and results written on blocking threads, clustering has a thread of its own, and `block_in_place` is
//! around the store's opening and short reads. No path is made of a name that a client gave.

#[cfg(not(unix))]
compile_error!("the service runs on Unix; elsewhere, build the command without it");

mod backup;
mod blobs;
mod files;
#[cfg(any(fuzzing, test))]
pub mod fuzzing;
mod guard;
mod http;
mod ingest;
mod metrics;
mod ops;
mod queue;
mod server;
mod settings;
mod store;
mod work;

pub use backup::{Backup, back_up};
pub use blobs::place::BlobPlace;
pub use guard::access::tokens::{Quotas, TenantEntry, Token, TokenEntry, TokenFile};
pub use http::openapi::openapi_yaml;
pub use http::state::DeviceDescription;
pub use ops::faults::{FaultPoint, Faults};
pub use server::{Extras, Server};
pub use settings::logging::{LogFormat, LogSettings};
pub use settings::{
    AccessSettings, Settings, StorageSettings, Switch, TrafficConstants, TrafficSettings, WebhookHost, WebhookSettings,
    WorkSettings,
};
pub use store::StoreUrl;
pub use work::pipeline::device_thread::Reopen;
