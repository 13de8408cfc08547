//! What can be found wrong before the device is opened, which takes seconds: files, folder and address.

use std::net::TcpListener;
use std::path::{Path, PathBuf};

use tesserae_mesh::error::{Error, Result};

use crate::files::check_reserve;
use crate::guard::access::tokens::Tokens;
use crate::settings::Settings;
use crate::work::webhooks::Webhooks;

/// Checks that the service can have what the settings name. It can still fail later: others may take it meanwhile.
pub fn preflight(settings: &Settings) -> Result<()> {
    settings.check()?;
    if let Some(path) = &settings.access.tokens {
        Tokens::read(path)?;
    }
    crate::ops::tls::prepare();
    Webhooks::new(&settings.webhooks)?;
    let folder = match &settings.data_dir {
        Some(folder) => check_folder(folder)?,
        None => std::env::temp_dir(),
    };
    check_reserve(&folder, settings.storage.min_free_bytes)?;
    let cannot = |error| Error::io(format_args!("cannot listen on {}", settings.listen), error);
    TcpListener::bind(settings.listen).map(drop).map_err(cannot)
}

/// Whether something can be written into the folder, or into the nearest one above it that is there; gives that one.
fn check_folder(folder: &Path) -> Result<PathBuf> {
    let check = || {
        let path = std::path::absolute(folder)?;
        let there = path.ancestors().find(|folder| folder.exists()).unwrap_or(&path);
        tempfile::tempfile_in(there).map(|_| there.to_owned())
    };
    check().map_err(|error| {
        Error::io(format_args!("nothing can be written into the data folder (--data-dir): {}", folder.display()), error)
    })
}
