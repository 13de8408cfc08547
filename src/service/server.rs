//! Start and stop.

use std::fmt;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant, SystemTime};

use axum::Router;
use tesserae_mesh::device::Device;
use tesserae_mesh::error::{Error, Result};
use tokio::net::{TcpListener, TcpSocket};
use tokio::sync::{Notify, Semaphore};
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::files::Files;
use crate::files::retention::Retention;
use crate::files::storage::Storage;
use crate::guard::access::Access;
use crate::guard::traffic::{Traffic, connections};
use crate::http::router::{router, routes};
use crate::http::state::{DeviceDescription, Shared};
use crate::metrics::Metrics;
use crate::ops::blocking;
use crate::ops::faults::Faults;
use crate::ops::health::{Health, Part};
use crate::settings::{Settings, Switch};
use crate::store::live::Live;
use crate::store::{Rules, Store};
use crate::work::pipeline::device_thread::{self, DeviceThread, Reopen};
use crate::work::pipeline::{Memory, Pipeline, worker_name};
use crate::work::webhooks::{Teller, Webhooks};

/// Time for what is left to do after the grace period: ending jobs that were told to stop, sending last answers.
const LAST_MOMENT: Duration = Duration::from_secs(2);

/// What a service can do without.
#[derive(Default)]
pub struct Extras {
    /// Opens the device anew after it was lost.
    pub reopen: Option<Reopen>,
    /// Ends the drain delay when it is notified during it.
    pub end_drain_delay: Option<Arc<Notify>>,
    /// Time after which a job fails that cannot read or write its files; ten minutes when none.
    pub patience: Option<Duration>,
    /// Failures on purpose.
    pub faults: Faults,
}

/// A service that has its address, its folder and its device, and does not answer yet.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    shared: Arc<Shared>,
    router: Router,
    pipeline: Pipeline,
    end_drain_delay: Arc<Notify>,
}

impl fmt::Debug for Server {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Server").field("address", &self.address).finish_non_exhaustive()
    }
}

impl Server {
    /// Takes the address and the data folder, and what is there. Needs a tokio runtime with its timers and network on.
    pub async fn bind(
        settings: Settings,
        device: Box<dyn Device>,
        description: DeviceDescription,
        extras: Extras,
    ) -> Result<Self> {
        settings.check()?;
        // an error says that it was chosen before
        let _ = rustls::crypto::ring::default_provider().install_default();
        let cannot = |error| Error::io(format_args!("cannot listen on {}", settings.listen), error);
        let listener = listen(settings.listen).map_err(cannot)?;
        let address = listener.local_addr().map_err(cannot)?;
        let access = Arc::new(Access::open(&settings.access).await?);
        // routes are made on another thread, while this one opens the store
        let (routes, places) = tokio::join!(blocking(routes), open_places(&settings, &extras.faults));
        let (routes, (files, mut store)) = (routes?, places?);
        let metrics = Arc::new(Metrics::new(&description.info, &settings));
        let observer = Arc::clone(&metrics);
        store.observe(move |operation, elapsed, failed| observer.stored(operation, elapsed, failed));
        let store = Arc::new(store);
        // a place that is shared is swept by the one service that cleans up, and a temporary one is empty
        if store.is_durable() && !files.is_shared() {
            let (swept, unknown) = (files.sweep(store.as_ref(), None).await?, files.unknown.load(Ordering::Relaxed));
            if swept + unknown as usize > 0 {
                let why = "files that belong to no job were removed; those of jobs that the store does not know stay";
                tracing::info!(swept, unknown, "{why}");
            }
        }
        let health = Arc::<Health>::default();
        let storage = Arc::new(Storage::new(Arc::clone(&files), Arc::clone(&store), Arc::clone(&health)));
        storage.look_at_room().await;
        let live = Arc::<Live>::default();
        let context = device_thread::Context {
            reopen: extras.reopen,
            faults: extras.faults.clone(),
            cpu_below_faces: description.cpu_below_faces,
            timeout: settings.work.device_timeout,
            health: Arc::clone(&health),
            metrics: Arc::clone(&metrics),
        };
        let pipeline = Pipeline {
            tokens: access.tokens.subscribe(),
            worker: worker_name().into(),
            device_name: description.info.name.clone(),
            store: Arc::clone(&store),
            files: Arc::clone(&files),
            storage: Arc::clone(&storage),
            device: DeviceThread::start(device, context)?,
            metrics: Arc::clone(&metrics),
            live: Arc::clone(&live),
            limits: settings.limits(),
            slots: Arc::new(Semaphore::new(settings.meshes_in_memory)),
            newcomer: Arc::new(Semaphore::new(1)),
            memory: Memory::new(settings.work.memory_budget),
            leases: Arc::default(),
            time: Some(Duration::from_secs(settings.work.max_job_seconds)).filter(|time| !time.is_zero()),
            patience: extras.patience.unwrap_or(Duration::from_secs(600)),
        };
        let shared = Arc::new(Shared {
            store,
            files,
            storage,
            device: description,
            health,
            live,
            stop: CancellationToken::new(),
            // hierarchies and other large results that are in memory at a time, to be cut or written
            encoding: Arc::new(Semaphore::new(2)),
            memory: pipeline.memory.clone(),
            traffic: Arc::new(Traffic::new(&settings, Arc::clone(&access), extras.faults.clone())),
            access,
            webhooks: Arc::new(Webhooks::new(&settings.webhooks)?),
            metrics,
            settings,
        });
        let router = router(Arc::clone(&shared), routes);
        let end_drain_delay = extras.end_drain_delay.unwrap_or_default();
        Ok(Self { listener, address, shared, router, pipeline, end_drain_delay })
    }

    /// The address it listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Answers until `shutdown` completes; then `/readyz` fails, and after the drain delay no more jobs are taken or
    /// begun, streams end, running jobs get the grace period to finish and are released after it, and the last answers
    /// are sent: a few seconds after the grace period at most. Work on a mesh that is not done when this returns stays
    /// behind on a blocking thread: leave the runtime with `shutdown_background` rather than waiting for it.
    pub async fn run(self, shutdown: impl Future<Output = ()>) -> Result<()> {
        let Self { listener, address, shared, router, pipeline, end_drain_delay } = self;
        let stop = shared.stop.clone();
        let (abort, close) = (CancellationToken::new(), CancellationToken::new());
        let kept = shared.settings.storage.retention();
        let now = (SystemTime::now(), Instant::now());
        let retention = Retention::new(&shared.files, &shared.store, kept, now).await?;
        let mut work = match shared.settings.work.work {
            Switch::On => tokio::spawn(pipeline.run(stop.clone(), abort.clone())),
            Switch::Off => tokio::spawn(stop.clone().cancelled_owned()),
        };
        let tasks = TaskTracker::new();
        tasks.spawn(Arc::clone(&shared.storage).watch(close.clone()));
        tasks.spawn(retention.run(stop.clone()));
        let (traffic, metrics) = (shared.settings.traffic.clone(), Arc::clone(&shared.metrics));
        let _close = close.clone().drop_guard();
        let mut serving = connections::serve(listener, router, traffic, metrics, close.clone())
            .map_err(|error| Error::io("connections cannot be accepted", error))?;
        tasks.spawn(Arc::clone(&shared.metrics).watch_lag(close.clone()));
        let (followed, until) = (Arc::clone(&shared), stop.clone());
        tasks.spawn(async move { followed.access.follow(&followed.health, until).await });
        let (store, webhooks) = (Arc::clone(&shared.store), Arc::clone(&shared.webhooks));
        tasks.spawn(Teller { store, webhooks, metrics: Arc::clone(&shared.metrics) }.run(stop.clone()));
        tracing::info!(%address, device = shared.device.info.name, "listening on http://{address}");

        tokio::select! {
            () = shutdown => {}
            // without having been told to, it ends only by a defect
            ended = &mut serving => tracing::error!(?ended, "the service does not listen any more"),
        }
        tracing::info!("stopping");
        shared.health.fail(Part::Process, "the service is stopping");
        // jobs are still taken while load balancers notice
        let delay = Duration::from_secs(shared.settings.drain_delay);
        if !delay.is_zero() && !serving.is_terminated() {
            tokio::select! {
                () = sleep(delay) => {}
                () = end_drain_delay.notified() => tracing::info!("asked to stop again: the drain delay ends"),
            }
        }
        stop.cancel();
        if timeout(Duration::from_secs(shared.settings.grace_period), &mut work).await.is_err() {
            tracing::warn!("the grace period is over: running jobs are broken off");
            abort.cancel();
            let _ = timeout(LAST_MOMENT, work).await;
        }
        close.cancel();
        if !serving.is_terminated() {
            let _ = timeout(LAST_MOMENT, serving).await;
        }
        tasks.close();
        let _ = timeout(LAST_MOMENT, tasks.wait()).await;
        // work that still runs can no longer change the store or the files
        let _ = timeout(LAST_MOMENT, shared.store.close()).await;
        shared.files.close().await;
        tracing::info!("stopped");
        Ok(())
    }
}

/// The place of files, and the store that it belongs to.
async fn open_places(settings: &Settings, faults: &Faults) -> Result<(Arc<Files>, Store)> {
    let (place, reserve) = (settings.storage.blobs.as_ref(), settings.storage.min_free_bytes);
    let mut files = Files::open(settings.data_dir.as_deref(), place, reserve, faults.clone())?;
    files.allow_references(&settings.storage.mesh_prefixes)?;
    let store = open_store(settings, &files, faults.clone()).await?;
    let check = async {
        files.probe_elsewhere().await?;
        if !store.is_shared() && store.is_durable() && !store.was_used().await? {
            files.check_unused_store().await?;
        }
        if store.is_durable() {
            files.take_place(&store.name().await?, store.newest().await?.is_some()).await?;
        }
        Ok(())
    };
    if let Err(refusal) = check.await {
        // another process may open the file at once
        store.close().await;
        return Err(refusal);
    }
    Ok((Arc::new(files), store))
}

async fn open_store(settings: &Settings, files: &Files, faults: Faults) -> Result<Store> {
    let rules = Rules {
        max_queued: settings.max_queued_jobs,
        max_attempts: settings.work.max_attempts,
        crash_pause: Duration::from_secs(settings.work.crash_pause),
    };
    #[cfg(feature = "postgres")]
    if let Some(url) = &settings.storage.store {
        // eight connections: ten services leave room below PostgreSQL's default of 100
        return Store::shared(url, 8, rules).await;
    }
    let is_temporary = settings.data_dir.is_none();
    if !is_temporary {
        files.check_store()?;
    }
    Store::open(&files.database(), is_temporary, rules, faults).await
}

fn listen(address: SocketAddr) -> std::io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    // a restarted service takes its address again at once
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    // connections that wait to be accepted: those of a second's rush; the system may have a lower limit
    socket.listen(1024)
}
