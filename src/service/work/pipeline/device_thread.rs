//! The one thread that uses the device: it clusters prepared meshes one after the other. A cpu device works in a thread
//! pool, for which this thread waits. Results are made of labels and energies beside the next mesh.
//!
//! Failures of the device are handled here. A device that was lost is opened anew before the next mesh. A device that
//! shows no sign of life is abandoned with its thread, and a new thread starts. If the service may use the cpu instead,
//! the cpu takes meshes that lost the device before, and all meshes while there is no device. Otherwise a device that
//! cannot be opened makes the service not ready, and no job begins until it can be opened. A device that computed
//! wrongly is opened anew, too, which tests it. The cpu runs that job again, also where it takes no part otherwise.
//!
//! A device that takes [several](Device::another) meshes at a time works on small ones beside the thread, and on a
//! [short](SmallMeshes::beside) one beside a long one. The others take [turns](Line).

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use rayon::ThreadPool;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::{Cancel, Device};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job::{self, Clustered, Outcome, Prepared, instead_of_gpu};
use tesserae_mesh::report::DeviceKind;
use tokio::sync::oneshot;

use super::bounds::{caught, pool, within};
use super::memory::Slot;
use super::rows::OnRow;
use super::small::{SMALL_FACES, SmallMeshes};
use super::turns::Line;
use crate::metrics::Metrics;
use crate::ops::blocking;
use crate::ops::faults::{FaultPoint, Faults};
use crate::ops::health::{Health, Part, Severity};

/// Opens the device of the service anew.
pub type Reopen = Arc<dyn Fn() -> Result<Box<dyn Device>> + Send + Sync>;

/// Time between two attempts to open a device that could not be opened.
const REOPEN: Duration = Duration::from_secs(10);

/// A mesh on its way through the device.
pub(super) struct Task {
    pub prepared: Arc<Prepared>,
    /// Requests a stop. Every look at it counts as a sign of life of the device's thread.
    pub cancel: Cancel,
    /// About how much work it is, in faces of a flat clustering, to tell short meshes from long ones; not 0.
    pub cost: u64,
    /// Whether an earlier attempt at this mesh failed, maybe with the device.
    pub is_retry: bool,
    /// Receives every row of the report.
    pub on_row: OnRow,
    /// Where the lines of the log belong.
    pub span: tracing::Span,
    /// Freed when the mesh is: other meshes wait for its place in memory.
    pub slot: Slot,
}

/// A mesh that the device is done with.
struct ClusteredMesh {
    prepared: Arc<Prepared>,
    clustered: Clustered,
    _slot: Slot,
}

impl Task {
    /// All rows of the job are delivered, and after a failure its place is free, when this returns.
    fn run(mut self, work: impl FnOnce(&mut Self) -> Result<Clustered>) -> Result<ClusteredMesh> {
        let span = self.span.clone();
        let clustered = span.in_scope(|| caught(|| work(&mut self)))?;
        Ok(ClusteredMesh { prepared: self.prepared, clustered, _slot: self.slot })
    }

    fn cluster(&mut self, device: &mut dyn Device, metrics: &Metrics) -> Result<Clustered> {
        let started = Instant::now();
        let clustered = job::cluster(&self.prepared, device, &self.cancel, &mut *self.on_row);
        metrics.families.device_busy.inc_by(started.elapsed().as_secs_f64());
        clustered
    }
}

impl ClusteredMesh {
    /// Makes results, and frees the mesh.
    fn finish(self, faults: &Faults) -> Result<Outcome> {
        faults.hit(FaultPoint::Finish).map_err(|error| Error::io("the results cannot be made", error))?;
        job::finish(&self.prepared, self.clustered)
    }
}

/// The way to the thread. It ends when this is dropped.
pub(crate) struct DeviceThread {
    context: Arc<Context>,
    /// For small meshes, which then need not wait for others.
    like: Mutex<Option<Box<dyn Device>>>,
    thread: Mutex<Thread>,
    line: Line,
    pub(super) small: SmallMeshes,
    /// Where short meshes go while the thread is at a long one; none where the device takes one mesh at a time.
    beside: Option<SmallMeshes>,
}

type Work = Box<dyn FnOnce(&mut Devices) + Send>;

#[derive(Clone)]
struct Thread {
    queue: mpsc::Sender<Work>,
    life: Arc<AtomicU64>,
}

pub(crate) struct Context {
    /// What opens another device after one was lost.
    pub reopen: Option<Reopen>,
    pub faults: Faults,
    /// The cpu takes meshes with fewer faces, and what the device cannot do or is slow at. None when it takes no part.
    pub cpu_below_faces: Option<u64>,
    /// Time without a sign of life after which a device counts as lost.
    pub timeout: Duration,
    pub health: Arc<Health>,
    pub metrics: Arc<Metrics>,
}

impl DeviceThread {
    pub fn start(device: Box<dyn Device>, context: Context) -> Result<Self> {
        let context = Arc::new(context);
        *context.metrics.memory_meter.lock() = Some(device.memory_meter());
        let takes_small = context.cpu_below_faces.is_some_and(|faces| faces > SMALL_FACES as u64);
        let cpu = || takes_small.then(|| Box::new(CpuDevice::new()) as Box<dyn Device>);
        let takes_several = device.info().kind == DeviceKind::Cpu && device.another().is_some();
        let beside = takes_several.then(SmallMeshes::beside);
        let like = Mutex::new(device.another().or_else(cpu));
        let thread = Mutex::new(Thread::start(Devices::new(Some(device), &context))?);
        Ok(Self { context, like, thread, line: Line::default(), small: SmallMeshes::new(), beside })
    }

    /// Clusters a mesh, after those that came before, or on one of the threads for small ones, and makes results of
    /// that beside the next. [`Kind::DeviceLost`] when the device was lost, or seems to be. [`Kind::TimeLimit`] when it
    /// takes longer than `limit`, not counting the time that it waits for others.
    pub(super) async fn run(&self, task: Task, limit: Option<Duration>) -> Result<Outcome> {
        let small = self.another().filter(|_| task.prepared.subject.items() <= SMALL_FACES);
        let (turn, beside) = match (small, &self.beside) {
            (Some(device), _) => (None, Some((device, &self.small))),
            (None, None) => (Some(self.line.turn(task.cost).await), None),
            (None, Some(beside)) => {
                (self.line.turn_unless_short(task.cost).await, self.another().map(|device| (device, beside)))
            }
        };
        let context = Arc::clone(&self.context);
        match (turn, beside) {
            (Some(turn), _) => {
                let work = async {
                    let done = self.on_thread(|devices| task.run(|task| devices.run(task))).await;
                    drop(turn);
                    let (done, span) = (done?, tracing::info_span!("finish"));
                    blocking(move || caught(|| span.in_scope(|| done.finish(&context.faults)))).await?
                };
                within(limit, work).await
            }
            (None, Some((mut device, threads))) => {
                let span = task.span.clone();
                let work = move || {
                    let done = task.run(|task| task.cluster(device.as_mut(), &context.metrics))?;
                    span.in_scope(|| done.finish(&context.faults))
                };
                threads.run(limit, work).await
            }
            (None, None) => Err(Error::internal("the device for short meshes is gone")),
        }
    }

    fn another(&self) -> Option<Box<dyn Device>> {
        self.like.lock().as_ref()?.another()
    }

    /// Completes once there is a device, or the cpu instead.
    pub(super) async fn is_there(&self) {
        while self.context.health.severity(Part::Device) == Some(Severity::Failing) {
            tokio::time::sleep(REOPEN).await;
            let _turn = self.line.turn(0).await;
            let _ = self.on_thread(|devices| devices.device().map(drop)).await;
        }
    }

    /// Runs `work` on the thread. [`Kind::DeviceLost`] when the device shows no sign of life meanwhile.
    async fn on_thread<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Devices) -> Result<T> + Send + 'static,
    ) -> Result<T> {
        let gone = || Error::internal("the thread of the device is gone");
        let (reply, outcome) = oneshot::channel();
        let Thread { queue, life } = self.thread.lock().clone();
        let work = async {
            // the receiver may be gone
            let work = move |devices: &mut Devices| drop(reply.send(work(devices)));
            queue.send(Box::new(work)).map_err(|_| gone())?;
            outcome.await.map_err(|_| gone())?
        };
        let timeout = self.context.timeout;
        tokio::select! {
            outcome = work => outcome,
            () = self.lifeless(&life) => {
                tracing::error!(?timeout, "the device shows no sign of life; its thread is abandoned");
                self.context.lost("it showed no sign of life");
                let thread = Thread::start(Devices::new(None, &self.context))?;
                *self.thread.lock() = thread;
                let why = format_args!("the device showed no sign of life for {timeout:?}");
                Err(Error::new(Kind::DeviceLost, why))
            }
        }
    }

    /// Completes when there was no sign of life for too long.
    async fn lifeless(&self, life: &AtomicU64) {
        let mut seen = None;
        loop {
            let looks = life.load(Ordering::Relaxed);
            if seen.replace(looks) == Some(looks) {
                return;
            }
            tokio::time::sleep(self.context.timeout).await;
        }
    }
}

impl Thread {
    fn start(mut devices: Devices) -> Result<Self> {
        // a sender has the turn, or has given up waiting: there are never many
        let (queue, tasks) = mpsc::channel::<Work>();
        let life = Arc::clone(&devices.life);
        std::thread::Builder::new()
            .name("device".to_owned())
            .spawn(move || tasks.iter().for_each(|task| task(&mut devices)))
            .map_err(|error| Error::io("the thread of the device cannot be started", error))?;
        Ok(Self { queue, life })
    }
}

impl Context {
    fn lost(&self, how: &str) {
        self.health.degrade(Part::Device, format!("the device was lost and is opened anew: {how}"));
    }
}

struct Devices {
    context: Arc<Context>,
    /// None after it was lost.
    device: Option<Box<dyn Device>>,
    /// For what the device cannot do.
    cpu: Option<CpuDevice>,
    /// Where the cpu clusters, if it does: apart from the pool in which other meshes are read, which would delay it.
    /// Started with the first mesh.
    workers: Option<Arc<ThreadPool>>,
    next_attempt: Option<Instant>,
    /// Counts signs of life of this thread only: not of small meshes beside it, nor of an abandoned thread.
    life: Arc<AtomicU64>,
}

impl Devices {
    fn new(device: Option<Box<dyn Device>>, context: &Arc<Context>) -> Self {
        let needs_cpu = device.as_ref().is_none_or(|device| device.info().kind == DeviceKind::Gpu);
        let cpu = (context.cpu_below_faces.is_some() && needs_cpu).then(CpuDevice::new);
        Self { context: Arc::clone(context), device, cpu, workers: None, next_attempt: None, life: Arc::default() }
    }

    fn run(&mut self, task: &mut Task) -> Result<Clustered> {
        task.cancel = task.cancel.counting(Arc::clone(&self.life));
        let items = task.prepared.subject.items() as u64;
        let is_few = self.context.cpu_below_faces.is_some_and(|faces| items < faces);
        let suits_cpu = task.prepared.wants_cpu() || task.is_retry || is_few;
        let metrics = Arc::clone(&self.context.metrics);
        let is_cpu = self.device.as_ref().is_some_and(|device| device.info().kind == DeviceKind::Cpu);
        if self.workers.is_none() && (is_cpu || self.cpu.is_some()) {
            self.workers = pool(0, "cluster");
        }
        let workers = self.workers.clone();
        let mut run = |device: &mut dyn Device| match &workers {
            Some(workers) if device.info().kind == DeviceKind::Cpu => {
                workers.install(|| task.cluster(device, &metrics))
            }
            _ => task.cluster(device, &metrics),
        };
        if let Some(cpu) = self.cpu.as_mut().filter(|_| suits_cpu) {
            let outcome = run(cpu);
            if is_few {
                // a device that was lost is opened though no mesh needs it now, for its part of the health
                let _ = self.device();
            }
            return outcome;
        }
        let outcome = match self.device() {
            Ok(device) => run(device.as_mut()),
            Err(error) => return self.cpu.as_mut().map_or(Err(error), |cpu| run(cpu)),
        };
        match (outcome, &mut self.cpu) {
            (Err(error), Some(cpu)) if error.kind == Kind::DeviceUnsuitable => {
                tracing::warn!(%error, "taking the cpu instead of the gpu");
                run(cpu).map(|clustered| clustered.with_warning(instead_of_gpu(&error.message)))
            }
            (Err(error), cpu) if error.kind == Kind::DeviceWrong => {
                tracing::error!(%error, "the cpu runs the job again");
                self.context.metrics.families.device_wrong.inc();
                self.context.lost(&error.message);
                self.device.take_if(|_| self.context.reopen.is_some());
                let outcome = run(cpu.get_or_insert_with(CpuDevice::new));
                outcome.map(|clustered| clustered.with_warning(instead_of_gpu(&error.message)))
            }
            (Err(error), _) if error.kind == Kind::DeviceLost => {
                // cancelled, too, when the thread was abandoned, whose failures say nothing about the next device
                if !task.cancel.is_cancelled() {
                    self.context.lost(&error.message);
                }
                self.device.take_if(|_| self.context.reopen.is_some());
                Err(error)
            }
            (outcome, _) => outcome.inspect(|_| self.context.health.clear(Part::Device)),
        }
    }

    /// The device, opened if it is not.
    fn device(&mut self) -> Result<&mut Box<dyn Device>> {
        let device = self.device.take().map_or_else(|| self.open(), Ok)?;
        Ok(self.device.insert(device))
    }

    fn open(&mut self) -> Result<Box<dyn Device>> {
        let refuse = |why: &str| Error::new(Kind::DeviceLost, format_args!("the device cannot be opened again: {why}"));
        let error = match &self.context.reopen {
            // not at every mesh: looking for a device takes its time
            _ if self.next_attempt.is_some_and(|next| Instant::now() < next) => {
                return Err(refuse("it could not be a moment ago"));
            }
            Some(reopen) => match caught(|| reopen()) {
                Ok(device) => {
                    tracing::info!(device = device.info().name, "the device was opened anew");
                    *self.context.metrics.memory_meter.lock() = Some(device.memory_meter());
                    self.next_attempt = None;
                    self.context.health.clear(Part::Device);
                    return Ok(device);
                }
                Err(error) => refuse(&error.message),
            },
            None => refuse("there is no way to"),
        };
        self.next_attempt = Some(Instant::now() + REOPEN / 2);
        match self.cpu {
            Some(_) => self.context.health.degrade(Part::Device, format!("the cpu stands in: {error}")),
            None => self.context.health.fail(Part::Device, error.message.clone()),
        }
        Err(error)
    }
}
