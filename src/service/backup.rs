//! Backups: a copy of a data folder, made while a service works in it, on which a service can be started.
//!
//! The store of jobs is copied by SQLite itself, as it is at one moment. Files of jobs never change once they are
//! there, so those that the copy of the store needs are linked, or copied to another disk. A job may end meanwhile, and
//! its upload go: files are taken before and after the store, and a job that began and ended in between is left out.
//! Files that lie elsewhere (`--blobs`) stay there, and serve the copy too.

use std::collections::HashSet;
use std::fs::File;
use std::io;
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};

use rusqlite::types::{ToSqlOutput, Type, ValueRef};
use rusqlite::{Connection, OpenFlags};
use tesserae_mesh::artifacts::REPORT_JSON;
use tesserae_mesh::error::{Error, Kind, Result};
use walkdir::WalkDir;

use crate::blobs::folder::{link, whole_files};
use crate::files::{self, Folder, OWNER, RESULTS, UPLOADS};
use crate::ops::private;
use crate::store::JobId;

const STORE: &str = "jobs.sqlite3";

/// What a backup holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Backup {
    /// Jobs in it.
    pub jobs: i64,
    /// Files of uploads and results, beside what is in the store.
    pub files: u64,
    /// Jobs that began and ended while it was made, and are not in it.
    pub left_out: u64,
}

/// A folder with files of a job.
struct WantedFolder {
    job: JobId,
    path: PathBuf,
    /// A file that is there unless the job is worth nothing: the mesh of an upload, or what came with one in a bucket;
    /// the report of a result. None of a job that failed, whose upload may be there or not.
    needed: Option<String>,
}

impl WantedFolder {
    /// Whether the backup in `to` lacks files that the job needs.
    fn is_lost(&self, to: &Path) -> bool {
        self.needed.as_ref().is_some_and(|file| !to.join(&self.path).join(file).is_file())
    }
}

/// Copies the data folder `from` to `to`, which must be missing or empty. [`Kind::Conflict`] when it is not,
/// [`Kind::NotFound`] when `from` holds no store of jobs. Where it fails, `to` is as it was before.
pub fn back_up(from: &Path, to: &Path) -> Result<Backup> {
    match from.join(STORE).metadata() {
        Ok(found) if found.len() > 0 => {}
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            return Err(Error::io(format_args!("the data folder cannot be read: {}", from.display()), error));
        }
        _ => {
            let message = format_args!("there is no store of jobs ({STORE}) in the data folder: {}", from.display());
            return Err(Error::not_found(message));
        }
    }
    let cannot_write = |error| Error::io(format_args!("the backup cannot be written: {}", to.display()), error);
    if is_within(to, from).map_err(cannot_write)? {
        return Err(Error::conflict(format_args!(
            "the backup would lie in the data folder, which it copies; give a folder outside of it: {}",
            to.display()
        )));
    }
    let missing = to.ancestors().take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists()).count();
    private::make_folder(to).map_err(cannot_write)?;
    if std::fs::read_dir(to).map_err(cannot_write)?.next().is_some() {
        let message = format_args!("the folder for the backup is not empty; give a new one: {}", to.display());
        return Err(Error::conflict(message));
    }
    copy_all(from, to).inspect_err(|_| {
        for entry in std::fs::read_dir(to).into_iter().flatten().flatten() {
            let path = entry.path();
            let _ = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
        }
        for folder in to.ancestors().take(missing) {
            let _ = std::fs::remove_dir(folder);
        }
    })
}

/// Whether `path`, which may be missing, is `folder` or lies in it.
fn is_within(path: &Path, folder: &Path) -> io::Result<bool> {
    let path = std::path::absolute(path)?;
    let there = path.ancestors().find(|ancestor| ancestor.exists()).unwrap_or(&path);
    Ok(there.canonicalize()?.starts_with(folder.canonicalize()?))
}

fn copy_all(from: &Path, to: &Path) -> Result<Backup> {
    let cannot_write = |error| Error::io(format_args!("the backup cannot be written: {}", to.display()), error);
    // without a first part that SQLite would take for a scheme, as in file:backup
    let store = from.canonicalize().map_err(cannot_write)?.join(STORE);
    let to = &to.canonicalize().map_err(cannot_write)?;
    let copy = to.join(STORE);
    take_files(from, to).map_err(cannot_write)?;
    link(from, to, Path::new(OWNER)).map_err(cannot_write)?;
    let is_elsewhere = !to.join(OWNER).exists();
    if is_elsewhere && !all_files(to).is_empty() {
        let folder = from.display();
        return Err(Error::conflict(format_args!(
            "the data folder has files of jobs and no file {OWNER}: start a service there first: {folder}"
        )));
    }
    let failed = |error: rusqlite::Error| {
        Error::new(Kind::Io, format_args!("the store of jobs cannot be copied to {}: {error}", copy.display()))
    };
    let mut jobs = copy_store(&store, &copy).map_err(failed)?;
    let wanted = if is_elsewhere { Vec::new() } else { wanted(&jobs).map_err(failed)? };
    take_files(from, to).map_err(cannot_write)?;
    let lost: Vec<JobId> = wanted.iter().filter(|wanted| wanted.is_lost(to)).map(|wanted| wanted.job).collect();
    leave_out(&mut jobs, &lost).map_err(failed)?;
    remove_others(to, &wanted).map_err(cannot_write)?;
    let count = jobs.query_row("SELECT count(*) FROM jobs", [], |row| row.get(0)).map_err(failed)?;
    jobs.close().map_err(|(_, error)| failed(error))?;
    let backup = Backup { jobs: count, files: all_files(to).len() as u64, left_out: lost.len() as u64 };
    let mut all = WalkDir::new(to).contents_first(true).into_iter();
    all.try_for_each(|entry| File::open(entry?.path())?.sync_all()).map_err(cannot_write)?;
    Ok(backup)
}

/// Copies the store as it is at one moment, however many processes write to it; a connection to the copy.
fn copy_store(store: &Path, copy: &Path) -> rusqlite::Result<Connection> {
    let connection = Connection::open_with_flags(store, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
    connection.busy_timeout(std::time::Duration::from_secs(5))?;
    // SQLite writes into a file that is there if it is empty; this one is for the owner only
    private::options().open(copy).map_err(|_| rusqlite::Error::InvalidPath(copy.to_owned()))?;
    // as a text of SQL, whatever its bytes are
    let path = ToSqlOutput::Borrowed(ValueRef::Text(copy.as_os_str().as_bytes()));
    connection.execute("VACUUM INTO ?1", [path])?;
    let copy = Connection::open(copy)?;
    // no process died: jobs that run wait again without suspicion when a service starts on the copy
    copy.execute("UPDATE jobs SET begun = 0 WHERE state = 'running'", [])?;
    Ok(copy)
}

/// Folders of files of the jobs of a store: results of those that succeeded, and uploads of the others.
fn wanted(copy: &Connection) -> rusqlite::Result<Vec<WantedFolder>> {
    let (report, mesh, buffer) = (REPORT_JSON.file, files::MESH, files::buffer(0));
    let (seeds, weights, graph) = (files::SEEDS, files::WEIGHTS, files::GRAPH);
    let sql = format!(
        "SELECT id, state = 'succeeded', attempt, CASE \
             WHEN state = 'succeeded' THEN '{report}' \
             WHEN state NOT IN ('queued', 'running') THEN NULL \
             WHEN spec ->> 'referred' IS NULL THEN '{mesh}' \
             WHEN spec ->> 'listed_seeds' THEN '{seeds}' \
             WHEN spec ->> 'has_weights' THEN '{weights}' \
             WHEN spec ->> 'has_graph' THEN '{graph}' \
             WHEN json_array_length(spec, '$.buffers') > 0 THEN '{buffer}' END FROM jobs \
         WHERE NOT coalesce(CASE WHEN state = 'succeeded' THEN summary ELSE spec END ->> 'is_small', 0)"
    );
    let mut statement = copy.prepare(&sql)?;
    let rows = statement.query_map([], |row| {
        let unreadable = |error| rusqlite::Error::FromSqlConversionFailure(0, Type::Text, Box::new(error));
        let job = row.get::<_, String>(0)?.parse().map_err(unreadable)?;
        let folder = if row.get(1)? { Folder::Result(job, row.get(2)?) } else { Folder::Upload(job) };
        Ok(WantedFolder { job, path: folder.path().as_ref().into(), needed: row.get(3)? })
    })?;
    rows.collect()
}

fn leave_out(copy: &mut Connection, jobs: &[JobId]) -> rusqlite::Result<()> {
    let transaction = copy.transaction()?;
    for job in jobs.iter().map(JobId::to_string) {
        for table in ["events", "blobs"] {
            let sql = format!("DELETE FROM {table} WHERE job = (SELECT number FROM jobs WHERE id = ?1)");
            transaction.execute(&sql, [&job])?;
        }
        transaction.execute("DELETE FROM jobs WHERE id = ?1", [&job])?;
    }
    transaction.commit()
}

fn all_files(root: &Path) -> Vec<PathBuf> {
    [UPLOADS, RESULTS].into_iter().flat_map(|folder| whole_files(root, &folder.into())).collect()
}

/// Takes all files into the backup. What is gone meanwhile is left out.
fn take_files(from: &Path, to: &Path) -> io::Result<()> {
    all_files(from).iter().try_for_each(|file| link(from, to, file))
}

fn remove_others(to: &Path, wanted: &[WantedFolder]) -> io::Result<()> {
    let wanted: HashSet<&Path> = wanted.iter().map(|wanted| &*wanted.path).collect();
    for file in all_files(to) {
        let folder = file.parent().unwrap_or(&file);
        if !wanted.contains(folder) {
            std::fs::remove_file(to.join(&file))?;
            // empty by now, or not yet
            let _ = std::fs::remove_dir(to.join(folder));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use tempfile::TempDir;

    use super::*;
    use crate::store::tests::{RULES, new_job};
    use crate::store::{NewJob, Referred, Spec, Store};

    fn folders() -> [TempDir; 2] {
        [(); 2].map(|()| tempfile::tempdir().expect("a folder"))
    }

    fn put(file: PathBuf, text: &str) {
        std::fs::create_dir_all(file.parent().expect("a folder")).expect("made");
        std::fs::write(file, text).expect("written");
    }

    #[test]
    fn a_job_whose_files_went_is_lost() {
        let [from, to] = folders();
        let job = JobId::random();
        let folder = PathBuf::from(Folder::Upload(job).path().as_ref());
        let wanted = WantedFolder { job, path: folder.clone(), needed: Some(files::MESH.to_owned()) };
        let file = folder.join(files::MESH);
        link(from.path(), to.path(), &file).expect("nothing to take");
        assert!(!to.path().join(&folder).exists() && wanted.is_lost(to.path()));
        std::fs::create_dir_all(to.path().join(&folder)).expect("made");
        assert!(wanted.is_lost(to.path()), "an empty folder is no upload");
        put(from.path().join(&file), "mesh");
        put(from.path().join(&folder).join("mesh#1"), "me");
        take_files(from.path(), to.path()).expect("taken");
        assert_eq!(all_files(to.path()), [file], "what is being written is no file of a job");
        assert!(!wanted.is_lost(to.path()));
    }

    #[tokio::test]
    async fn jobs_of_meshes_in_a_bucket_are_in_a_backup_with_what_came_with_them() {
        let [from, to] = folders();
        let store = Store::open(&from.path().join(STORE), false, RULES, Default::default()).await.expect("opened");
        let create = async |listed_seeds| {
            let referred = Some(Referred { url: "s3://bucket/x.obj".to_owned(), tag: None });
            let new = new_job();
            let job = NewJob { spec: Spec { referred, listed_seeds, ..new.spec }, ..new };
            store.create(job.clone()).await.expect("created");
            Folder::Upload(job.id).path().to_string()
        };
        create(false).await;
        let (whole, lost) = (create(true).await, create(true).await);
        put(from.path().join(&whole).join(files::SEEDS), "[0, 1]");
        put(from.path().join(OWNER), &store.name().await.expect("a name"));
        let backup = back_up(from.path(), &to.path().join("new")).expect("made");
        assert_eq!(backup, Backup { jobs: 2, files: 1, left_out: 1 }, "without the job whose seeds went: {lost}");
        assert!(to.path().join("new").join(&whole).join(files::SEEDS).is_file());
        store.close().await;
    }

    #[test]
    fn a_backup_into_its_own_data_folder_is_refused() {
        let from = tempfile::tempdir().expect("a folder");
        put(from.path().join(STORE), "not empty");
        for out in ["", "backup", "results/new/newer"] {
            let error = back_up(from.path(), &from.path().join(out)).expect_err("it would copy itself");
            assert!(error.kind == Kind::Conflict && error.message.contains("outside of it"), "{error}");
        }
        assert_eq!(std::fs::read_dir(from.path()).expect("still there").count(), 1);
    }

    #[test]
    fn a_backup_that_fails_leaves_nothing() {
        let [from, to] = folders();
        put(from.path().join(STORE), "no store of jobs");
        put(from.path().join("uploads/a").join(files::MESH), "mesh");
        for out in ["", "new/newer"] {
            back_up(from.path(), &to.path().join(out)).expect_err("it cannot be copied");
            assert_eq!(std::fs::read_dir(to.path()).expect("still there").count(), 0, "{out}");
        }
    }
}
