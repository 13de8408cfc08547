//! Cursors: the text by which a client gets the next page of the list of jobs.
//!
//! A cursor holds the number of a job among the jobs of all tenants, encrypted: a client learns nothing about other
//! tenants. The key is kept as long as the jobs are, so that cursors outlast a restart.

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;
use tesserae_mesh::error::{Error, Kind, Result};

/// Bytes of a key.
const KEY: usize = 32;

/// Makes and reads cursors.
#[derive(Clone)]
pub(super) struct Cursors([u8; KEY]);

impl std::fmt::Debug for Cursors {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cursors").finish_non_exhaustive()
    }
}

impl Cursors {
    /// With a new key.
    pub fn random() -> Result<Self> {
        let mut key = [0; KEY];
        getrandom::fill(&mut key)
            .map_err(|error| Error::new(Kind::Internal, format_args!("no random bytes can be had: {error}")))?;
        Ok(Self(key))
    }

    /// With a key that was kept; none when it is not one.
    pub fn with_key(key: &[u8]) -> Option<Self> {
        Some(Self(key.try_into().ok()?))
    }

    /// The key, to be kept.
    pub fn key(&self) -> &[u8] {
        &self.0
    }

    /// The cursor of the page after the job of that number.
    pub fn cursor_of(&self, number: u64) -> String {
        // The tag is derived from the number and the mask from the tag, so that equal cursors mean equal numbers only.
        let tag = self.digest(b"tag", &number.to_be_bytes());
        let hidden = number ^ u64::from_be_bytes(self.digest(b"mask", &tag));
        URL_SAFE_NO_PAD.encode([tag, hidden.to_be_bytes()].concat())
    }

    /// The number in a cursor.
    pub fn number_of(&self, cursor: &str) -> Result<u64> {
        let number = || {
            let bytes: [u8; 16] = URL_SAFE_NO_PAD.decode(cursor).ok()?.try_into().ok()?;
            let (tag, hidden) = bytes.split_at(8);
            let number = u64::from_be_bytes(hidden.try_into().ok()?) ^ u64::from_be_bytes(self.digest(b"mask", tag));
            (self.digest(b"tag", &number.to_be_bytes()) == tag).then_some(number)
        };
        number().ok_or_else(|| Error::parameter(format_args!("cursor is not one that a list of jobs gave: {cursor:?}")))
    }

    fn digest(&self, purpose: &[u8], bytes: &[u8]) -> [u8; 8] {
        let mut out = [0; 8];
        // a key of any length is taken
        if let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(&self.0) {
            mac.update(purpose);
            mac.update(bytes);
            out.copy_from_slice(&mac.finalize().into_bytes()[..8]);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_tells_nothing_without_its_key() {
        let (cursors, others) = (Cursors::random().expect("random"), Cursors::random().expect("random"));
        let (first, second) = (cursors.cursor_of(7), cursors.cursor_of(8));
        assert_eq!((cursors.number_of(&first), cursors.number_of(&second)), (Ok(7), Ok(8)));
        assert_eq!(cursors.cursor_of(u64::MAX).len(), first.len(), "the length tells nothing");
        assert!(others.number_of(&first).is_err());
        for cursor in [&first, &second] {
            let bytes = URL_SAFE_NO_PAD.decode(cursor).expect("base64");
            assert!(!bytes.windows(2).any(|pair| pair == [0, 7] || pair == [0, 8]), "{bytes:?}");
        }
        let kept = Cursors::with_key(cursors.key()).expect("a key");
        assert_eq!(kept.number_of(&first), Ok(7));
        assert!(Cursors::with_key(b"short").is_none());
    }
}
