//! The HTTP service: jobs in, labels and live energies out.
//!
//! ```text
//! POST ─ upload ─→ folder + Spec ─ store ─→ queue ─ pipeline ─→ result folder ─ results ─→ GET
//!                                   └── events, pulses ─→ events (SSE), Prefer: wait
//! ```
//!
//! | to change | look in |
//! |---|---|
//! | a setting | [`settings`](Settings) |
//! | what a request may ask for | `request`, `query` |
//! | how bodies come in | `upload`, `intake` |
//! | what happens to a job | `pipeline` |
//! | which job is next, what follows from what | `queue` |
//! | how jobs are kept | `store`, and their files in `files`; `job_blobs` knows which are where |
//! | where files lie: a folder or a bucket | `blobs` |
//! | what a job keeps of its mesh | `kept`, `kept_mesh` |
//! | how long they are kept | `retention`, `deletion` |
//! | what happens when the disk fails | `storage` |
//! | backups | `backup` |
//! | repeated requests | `idempotency` |
//! | a resource | `api`, one handler a file; what they share in `state` |
//! | what results look like | `results`, `negotiate` |
//! | what errors look like | `problem` |
//! | what `/readyz` knows | `health` |
//! | the list of workers | `presence` |
//! | tokens and tenants | `access` |
//! | limits of traffic and of the queue | `traffic`, `admission` |
//! | which web pages reach a service without tokens | `traffic::sites` |
//! | metrics | `metrics`, `lag` |
//! | what is logged about requests | `access_log`, `audit` |
//! | which trace a request belongs to | `trace` |
//! | webhooks | `webhooks` |
//! | ETag, Range | `conditional` |
//! | the page at `/` | `page`; its sources are in `web/` |
//! | routes and layers | `router` |
//! | start and stop | `server` |
//!
//! Handlers return errors of the crate; one layer makes problem documents of them. Nothing here blocks the runtime:
//! meshes are read and results written on blocking threads, clustering has a thread of its own, and `block_in_place` is
//! around the store's short reads. No path is made of a name that a client gave.

mod access;
mod access_log;
mod admission;
mod api;
mod audit;
mod backup;
mod blobs;
mod blocking;
mod budget;
mod conditional;
mod deletion;
mod faults;
mod files;
#[cfg(fuzzing)]
pub mod fuzzing;
mod health;
mod idempotency;
mod intake;
mod job_blobs;
mod kept;
mod kept_mesh;
mod lag;
mod live;
mod logging;
mod metrics;
mod negotiate;
mod openapi;
mod page;
mod pipeline;
mod prefer;
mod preflight;
mod presence;
mod private;
mod problem;
mod query;
mod queue;
mod request;
mod results;
mod retention;
mod router;
mod server;
mod settings;
mod state;
mod storage;
mod store;
mod timestamp;
mod tls;
mod trace;
mod traffic;
mod upload;
mod urls;
mod webhooks;
mod yaml;

pub use access::tokens::{Quotas, TenantEntry, Token, TokenEntry, TokenFile};
pub use backup::{Backup, back_up};
pub use blobs::place::BlobPlace;
pub use faults::{FaultPoint, Faults};
pub use logging::{LogFormat, LogSettings};
pub use openapi::openapi_yaml;
pub use pipeline::device_thread::Reopen;
pub use preflight::preflight;
pub use server::{Extras, Server, serve};
pub use settings::heading;
pub use settings::{
    AccessSettings, Settings, StorageSettings, Switch, TrafficConstants, TrafficSettings, WebhookSettings, WorkSettings,
};
pub use state::DeviceDescription;
use store::LOCAL_TENANT;
pub use store::StoreUrl;
pub use traffic::origin::Network;
pub use webhooks::WebhookHost;
