//! `tesserae token`: who may use the service.

use std::path::PathBuf;

use crate::cli::files::Target;
use crate::cli::{Failure, print, print_line};
use crate::error::{Error, Kind, wrong_json};
use crate::service::{Quotas, StoreUrl, TokenFile};

/// Arguments of `tesserae token`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A service that runs with the file takes the change within seconds, and so do all that run with the database. Quotas of \
a tenant are set by `token quota`, or in the file, which is JSON:
  \"quotas\": {\"max_queued_jobs\": 100, \"max_request_rate\": 50,
    \"max_requests_at_once\": 16, \"max_streams\": 64, \"max_running_jobs\": 4,
    \"weight\": 2}

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

        /// Let the tenant read /metrics, which tell about everybody
        #[arg(long)]
        metrics: bool,

        /// Let the tenant list and drain the workers, which have jobs of everybody
        #[arg(long)]
        admin: bool,

        #[command(flatten)]
        place: Place,
    },
    /// List tenants and the ids of their tokens
    List {
        #[command(flatten)]
        place: Place,
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
        place: Place,
    },
    /// Take a token back
    Revoke {
        /// Id of the token: what stands in it between the two underscores
        id: String,

        #[command(flatten)]
        place: Place,
    },
}

/// Where the tokens are.
#[derive(Debug, clap::Args)]
struct Place {
    /// File of tokens; `new` makes it if it is not there
    #[arg(long, env = "TESSERAE_TOKENS", value_name = "FILE", required_unless_present = "store")]
    tokens: Option<PathBuf>,

    /// Database that services share, as for `tesserae serve --tokens-in-store`; not looked at beside a file
    #[arg(long, env = "TESSERAE_STORE", value_name = "URL", hide_env_values = true)]
    store: Option<StoreUrl>,
}

impl Place {
    /// The tokens.
    fn read(&self) -> Result<TokenFile, Failure> {
        match &self.tokens {
            Some(path) => Ok(TokenFile::read(path)?),
            None => Ok(in_store::read(self.store()?)?),
        }
    }

    /// Changes the tokens, whole or not at all.
    fn change<T>(&self, change: impl FnOnce(&mut TokenFile) -> Result<T, Failure>) -> Result<T, Failure> {
        match &self.tokens {
            Some(path) => TokenFile::try_change(path, change),
            None => in_store::change(self.store()?, change),
        }
    }

    /// The database, where no file is named.
    fn store(&self) -> Result<&StoreUrl, Failure> {
        self.store.as_ref().ok_or_else(|| Error::parameter("give --tokens FILE, or --store URL").into())
    }
}

/// Tokens in a database.
#[cfg(feature = "postgres")]
mod in_store {
    pub use crate::service::{change_tokens as change, read_tokens as read};
}

/// Refuses a database: this build knows none.
#[cfg(not(feature = "postgres"))]
mod in_store {
    use crate::cli::Failure;
    use crate::error::{Error, Result};
    use crate::service::{StoreUrl, TokenFile};

    pub fn read(_: &StoreUrl) -> Result<TokenFile> {
        Err(refused())
    }

    pub fn change<T>(_: &StoreUrl, _: impl FnOnce(&mut TokenFile) -> Result<T, Failure>) -> Result<T, Failure> {
        Err(refused().into())
    }

    fn refused() -> Error {
        Error::parameter("this build has no --store: build tesserae with the cargo feature postgres")
    }
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
        Command::New { tenant, metrics, admin, place } => {
            Target::Stdout.check()?;
            // printed before the file is written: a token that was never shown is never valid
            place.change(|file| {
                let token = file.add(tenant)?;
                if let Some(entry) = file.tenants.get_mut(tenant) {
                    entry.metrics |= *metrics;
                    entry.admin |= *admin;
                }
                print(|out| writeln!(out, "{}", token.reveal()))
            })
        }
        Command::List { place } => {
            let file = place.read()?;
            print(|out| {
                file.tenants.iter().try_for_each(|(name, tenant)| {
                    let ids: Vec<&str> = tenant.tokens.iter().map(|token| token.id.as_str()).collect();
                    writeln!(out, "{name}: {}", ids.join(" "))
                })
            })
        }
        Command::Quota { tenant, quotas, place } => place.change(|file| {
            file.tenants.entry(tenant.clone()).or_default().quotas = *quotas;
            Ok(file.check()?)
        }),
        Command::Revoke { id, place } => {
            let tenant = place.change(|file| match file.revoke(id) {
                Some(tenant) => Ok(tenant.to_owned()),
                None => Err(Error::new(Kind::NotFound, format_args!("there is no token with this id: {id:?}")).into()),
            })?;
            print_line(&format!("{tenant}: {id} is no longer a token"))
        }
    }
}
