//! Running the real binary in a folder of its own.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use tempfile::TempDir;

/// A folder that is gone after the test; commands run in it.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The command, without any setting of the surroundings. `TESSERAE_TEST_COMMAND` may name another binary, after
    /// what runs it.
    pub fn tesserae(&self, arguments: &[&str]) -> Command {
        let other = std::env::var("TESSERAE_TEST_COMMAND").unwrap_or_default();
        let mut words = other.split_whitespace();
        let mut command = Command::new(words.next().unwrap_or(env!("CARGO_BIN_EXE_tesserae")));
        command.args(words);
        command.args(arguments).current_dir(self.0.path()).stdin(Stdio::null());
        for (name, _) in std::env::vars_os() {
            if name.to_string_lossy().starts_with("TESSERAE_") {
                command.env_remove(name);
            }
        }
        command
    }

    /// What the command puts out.
    pub fn run(&self, arguments: &[&str]) -> Done {
        Done::of(self.tesserae(arguments).output().expect("the binary runs"))
    }

    /// What the command puts out when it is fed.
    pub fn run_with_input(&self, arguments: &[&str], input: &[u8]) -> Done {
        let mut child = self
            .tesserae(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the binary runs");
        let mut stdin = child.stdin.take().expect("a pipe");
        let input = input.to_vec();
        let feeder = std::thread::spawn(move || stdin.write_all(&input));
        let done = Done::of(child.wait_with_output().expect("the binary ends"));
        feeder.join().expect("no panic").expect("all input is read");
        done
    }

    /// A sample of that name, made by the command itself.
    pub fn sample(&self, name: &str, faces: u64, out: &str) {
        self.run(&["sample", name, "--faces", &faces.to_string(), out]).expect_success();
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).expect("a writable folder");
    }

    pub fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.read(name)).expect("JSON")
    }

    /// Names of the files that are there.
    pub fn files(&self) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(self.0.path())
            .expect("a folder")
            .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    pub fn root(&self) -> &Path {
        self.0.path()
    }
}

/// How a command ended.
#[derive(Debug)]
pub struct Done {
    pub status: Option<i32>,
    pub stdout: Vec<u8>,
    pub stderr: String,
}

impl Done {
    pub fn of(output: Output) -> Self {
        // Wayland's client library, which Mesa loads to find displays, complains here where there is none.
        let stderr = String::from_utf8(output.stderr).expect("text");
        let stderr = stderr.lines().filter(|line| !line.contains("XDG_RUNTIME_DIR"));
        Self {
            status: output.status.code(),
            stdout: output.stdout,
            stderr: stderr.map(|line| format!("{line}\n")).collect(),
        }
    }

    pub fn text(&self) -> &str {
        std::str::from_utf8(&self.stdout).expect("text")
    }

    /// Exit status 0 and nothing on standard error; gives standard output.
    #[track_caller]
    pub fn expect_success(self) -> Vec<u8> {
        assert_eq!((self.status, self.stderr.as_str()), (Some(0), ""), "{self:?}");
        self.stdout
    }

    /// Exit status 1 and a single line on standard error that contains all of `words`.
    #[track_caller]
    pub fn expect_failure(self, words: &[&str]) {
        assert_eq!(self.status, Some(1), "{self:?}");
        assert_eq!(self.stderr.lines().count(), 1, "{self:?}");
        assert!(self.stderr.starts_with("tesserae: "), "{self:?}");
        assert!(words.iter().all(|word| self.stderr.contains(word)), "{words:?}: {self:?}");
        assert!(self.stdout.is_empty(), "{self:?}");
    }

    /// Exit status 2 and all of `words` on standard error.
    #[track_caller]
    pub fn expect_usage_error(self, words: &[&str]) {
        assert_eq!(self.status, Some(2), "{self:?}");
        assert!(words.iter().all(|word| self.stderr.contains(word)), "{words:?}: {self:?}");
        assert!(self.stdout.is_empty(), "{self:?}");
    }
}
