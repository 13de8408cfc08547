//! Tokens: which tenants may use the service, and how much of it.
//!
//! A token is `tess_ID_SECRET`. The file of tokens has the id, and the SHA-256 of the secret, by which it is found: a
//! reader of the file has no token. The secret is 256 random bits: neither salt nor a slow hash would gain anything.

use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::num::NonZeroU32;
use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use tesserae_mesh::error::{Error, Result, wrong_json_at};

use crate::queue::{Share, Shares};

/// What every token begins with, so that scanners for leaked secrets find it.
pub(crate) const TOKEN_PREFIX: &str = "tess_";

/// What a tenant may use of the service; what is left out is as the settings say.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Quotas {
    /// Jobs that may wait.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_queued_jobs: Option<u64>,
    /// Requests at a time, event streams aside.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_requests_at_once: Option<u32>,
    /// Event streams at a time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_streams: Option<u32>,
    /// Jobs that may run at a time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_running_jobs: Option<u64>,
    /// Share of the running jobs, from 1 on: a tenant of weight 2 gets twice as much as one of weight 1, the default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weight: Option<NonZeroU32>,
}

/// The content of the file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TokenFile {
    /// Tenants by name.
    pub tenants: BTreeMap<String, TenantEntry>,
}

/// A tenant in the file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TenantEntry {
    /// What it may use.
    pub quotas: Quotas,
    /// Whether it may read `/metrics` and `/v1/workers`, which cover all tenants.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub metrics: bool,
    /// Its tokens, any of which will do.
    pub tokens: Vec<TokenEntry>,
}

/// A token in the file, which cannot be made from it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TokenEntry {
    /// Which one it is: 16 hexadecimal digits.
    pub id: String,
    /// SHA-256 of the secret, base64url.
    sha256: String,
}

/// A token as its owner has it. Its `Debug` form hides the secret.
pub struct Token {
    /// Which one it is.
    pub id: String,
    secret: String,
}

impl Token {
    /// The whole token: to be shown once.
    pub fn reveal(&self) -> String {
        format!("{TOKEN_PREFIX}{}_{}", self.id, self.secret)
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Token").field("id", &self.id).finish_non_exhaustive()
    }
}

impl TokenFile {
    /// Reads the content of a file.
    pub fn parse(json: &[u8]) -> Result<Self> {
        let file: Self = serde_json::from_slice(json).map_err(|error| {
            Error::parameter(format_args!("the file of tokens is not valid: {}", wrong_json_at(&error)))
        })?;
        file.index()?;
        Ok(file)
    }

    /// Refuses what cannot be the name of a tenant.
    pub fn check_name(name: &str) -> Result<()> {
        let is_allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        // names are parts of paths
        let is_dots = name.bytes().all(|byte| byte == b'.');
        if is_dots || name.len() > 64 || !name.chars().all(is_allowed) {
            return Err(Error::parameter(format_args!(
                "the name of a tenant must have 1 to 64 letters, digits, '-', '_' and '.', and not dots alone: {name:?}"
            )));
        }
        if name == crate::store::LOCAL_TENANT {
            let message = format_args!("this name stands for a service without tokens; take another: {name:?}");
            return Err(Error::parameter(message));
        }
        Ok(())
    }

    /// Adds a token for a tenant, which is new or known.
    pub fn add(&mut self, tenant: &str) -> Result<Token> {
        Self::check_name(tenant)?;
        let mut secret = [0; 32];
        let id = getrandom::fill(&mut secret).and_then(|()| getrandom::u64());
        let id = id.map_err(|error| Error::internal(format_args!("no random bytes can be had: {error}")))?;
        let (id, secret) = (format!("{id:016x}"), URL_SAFE_NO_PAD.encode(secret));
        let entry = TokenEntry { id: id.clone(), sha256: digest(&secret) };
        self.tenants.entry(tenant.to_owned()).or_default().tokens.push(entry);
        Ok(Token { id, secret })
    }

    /// Takes a token back; its tenant, which stays with its quotas, or none when there is no such token.
    pub fn revoke(&mut self, id: &str) -> Option<&str> {
        self.tenants.iter_mut().find_map(|(name, tenant)| {
            let place = tenant.tokens.iter().position(|token| token.id == id)?;
            tenant.tokens.remove(place);
            Some(name.as_str())
        })
    }

    /// Every token with its tenant, by the digest of its secret. Refuses what a file may not be.
    pub(super) fn index(&self) -> Result<HashMap<String, Arc<Tenant>>> {
        let mut index = HashMap::new();
        for (name, TenantEntry { quotas, metrics, tokens }) in &self.tenants {
            Self::check_name(name)?;
            if quotas.max_running_jobs == Some(0) {
                return Err(Error::parameter(format_args!(
                    "with max_running_jobs 0 no job of a tenant would ever run: give at least 1, leave it out for any \
                     number, or set max_queued_jobs to 0 to take no jobs of {name:?}"
                )));
            }
            for token in tokens {
                let is_id = token.id.len() == 16 && token.id.bytes().all(|byte| byte.is_ascii_hexdigit());
                if !is_id || URL_SAFE_NO_PAD.decode(&token.sha256).map_or(0, |digest| digest.len()) != 32 {
                    let message = format_args!("a token is not as this program writes them, of {name:?}");
                    return Err(Error::parameter(message));
                }
                let tenant =
                    Tenant { name: name.clone(), quotas: *quotas, metrics: *metrics, token: Some(token.clone()) };
                if index.insert(token.sha256.clone(), Arc::new(tenant)).is_some() {
                    return Err(Error::parameter(format_args!("a token is listed twice: {:?}", token.id)));
                }
            }
        }
        Ok(index)
    }
}

#[derive(Debug, Default)]
pub(crate) struct Tokens {
    pub(super) by_digest: HashMap<String, Arc<Tenant>>,
    /// What each tenant may use of the queue.
    pub shares: Arc<Shares>,
}

/// A tenant, as one of its tokens lets it in.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tenant {
    pub name: String,
    pub quotas: Quotas,
    /// Whether it may read `/metrics` and `/v1/workers`.
    pub metrics: bool,
    /// That token, where there are tokens.
    pub token: Option<TokenEntry>,
}

impl Tokens {
    pub fn of(file: &TokenFile) -> Result<Self> {
        let share = |(name, tenant): (&String, &TenantEntry)| {
            let Quotas { weight, max_running_jobs: max_running, .. } = tenant.quotas;
            (name.clone(), Share { weight, max_running })
        };
        let shares = Arc::new(file.tenants.iter().map(share).collect());
        Ok(Self { by_digest: file.index()?, shares })
    }

    /// The tenant of a token. How long that takes tells of the digest, not of the secret.
    pub fn tenant(&self, token: &str) -> Option<Arc<Tenant>> {
        let (id, secret) = token.strip_prefix(TOKEN_PREFIX)?.split_once('_')?;
        let known = self.by_digest.get(&digest(secret))?;
        known.token.as_ref().is_some_and(|token| token.id == id).then(|| Arc::clone(known))
    }

    /// Whether the token of a tenant is still there, and its own.
    pub fn has(&self, tenant: &Tenant) -> bool {
        let known = tenant.token.as_ref().map(|token| self.by_digest.get(&token.sha256));
        known.is_none_or(|known| known.is_some_and(|known| known.name == tenant.name))
    }
}

/// SHA-256 of a secret, base64url.
fn digest(secret: &str) -> String {
    URL_SAFE_NO_PAD.encode(Sha256::digest(secret))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(file: &TokenFile, token: &str) -> Option<String> {
        Tokens::of(file).expect("valid").tenant(token).map(|tenant| tenant.name.clone())
    }

    #[test]
    fn a_token_opens_for_its_tenant_and_nothing_else_does() {
        let mut file = TokenFile::default();
        let (mine, other) = (file.add("mine").expect("made"), file.add("other").expect("made"));
        let token = mine.reveal();
        assert_eq!(ask(&file, &token).as_deref(), Some("mine"));
        assert_eq!(ask(&file, &other.reveal()).as_deref(), Some("other"));
        let secret_of_another = format!("tess_{}_{}", mine.id, other.secret);
        let longer = format!("{token}A");
        for wrong in ["", "tess_", "tess__", &token[..token.len() - 1], &longer, &token[5..], &secret_of_another] {
            assert_eq!(ask(&file, wrong), None, "{wrong}");
        }
        assert_eq!(file.revoke(&mine.id), Some("mine"));
        assert_eq!(ask(&file, &token), None);
        assert_eq!(file.revoke(&mine.id), None);
    }

    #[test]
    fn what_is_wrong_with_a_file_is_told() {
        let entry = r#"{"id": "0123456789abcdef", "sha256": "AAAA"}"#;
        for (json, words) in [
            ("", "EOF"),
            ("{}", "tenants"),
            (r#"{"tenants": {"a": {"quota": {}}}}"#, "quota"),
            (r#"{"tenants": {"a b": {}}}"#, "a b"),
            (r#"{"tenants": {"local": {}}}"#, "local"),
            (r#"{"tenants": {"a": {"quotas": {"max_streams": -1}}}}"#, "-1"),
            (r#"{"tenants": {"a": {"quotas": {"weight": 0}}}}"#, "from 1 to"),
            (r#"{"tenants": {"a": {"quotas": {"max_running_jobs": 0}}}}"#, "give at least 1"),
            (&format!(r#"{{"tenants": {{"acme": {{"tokens": [{entry}]}}}}}}"#), "acme"),
        ] {
            let error = TokenFile::parse(json.as_bytes()).expect_err(json);
            assert!(error.message.contains(words), "{json}: {error}");
        }
        let quotas = r#"{"weight": 4, "max_running_jobs": 2, "max_queued_jobs": 3}"#;
        let json = format!(r#"{{"tenants": {{"a": {{"quotas": {quotas}, "metrics": true}}, "b": {{}}}}}}"#);
        let file = TokenFile::parse(json.as_bytes()).expect("valid");
        assert_eq!(file.tenants["a"].quotas.max_queued_jobs, Some(3));
        let shares = Tokens::of(&file).expect("valid").shares;
        assert_eq!(shares["a"], Share { weight: NonZeroU32::new(4), max_running: Some(2) });
        assert_eq!(shares["b"], Share::default());
    }
}
