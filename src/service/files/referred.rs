//! Meshes that no request brings: a client stored one in the bucket by a URL, or it lies in a bucket already.
//!
//! A client reserves an upload in the store of jobs and gets a URL that takes it: the place of the mesh of the job that
//! the upload will be. A URL takes uploads until it ends, also when the upload was given up, or its job deleted. What
//! lies at such a place has a name of its own, so that a sweep removes it at once when there is neither a job nor a
//! reservation. An upload whose reservation is over goes as every upload without a job does.
//!
//! A mesh in a bucket is read only below the prefixes that the operator allows. What a client can replace later is
//! read by its tag, so that every attempt at the job reads the same bytes.

use std::time::{Duration, SystemTime};

use object_store::GetRange;
use object_store::path::Path as BlobPath;

use super::folder::Files;
use super::names::{Folder, MESH_BY_URL};
use super::references::References;
use crate::error::{Error, Kind, Result};
use crate::service::blobs::place::BlobPlace;
use crate::service::blobs::{Blob, Blobs, Found, PutUrl, UploadUrls};
use crate::service::store::{JobId, Referred, Reservations};

/// Time for which a URL takes an upload.
const URL_VALID: Duration = Duration::from_secs(3600);

/// Largest upload by one request, in bytes: a limit of S3.
const MAX_PUT: u64 = 5 << 30;

impl Files {
    /// Allows uploads by URL where the place of the blobs has URLs, and meshes below prefixes of buckets.
    pub fn allow_references(&mut self, prefixes: &[BlobPlace]) -> Result<()> {
        self.references = References::open(self.elsewhere.as_ref(), prefixes)?;
        Ok(())
    }

    /// Refuses uploads by URL where there are none.
    pub fn check_urls(&self) -> Result<()> {
        self.url_maker().map(drop)
    }

    /// A URL that takes an upload of so many bytes, the mesh of a job.
    pub async fn put_url(&self, id: JobId, bytes: u64) -> Result<PutUrl> {
        let urls = self.url_maker()?;
        if bytes > MAX_PUT {
            return Err(Error::too_large(format_args!(
                "an upload by URL has at most {MAX_PUT} bytes; send the mesh as the body of POST /v1/jobs: {bytes}"
            )));
        }
        self.noting(urls.put_url(&mesh_of(id), URL_VALID).await)
    }

    /// What is known of a mesh that no request brings, without reading it.
    pub async fn find_referred(&self, id: JobId, tenant: &str, url: Option<&str>) -> Result<Found> {
        let (blobs, path) = self.place_of(id, tenant, url)?;
        let found = self.explain_forbidden(blobs.find(&path).await, url).await;
        self.noting(found).map_err(|error| match (error.kind, url) {
            (Kind::NotFound, None) => Error::new(
                Kind::Conflict,
                format_args!("nothing was stored at the URL of this upload yet: PUT the mesh there first: {id}"),
            ),
            (Kind::NotFound, Some(url)) => no_object(url),
            _ => error,
        })
    }

    /// Opens a mesh that no request brought, or a range of it.
    pub async fn read_referred(
        &self,
        id: JobId,
        tenant: &str,
        referred: &Referred,
        range: Option<GetRange>,
    ) -> Result<Blob> {
        let (blobs, path) = self.place_of(id, tenant, referred.url.as_deref())?;
        // it could be read when the job was accepted: a key that may not read it now may do so again
        let found = blobs.get_tagged(&path, range, referred.tag.as_deref()).await.map_err(forbidden_as_unavailable);
        self.noting(found).map_err(|error| match (error.kind, &referred.url) {
            (Kind::Conflict, _) => Error::mesh("the mesh was replaced by another one after the job was accepted"),
            (Kind::NotFound, Some(url)) => no_object(url),
            _ => error,
        })
    }

    /// Whether an upload without a job may become one: blobs of it were stored after a time, and those by URL have a
    /// reservation.
    pub(super) async fn is_expected(
        &self,
        id: JobId,
        old: Option<SystemTime>,
        store: &dyn Reservations,
    ) -> Result<bool> {
        let Some(old) = old else { return Ok(false) };
        let stored = self.blobs.times(&Folder::Upload(id).path()).await?;
        let is_by_url = stored.iter().any(|(path, _)| *path == mesh_of(id));
        let is_young = stored.iter().any(|(_, time)| *time > old);
        // a job takes the place of its reservation: it is there when that is not
        Ok(is_young && (!is_by_url || store.reservation(id).await?.is_some() || store.get(id).await?.is_some()))
    }

    /// Says what to do where a bucket does not let the service read a mesh. While it lets the service read nothing, its
    /// key is wrong, and nothing is wrong with the mesh.
    pub(super) async fn explain_forbidden<T>(&self, found: Result<T>, url: Option<&str>) -> Result<T> {
        match (found, url) {
            (Err(error), Some(url)) if error.kind == Kind::Forbidden => {
                self.check_place().await?;
                Err(Error::parameter(format_args!(
                    "the bucket does not let the service read the object at mesh_url, or there is none: grant the key \
                     of the service s3:GetObject on it; {url:?}"
                )))
            }
            (found, _) => found.map_err(forbidden_as_unavailable),
        }
    }

    fn url_maker(&self) -> Result<&dyn UploadUrls> {
        self.references.urls.as_deref().ok_or_else(|| {
            Error::new(
                Kind::NotImplemented,
                "only a bucket takes uploads by URL, and this service keeps its files in a folder: send the mesh as \
                 the body of POST /v1/jobs; the operator may give the service a bucket by --blobs s3://BUCKET/PREFIX",
            )
        })
    }

    /// Where a mesh lies that no request brings.
    fn place_of(&self, id: JobId, tenant: &str, url: Option<&str>) -> Result<(&dyn Blobs, BlobPath)> {
        let Some(url) = url else { return Ok((self.blobs.as_ref(), mesh_of(id))) };
        self.references.place_of(url, tenant).ok_or_else(|| {
            Error::parameter(format_args!(
                "mesh_url must be s3://BUCKET/KEY below a prefix that the operator allows (--mesh-prefixes), not \
                 {url:?}"
            ))
        })
    }

    fn noting<T>(&self, outcome: Result<T>) -> Result<T> {
        outcome.map_err(|error| self.noted(error))
    }
}

/// Where a client stores the mesh of a job by URL.
fn mesh_of(id: JobId) -> BlobPath {
    Folder::Upload(id).path().join(MESH_BY_URL)
}

/// The error of a file of the service's own, which it must be able to read.
fn forbidden_as_unavailable(error: Error) -> Error {
    match error.kind {
        Kind::Forbidden => Error::new(Kind::Unavailable, error.message),
        _ => error,
    }
}

fn no_object(url: &str) -> Error {
    Error::parameter(format_args!("there is no object at mesh_url: {url:?}"))
}
