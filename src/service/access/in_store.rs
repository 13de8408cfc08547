//! Reading and changing the tokens of a store that services share.

use std::time::Duration;

use tokio::runtime::{Builder, Runtime};

use super::tokens::TokenFile;
use crate::error::{Error, Kind, Result};
use crate::service::store::postgres::{self, PostgresStore};
use crate::service::store::{Maintenance as _, Rules, StoreUrl};
use crate::service::tls;

/// The tokens in the database, which stays as it is.
pub fn read_tokens(url: &StoreUrl) -> Result<TokenFile> {
    tls::prepare();
    runtime()?.block_on(async { TokenFile::from_rows(postgres::read_tokens(url).await?) })
}

/// Changes the tokens in the database, whole or not at all, one change after the other; services take the change within
/// seconds. Nothing changes where `change` fails.
pub fn change_tokens<T, E: From<Error>>(
    url: &StoreUrl,
    change: impl FnOnce(&mut TokenFile) -> Result<T, E>,
) -> Result<T, E> {
    on_store(url, async |store| {
        let changed = store.change_tokens(|rows| {
            let mut file = TokenFile::from_rows(std::mem::take(rows))?;
            let done = change(&mut file)?;
            *rows = file.to_rows()?;
            Ok(done)
        });
        changed.await
    })
}

/// Opens the store for a piece of work, without jobs.
fn on_store<T, E: From<Error>>(url: &StoreUrl, work: impl AsyncFnOnce(&PostgresStore) -> Result<T, E>) -> Result<T, E> {
    tls::prepare();
    runtime()?.block_on(async {
        let rules = Rules { max_queued: 0, max_attempts: 1, crash_pause: Duration::ZERO };
        let store = PostgresStore::open(url, 2, rules).await?;
        let done = work(&store).await;
        store.close().await;
        done
    })
}

fn runtime() -> Result<Runtime> {
    let runtime = Builder::new_current_thread().enable_all().build();
    runtime.map_err(|error| Error::new(Kind::Io, format_args!("no runtime can be started: {error}")))
}
