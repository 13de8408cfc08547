//! Meshes that no request brings: they lie in a bucket already (`mesh_url`).
//!
//! A mesh in a bucket is read only below the prefixes that the operator allows. A client can replace it later, so it is
//! read by its tag: every attempt at the job reads the same bytes.

use object_store::GetRange;
use object_store::path::Path as BlobPath;
use tesserae_mesh::error::{Error, Kind, Result};

use super::folder::Files;
use super::references::References;
use crate::blobs::place::BlobPlace;
use crate::blobs::{Blob, Blobs, Found};
use crate::store::Referred;

impl Files {
    /// Allows meshes below prefixes of buckets.
    pub fn allow_references(&mut self, prefixes: &[BlobPlace]) -> Result<()> {
        self.references = References::open(prefixes)?;
        Ok(())
    }

    /// What is known of a mesh that no request brings, without reading it.
    pub async fn find_referred(&self, tenant: &str, url: &str) -> Result<Found> {
        let (blobs, path) = self.place_of(tenant, url)?;
        let found = self.explain_forbidden(blobs.find(&path).await, url).await;
        self.noting(found).map_err(|error| match error.kind {
            Kind::NotFound => no_object(url),
            _ => error,
        })
    }

    /// Opens a mesh that no request brought, or a range of it.
    pub async fn read_referred(&self, tenant: &str, referred: &Referred, range: Option<GetRange>) -> Result<Blob> {
        let (blobs, path) = self.place_of(tenant, &referred.url)?;
        // it could be read when the job was accepted: a key that may not read it now may do so again
        let found = blobs.get_tagged(&path, range, referred.tag.as_deref()).await.map_err(forbidden_as_unavailable);
        self.noting(found).map_err(|error| match error.kind {
            Kind::Conflict => Error::mesh("the mesh was replaced by another one after the job was accepted"),
            Kind::NotFound => no_object(&referred.url),
            _ => error,
        })
    }

    /// Says what to do where a bucket does not let the service read a mesh. While it lets the service read nothing, its
    /// key is wrong, and nothing is wrong with the mesh.
    pub(super) async fn explain_forbidden<T>(&self, found: Result<T>, url: &str) -> Result<T> {
        match found {
            Err(error) if error.kind == Kind::Forbidden => {
                self.check_place().await?;
                Err(Error::parameter(format_args!(
                    "the bucket does not let the service read the object at mesh_url, or there is none: grant the key \
                     of the service s3:GetObject on it; {url:?}"
                )))
            }
            found => found,
        }
    }

    /// Where a mesh lies that no request brings.
    fn place_of(&self, tenant: &str, url: &str) -> Result<(&Blobs, BlobPath)> {
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

/// The error of a file that the service could read before.
fn forbidden_as_unavailable(error: Error) -> Error {
    match error.kind {
        Kind::Forbidden => Error::new(Kind::Unavailable, error.message),
        _ => error,
    }
}

fn no_object(url: &str) -> Error {
    Error::parameter(format_args!("there is no object at mesh_url: {url:?}"))
}
