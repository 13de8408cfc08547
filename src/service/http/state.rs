//! What handlers share.

use std::sync::Arc;

use axum::extract::{FromRequestParts, Path, State};
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use tesserae_mesh::device::select::AdapterReport;
use tesserae_mesh::error::{Error, Result};
use tesserae_mesh::report::DeviceInfo;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use utoipa::ToSchema;

use crate::files::Files;
use crate::files::storage::Storage;
use crate::guard::access::tokens::Tenant;
use crate::guard::access::{Access, Caller};
use crate::guard::problem::Failure;
use crate::guard::traffic::Traffic;
use crate::metrics::Metrics;
use crate::ops::health::Health;
use crate::settings::Settings;
use crate::store::live::Live;
use crate::store::{Job, JobId, LOCAL_TENANT, Store, no_such_job};
use crate::work::pipeline::Memory;
use crate::work::webhooks::Webhooks;

/// The device of this process and why it is that one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct DeviceDescription {
    /// What it is.
    #[serde(flatten)]
    pub info: DeviceInfo,
    /// How it was chosen, for people.
    #[schema(example = "auto: there is no GPU")]
    pub chosen: String,
    /// Meshes with fewer faces are clustered by the processor, as is what the device cannot do or is slow at; null when
    /// the device was chosen by name, and the processor takes no part.
    #[schema(example = 200_000)]
    pub cpu_below_faces: Option<u64>,
    /// The graphics adapters that were looked at for it, usable or not; none when the device was chosen to be the
    /// processor.
    pub adapters: Vec<AdapterReport>,
}

pub(crate) struct Shared {
    pub settings: Settings,
    pub store: Arc<Store>,
    pub files: Arc<Files>,
    pub storage: Arc<Storage>,
    pub device: DeviceDescription,
    pub health: Arc<Health>,
    pub live: Arc<Live>,
    /// Cancelled once the service is to stop.
    pub stop: CancellationToken,
    /// Large results that may be in memory at a time.
    pub encoding: Arc<Semaphore>,
    pub memory: Memory,
    pub access: Arc<Access>,
    pub traffic: Arc<Traffic>,
    pub metrics: Arc<Metrics>,
    pub webhooks: Arc<Webhooks>,
}

pub(crate) type App = State<Arc<Shared>>;

impl Shared {
    /// The job of this id, if it is the caller's. Handlers have no other way from an id to a job.
    pub async fn job(&self, caller: &Caller, id: &str) -> Result<Job> {
        let id: JobId = id.parse()?;
        self.store.get(id).await?.filter(|job| job.spec.tenant == caller.0.name).ok_or_else(|| no_such_job(id))
    }

    /// Jobs of a tenant that may wait; none without tokens, where the limit of the whole queue is enough.
    pub fn most_waiting(&self, tenant: &Tenant) -> Option<u64> {
        let most = self.settings.traffic.max_queued_jobs_per_tenant;
        tenant.quotas.max_queued_jobs.or((tenant.name != LOCAL_TENANT).then_some(most))
    }

    pub fn refuse_when_stopping(&self) -> Result<()> {
        match self.stop.is_cancelled() {
            true => Err(Error::unavailable("the service is stopping")),
            false => Ok(()),
        }
    }
}

/// The job that the path names.
pub(crate) struct Found {
    pub shared: Arc<Shared>,
    pub job: Job,
}

impl FromRequestParts<Arc<Shared>> for Found {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, shared: &Arc<Shared>) -> Result<Self, Response> {
        let (caller, Path(id)) = <(Caller, Path<String>)>::from_request_parts(parts, shared).await?;
        let job = shared.job(&caller, &id).await.map_err(|error| Failure::from(error).into_response())?;
        Ok(Self { shared: Arc::clone(shared), job })
    }
}
