//! `tesserae serve` in a process of its own, and requests to it.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::Duration;

use crate::command::Folder;

/// Longer than an answer takes on a slow machine.
const PATIENCE: Duration = Duration::from_secs(180);

/// The service in a process of its own; killed when the test ends before it does.
pub struct Running {
    pub child: Child,
    pub address: String,
    /// What it wrote up to the address.
    pub start: String,
    /// What it writes afterwards.
    pub log: BufReader<ChildStderr>,
}

impl Running {
    pub fn start(folder: &Folder) -> Self {
        Self::with(folder, &[])
    }

    pub fn with(folder: &Folder, more: &[&str]) -> Self {
        let mut command = Self::command(folder);
        command.args(more);
        Self::spawn(command)
    }

    pub fn command(folder: &Folder) -> Command {
        folder.tesserae(&["serve", "--listen", "127.0.0.1:0", "--device", "cpu"])
    }

    pub fn spawn(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the binary runs");
        let mut log = BufReader::new(child.stderr.take().expect("a pipe"));
        let mut start = String::new();
        while !start.contains("listening on http://") {
            assert_ne!(log.read_line(&mut start).expect("text"), 0, "it ended before it listened: {start}");
        }
        let (_, rest) = start.split_once("listening on http://").expect("just found");
        let address = rest.split([' ', '"', '\n']).next().expect("an address").to_owned();
        Self { child, address, start, log }
    }

    /// The whole answer to a request without a body.
    pub fn get(&self, path: &str) -> String {
        self.get_with(path, "")
    }

    /// The same with more lines in the head.
    pub fn get_with(&self, path: &str, head: &str) -> String {
        self.send(&format!("GET {path} HTTP/1.0"), head, &[])
    }

    /// The whole answer to an OBJ that is posted as a job, with more lines in the head.
    pub fn post(&self, query: &str, head: &str, obj: &[u8]) -> String {
        let head = format!("Content-Type: model/obj\r\nContent-Length: {}\r\n{head}", obj.len());
        self.send(&format!("POST /v1/jobs?{query} HTTP/1.0"), &head, obj)
    }

    fn send(&self, line: &str, head: &str, body: &[u8]) -> String {
        let mut stream = TcpStream::connect(&self.address).expect("it listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a time");
        write!(stream, "{line}\r\nHost: {}\r\n{head}\r\n", self.address).expect("it reads");
        stream.write_all(body).expect("it reads");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("it answers");
        answer
    }

    /// Sends a signal and gives the exit status and the rest of the log.
    pub fn end(mut self, signal: &str) -> (Option<i32>, String) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args([signal, &id]).status().expect("kill runs").success());
        let mut log = String::new();
        self.log.read_to_string(&mut log).expect("text");
        (self.child.wait().expect("it ends").code(), log)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
