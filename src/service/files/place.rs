//! The place of the blobs: the data folder, or elsewhere (`--blobs`), where other processes may have theirs.
//!
//! A store of jobs belongs to a place, and a place to one store: another store would sweep its files away, and at
//! another place the jobs have no files. So a place keeps the name of its store as a blob, [`OWNER`]. That the store of
//! a data folder was lost is noticed by the same blob.
//!
//! The room of a place elsewhere is not counted: other processes fill it too. When it is full, what is written to it
//! fails.

use axum::body::Bytes;
use object_store::path::Path as BlobPath;
use tesserae_mesh::error::{Error, Kind, Result};

use super::ballast::{BALLAST, LAST};
use super::failure::CANNOT_REACH;
use super::folder::Files;
use super::names::{OWNER, RESULTS, UPLOADS};

impl Files {
    /// Whether the blobs lie elsewhere, where other processes may have theirs.
    pub fn is_shared(&self) -> bool {
        self.elsewhere.is_some()
    }

    /// Checks, before the store of jobs is opened, that it is there if there was one: what is left of its log would go.
    pub fn check_store(&self) -> Result<()> {
        let is_there = self.database().metadata().is_ok_and(|found| found.len() > 0);
        let had_one = [OWNER, BALLAST].iter().any(|name| self.root.path.join(name).exists());
        if had_one && !is_there { Err(self.lost_store()) } else { Ok(()) }
    }

    /// Checks a store of jobs that never knew a job: there are no results then.
    pub async fn check_unused_store(&self) -> Result<()> {
        match self.is_shared() || self.jobs_in(RESULTS).await?.is_empty() {
            true => Ok(()),
            false => Err(self.lost_store()),
        }
    }

    fn lost_store(&self) -> Error {
        Error::new(
            Kind::Conflict,
            format_args!(
                "the store of jobs of this data folder is missing, empty, older than its files, or another one: put it \
                 back, from a backup for instance, or, to begin with an empty store, move {UPLOADS}, {RESULTS}, \
                 {OWNER}, {BALLAST}, {LAST} and what there is of jobs.sqlite3 out of the data folder: {}",
                self.root.path.display()
            ),
        )
    }

    /// Takes the place of the blobs for a store of this name: checks that they are each other's, from now on where the
    /// place has no owner and the store no jobs.
    pub async fn take_place(&mut self, store: &str, has_jobs: bool) -> Result<()> {
        let folder = self.root.path.display();
        let place = self.elsewhere.as_ref().map_or(folder.to_string(), ToString::to_string);
        let conflict = |message: String| Err(Error::new(Kind::Conflict, message));
        if self.is_shared() && self.root.path.join(OWNER).exists() {
            return conflict(format!(
                "files of jobs lie in the data folder: move {UPLOADS}, {RESULTS} and {OWNER} from it to {place} while \
                 the service is stopped, or start without --blobs: {folder}"
            ));
        }
        match self.owner().await? {
            Some(owner) if owner == store => {}
            Some(_) if self.is_shared() => {
                return conflict(format!(
                    "another store of jobs has its files here, and each would remove the other's: give every store its \
                     own folder or prefix (--blobs), or remove the file {OWNER} here if that store is gone: {place}"
                ));
            }
            Some(_) => {
                let Error { message, .. } = self.lost_store();
                return conflict(format!("{message}; or, if only the file {OWNER} is wrong, write {store} into it"));
            }
            None if has_jobs => {
                return conflict(format!(
                    "the files of the jobs of this store do not lie here: give --blobs with the place where they lie, \
                     or, if they do, write {store} into a file {OWNER} there: {place}"
                ));
            }
            None => {
                self.blobs.put(&BlobPath::from(OWNER), Bytes::copy_from_slice(store.as_bytes())).await?;
                // of two new stores at one place, the last one has it
                if self.owner().await?.as_deref() != Some(store) {
                    return conflict(format!("another store of jobs takes this place at the same time: {place}"));
                }
            }
        }
        self.owner = Some(store.to_owned());
        Ok(())
    }

    /// The name of the store that the place belongs to, if it belongs to one.
    async fn owner(&self) -> Result<Option<String>> {
        match self.blobs.get(&BlobPath::from(OWNER), None).await {
            Ok(found) => Ok(Some(String::from_utf8_lossy(&found.bytes().await?).trim().to_owned())),
            Err(error) if error.kind == Kind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Whether blobs that lie elsewhere can be stored and found there; says what is wrong. Without the owner it is
    /// another place: a folder that is not mounted, say.
    pub async fn probe_elsewhere(&self) -> Result<()> {
        let Some(place) = &self.elsewhere else { return Ok(()) };
        let probe = async {
            self.blobs.names(&BlobPath::default()).await?;
            if self.owner.is_some() && self.owner().await? != self.owner {
                return Err(Error::new(Kind::Conflict, format_args!("the file {OWNER} is not there, or another one")));
            }
            self.blobs.probe().await
        };
        probe.await.map(drop).map_err(|error| {
            let what = format_args!("files of jobs cannot be stored at {place} (--blobs)");
            Error::new(Kind::Unavailable, format_args!("{what}: {error}"))
        })
    }

    /// An error when the place of the blobs is away: each blob looks removed then.
    pub(super) async fn check_place(&self) -> Result<()> {
        self.check_reachable()?;
        if self.is_shared() && self.blobs.names(&BlobPath::default()).await.is_err() {
            return Err(self.noted(Error::new(Kind::Unavailable, CANNOT_REACH)));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;
    use std::sync::atomic::Ordering;
    use std::time::{Duration, SystemTime};

    use super::*;
    use crate::blobs::place::BlobPlace;
    use crate::files::{Folder, MESH};
    use crate::ops::faults::Faults;
    use crate::store::JobId;
    use crate::store::tests::{new_job, store_in};

    fn place(path: &Path) -> BlobPlace {
        path.to_str().expect("a name").parse().expect("a place")
    }

    fn open(data_dir: Option<&Path>, elsewhere: Option<&BlobPlace>, reserve: u64) -> Arc<Files> {
        Arc::new(Files::open(data_dir, elsewhere, reserve, Faults::default()).expect("it opens"))
    }

    async fn write(files: &Arc<Files>, id: JobId) {
        let mut blob = files.result(id, 1, "x");
        blob.write(b"x").await.expect("taken");
        blob.finish().await.expect("stored");
    }

    async fn is_there(files: &Files, folder: Folder, name: &str) -> bool {
        files.read(folder, name, None).await.is_ok()
    }

    #[tokio::test]
    async fn a_place_and_a_store_are_each_others() {
        let folders = [(); 5].map(|()| tempfile::tempdir().expect("a folder"));
        let [data, another_data, blobs, other_blobs, used] = folders.each_ref().map(|folder| folder.path());
        let try_open = async |data: &Path, elsewhere: Option<&Path>, has_jobs| {
            let elsewhere = elsewhere.map(place);
            let files = Files::open(Some(data), elsewhere.as_ref(), 0, Faults::default());
            let mut files = files.expect("it opens");
            // the name of the store that such a data folder has
            let taken = files.take_place(&data.display().to_string(), has_jobs).await;
            files.close().await;
            taken
        };
        for has_jobs in [false, true] {
            assert_eq!(try_open(data, Some(blobs), has_jobs).await, Ok(()), "new, then known");
        }
        assert_eq!(try_open(used, None, false).await, Ok(()));
        for (data, elsewhere, has_jobs, expected) in [
            (data, None, true, "do not lie here"),
            (data, Some(other_blobs), true, "do not lie here"),
            (another_data, Some(blobs), false, "another store of jobs"),
            (used, Some(other_blobs), true, "move uploads"),
        ] {
            let error = try_open(data, elsewhere, has_jobs).await.expect_err(expected);
            assert_eq!(error.kind, Kind::Conflict);
            assert!(error.message.contains(expected), "{error}");
        }
        assert_eq!(try_open(another_data, Some(other_blobs), false).await, Ok(()));
        assert_eq!(try_open(used, None, true).await, Ok(()));

        let place = place(blobs);
        let mut files = Files::open(Some(data), Some(&place), 0, Faults::default()).expect("opened");
        assert_eq!(files.take_place(&data.display().to_string(), true).await, Ok(()));
        assert_eq!(files.probe_elsewhere().await, Ok(()));
        std::fs::remove_file(blobs.join(OWNER)).expect("there");
        assert!(files.probe_elsewhere().await.is_err(), "as when it is not mounted");
        files.close().await;
    }

    #[tokio::test]
    async fn what_is_new_at_a_shared_place_stays_although_the_store_does_not_know_it() {
        let blobs = tempfile::tempdir().expect("a folder");
        let place = place(blobs.path());
        let [one, other] = [(); 2].map(|()| open(None, Some(&place), 0));
        let folder = tempfile::tempdir().expect("a folder");
        let store = store_in(folder.path()).await;
        let known = new_job();
        store.create(known.clone()).await.expect("created");

        // in parts, of which the last is still to come
        let incoming = other.incoming();
        let mut mesh = incoming.blob(MESH);
        mesh.write(&vec![0; 3 << 20]).await.expect("taken");
        let unknown = JobId::random();
        for id in [unknown, known.id] {
            write(&other, id).await;
        }
        assert_eq!(one.sweep(&store, None).await, Ok(1), "the attempt that the known job did not make");
        assert!(is_there(&other, Folder::Result(unknown, 1), "x").await);
        assert!(!is_there(&other, Folder::Result(known.id, 1), "x").await);
        mesh.finish().await.expect("its parts are there");
        let upload = Folder::Upload(incoming.id());
        assert!(is_there(&one, upload, MESH).await);

        let day = Duration::from_secs(86_400);
        for (folder, name, age) in [(upload, MESH, day - day / 24), (Folder::Result(unknown, 1), "x", day + day / 24)] {
            let path = blobs.path().join(folder.path().as_ref()).join(name);
            let file = std::fs::File::options().write(true).open(path).expect("there");
            file.set_modified(SystemTime::now() - age).expect("set");
        }
        assert_eq!(one.sweep(&store, None).await, Ok(1));
        assert!(is_there(&one, upload, MESH).await);
        assert!(!is_there(&one, Folder::Result(unknown, 1), "x").await);
    }

    #[tokio::test]
    async fn files_elsewhere_take_no_room_in_the_data_folder() {
        let (data, blobs) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
        for (elsewhere, is_taken) in [(Some(place(blobs.path())), true), (None, false)] {
            let files = open(Some(data.path()), elsewhere.as_ref(), 0);
            assert_eq!(files.check_room(1 << 60, 0).is_ok(), is_taken);
            files.close().await;
        }
    }

    #[tokio::test]
    async fn a_blob_is_not_gone_while_its_place_is_away() {
        let blobs = tempfile::tempdir().expect("a folder");
        let files = open(None, Some(&place(blobs.path())), 0);
        let id = JobId::random();
        let kind = async || files.read(Folder::Result(id, 1), "x", None).await.expect_err("not there").kind;
        assert_eq!(kind().await, Kind::NotFound);
        assert_eq!(files.probe_elsewhere().await, Ok(()));
        drop(blobs);
        assert_eq!(kind().await, Kind::Unavailable);
        assert!(files.probe_elsewhere().await.is_err() && files.failures.load(Ordering::Relaxed) > 0);
    }
}
