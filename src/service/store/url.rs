//! Where a store is that several services share: the URL of a database, which nothing shows, because of its password.

use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

/// The URL of a database. Every text is taken here, because messages of the command line show what they refuse; the
/// check of the settings refuses what is no such URL.
#[derive(Clone, PartialEq, Eq)]
pub struct StoreUrl(String);

impl FromStr for StoreUrl {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self(text.to_owned()))
    }
}

impl StoreUrl {
    /// The text, password included: for the connection only.
    #[cfg(feature = "postgres")]
    pub(crate) fn expose(&self) -> &str {
        &self.0
    }
}

impl fmt::Debug for StoreUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("StoreUrl").finish_non_exhaustive()
    }
}
