//! Where meshes may lie that no request brings: below prefixes of buckets.

use object_store::path::Path as BlobPath;
use tesserae_mesh::error::{Error, Result};

use crate::blobs::Blobs;
use crate::blobs::place::BlobPlace;

/// What stands for the tenant in a prefix.
const TENANT: &str = "{tenant}";

#[derive(Debug, Default)]
pub(super) struct References(Vec<Prefix>);

/// A prefix of a bucket, below which jobs may name meshes.
#[derive(Debug)]
struct Prefix {
    /// As the operator wrote it.
    text: String,
    /// The URL of its bucket.
    bucket: String,
    blobs: Blobs,
}

impl References {
    pub fn open(prefixes: &[BlobPlace]) -> Result<Self> {
        let open = |place: &BlobPlace| {
            let (bucket, _) = place.bucket()?;
            let blobs = bucket.open();
            Some(blobs.map(|blobs| Prefix { text: place.to_string(), bucket: bucket.to_string(), blobs }))
        };
        Ok(Self(prefixes.iter().filter_map(open).collect::<Result<_>>()?))
    }

    /// Where an object of a bucket lies that a tenant may read; none where it may not.
    pub fn place_of(&self, url: &str, tenant: &str) -> Option<(&Blobs, BlobPath)> {
        self.0.iter().find_map(|prefix| {
            let path = path_in(&prefix.text, &prefix.bucket, url, tenant)?;
            Some((&prefix.blobs, path))
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
