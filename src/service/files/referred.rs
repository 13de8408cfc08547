//! Meshes that no request brings: they lie in a bucket already (`mesh_url`).
//!
//! A mesh in a bucket is read only below the prefixes that the operator allows. A client can replace it later, so it is
//! read by its tag: every attempt at the job reads the same bytes.

use object_store::path::Path as BlobPath;
use object_store::{GetRange, ObjectMeta};
use tesserae_mesh::error::{Error, Kind, Result};

use super::folder::Files;
use crate::blobs::place::BlobPlace;
use crate::blobs::{Blob, Blobs};
use crate::store::Referred;

const TENANT: &str = "{tenant}";

impl Files {
    /// Allows meshes below prefixes of buckets.
    pub fn allow_references(&mut self, prefixes: &[BlobPlace]) -> Result<()> {
        for place in prefixes {
            let Some((bucket, _)) = place.bucket() else { continue };
            self.prefixes.push((place.clone(), bucket.open()?));
        }
        Ok(())
    }

    /// What is known of a mesh that no request brings, without reading it.
    pub async fn find_referred(&self, tenant: &str, url: &str) -> Result<ObjectMeta> {
        let (blobs, path) = self.place_of(tenant, url)?;
        let found = self.explain_forbidden(blobs.find(&path).await, url).await;
        found.map_err(|error| self.of_referred(error, url))
    }

    /// Opens a mesh that no request brought, or a range of it.
    pub async fn read_referred(&self, tenant: &str, referred: &Referred, range: Option<GetRange>) -> Result<Blob> {
        let (blobs, path) = self.place_of(tenant, &referred.url)?;
        let found = blobs.get_tagged(&path, range, referred.tag.as_deref()).await;
        found.map_err(|error| self.of_referred(error, &referred.url))
    }

    fn of_referred(&self, error: Error, url: &str) -> Error {
        match error.kind {
            Kind::Conflict => Error::mesh("the mesh was replaced by another one after the job was accepted"),
            Kind::NotFound => Error::parameter(format_args!("there is no object at mesh_url: {url:?}")),
            // it could be read when the job was accepted: a key that may not read it now may do so again
            Kind::Forbidden => self.noted(Error::unavailable(error.message)),
            _ => self.noted(error),
        }
    }

    /// Says what to do where a bucket does not let the service read a mesh, unless its key lets it read nothing.
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
    fn place_of<'f>(&'f self, tenant: &str, url: &str) -> Result<(&'f Blobs, BlobPath)> {
        let place = |(prefix, blobs): &'f (BlobPlace, Blobs)| {
            let (bucket, _) = prefix.bucket()?;
            Some((blobs, path_in(&prefix.to_string(), &bucket.to_string(), url, tenant)?))
        };
        self.prefixes.iter().find_map(place).ok_or_else(|| {
            Error::parameter(format_args!(
                "mesh_url must be s3://BUCKET/KEY below a prefix that the operator allows (--mesh-prefixes), not \
                 {url:?}"
            ))
        })
    }
}

/// The path in its bucket of an object below a prefix, as a tenant sees it.
fn path_in(prefix: &str, bucket: &str, url: &str, tenant: &str) -> Option<BlobPath> {
    url.strip_prefix(&prefix.replace(TENANT, tenant))?.strip_prefix('/').filter(|rest| !rest.is_empty())?;
    let key = url.strip_prefix(bucket)?.strip_prefix('/')?;
    // the parser leaves out a `/` at either end, which makes another key
    BlobPath::parse(key).ok().filter(|path| path.as_ref() == key)
}

/// Checks prefixes below which jobs may name meshes: none shows files of jobs.
pub(crate) fn check_prefixes(prefixes: &[BlobPlace], blobs: Option<&BlobPlace>) -> Result<()> {
    for place in prefixes {
        let Some((bucket, prefix)) = place.bucket() else {
            return Err(Error::parameter(format_args!("--mesh-prefixes must be s3://BUCKET/PREFIX, not {place}")));
        };
        if prefix.parts().any(|part| part.as_ref() != TENANT && part.as_ref().contains(TENANT)) {
            return Err(Error::parameter(format_args!(
                "{TENANT} in --mesh-prefixes must be all that is between two slashes, or tenants could name each \
                 other's folders and those of the service; it is {place}"
            )));
        }
        let Some((_, own)) = blobs.and_then(BlobPlace::bucket).filter(|(other, _)| *other == bucket) else { continue };
        // any name of a tenant may be that of a folder of the service
        let mut segments = prefix.parts().take_while(|part| part.as_ref() != TENANT).zip(own.parts());
        if segments.all(|(segment, other)| segment == other) {
            return Err(Error::parameter(format_args!(
                "jobs could read the files of other tenants' jobs: neither of --mesh-prefixes and --blobs may be \
                 below the other; it is {place}"
            )));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenant_reads_below_its_prefix_only() {
        let path = |prefix: &str, url: &str| path_in(prefix, "s3://b", url, "acme").map(|path| path.to_string());
        for (prefix, url, expected) in [
            ("s3://b/m", "s3://b/m/x.glb", Some("m/x.glb")),
            ("s3://b/m", "s3://b/m/a b/%41?.obj", Some("m/a b/%41?.obj")),
            ("s3://b/m/{tenant}", "s3://b/m/acme/x", Some("m/acme/x")),
            ("s3://b/m/{tenant}", "s3://b/m/other/x", None),
            ("s3://b/m/{tenant}", "s3://b/m/{tenant}/x", None),
            ("s3://b/m", "s3://b/mx/y", None),
            ("s3://b/m", "s3://b/m", None),
            ("s3://b/m", "s3://b/m/", None),
            ("s3://b/m", "s3://b/m/../farm/x", None),
            ("s3://b/m", "s3://b/m//x", None),
            ("s3://b/m", "s3://b/m/x/", None),
            ("s3://b/m", "s3://c/m/x", None),
            ("s3://b/m", "https://b/m/x", None),
            ("s3://b/m", "file:///etc/passwd", None),
        ] {
            assert_eq!(path(prefix, url).as_deref(), expected, "{prefix} {url}");
        }
    }

    #[test]
    fn no_prefix_shows_files_of_jobs() {
        let place = |text: &str| text.parse::<BlobPlace>().expect(text);
        for (prefix, is_right) in [
            ("s3://b/meshes", true),
            ("s3://b/meshes/{tenant}", true),
            ("s3://b/farms", true),
            ("s3://c/farm", true),
            ("s3://b", false),
            ("s3://b/farm", false),
            ("s3://b/farm/uploads", false),
            ("s3://b/{tenant}", false),
            ("s3://b/fa{tenant}", false),
            ("s3://c/m/{tenant}-x", false),
            ("meshes", false),
        ] {
            let checked = check_prefixes(&[place(prefix)], Some(&place("s3://b/farm")));
            assert_eq!(checked.is_ok(), is_right, "{prefix}: {checked:?}");
        }
        assert!(check_prefixes(&[place("s3://b/m")], Some(&place("s3://b"))).is_err());
        assert!(check_prefixes(&[place("s3://b/m")], Some(&place("folder"))).is_ok());
    }
}
