//! `tesserae serve` as a process: where it listens, and how it ends.
#![cfg(unix)]

mod cli_support;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};

use cli_support::Folder;

/// The service in a process of its own; killed when the test ends before it does.
struct Running {
    child: Child,
    address: String,
    /// What it wrote up to the address, and what it writes afterwards.
    log: BufReader<std::process::ChildStderr>,
}

impl Running {
    fn start(folder: &Folder) -> Self {
        Self::with(folder, &[])
    }

    fn with(folder: &Folder, more: &[&str]) -> Self {
        let mut command = folder.tesserae(&["serve", "--listen", "127.0.0.1:0", "--device", "cpu"]);
        command.args(more);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the binary runs");
        let mut log = BufReader::new(child.stderr.take().expect("a pipe"));
        let mut line = String::new();
        while !line.contains("listening on http://") {
            line.clear();
            assert_ne!(log.read_line(&mut line).expect("text"), 0, "it ended before it listened");
        }
        let (_, rest) = line.split_once("listening on http://").expect("just found");
        let address = rest.split([' ', '"', '\n']).next().expect("an address").to_owned();
        Self { child, address, log }
    }

    /// The whole answer to a request without a body.
    fn get(&self, path: &str) -> String {
        self.get_with(path, "")
    }

    /// The same with more lines in the head.
    fn get_with(&self, path: &str, head: &str) -> String {
        let mut stream = TcpStream::connect(&self.address).expect("it listens");
        write!(stream, "GET {path} HTTP/1.0\r\nHost: {}\r\n{head}\r\n", self.address).expect("it reads");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("it answers");
        answer
    }

    /// Sends a signal and gives the exit status and the rest of the log.
    fn end(mut self, signal: &str) -> (Option<i32>, String) {
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

#[test]
fn it_says_where_it_listens_and_ends_in_order_when_asked() {
    for signal in ["-TERM", "-INT"] {
        let folder = Folder::new();
        let service = Running::start(&folder);
        assert!(service.get("/readyz").starts_with("HTTP/1.0 200 "));
        let device = service.get("/v1/device");
        assert!(device.contains(r#""kind":"cpu""#) && device.contains("asked for: cpu"), "{device}");
        let (status, log) = service.end(signal);
        assert_eq!(status, Some(0), "{signal}: {log}");
        assert!(!log.contains('\u{1b}'), "colours are for terminals: {log}");
        assert!(folder.files().is_empty());
    }
}

#[test]
fn tokens_are_made_listed_and_taken_back() {
    let folder = Folder::new();
    let made = folder.run(&["token", "new", "acme", "--tokens", "tokens.json"]);
    let token = String::from_utf8(made.expect_success()).expect("text").trim().to_owned();
    let id = token.strip_prefix("tess_").and_then(|rest| rest.split('_').next()).expect("an id").to_owned();
    assert!(!String::from_utf8_lossy(&folder.read("tokens.json")).contains(&token[22..]));
    folder.run(&["token", "new", "acme", "--tokens", "tokens.json", "--metrics"]).expect_success();
    let listed = folder.run(&["token", "list", "--tokens", "tokens.json"]);
    assert!(listed.text().starts_with(&format!("acme: {id} ")), "{}", listed.text());
    folder.run(&["token", "revoke", &id, "--tokens", "tokens.json"]).expect_success();
    folder.run(&["token", "revoke", &id, "--tokens", "tokens.json"]).expect_failure(&[&id]);
    folder.run(&["token", "new", "a b", "--tokens", "tokens.json"]).expect_failure(&["a b"]);
    folder.run(&["token", "new", "acme"]).expect_usage_error(&["--tokens"]);
    folder.run(&["token", "list", "--tokens", "missing.json"]).expect_failure(&["missing.json"]);
    folder.run(&["serve", "--tokens", "missing.json", "--log", "off"]).expect_failure(&["missing.json"]);
    folder.run(&["serve", "--listen", "0.0.0.0:0"]).expect_usage_error(&["--insecure-no-auth"]);
}

#[test]
fn tokens_are_never_logged() {
    for format in ["text", "json"] {
        let folder = Folder::new();
        let made = folder.run(&["token", "new", "acme", "--tokens", "tokens.json"]);
        let token = String::from_utf8(made.expect_success()).expect("text").trim().to_owned();
        let more = ["--tokens", "tokens.json", "--log", "trace", "--log-format", format];
        let service = Running::with(&folder, &more);
        let wrong = format!("{}x", &token[..token.len() - 4]);
        let good = service.get_with("/v1/jobs", &format!("Authorization: Bearer {token}\r\n"));
        assert!(good.starts_with("HTTP/1.0 200 "), "{good}");
        let bad = service.get_with("/v1/jobs", &format!("Authorization: Bearer {wrong}\r\n"));
        assert!(bad.starts_with("HTTP/1.0 401 "), "{bad}");
        service.get_with("/nothing", &format!("Authorization: Bearer {token}\r\nContent-Length: x\r\n"));
        let (status, log) = service.end("-TERM");
        assert_eq!(status, Some(0));
        assert!(log.contains("/v1/jobs") && log.contains("acme"), "requests and tenants are logged: {log}");
        assert!(!log.contains(&token[22..]) && !log.contains(&wrong[22..]), "{log}");
    }
}

#[test]
fn an_address_in_use_and_a_wrong_filter_are_told() {
    let folder = Folder::new();
    let service = Running::start(&folder);
    folder
        .run(&["serve", "--device", "cpu", "--listen", &service.address, "--log", "off"])
        .expect_failure(&["cannot listen on", &service.address]);
    folder.run(&["serve", "--log", "a=b=c"]).expect_usage_error(&["a=b=c"]);
    folder.run(&["serve", "--listen", "nowhere"]).expect_usage_error(&["--listen", "nowhere"]);
    folder.run(&["serve", "--device", "cpu", "--adapter", "0"]).expect_usage_error(&["--adapter"]);
    assert_eq!(service.end("-TERM").0, Some(0));
}
