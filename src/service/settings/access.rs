//! Settings of access.

use std::path::PathBuf;

use axum::http::HeaderValue;

use super::heading;

/// Settings of access.
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
pub struct AccessSettings {
    /// File of tokens, as `tesserae token new` makes it; read again when it changes. When left out, no request needs a
    /// token
    #[arg(long, env = "TESSERAE_TOKENS", value_name = "FILE", help_heading = heading::ACCESS)]
    pub tokens: Option<PathBuf>,

    /// Listen to other machines without tokens, and answer for any name (Host): every client that reaches the service
    /// can read and delete every job
    #[arg(long, env = "TESSERAE_INSECURE_NO_AUTH", help_heading = heading::ACCESS)]
    pub insecure_no_auth: bool,

    /// Origins whose web pages may use the service (CORS), such as https://a.example; none when left out
    #[arg(long, env = "TESSERAE_CORS_ORIGINS", value_name = "ORIGIN,…", value_delimiter = ',', value_parser = origin,
          help_heading = heading::ACCESS, hide_short_help = true)]
    pub cors_origins: Vec<String>,
}

/// Checks an origin: scheme, host and port as browsers send them; any other text would never match.
fn origin(text: &str) -> Result<String, String> {
    let rest = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    let is_host = |rest: &str| !rest.is_empty() && !rest.contains(['/', '?', '#', '*', ' ', '@']);
    match rest {
        Some(rest) if is_host(rest) && text == text.to_ascii_lowercase() && HeaderValue::from_str(text).is_ok() => {
            Ok(text.to_owned())
        }
        _ => {
            Err("an origin is http:// or https://, a host in lower case, and a port if it is not the usual one".into())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_origin_is_what_browsers_send() {
        for good in ["https://a.example", "http://localhost:3000", "http://[::1]:80"] {
            assert!(origin(good).is_ok(), "{good}");
        }
        for bad in
            ["*", "null", "a.example", "https://", "https://a.example/", "https://A.example", "ftp://a", "https://*.a"]
        {
            assert!(origin(bad).is_err(), "{bad}");
        }
    }
}
