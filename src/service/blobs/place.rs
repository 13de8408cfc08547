//! Where blobs lie when they do not lie in the data folder: a folder, or a part of a bucket.
//!
//! Several processes may have one place. Nothing locks it, and nothing depends on a conditional put, which not every
//! S3 server has: paths have the id of their job in them, and the store of jobs decides what they mean.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use object_store::path::Path as BlobPath;
use tesserae_mesh::error::{Error, Result};

use super::Blobs;
use crate::ops::private;

/// What the URL of a bucket begins with.
const BUCKET: &str = "s3://";

/// A place for blobs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BlobPlace {
    /// A folder.
    Folder(PathBuf),
    /// `s3://NAME/PREFIX`
    Bucket {
        /// The bucket.
        name: String,
        /// What the keys of blobs begin with; may be empty.
        prefix: BlobPath,
    },
}

impl FromStr for BlobPlace {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let Some(rest) = text.strip_prefix(BUCKET) else {
            let why = format_args!("a place for blobs is a folder or s3://BUCKET/PREFIX, not {text:?}");
            let is_folder = !text.is_empty() && !text.contains("://");
            return if is_folder { Ok(Self::Folder(text.into())) } else { Err(Error::parameter(why)) };
        };
        let (name, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let is_name = |byte: u8| byte.is_ascii_alphanumeric() || b".-_".contains(&byte);
        // the parser would leave a first `/` out
        let prefix = BlobPath::parse(prefix).ok().filter(|_| !prefix.starts_with('/'));
        match prefix.filter(|_| !name.is_empty() && name.bytes().all(is_name)) {
            Some(prefix) => Ok(Self::Bucket { name: name.to_owned(), prefix }),
            None => Err(Error::parameter(format_args!(
                "a bucket is s3://BUCKET or s3://BUCKET/PREFIX, without user, port, `?` or empty segments, not {text:?}"
            ))),
        }
    }
}

impl fmt::Display for BlobPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(path) => path.display().fmt(f),
            Self::Bucket { name, prefix } if prefix.as_ref().is_empty() => write!(f, "{BUCKET}{name}"),
            Self::Bucket { name, prefix } => write!(f, "{BUCKET}{name}/{prefix}"),
        }
    }
}

impl BlobPlace {
    /// The blobs there. A folder is made if need be; a bucket must be there, which is not checked yet.
    pub(crate) fn open(&self) -> Result<Blobs> {
        match self {
            Self::Folder(path) => {
                let opened = private::make_folder(path).and_then(|()| Blobs::in_folder(path, true));
                opened.map_err(|error| Error::io(format_args!("the folder cannot be used (--blobs): {self}"), error))
            }
            #[cfg(feature = "s3")]
            Self::Bucket { name, prefix } => super::bucket::open(name, prefix).map(Blobs::stored),
            #[cfg(not(feature = "s3"))]
            Self::Bucket { .. } => Err(Error::parameter(format_args!(
                "this program was built without the cargo feature s3; give --blobs a folder, not {self}"
            ))),
        }
    }

    /// The same bucket without the prefix, and the prefix; none for a folder.
    pub(crate) fn bucket(&self) -> Option<(Self, &BlobPath)> {
        let Self::Bucket { name, prefix } = self else { return None };
        Some((Self::Bucket { name: name.clone(), prefix: BlobPath::default() }, prefix))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_a_folder_or_a_bucket() {
        for text in ["blobs", "/srv/blobs", "s3:x", "s3://b", "s3://b/p", "s3://my-bucket.x_1/p/q"] {
            let place: BlobPlace = text.parse().expect(text);
            assert_eq!(place.to_string(), text);
            assert_eq!(matches!(place, BlobPlace::Bucket { .. }), text.starts_with(BUCKET));
        }
        for (text, same) in [("s3://b/", "s3://b"), ("s3://b/p/", "s3://b/p")] {
            assert_eq!(text.parse::<BlobPlace>().expect(text).to_string(), same);
        }
        for text in
            ["", "s3://", "s3:///p", "s3://b/../c", "s3://b//p", "s3://u:p@b/p", "s3://b:9/p", "gs://b/p", "http://b"]
        {
            let error = text.parse::<BlobPlace>().expect_err(text);
            assert!(error.message.contains("s3://BUCKET") && error.message.ends_with(&format!("{text:?}")), "{error}");
        }
    }

    #[test]
    #[cfg(not(feature = "s3"))]
    fn a_bucket_needs_the_feature() {
        let place: BlobPlace = "s3://b/p".parse().expect("a bucket");
        assert!(place.open().expect_err("not built in").message.contains("cargo feature s3"));
    }
}
