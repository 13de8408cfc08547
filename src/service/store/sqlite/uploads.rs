//! Small uploads of jobs that wait, in memory besides the file: a job that starts soon reads nothing from the file.

use std::collections::HashMap;

use tokio_util::bytes::Bytes;

use super::super::{JobId, SmallBlob};

/// Bytes of all of them, at most. Jobs that come after that are read from the file.
const BYTES: usize = 16 << 20;

/// Uploads by job.
#[derive(Debug, Default)]
pub(super) struct Uploads {
    of_job: HashMap<JobId, Vec<SmallBlob>>,
    bytes: usize,
}

impl Uploads {
    /// Keeps the upload of a job, if there is room.
    pub fn keep(&mut self, id: JobId, blobs: Vec<SmallBlob>) {
        let bytes = bytes_of(&blobs);
        if bytes > 0 && self.bytes + bytes <= BYTES {
            self.bytes += bytes;
            self.of_job.insert(id, blobs);
        }
    }

    /// Takes a blob out.
    pub fn take(&mut self, id: JobId, name: &str) -> Option<Bytes> {
        let blobs = self.of_job.get_mut(&id)?;
        let at = blobs.iter().position(|blob| blob.name == name)?;
        let SmallBlob { bytes, .. } = blobs.swap_remove(at);
        self.bytes -= bytes.len();
        if blobs.is_empty() {
            self.of_job.remove(&id);
        }
        Some(bytes)
    }

    /// Drops what is left of a job.
    pub fn forget(&mut self, id: JobId) {
        self.bytes -= self.of_job.remove(&id).map_or(0, |blobs| bytes_of(&blobs));
    }
}

fn bytes_of(blobs: &[SmallBlob]) -> usize {
    blobs.iter().map(|blob| blob.bytes.len()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blobs_are_given_once_and_no_more_are_kept_than_there_is_room_for() {
        let blob = |name: &str, bytes: usize| SmallBlob { name: name.to_owned(), bytes: vec![1; bytes].into() };
        let [first, second, third] = [(); 3].map(|()| JobId::random());
        let mut uploads = Uploads::default();
        uploads.keep(first, vec![blob("mesh", BYTES - 10), blob("seeds", 6)]);
        uploads.keep(second, vec![blob("mesh", 5)]);
        assert!(uploads.take(second, "mesh").is_none(), "there was no room");
        assert!(uploads.take(first, "weights").is_none());
        assert_eq!(uploads.take(first, "mesh").map(|bytes| bytes.len()), Some(BYTES - 10));
        assert!(uploads.take(first, "mesh").is_none());
        uploads.keep(third, vec![blob("mesh", BYTES - 6)]);
        uploads.forget(first);
        uploads.forget(third);
        uploads.forget(third);
        assert!(uploads.of_job.is_empty() && uploads.bytes == 0);
    }
}
