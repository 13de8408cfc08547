use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime};

use tesserae_mesh::artifacts::REPORT_JSON;
use tesserae_mesh::error::{Error, Kind, Result};

use super::*;
use crate::blobs::place::BlobPlace;
use crate::blobs::tests::content;
use crate::ops::faults::{FaultPoint, Faults};
use crate::store::tests::{SUMMARY, new_job, store_in};
use crate::store::{Created, End, JobId, NewJob, SMALL_BLOBS};

fn open(data_dir: Option<&Path>, elsewhere: Option<&BlobPlace>, reserve: u64) -> Arc<Files> {
    Arc::new(Files::open(data_dir, elsewhere, reserve, Faults::default()).expect("it opens"))
}

fn place(path: &Path) -> BlobPlace {
    path.to_str().expect("a name").parse().expect("a place")
}

async fn write(mut blob: BlobWriter, bytes: &[u8]) -> Result<()> {
    for chunk in bytes.chunks(300_000) {
        blob.write(chunk).await?;
    }
    blob.finish().await
}

async fn read(files: &Files, folder: Folder, name: &str) -> Vec<u8> {
    files.read(folder, name, None).await.expect("there").bytes().await.expect("readable").to_vec()
}

async fn is_there(files: &Files, folder: Folder, name: &str) -> bool {
    files.read(folder, name, None).await.is_ok()
}

#[tokio::test]
async fn blobs_that_are_small_together_become_no_files_and_others_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = open(Some(folder.path()), None, 0);
    let limit = SMALL_BLOBS as usize;
    for (sizes, is_small) in [
        (vec![limit], true),
        (vec![1, 0, limit - 1], true),
        (vec![limit + 1], false),
        (vec![1, limit, 2 << 20, 0], false),
        // around the size of a part
        (vec![(1 << 20) - 1, 1 << 20, (1 << 20) + 1], false),
    ] {
        let mut incoming = files.incoming();
        for (name, size) in ["a", "b", "c", "d"].iter().zip(&sizes) {
            let mut blob = incoming.blob(name);
            blob.write(&content(*size)).await.expect("written");
            incoming.add(blob).await.expect("added");
        }
        let small = incoming.settle().await.expect("settled");
        assert_eq!(!small.is_empty(), is_small, "{sizes:?}");
        for ((name, size), at) in ["a", "b", "c", "d"].iter().zip(&sizes).zip(0..) {
            let bytes = match is_small {
                true => {
                    assert_eq!(small[at].name, *name);
                    let ranged = files.held(&small[at].bytes, Some(object_store::GetRange::Suffix(7)));
                    let ranged = ranged.expect("there").bytes().await.expect("readable");
                    assert_eq!(ranged, content(*size)[size.saturating_sub(7)..]);
                    small[at].bytes.to_vec()
                }
                false => read(&files, Folder::Upload(incoming.id), name).await,
            };
            assert!(bytes == content(*size), "{sizes:?}");
        }
        let path = folder.path().join(Folder::Upload(incoming.id).path().as_ref());
        assert_eq!(path.exists(), !is_small);
        files.remove(incoming.id).await;
        assert!(!path.exists());
    }
}

#[tokio::test]
async fn a_reserve_that_the_disk_never_has_is_refused_and_one_that_it_has_not_now_refuses_uploads() {
    let folder = tempfile::tempdir().expect("a folder");
    let total = disk::total_bytes(folder.path()).expect("known");
    let files = open(Some(folder.path()), None, total - 1);
    let error = files.check_room(0, 0).expect_err("the disk holds something");
    assert_eq!(error.kind, Kind::InsufficientStorage);
    assert!(error.message.contains("--min-free-bytes"), "{error}");
    assert_eq!(write(files.incoming().blob("a"), b"x").await.map_err(|error| error.kind), Err(Kind::TooLarge));
    write(files.result(JobId::random(), 1, "x"), &content(2 << 20)).await.expect("what was accepted may end");
    assert_eq!(files.probe(), Ok(()), "what was accepted may end");
    files.close().await;
    // no deletion makes room for these
    let files = open(Some(folder.path()), None, 0);
    assert_eq!(files.check_room(total / 4, 0).expect_err("never").kind, Kind::TooLarge);
    files.close().await;
    let error = Files::open(Some(folder.path()), None, total, Faults::default()).expect_err("no disk is that empty");
    let words = format!("less than the {total} bytes");
    assert!(error.message.contains("--min-free-bytes") && error.message.contains(&words), "{error}");
}

#[tokio::test]
async fn a_disk_that_fails_says_how() {
    let folder = tempfile::tempdir().expect("a folder");
    let faults = Faults::default();
    let files = Arc::new(Files::open(Some(folder.path()), None, 0, faults.clone()).expect("it opens"));
    let id = JobId::random();
    for (kind, expected) in
        [(ErrorKind::StorageFull, Kind::InsufficientStorage), (ErrorKind::ReadOnlyFilesystem, Kind::Unavailable)]
    {
        faults.arm(FaultPoint::WriteBlob, kind, 1, 1);
        let error = write(files.result(id, 1, "x"), &content(2 << 20)).await.expect_err("it fails");
        assert_eq!(error.kind, expected);
        assert_eq!(files.read(Folder::Result(id, 1), "x", None).await.expect_err("none").kind, Kind::NotFound);
        faults.disarm();
    }
    write(files.result(id, 1, "x"), &content(2 << 20)).await.expect("it works again");
    // gone, as when it is unmounted
    let elsewhere = folder.path().with_extension("moved");
    std::fs::rename(folder.path(), &elsewhere).expect("moved");
    assert_eq!(files.probe().expect_err("gone").kind, Kind::Unavailable);
    assert!(write(files.incoming().blob("x"), b"x").await.is_err() || files.probe().is_err());
    let _ = std::fs::remove_dir_all(folder.path());
    std::fs::rename(&elsewhere, folder.path()).expect("moved back");
    // another process may have removed it
    std::fs::remove_file(folder.path().join("lock")).expect("there");
    assert_eq!(files.probe(), Ok(()));
    for name in [UPLOADS, RESULTS, "scratch"] {
        let path = folder.path().join(name);
        std::fs::remove_dir_all(&path).expect("there");
        std::fs::write(&path, "").expect("written");
        assert!(files.probe().is_err(), "{name} takes no file");
        std::fs::remove_file(&path).expect("there");
        assert_eq!(files.probe(), Ok(()));
    }
}

#[tokio::test]
async fn a_sweep_leaves_what_jobs_know_of() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = open(Some(folder.path()), None, 0);
    let store = store_in(folder.path()).await;
    let accepted = async || {
        let incoming = files.incoming();
        let job = NewJob { id: incoming.id, ..new_job() };
        write(incoming.blob(MESH), b"mesh").await.expect("written");
        incoming.keep();
        assert!(matches!(store.create(job.clone()).await, Ok(Created::New(_))));
        job.id
    };
    let succeeded = accepted().await;
    let waiting = accepted().await;
    let coming_in = files.incoming();
    write(coming_in.blob(MESH), b"mesh").await.expect("written");
    let claimed = store.claim(1, Duration::from_secs(60)).await.expect("claimable");
    store.end(claimed[0].0, End::Succeeded(SUMMARY)).await.expect("finished");
    let unknown = JobId::random();
    for (job, attempt) in [(succeeded, 1), (succeeded, 7), (waiting, 1), (unknown, 1)] {
        write(files.result(job, attempt, REPORT_JSON.file), b"{}").await.expect("written");
    }
    // half-written by a process that was killed
    let never_accepted = folder.path().join(Folder::Upload(JobId::random()).path().as_ref());
    std::fs::create_dir(&never_accepted).expect("made");
    std::fs::write(never_accepted.join("mesh#1"), b"me").expect("written");
    std::fs::create_dir(folder.path().join("uploads/not ours")).expect("made");

    assert_eq!(files.sweep(&store, None).await, Ok(4));
    assert_eq!(files.unknown.load(Ordering::Relaxed), 1);
    assert!(!never_accepted.exists());
    assert!(folder.path().join("uploads/not ours").exists());
    for (folder, name, is_there) in [
        (Folder::Upload(succeeded), MESH, false),
        (Folder::Upload(waiting), MESH, true),
        (Folder::Upload(coming_in.id), MESH, true),
        (Folder::Result(succeeded, 1), REPORT_JSON.file, true),
        (Folder::Result(succeeded, 7), REPORT_JSON.file, false),
        (Folder::Result(waiting, 1), REPORT_JSON.file, false),
        (Folder::Result(unknown, 1), REPORT_JSON.file, true),
    ] {
        assert_eq!(self::is_there(&files, folder, name).await, is_there, "{folder:?}");
    }
    let before = SystemTime::now() - Duration::from_secs(60);
    assert_eq!(files.sweep(&store, Some(before)).await, Ok(0), "it is not old");
    assert_eq!(files.sweep(&store, Some(SystemTime::now() + Duration::from_secs(60))).await, Ok(1));
    assert!(files.read(Folder::Result(unknown, 1), REPORT_JSON.file, None).await.is_err());
    assert_eq!(files.unknown.load(Ordering::Relaxed), 0);
}

#[tokio::test]
async fn a_mesh_that_the_bucket_does_not_show_is_refused_unless_it_shows_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = open(None, Some(&place(folder.path())), 0);
    let url = "s3://bucket/meshes/x.glb";
    let refused = async || {
        let forbidden = Error::new(Kind::Forbidden, "403");
        files.explain_forbidden(Err::<(), _>(forbidden), url).await.expect_err("forbidden")
    };
    let error = refused().await;
    assert_eq!(error.kind, Kind::InvalidParameter);
    assert!(error.message.contains("s3:GetObject") && error.message.contains(url), "{error}");
    drop(folder);
    assert_eq!(refused().await.kind, Kind::Unavailable, "as with a wrong key");
}

#[tokio::test]
async fn a_place_and_a_store_are_each_others() {
    let folders = [(); 5].map(|()| tempfile::tempdir().expect("a folder"));
    let [data, another_data, blobs, other_blobs, used] = folders.each_ref().map(|folder| folder.path());
    let try_open = async |data: &Path, elsewhere: Option<&Path>, has_jobs| {
        let files = Files::open(Some(data), elsewhere.map(place).as_ref(), 0, Faults::default());
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
    let files = Arc::new(files);
    let written = write(files.result(JobId::random(), 1, "x"), b"x").await;
    assert_eq!(written.expect_err("lost when it is mounted").kind, Kind::Unavailable);
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
        write(other.result(id, 1, "x"), b"x").await.expect("written");
    }
    assert_eq!(one.sweep(&store, None).await, Ok(1), "the attempt that the known job did not make");
    assert!(is_there(&other, Folder::Result(unknown, 1), "x").await);
    assert!(!is_there(&other, Folder::Result(known.id, 1), "x").await);
    mesh.finish().await.expect("its parts are there");
    let upload = Folder::Upload(incoming.id);
    assert!(is_there(&one, upload, MESH).await);

    let day = Duration::from_secs(86_400);
    let aged = |path: &str, age| {
        let file = std::fs::File::options().write(true).create(true).truncate(false).open(blobs.path().join(path));
        file.expect("it opens").set_modified(SystemTime::now() - age).expect("set");
    };
    aged(&format!("{}/{MESH}", upload.path()), day - day / 24);
    for (age, counted) in [(day - day / 24, 0), (day + day / 24, 1), (7 * day - day / 24, 1)] {
        aged(&format!("{}/x", Folder::Result(unknown, 1).path()), age);
        assert_eq!(one.sweep(&store, None).await, Ok(0));
        assert_eq!(one.unknown.load(Ordering::Relaxed), counted, "{age:?}");
    }
    aged(&format!("{}/x", Folder::Result(unknown, 1).path()), 7 * day + day / 24);
    // killed processes leave such files
    for (name, age) in [("new", day / 24), ("old", 2 * day)] {
        std::fs::create_dir_all(blobs.path().join("probes").join(name)).expect("made");
        aged(&format!("probes/{name}/probe"), age);
    }
    assert_eq!(one.sweep(&store, None).await, Ok(1));
    let probes = one.blobs.names(&"probes".into()).await;
    assert_eq!(probes, Ok(vec!["new".to_owned()]));
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
