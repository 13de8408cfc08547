//! Blobs that lie elsewhere than in the data folder (`--blobs`), where other processes may have theirs.
//!
//! A store of jobs belongs to a place, and a place to one store: with another place its jobs have no files, and another
//! store sweeps them away. So the data folder keeps the place in a file, [`BLOBS`], and the place keeps the name of the
//! store as a blob, [`OWNER`].
//!
//! The room of a place is not counted: other processes fill it too. When it is full, what is written to it fails.

use std::fmt;
use std::io::{self, Write as _};

use axum::body::Bytes;
use object_store::path::Path as BlobPath;
use tesserae_mesh::error::{Error, Kind, Result};

use super::failure::{CANNOT_REACH, cannot_make};
use super::folder::Files;
use super::names::{RESULTS, UPLOADS};
use super::root::BLOBS;
use crate::blobs::place::BlobPlace;
use crate::ops::private;

/// Name of the blob with the name of the store that a place belongs to.
const OWNER: &str = "owner";

impl Files {
    /// Whether the blobs lie elsewhere, where other processes may have theirs.
    pub fn is_shared(&self) -> bool {
        self.elsewhere.is_some()
    }

    /// Takes the place of the blobs for a store of this name: checks that it works, and that place, store and data
    /// folder are each other's, from now on if they are new. A temporary store has no place to itself.
    pub async fn take_place(&mut self, store: &str, is_durable: bool) -> Result<()> {
        let file = self.root.path.join(BLOBS);
        let cannot = |error| cannot_make(&file, error);
        let known = match std::fs::read_to_string(&file) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            text => text.map_err(cannot)?.lines().next().map(str::to_owned),
        };
        let is_new = known.is_none() && self.root.is_kept();
        let conflict = |message: fmt::Arguments<'_>| Err(Error::new(Kind::Conflict, message));
        let place = match (&self.elsewhere, known) {
            (None, None) => return Ok(()),
            (None, Some(known)) => {
                return conflict(format_args!(
                    "the files of the jobs of this data folder lie elsewhere: give --blobs {known}"
                ));
            }
            (Some(place), Some(known)) if known != place.to_string() => {
                return conflict(format_args!(
                    "the files of the jobs of this data folder do not lie at {place}: give --blobs {known}, or, if \
                     they were moved, write the new place into {}",
                    file.display()
                ));
            }
            (Some(place), _) => {
                self.probe_elsewhere().await?;
                if is_new && self.has_files_in_root() {
                    return conflict(format_args!(
                        "files of jobs lie in the data folder: move its folders {UPLOADS} and {RESULTS} to {place} \
                         while the service is stopped, or start without --blobs: {}",
                        self.root.path.display()
                    ));
                }
                place
            }
        };
        if !is_durable {
            return Ok(());
        }
        let path = BlobPath::from(OWNER);
        if self.blobs.get(&path, None).await.is_err_and(|error| error.kind == Kind::NotFound) {
            self.blobs.put(&path, Bytes::copy_from_slice(store.as_bytes())).await?;
        }
        self.check_owner(place, store).await?;
        if is_new {
            keep(&file, place).map_err(cannot)?;
        }
        self.owner = Some(store.to_owned());
        Ok(())
    }

    /// Checks that the place belongs to the store of this name.
    async fn check_owner(&self, place: &BlobPlace, store: &str) -> Result<()> {
        match self.blobs.get(&BlobPath::from(OWNER), None).await?.bytes().await? == store.as_bytes() {
            true => Ok(()),
            false => Err(Error::new(
                Kind::Conflict,
                format_args!(
                    "another store of jobs has its files here, and each would remove the other's: give every store its \
                     own folder or prefix (--blobs), or remove the file {OWNER} here if that store is gone: {place}"
                ),
            )),
        }
    }

    fn has_files_in_root(&self) -> bool {
        [UPLOADS, RESULTS].iter().any(|folder| {
            std::fs::read_dir(self.root.path.join(folder)).is_ok_and(|mut entries| entries.next().is_some())
        })
    }

    /// Whether blobs that lie elsewhere can be stored and found there; says what is wrong. Without the owner it is
    /// another place: a folder that is not mounted, say.
    pub async fn probe_elsewhere(&self) -> Result<()> {
        let Some(place) = &self.elsewhere else { return Ok(()) };
        let probe = async {
            self.blobs.names(&BlobPath::default()).await?;
            if let Some(owner) = &self.owner {
                self.check_owner(place, owner).await?;
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

/// Writes the place into a file, whole or not at all.
fn keep(file: &std::path::Path, place: &BlobPlace) -> io::Result<()> {
    let new = file.with_extension("new");
    let mut out = private::options().truncate(true).open(&new)?;
    writeln!(out, "{place}")?;
    out.sync_all()?;
    std::fs::rename(&new, file)
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;
    use std::time::{Duration, SystemTime};

    use super::*;
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
        let try_open = async |data: &Path, elsewhere: Option<&Path>| {
            let elsewhere = elsewhere.map(place);
            let files = Files::open(Some(data), elsewhere.as_ref(), 0, Faults::default());
            let mut files = files.expect("it opens");
            // the name of the store that such a data folder has
            let taken = files.take_place(&data.display().to_string(), true).await;
            files.close().await;
            taken
        };
        for _ in 0..2 {
            assert_eq!(try_open(data, Some(blobs)).await, Ok(()), "new, then known");
        }
        for (data, elsewhere, expected) in [
            (data, None, "lie elsewhere: give --blobs"),
            (data, Some(other_blobs), "do not lie at"),
            (another_data, Some(blobs), "another store of jobs"),
        ] {
            let error = try_open(data, elsewhere).await.expect_err(expected);
            assert_eq!(error.kind, Kind::Conflict);
            assert!(error.message.contains(expected), "{error}");
        }
        assert_eq!(try_open(another_data, Some(other_blobs)).await, Ok(()));

        let files = open(Some(used), None, 0);
        write(&files, JobId::random()).await;
        files.close().await;
        let error = try_open(used, Some(&used.join("new"))).await.expect_err("files are here");
        assert!(error.message.contains("move its folders"), "{error}");
        assert_eq!(try_open(used, None).await, Ok(()));

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
            assert_eq!(files.check_room(1 << 60).is_ok(), is_taken);
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
        assert!(files.probe_elsewhere().await.is_err() && files.failures() > 0);
    }
}
