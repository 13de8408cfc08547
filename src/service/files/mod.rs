//! The files of jobs: uploads and results, as blobs in a folder.
//!
//! ```text
//! DIR/lock                          held by the one process that works here
//! DIR/jobs.sqlite3…                 the store of jobs
//! DIR/uploads/{job}/…               from the request until the job ends
//! DIR/results/{job}/{attempt}/…     from the attempt that succeeded until the job is deleted
//! DIR/scratch/…                     what an answer is made of while it is sent
//! DIR/ballast, DIR/ballast.last     room that deletions and a start get on a full disk
//! DIR/owner                         the name of the store that uploads and results belong to
//! ```
//!
//! With `--blobs`, `uploads` and `results` lie in another folder or in a bucket (`place`).
//!
//! An upload or a result of a few hundred kilobytes becomes no file: it is handed back as small blobs, for the store to
//! keep with the job. Files cost the disk more than what is in them: for each a place, a name, and two waits.
//!
//! Nothing that a client says becomes part of a path. A blob is whole or not there, and in a folder of the operator's
//! it is on the disk when its writing returns. Whether it means anything, the store of jobs decides: an upload before
//! its job was accepted, and the result of an attempt before it was finished, are swept away after a crash.

mod blob;
mod disk;
mod folder;
pub(crate) mod job_blobs;
pub(crate) mod kept_mesh;
mod place;
mod referred;
pub(crate) mod retention;
mod root;
pub(crate) mod storage;

pub(crate) use self::blob::{BlobWriter, Incoming, settle};
pub(crate) use self::folder::Files;
pub(crate) use self::referred::check_prefixes;
pub(crate) use self::root::{Folder, GRAPH, MESH, OWNER, RESULTS, SEEDS, UPLOADS, WEIGHTS, buffer};

#[cfg(test)]
mod tests;
