//! The file of tokens on disk: reading it, and changing it whole or not at all.

use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::SystemTime;

use tesserae_mesh::error::{Error, Result};

use super::tokens::{TokenFile, Tokens};

/// Largest file of tokens that is read, in bytes.
const MAX_BYTES: u64 = 16 << 20;

impl TokenFile {
    /// Reads a file. What is wrong with it is named by line or tenant, never by content of a token.
    pub fn read(path: &Path) -> Result<Self> {
        let cannot = |error| Error::io(format_args!("the file of tokens cannot be read: {}", path.display()), error);
        let found = std::fs::metadata(path).map_err(cannot)?;
        // a named pipe would be waited for without end
        if !found.is_file() || found.len() > MAX_BYTES {
            return Err(Error::parameter(format_args!("tokens need a file of at most {MAX_BYTES} bytes: {path:?}")));
        }
        Self::parse(&std::fs::read(path).map_err(cannot)?)
            .map_err(|error| Error::new(error.kind, format_args!("{}: {}", error.message, path.display())))
    }

    /// Changes the file at `path`, which is made if it is not there: whole or not at all, readable by its owner only,
    /// one change after the other. Nothing changes where `change` fails, or where what it makes is not valid.
    pub fn change<T>(path: &Path, change: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let cannot = |error| Error::io(format_args!("the file of tokens cannot be written: {}", path.display()), error);
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut lock_name = path.file_name().unwrap_or_default().to_owned();
        lock_name.push(".lock");
        let lock = std::fs::File::create(folder.join(lock_name)).map_err(cannot)?;
        lock.lock().map_err(cannot)?;
        let mut file = if path.exists() { Self::read(path)? } else { Self::default() };
        let result = change(&mut file)?;
        file.index()?;
        let mut json = serde_json::to_vec_pretty(&file)
            .map_err(|error| Error::internal(format_args!("tokens cannot be written as JSON: {error}")))?;
        json.push(b'\n');
        // a temporary file is its owner's alone, and stays so under its new name
        let mut new = tempfile::NamedTempFile::new_in(folder).map_err(cannot)?;
        new.write_all(&json).map_err(cannot)?;
        new.as_file().sync_all().map_err(cannot)?;
        new.persist(path).map_err(|error| cannot(error.error)).map(|_| result)
    }
}

impl Tokens {
    /// Reads the file at `path`. One that every local user can write to is refused: each could make itself a token.
    pub fn read(path: &Path) -> Result<Self> {
        let cannot = |error| Error::io(format_args!("the file of tokens cannot be read: {}", path.display()), error);
        let mode = std::fs::metadata(path).map_err(cannot)?.permissions().mode();
        if mode & 0o002 != 0 {
            return Err(Error::parameter(format_args!(
                "every user of this machine can write to the file of tokens, and so make a token: run `chmod 600` on \
                 {}",
                path.display()
            )));
        }
        if mode & 0o024 != 0 {
            tracing::warn!(
                path = %path.display(),
                mode = format!("{:o}", mode & 0o777),
                "other users of this machine can read the file of tokens, or its group can write to it; `chmod 600` it"
            );
        }
        Self::of(&TokenFile::read(path)?)
    }
}

/// What changes when the file does: when it was written, and its length. None while it is not there.
pub(super) type Stamp = Option<(Option<SystemTime>, u64)>;

pub(super) fn stamp(path: &Path) -> Stamp {
    std::fs::metadata(path).ok().map(|metadata| (metadata.modified().ok(), metadata.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_names_the_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("tokens.json");
        std::fs::write(&path, r#"{"tenants": []}"#).expect("written");
        let error = TokenFile::read(&path).expect_err("no object");
        assert!(error.message.contains("must be an object, not array"), "{error}");
        assert!(error.message.ends_with(&path.display().to_string()), "{error}");
        assert!(TokenFile::read("/dev/zero".as_ref()).is_err(), "it has no end");
    }

    #[test]
    fn neither_the_file_nor_debug_output_tells_the_secret() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("tokens.json");
        let token = TokenFile::change(&path, |file| file.add("mine")).expect("made");
        let second = TokenFile::change(&path, |file| file.add("mine")).expect("made");
        let text = std::fs::read_to_string(&path).expect("text");
        let all = format!("{text}{token:?}{:?}", Tokens::read(&path).expect("valid"));
        for token in [token, second] {
            assert!(text.contains(&token.id));
            let secret = token.reveal().split_off("tess_".len() + token.id.len() + 1);
            assert!(secret.len() > 40 && !all.contains(&secret), "{all}");
        }
        let mode = std::fs::metadata(&path).expect("a file").permissions().mode();
        assert_eq!(mode & 0o77, 0, "its owner's alone: {mode:o}");
    }
}
