//! Meshes that no request brings: a client stored one in the bucket by a URL, or it lies in a bucket already.
//!
//! A client reserves an upload and gets a URL that takes it: the place of the mesh of the job that the upload will be.
//! The reservation is a blob with tenant and job in its path. It shows whose upload it is, counts for the tenant's
//! quota, and goes when the job is made, or when it is [`RESERVED_FOR`] old. The upload itself goes as every upload
//! without a job does.
//!
//! A URL takes uploads until it ends, also when the upload was given up, or its job deleted. So another blob tells that
//! a URL was given for a job. A sweep removes at once what lies at such a URL without a job or a reservation.
//!
//! A mesh in a bucket is read only below the prefixes that the operator allows. What a client can replace later is
//! read by its tag, so that every attempt at the job reads the same bytes.

use std::collections::HashSet;
use std::time::{Duration, SystemTime};

use axum::body::Bytes;
use object_store::GetRange;
use object_store::path::Path as BlobPath;

use super::folder::Files;
use super::names::{Folder, MESH, RESERVED, URLS};
use super::references::References;
use crate::error::{Error, Kind, Result};
use crate::service::blobs::place::BlobPlace;
use crate::service::blobs::{Blob, Blobs, Found, PutUrl, UploadUrls};
use crate::service::store::{JobId, Referred};

/// Time for which a URL takes an upload.
const URL_VALID: Duration = Duration::from_secs(3600);

/// Time after which no job is made of an upload any more. It is far below that of a sweep, whatever the clocks say.
pub(in crate::service) const RESERVED_FOR: Duration = Duration::from_secs(12 * 3600);

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

    /// Uploads of a tenant that no job is made of yet.
    pub async fn reserved(&self, tenant: &str) -> Result<u64> {
        Ok(self.noting(self.names_in(&BlobPath::from_iter([RESERVED, tenant])).await)?.len() as u64)
    }

    /// Lets a tenant store an upload of so many bytes: the name of the job that it will be, and the URL that takes it.
    pub async fn reserve(&self, tenant: &str, bytes: u64) -> Result<(JobId, PutUrl)> {
        let urls = self.url_maker()?;
        if bytes > MAX_PUT {
            return Err(Error::too_large(format_args!(
                "an upload by URL has at most {MAX_PUT} bytes; send the mesh as the body of POST /v1/jobs: {bytes}"
            )));
        }
        let id = JobId::random();
        let url = urls.put_url(&mesh_of(id), URL_VALID).await?;
        let stored = async {
            self.blobs.put(&reservation(tenant, id).join(MESH), Bytes::from(bytes.to_string())).await?;
            // after the reservation: a sweep takes a URL without one for that of an upload that was given up
            self.blobs.put(&given_url(id).join(MESH), Bytes::new()).await
        };
        if let Err(error) = self.noting(stored.await) {
            self.forget(tenant, id).await;
            return Err(error);
        }
        Ok((id, url))
    }

    /// Takes an upload back that no job is made of.
    pub async fn unreserve(&self, tenant: &str, id: JobId) {
        self.remove_below(&reservation(tenant, id)).await;
    }

    /// Takes an upload back whose URL no client got.
    pub async fn forget(&self, tenant: &str, id: JobId) {
        self.unreserve(tenant, id).await;
        self.remove_below(&given_url(id)).await;
    }

    /// Number of bytes that an upload is to have; [`Kind::NotFound`] unless the tenant reserved it, not long ago.
    pub async fn reserved_bytes(&self, tenant: &str, id: JobId) -> Result<u64> {
        self.url_maker()?;
        let path = reservation(tenant, id).join(MESH);
        let found = async {
            let found = self.blobs.find(&path).await.map_err(forbidden_as_unavailable)?;
            let bytes = self.blobs.get(&path, None).await?.bytes().await?;
            let bytes = str::from_utf8(&bytes).ok().and_then(|text| text.parse().ok());
            Ok((found, bytes.ok_or_else(|| Error::new(Kind::Internal, "a reservation of an upload is damaged"))?))
        };
        match self.noting(found.await) {
            Ok((found, bytes)) if found.stored_at + RESERVED_FOR > SystemTime::now() => Ok(bytes),
            Err(error) if error.kind != Kind::NotFound => Err(error),
            Ok(_) | Err(_) => Err(Error::new(
                Kind::NotFound,
                format_args!(
                    "there is no such upload, or no job was made of it within {} hours: {id}",
                    RESERVED_FOR.as_secs() / 3600
                ),
            )),
        }
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

    /// Removes reservations that are over. Gives how many there were, and the uploads that have a URL, but no
    /// reservation any more: each is a job, or was given up.
    pub(super) async fn sweep_reservations(&self, now: SystemTime) -> Result<(usize, HashSet<JobId>)> {
        let mut removed = 0;
        let mut unreserved = HashSet::new();
        // before the reservations, which are stored first
        for name in self.names_in(&BlobPath::from(URLS)).await? {
            let Ok(id) = name.parse() else { continue };
            match self.is_over(&given_url(id), now).await? {
                true => self.remove_below(&given_url(id)).await,
                false => drop(unreserved.insert(id)),
            }
        }
        for tenant in self.names_in(&BlobPath::from(RESERVED)).await? {
            for name in self.names_in(&BlobPath::from_iter([RESERVED, &tenant])).await? {
                let Ok(id) = name.parse() else { continue };
                unreserved.remove(&id);
                let path = reservation(&tenant, id);
                if self.is_over(&path, now).await? {
                    self.remove_below(&path).await;
                    removed += 1;
                }
            }
        }
        Ok((removed, unreserved))
    }

    /// Whether a reservation is too old for a job to be made of it.
    async fn is_over(&self, path: &BlobPath, now: SystemTime) -> Result<bool> {
        Ok(self.blobs.newest(path).await?.is_some_and(|newest| newest + RESERVED_FOR < now))
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

/// Where the mesh of a job lies.
fn mesh_of(id: JobId) -> BlobPath {
    Folder::Upload(id).path().join(MESH)
}

/// Where a reservation lies.
fn reservation(tenant: &str, id: JobId) -> BlobPath {
    BlobPath::from_iter([RESERVED, tenant, &id.to_string()])
}

/// Where the blob lies that tells that an upload has a URL.
fn given_url(id: JobId) -> BlobPath {
    BlobPath::from_iter([URLS, &id.to_string()])
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
