//! A PostgreSQL server of a test: of Debian's package, in a temporary folder, on a socket there; stopped when dropped.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};

use tempfile::TempDir;

use crate::store::StoreUrl;

/// A server without any client but the test.
pub(super) struct Server {
    folder: TempDir,
    programs: PathBuf,
    databases: AtomicUsize,
}

impl Server {
    /// Starts one; none, with a notice, where PostgreSQL is not installed.
    pub fn start() -> Option<Self> {
        let Some(programs) = programs() else {
            println!("skipped: PostgreSQL is not installed (deploy/install-missing.sh test installs it)");
            return None;
        };
        let folder = tempfile::tempdir().expect("a folder");
        if rustix::process::getuid().is_root() {
            std::os::unix::fs::chown(folder.path(), Some(UNPRIVILEGED), Some(UNPRIVILEGED)).expect("it is ours");
        }
        let server = Self { folder, programs, databases: AtomicUsize::new(0) };
        let data = server.data();
        server.run("initdb", &["--no-sync", "--auth=trust", "--encoding=UTF8", "--username=tesserae", "-D", &data]);
        server.up();
        Some(server)
    }

    /// Starts it again after [`down`](Self::down).
    pub fn up(&self) {
        let folder = self.folder.path().display();
        let options =
            format!("-c listen_addresses= -c unix_socket_directories={folder} -c fsync=off -c max_connections=300");
        self.run("pg_ctl", &["-w", "-s", "-D", &self.data(), "-l", &format!("{folder}/log"), "-o", &options, "start"]);
    }

    /// Stops it, as a crash does.
    pub fn down(&self) {
        self.run("pg_ctl", &["-w", "-s", "-D", &self.data(), "-m", "immediate", "stop"]);
    }

    /// The URL of a new database.
    pub fn database(&self) -> StoreUrl {
        let name = format!("test{}", self.databases.fetch_add(1, Ordering::Relaxed));
        let folder = self.folder.path().display().to_string();
        self.run("createdb", &["-h", &folder, "-U", "tesserae", "--strategy=file_copy", &name]);
        let host = folder.replace('/', "%2F");
        format!("postgres://tesserae@{host}/{name}").parse().expect("any text")
    }

    fn data(&self) -> String {
        self.folder.path().join("data").display().to_string()
    }

    /// Runs a program of the package, as a user that is not root.
    fn run(&self, program: &str, arguments: &[&str]) {
        let mut command = Command::new(self.programs.join(program));
        command.args(arguments).current_dir(self.folder.path()).stdin(Stdio::null()).stdout(Stdio::null());
        if rustix::process::getuid().is_root() {
            std::os::unix::process::CommandExt::uid(&mut command, UNPRIVILEGED);
        }
        let status = command.status().expect("it starts");
        assert!(status.success(), "{program} {arguments:?}: {status}");
    }
}

/// The user that the server is of when the tests are root's, for which it refuses to run.
const UNPRIVILEGED: u32 = 65_534;

impl Drop for Server {
    fn drop(&mut self) {
        if self.folder.path().join("data/postmaster.pid").exists() {
            self.down();
        }
    }
}

/// The folder of the programs: of the newest version that Debian's packages installed, or one in the search path.
fn programs() -> Option<PathBuf> {
    let versions = std::fs::read_dir("/usr/lib/postgresql").into_iter().flatten().flatten();
    let mut found: Vec<(u32, PathBuf)> = versions
        .filter_map(|entry| Some((entry.file_name().to_str()?.parse().ok()?, entry.path().join("bin"))))
        .filter(|(version, folder)| *version >= 15 && folder.join("initdb").exists())
        .collect();
    found.sort();
    let in_path = || {
        let path = std::env::var_os("PATH")?;
        std::env::split_paths(&path).find(|folder: &PathBuf| Path::join(folder, "initdb").exists())
    };
    found.pop().map(|(_, folder)| folder).or_else(in_path)
}
