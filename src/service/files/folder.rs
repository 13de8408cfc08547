//! The folder of the files: opened, promised to jobs, watched and emptied.

use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use object_store::path::Path as BlobPath;

use super::ballast::Ballast;
use super::disk::{self, Disk, DiskLimits};
use super::failure::{CANNOT_REACH, cannot_make, storage_error};
use super::names::{Folder, RESULTS, UPLOADS};
use super::needs;
use super::references::References;
use super::room::{self, Room};
use super::root::{self, Root};
use crate::error::{Error, Kind, Result};
use crate::mesh::Limits;
use crate::service::blobs::Blobs;
use crate::service::blobs::folder::FolderBlobs;
use crate::service::blobs::place::BlobPlace;
use crate::service::blocking::blocking;
use crate::service::faults::{FaultPoint, Faults};
use crate::service::private;
use crate::service::store::{Job, JobId};

/// Time between two looks for room that a job waits for.
const AGAIN: Duration = Duration::from_millis(500);

/// For how long a job that needs more room than it was promised waits for jobs that are still to be read.
const PATIENCE: Duration = Duration::from_secs(30);

/// Part of the room for uploads that the store of jobs may keep free for itself.
const STORE_PART: u64 = 8;

/// The folder and everything in it.
#[derive(Debug)]
pub(in crate::service) struct Files {
    pub(super) root: Root,
    pub(super) blobs: Box<dyn Blobs>,
    pub(super) references: References,
    /// Where the blobs lie when they are not in the root. Other processes may use them too.
    pub(super) elsewhere: Option<BlobPlace>,
    /// Name of the store that the place of the blobs belongs to.
    pub(super) owner: Option<String>,
    /// Whether the store of jobs is in the root, and grows there.
    pub(super) has_store: bool,
    pub(super) disk: Disk,
    pub(super) ballast: Ballast,
    pub(super) room: Room,
    /// Uploads in progress; the store has no row for them.
    pub(super) incoming: Mutex<HashSet<JobId>>,
    pub(super) failures: AtomicU64,
    /// Folders of jobs that the store does not know, as the last sweep found them.
    pub(super) unknown: AtomicU64,
    pub(super) damages: AtomicU64,
    pub(super) faults: Faults,
}

impl Files {
    /// Takes the folder `data_dir`, which is made if need be, or a temporary one; the blobs lie in it or `elsewhere`. A
    /// folder that another process works in is refused. Call [`make_ballast`](Self::make_ballast) once the jobs of the
    /// store have their promises again.
    pub fn open(
        data_dir: Option<&Path>,
        elsewhere: Option<&BlobPlace>,
        limits: DiskLimits,
        faults: Faults,
    ) -> Result<Self> {
        let root = match data_dir {
            Some(path) => Root::keep(path)?,
            None => Root::temporary(&std::env::temp_dir())?,
        };
        // nothing that is to stay lies in a temporary folder then
        let limits = if elsewhere.is_some() && !root.is_kept() { DiskLimits::default() } else { limits };
        limits.check(root.path())?;
        for folder in [UPLOADS, RESULTS, "scratch"] {
            let path = root.path().join(folder);
            let made = private::make_folder(&path).and_then(|()| private::tighten(&path));
            made.map_err(|error| cannot_make(&path, error))?;
        }
        let blobs: Box<dyn Blobs> = match elsewhere {
            Some(place) => place.open()?,
            None => {
                let blobs = FolderBlobs::open(root.path(), root.is_kept());
                Box::new(blobs.map_err(|error| cannot_make(root.path(), error))?)
            }
        };
        let ballast = Ballast::new(root.path(), disk::total_bytes(root.path()), limits.max_bytes, root.is_kept());
        let disk = Disk::new(root.path().to_owned(), limits);
        let room = Room::default();
        let (incoming, failures, damages) = (Mutex::default(), AtomicU64::new(0), AtomicU64::new(0));
        let references = References::default();
        let elsewhere = elsewhere.cloned();
        let files = Self {
            root,
            blobs,
            references,
            elsewhere,
            owner: None,
            has_store: true,
            disk,
            ballast,
            room,
            incoming,
            failures,
            unknown: AtomicU64::new(0),
            damages,
            faults,
        };
        // the store needs some room to be opened
        if files.disk.free().is_some_and(|free| free < disk::STORE_ROOM / 8) {
            files.ballast.give_up();
        }
        Ok(files)
    }

    /// Where the store of jobs is to be.
    pub fn database(&self) -> PathBuf {
        self.root.path().join(root::STORE[0])
    }

    /// A folder for files without a name.
    pub fn scratch(&self) -> PathBuf {
        self.root.path().join("scratch")
    }

    /// Removes the upload of a job.
    pub async fn remove_upload(&self, id: JobId) {
        self.remove_below(&Folder::Upload(id).path()).await;
    }

    /// Removes what an attempt at a job left.
    pub async fn remove_result(&self, id: JobId, attempt: u32) {
        self.remove_below(&Folder::Result(id, attempt).path()).await;
    }

    /// Removes everything of a job.
    pub async fn remove(&self, id: JobId) {
        self.remove_upload(id).await;
        self.remove_below(&Folder::Results(id).path()).await;
    }

    /// Refuses an upload of so many bytes, as far as is known, when there is no room for it or no folder any more.
    pub fn check_room(&self, bytes: u64) -> Result<()> {
        self.check_reachable()?;
        self.disk.check(self.in_root(bytes), self.taken())
    }

    /// Refuses when a job may be refused that is kept in the store of jobs.
    pub fn check_small_job(&self) -> Result<()> {
        self.check_reachable()?;
        self.disk.check(0, self.taken().saturating_add(self.in_root(needs::SMALL_JOB)))
    }

    /// Bytes that are promised to jobs or kept free for the ballast.
    fn taken(&self) -> u64 {
        self.room.promised().saturating_add(self.ballast.missing())
    }

    /// Promises a job that is being accepted, with an upload of so many bytes, room for its result. Refuses when there
    /// is none; [`Kind::TooLarge`] when there never is.
    pub fn promise(&self, job: JobId, upload: u64, bytes: u64) -> Result<()> {
        self.disk.check_job(self.in_root(upload), self.in_root(bytes), self.ballast.size())?;
        self.promise_from(job, 0, bytes)
    }

    fn promise_from(&self, job: JobId, attempt: u32, bytes: u64) -> Result<()> {
        self.check_reachable()?;
        let (bytes, missing) = (self.in_root(bytes), self.ballast.missing());
        if self.has_room_for_all() {
            return Ok(());
        }
        self.room.promise(job, attempt, bytes, |promised| self.disk.check(0, promised.saturating_add(missing)))
    }

    /// Promises jobs that were accepted before the service was started room again.
    pub async fn promise_again(&self, jobs: &[Job], limits: &Limits) -> Result<()> {
        if self.has_room_for_all() {
            return Ok(());
        }
        for job in jobs {
            let bytes = self.in_root(self.needs_of(job, limits).await?);
            self.room.promise(job.id, job.attempt, bytes, |_| Ok::<_, Error>(()))?;
        }
        Ok(())
    }

    /// Promises a job that runs again room for its result. Refuses when there is none.
    pub async fn promise_retry(&self, job: &Job, limits: &Limits) -> Result<()> {
        self.promise_from(job.id, job.attempt + 1, self.needs_of(job, limits).await?)
    }

    /// Estimate of a result, from the upload that is kept.
    async fn needs_of(&self, job: &Job, limits: &Limits) -> Result<u64> {
        // of a mesh in a bucket, the folder has what came with it
        let elsewhere = if job.spec.referred.is_some() { job.spec.bytes } else { 0 };
        let upload = match job.spec.is_small || self.is_shared() {
            true => job.spec.bytes,
            false => elsewhere.saturating_add(self.blobs.size(&Folder::Upload(job.id).path()).await?),
        };
        Ok(needs::of_upload(&job.spec, upload, limits))
    }

    /// The job ended, and will not be run again: what it was promised is free.
    pub fn give_back(&self, job: JobId) {
        self.room.give_back(job);
    }

    /// The job ended with an attempt: what it was promised is free, unless it is run again already.
    pub fn give_back_of(&self, job: JobId, attempt: u32) {
        self.room.give_back_of(job, attempt);
    }

    /// Jobs that were promised room.
    pub fn promised_jobs(&self) -> Vec<JobId> {
        self.room.jobs()
    }

    /// Waits for room for the result of an attempt at a job, which turned out to need so many bytes. Fails with
    /// [`Kind::InsufficientStorage`] when nothing can make room; [`gave_up`](Self::gave_up) holds from then on.
    pub async fn secure(&self, job: JobId, attempt: u32, bytes: u64) -> Result<()> {
        if self.has_room_for_all() {
            return Ok(());
        }
        let (started, bytes) = (Instant::now(), self.in_root(bytes));
        let mut is_told = false;
        loop {
            let disk = self.disk.state(self.ballast.there());
            match self.room.try_secure(job, attempt, bytes, disk, started.elapsed() < PATIENCE) {
                room::Outcome::Secured => return Ok(()),
                room::Outcome::Never => {
                    return Err(Error::new(
                        Kind::InsufficientStorage,
                        format_args!(
                            "the disk of the service has no room for the result of the job, and no other job will make \
                             some; delete jobs and submit it again; bytes needed: {bytes}"
                        ),
                    ));
                }
                room::Outcome::Wait => {
                    if !std::mem::replace(&mut is_told, true) {
                        tracing::warn!(job = %job, bytes, "the result of a job waits for room on the disk");
                    }
                    tokio::time::sleep(AGAIN).await;
                }
            }
        }
    }

    /// The job waits for its turn again after an attempt.
    pub fn put_back(&self, job: JobId, attempt: u32) {
        self.room.put_back(job, attempt);
    }

    /// Whether there will be no room for the result of a job.
    pub fn gave_up(&self, job: JobId) -> bool {
        self.room.gave_up(job)
    }

    /// Makes the ballast if it is missing and there is room beside the reserve. Blocks.
    pub fn make_ballast(&self) {
        if self.ballast.missing() == 0 {
            return;
        }
        let spare = self.disk.spare(self.room.promised());
        if let Err(error) = self.ballast.make(spare) {
            tracing::warn!(%error, "the ballast cannot be made; without it, a full disk may stop deletions");
        }
    }

    /// Gives the ballast up, so that the store can write; whether there was any.
    pub async fn give_up_ballast(self: &Arc<Self>) -> bool {
        let this = Arc::clone(self);
        let had_any = blocking(move || this.ballast.give_up()).await.unwrap_or(false);
        if had_any {
            tracing::warn!("the disk is full: the ballast was given up, so that jobs can be forgotten");
        }
        had_any
    }

    /// How often a blob could not be written or read for reasons of the disk.
    pub fn failures(&self) -> u64 {
        self.failures.load(Ordering::Relaxed)
    }

    /// Folders of jobs that the store does not know, as of the last sweep.
    pub fn unknown(&self) -> u64 {
        self.unknown.load(Ordering::Relaxed)
    }

    /// How often a blob of a result was not what was stored.
    pub fn damages(&self) -> u64 {
        self.damages.load(Ordering::Relaxed)
    }

    /// Counts and logs a blob of a result that is not what was stored; the error of it.
    pub fn damaged(&self, job: JobId, name: &str, why: impl std::fmt::Display) -> Error {
        self.damages.fetch_add(1, Ordering::Relaxed);
        tracing::error!(%job, "the stored {name} is damaged: {why}");
        Error::new(Kind::Damaged, format_args!("the stored {name} is damaged, submit the mesh again: {why}"))
    }

    /// Bytes in the folder: uploads, results and the store of jobs.
    pub fn used_bytes(&self) -> u64 {
        self.disk.used()
    }

    /// Bytes that may still be written to the file system of the folder; none where the system does not tell.
    pub fn free_bytes(&self) -> Option<u64> {
        self.disk.free()
    }

    /// So many bytes of the store of jobs are free for it to use again.
    pub fn free_in_store(&self, bytes: u64) {
        self.disk.free_in_store(bytes);
    }

    /// Whether bytes that are free in the store of jobs would be a good part of what uploads may take.
    pub fn is_short_of(&self, free_in_store: u64) -> bool {
        free_in_store > self.disk.spare(self.taken()) / STORE_PART
    }

    /// Whether the folder is there and takes a file; says what is wrong. Blocks.
    pub fn probe(&self) -> Result<()> {
        let cannot = |error| {
            storage_error(
                format_args!("no file can be written in the data folder: {}", self.root.path().display()),
                error,
            )
        };
        self.faults.hit(FaultPoint::ProbeFolder).map_err(cannot)?;
        self.check_root()?;
        let write = || {
            let mut file = tempfile::tempfile_in(self.scratch())?;
            io::Write::write_all(&mut file, &[0; 4096])?;
            file.sync_all()
        };
        write().map_err(cannot)
    }

    /// An error when the folder is not the one that was opened any more. It names the folder: for the operator only.
    pub fn check_root(&self) -> Result<()> {
        self.root.check().map_err(|error| {
            let what = format_args!("the data folder cannot be used: {}", self.root.path().display());
            Error::new(Kind::Unavailable, format_args!("{what}: {error}"))
        })
    }

    /// The same for clients, without the folder's name. The failure is counted, so that the log gets the name.
    pub(super) fn check_reachable(&self) -> Result<()> {
        self.check_root().map_err(|error| {
            self.noted(error);
            Error::new(Kind::Unavailable, CANNOT_REACH)
        })
    }

    /// Counts an error of the disk.
    pub(super) fn noted(&self, error: Error) -> Error {
        if error.is_of_storage() {
            self.failures.fetch_add(1, Ordering::Relaxed);
        }
        error
    }

    /// Lets go of the folder: removes a temporary one, and lets another process have one that stays.
    pub async fn close(&self) {
        match &self.root {
            Root::Kept { lock, .. } => {
                if let Err(error) = lock.unlock() {
                    tracing::warn!(%error, "the data folder stays locked until the process ends");
                }
            }
            Root::Temporary { folder, .. } => {
                let _ = tokio::fs::remove_dir_all(folder.path()).await;
            }
        }
    }

    pub(super) fn lock_incoming(&self) -> MutexGuard<'_, HashSet<JobId>> {
        self.incoming.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Removes all blobs below a path. What cannot be removed now is swept away later.
    pub(super) async fn remove_below(&self, path: &BlobPath) {
        match self.blobs.remove(path).await {
            Ok(bytes) if !self.is_shared() => self.disk.removed(bytes),
            Ok(_) => {}
            Err(error) => tracing::warn!("{error}"),
        }
    }
}
