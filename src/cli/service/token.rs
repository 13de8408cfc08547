//! `tesserae token`: who may use the service.

use std::io;
use std::path::PathBuf;

use tesserae_mesh::error::{Error, Kind, wrong_json};
use tesserae_service::{Quotas, TokenFile};

use crate::{Failure, print, print_line};

/// Arguments of `tesserae token`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A service that runs with the file takes the change within seconds. Quotas of a tenant are set by `token quota`, or in \
the file, which is JSON:
  \"quotas\": {\"max_queued_jobs\": 100, \"max_requests_at_once\": 16,
    \"max_streams\": 64, \"max_running_jobs\": 4, \"weight\": 2}

Example:
  tesserae token new acme --tokens tokens.json
  tesserae serve --tokens tokens.json
  curl -H \"Authorization: Bearer $TOKEN\" http://127.0.0.1:8080/v1/jobs")]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Make a token for a tenant, new or known, and print it: the file does not hold it, and it is not shown again
    New {
        /// Name of the tenant: letters, digits, '-', '_' and '.'
        #[arg(value_parser = tenant_name)]
        tenant: String,

        /// Let the tenant read /metrics and /v1/workers, which tell about all tenants
        #[arg(long)]
        metrics: bool,

        #[command(flatten)]
        place: TokensFlag,
    },
    /// List tenants and the ids of their tokens
    List {
        #[command(flatten)]
        place: TokensFlag,
    },
    /// Set the quotas of a tenant, new or known; those that are left out are as the settings of the service say
    Quota {
        /// Name of the tenant
        #[arg(value_parser = tenant_name)]
        tenant: String,

        /// The quotas, as JSON: {"max_queued_jobs": 100, "weight": 2}
        #[arg(value_parser = quotas)]
        quotas: Quotas,

        #[command(flatten)]
        place: TokensFlag,
    },
    /// Take a token back
    Revoke {
        /// Id of the token: what stands in it between the two underscores
        id: String,

        #[command(flatten)]
        place: TokensFlag,
    },
}

/// Where the tokens are.
#[derive(Debug, clap::Args)]
struct TokensFlag {
    /// File of tokens; `new` makes it if it is not there
    #[arg(long, env = "TESSERAE_TOKENS", value_name = "FILE")]
    tokens: PathBuf,
}

fn tenant_name(name: &str) -> Result<String, String> {
    TokenFile::check_name(name).map(|()| name.to_owned()).map_err(|error| error.message)
}

fn quotas(text: &str) -> Result<Quotas, String> {
    serde_json::from_str(text).map_err(|error| wrong_json(&error))
}

/// Does what the arguments say.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    match &arguments.command {
        Command::New { tenant, metrics, place } => {
            if stdout_discards() {
                let why = "a token is shown once, and standard output is closed or the null device";
                return Err(Error::new(Kind::Io, why).into());
            }
            // printed before the file is written: a token that was never shown is never valid
            let mut shown = Ok(());
            let changed = TokenFile::change(&place.tokens, |file| {
                let token = file.add(tenant)?;
                if let Some(entry) = file.tenants.get_mut(tenant) {
                    entry.metrics |= *metrics;
                }
                shown = print(|out| writeln!(out, "{}", token.reveal()));
                shown.as_ref().map(|_| ()).map_err(|_| Error::new(Kind::Io, "the token was not shown"))
            });
            shown.and(changed.map_err(Failure::from))
        }
        Command::List { place } => {
            let file = TokenFile::read(&place.tokens)?;
            print(|out| {
                file.tenants.iter().try_for_each(|(name, tenant)| {
                    let ids: Vec<&str> = tenant.tokens.iter().map(|token| token.id.as_str()).collect();
                    writeln!(out, "{name}: {}", ids.join(" "))
                })
            })
        }
        Command::Quota { tenant, quotas, place } => Ok(TokenFile::change(&place.tokens, |file| {
            file.tenants.entry(tenant.clone()).or_default().quotas = *quotas;
            Ok(())
        })?),
        Command::Revoke { id, place } => {
            let tenant = TokenFile::change(&place.tokens, |file| match file.revoke(id) {
                Some(tenant) => Ok(tenant.to_owned()),
                None => Err(Error::not_found(format_args!("there is no token with this id: {id:?}"))),
            })?;
            print_line(&format!("{tenant}: {id} is no longer a token"))
        }
    }
}

/// Whether what is written to standard output is gone: it is the null device, which the standard library also opens in
/// place of a closed one.
fn stdout_discards() -> bool {
    match (rustix::fs::fstat(io::stdout()), rustix::fs::stat("/dev/null")) {
        (Ok(stdout), Ok(null)) => stdout.st_rdev == null.st_rdev,
        _ => false,
    }
}
