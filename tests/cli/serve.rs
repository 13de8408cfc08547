//! `tesserae serve` as a process: where it listens, and how it ends.
#![cfg(unix)]

use std::ffi::OsStr;
use std::io::ErrorKind::WouldBlock;
use std::io::{BufRead, BufReader, Read as _, Write};
use std::net::TcpStream;
use std::os::unix::ffi::OsStrExt as _;
use std::process::Command;

use crate::command::Folder;
use crate::running::Running;

#[test]
fn it_says_where_it_listens_and_ends_in_order_when_asked() {
    for signal in ["-TERM", "-INT"] {
        let folder = Folder::new();
        let service = Running::start(&folder);
        assert!(service.get("/readyz").starts_with("HTTP/1.0 200 "));
        let device = service.get("/v1/device");
        assert!(device.contains(r#""kind":"cpu""#) && device.contains("asked for: cpu"), "{device}");
        folder.run(&["health", "--listen", &service.address]).expect_success();
        folder.run(&["health", "--ready", "--listen", &service.address]).expect_success();
        let address = service.address.clone();
        let (status, log) = service.end(signal);
        folder.run(&["health", "--listen", &address]).expect_failure(&["does not answer", &address]);
        assert_eq!(status, Some(0), "{signal}: {log}");
        assert!(!log.contains('\u{1b}'), "colours are for terminals: {log}");
        assert!(folder.files().is_empty());
    }
}

#[test]
fn a_second_request_to_stop_ends_the_drain_delay() {
    for signal in ["-TERM", "-INT"] {
        let folder = Folder::new();
        let mut service = Running::with(&folder, &["--drain-delay", "3600"]);
        let id = service.child.id().to_string();
        let send = || assert!(Command::new("kill").args([signal, &id]).status().expect("kill runs").success());
        send();
        let mut line = String::new();
        while !line.contains("stopping") {
            line.clear();
            assert_ne!(service.log.read_line(&mut line).expect("text"), 0, "it ended at once");
        }
        while service.get("/readyz").starts_with("HTTP/1.0 200 ") {}
        assert!(service.get("/v1/jobs").starts_with("HTTP/1.0 200 "), "it still answers");
        let (status, log) = service.end(signal);
        assert_eq!(status, Some(0), "{log}");
        assert!(log.contains("drain delay"), "{log}");
    }
}

#[test]
fn a_temporary_folder_is_private_and_goes_with_the_service() {
    use std::os::unix::fs::PermissionsExt as _;

    let folder = Folder::new();
    std::fs::create_dir(folder.path("tmp")).expect("a folder");
    let mut command = Running::command(&folder);
    command.env("TMPDIR", folder.path("tmp"));
    let service = Running::spawn(command);
    let there =
        || std::fs::read_dir(folder.path("tmp")).expect("a folder").map(|entry| entry.expect("an entry").path());
    let mode = there().next().expect("there").metadata().expect("there").permissions().mode();
    assert_eq!(mode & 0o777, 0o700);
    assert_eq!(service.end("-TERM").0, Some(0));
    assert_eq!(there().count(), 0);
}

#[test]
fn a_backup_is_made_while_the_service_runs_and_a_service_starts_on_it() {
    let folder = Folder::new();
    folder.sample("sphere", 300, "sphere.obj");
    folder.run(&["backup", "--data-dir", "data", "backup"]).expect_failure(&["no store of jobs", "data"]);
    assert!(!folder.path("backup").exists());
    let service = Running::with(&folder, &["--data-dir", "data"]);
    let answer = service.post("clusters=5", "Prefer: wait=60\r\n", &folder.read("sphere.obj"));
    assert!(answer.starts_with("HTTP/1.0 200 "), "{answer}");
    let made = folder.run(&["backup", "--data-dir", "data", "backup"]);
    assert!(made.text().starts_with("jobs: 1, files: 0,"), "{made:?}");
    folder.run(&["backup", "--data-dir", "data", "backup"]).expect_failure(&["not empty", "backup"]);
    // names that SQLite would take for something else, or that are not Unicode
    let strange = [OsStr::from_bytes(b"b\xff"), OsStr::new("file:b"), OsStr::new("file:c?mode=memory")];
    for name in strange {
        let mut command = folder.tesserae(&["backup", "--data-dir", "data"]);
        let made = command.arg(name).output().expect("the binary runs");
        assert!(made.status.success(), "{made:?}");
        assert!(folder.root().join(name).join("jobs.sqlite3").metadata().is_ok_and(|store| store.len() > 0));
    }
    let told = service.get("/v1/jobs");
    assert_eq!(service.end("-TERM").0, Some(0));
    let service = Running::with(&folder, &["--data-dir", "backup"]);
    let body = |answer: &str| answer.split_once("\r\n\r\n").expect("a body").1.to_owned();
    assert_eq!(body(&service.get("/v1/jobs")), body(&told));
    assert_eq!(service.end("-TERM").0, Some(0));
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
    for name in ["a b", ".."] {
        folder.run(&["token", "new", name, "--tokens", "tokens.json"]).expect_usage_error(&[name, "1 to 64 letters"]);
    }
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
        service.get_with(&format!("/v1/jobs/{token}?token={token}"), &format!("X-Request-Id: {token}\r\n"));
        let (status, log) = service.end("-TERM");
        assert_eq!(status, Some(0));
        assert!(log.contains("/v1/jobs") && log.contains("acme"), "requests and tenants are logged: {log}");
        assert!(!log.contains(&token[22..]) && !log.contains(&wrong[22..]), "{log}");
        // the span of the request names it, once
        let answers: Vec<&str> = log.lines().filter(|line| line.contains("tesserae::access")).collect();
        assert!(answers.iter().any(|line| line.contains("401")), "{log}");
        assert!(answers.iter().any(|line| line.contains(&token[5..21])), "the id of the token: {log}");
        assert!(answers.iter().all(|line| line.matches("method").count() == 1), "{answers:#?}");
    }
}

#[test]
fn an_address_in_use_and_a_wrong_filter_are_told() {
    let folder = Folder::new();
    let service = Running::start(&folder);
    folder
        .run(&["serve", "--device", "cpu", "--listen", &service.address, "--log", "off"])
        .expect_failure(&["cannot listen on", &service.address]);
    for wrong in ["a=b=c", "infoo", "warn,wgpu_core"] {
        folder.run(&["serve", "--log", wrong]).expect_usage_error(&["log filter", wrong]);
    }
    folder.run(&["serve", "--listen", "nowhere"]).expect_usage_error(&["--listen", "nowhere"]);
    folder.run(&["serve", "--device", "cpu", "--adapter", "0"]).expect_usage_error(&["--adapter"]);
    assert_eq!(service.end("-TERM").0, Some(0));
}

/// Takes webhooks, and leaves it to the test to answer.
fn receiver() -> (String, std::sync::mpsc::Receiver<(String, TcpStream)>) {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("bound");
    let address = listener.local_addr().expect("an address").to_string();
    let (sender, deliveries) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = BufReader::new(stream.expect("accepted"));
            let mut head = String::new();
            while !head.ends_with("\r\n\r\n") && stream.read_line(&mut head).unwrap_or(0) > 0 {}
            if sender.send((head, stream.into_inner())).is_err() {
                return;
            }
        }
    });
    (address, deliveries)
}

#[test]
fn settings_that_cannot_be_are_told() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = Folder::new();
    for (flag, value) in [("--max-queued-jobs", "0"), ("--max-faces", "0")] {
        folder.run(&["serve", flag, value]).expect_usage_error(&[flag, value]);
    }
    let all = u64::MAX.to_string();
    for data in [&["--data-dir", "data"][..], &[]] {
        let serve = ["serve", "--log", "off", "--device", "cpu", "--listen", "127.0.0.1:0", "--min-free-bytes", &all];
        let done = folder.run(&[&serve[..], data].concat());
        assert!(!done.stderr.contains("disk of ."), "{done:?}");
        done.expect_failure(&["--min-free-bytes", "give less than", &all]);
    }
    folder.run(&["token", "new", "acme", "--tokens", "tokens.json"]).expect_success();
    let permit = |mode| {
        let permissions = std::fs::Permissions::from_mode(mode);
        std::fs::set_permissions(folder.path("tokens.json"), permissions).expect("changed");
    };
    permit(0o666);
    let serve = ["serve", "--device", "cpu", "--listen", "127.0.0.1:0", "--log", "off"];
    let with = |more: &[&str]| folder.run(&[&serve[..], more].concat());
    with(&["--tokens", "tokens.json"]).expect_failure(&["tokens.json", "chmod 600"]);
    with(&["--tokens", "missing.json"]).expect_failure(&["missing.json"]);
    with(&["--data-dir", "/dev/null/x"]).expect_failure(&["/dev/null/x"]);
    permit(0o644);
    let service = Running::with(&folder, &["--tokens", "tokens.json"]);
    assert!(service.start.contains("can read the file of tokens"), "{}", service.start);
}

#[test]
fn settings_without_effect_are_warned_about() {
    let folder = Folder::new();
    std::fs::write(folder.path("secret"), "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw\n").expect("written");
    let mut command = folder.tesserae(&["serve", "--device", "cpu", "--data-dir", "/dev/null/x"]);
    let output = command.env("TESSERAE_MAX_QUEUE_JOBS", "5").output().expect("the binary runs");
    let log = String::from_utf8(output.stderr).expect("text");
    assert!(log.contains("TESSERAE_MAX_QUEUE_JOBS") && log.contains("TESSERAE_MAX_QUEUED_JOBS"), "{log}");
    for (hosts, is_secret_unused) in [(&[][..], true), (&["--webhook-hosts", "hooks.example"], false)] {
        let service = Running::with(&folder, &[&["--webhook-secret", "secret"], hosts].concat());
        assert_eq!(service.start.contains("no webhook is sent"), is_secret_unused, "{}", service.start);
    }
}

#[test]
fn a_webhook_is_told_after_the_service_was_killed_while_it_told_it() {
    let (address, deliveries) = receiver();
    let next = || deliveries.recv_timeout(std::time::Duration::from_secs(120)).expect("told");
    let id = |head: &str| {
        let line = head.lines().find(|line| line.to_ascii_lowercase().starts_with("webhook-id: "));
        line.expect("an id").to_owned()
    };
    let folder = Folder::new();
    folder.write("secret", "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw");
    folder.sample("sphere", 300, "sphere.obj");
    let host = format!("http://{address}");
    let settings = ["--data-dir", "data", "--webhook-hosts", &host, "--webhook-secret", "secret"];
    let service = Running::with(&folder, &settings);
    let answer = service.post(&format!("clusters=5&webhook={host}/"), "", &folder.read("sphere.obj"));
    assert!(answer.starts_with("HTTP/1.0 202 "), "{answer}");
    let (first, unanswered) = next();
    service.end("-KILL");
    drop(unanswered);

    let service = Running::with(&folder, &settings);
    let (second, mut stream) = next();
    assert_eq!(id(&first), id(&second), "the same end");
    stream.write_all(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\nConnection: close\r\n\r\n").expect("answered");
    let started = std::time::Instant::now();
    while !service.get("/metrics").contains("\ntesserae_webhooks_pending 0\n") {
        assert!(started.elapsed() < std::time::Duration::from_secs(120), "it is not settled");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert_eq!(service.end("-TERM").0, Some(0));
    let service = Running::with(&folder, &settings);
    assert!(service.get("/metrics").contains("\ntesserae_webhooks_pending 0\n"), "what was told is not told again");
    assert_eq!(service.end("-TERM").0, Some(0));
}

#[test]
fn lines_of_the_log_about_a_request_and_its_job_have_the_caller_s_trace() {
    let folder = Folder::new();
    let service = Running::with(&folder, &["--log-format", "json"]);
    folder.sample("sphere", 300, "sphere.obj");
    let (trace, parent) = ("0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331");
    let head = format!("Prefer: wait=60\r\ntraceparent: 00-{trace}-{parent}-01\r\n");
    let answer = service.post("clusters=5", &head, &folder.read("sphere.obj"));
    assert!(answer.starts_with("HTTP/1.0 200 "), "{answer}");
    let id = answer.lines().find_map(|line| line.strip_prefix("x-request-id: ")).expect("an id").trim().to_owned();
    let id_of = |head: &str| {
        let answer = service.get_with("/v1/version", head);
        let id = answer.lines().find_map(|line| line.strip_prefix("x-request-id: "));
        id.unwrap_or_else(|| panic!("no id: {answer}")).trim().to_owned()
    };
    assert_eq!(id_of("X-Request-Id: of-a-proxy\r\n"), "of-a-proxy");
    for other in ["", "ü", &"x".repeat(257), "tess_one_secret"] {
        assert_eq!(id_of(&format!("X-Request-Id: {other}\r\n")).len(), 36, "a new one for {other:?}");
    }
    let (status, log) = service.end("-TERM");
    assert_eq!(status, Some(0), "{log}");
    for id in [&*id, "of-a-proxy"] {
        assert!(log.lines().any(|line| line.contains("answered") && line.contains(id)), "{id}: {log}");
    }

    let lines: Vec<serde_json::Value> = log.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    for message in ["answered", "succeeded"] {
        let line = lines
            .iter()
            .find(|line| line["fields"]["message"] == message)
            .unwrap_or_else(|| panic!("{message}: {log}"));
        let of_spans = line["spans"].as_array().into_iter().flatten().map(|span| &span["trace"]);
        assert!(of_spans.chain([&line["fields"]["trace"]]).any(|found| found == trace), "{line}");
        assert!(line.get("span").is_none(), "a span is written once: {line}");
    }
}

/// `command` with a limit of open files.
#[cfg(target_os = "linux")]
fn with_files(files: u32, command: Command) -> Command {
    let mut limited = Command::new("sh");
    limited.arg("-c").arg(format!("ulimit -n {files} && exec \"$0\" \"$@\""));
    limited.arg(command.get_program()).args(command.get_args());
    limited.current_dir(command.get_current_dir().expect("a folder"));
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => limited.env(name, value),
            None => limited.env_remove(name),
        };
    }
    limited
}

#[cfg(target_os = "linux")]
#[test]
fn connections_leave_open_files_to_jobs() {
    let folder = Folder::new();
    let few = with_files(500, Running::command(&folder)).output().expect("it runs");
    let refusal = String::from_utf8(few.stderr).expect("text");
    assert!(!few.status.success() && refusal.contains("too few files") && refusal.contains("500"), "{refusal}");

    let service = Running::spawn(with_files(600, Running::command(&folder)));
    let open_files = || std::fs::read_dir(format!("/proc/{}/fd", service.child.id())).expect("it runs").count();
    // as many as would take all of them, each with half a request
    let connections: Vec<TcpStream> = (0..800)
        .map(|_| {
            let mut stream = TcpStream::connect(&service.address).expect("it listens");
            stream.write_all(b"GET /v1/jobs HT").expect("it reads");
            stream.set_nonblocking(true).expect("set");
            stream
        })
        .collect();
    let mut most = 0;
    let is_open = |mut stream: &TcpStream| stream.read(&mut [0; 999]).is_err_and(|error| error.kind() == WouldBlock);
    while connections.iter().any(is_open) {
        most = most.max(open_files());
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(most < 400, "{most}");
    let (_, log) = service.end("-TERM");
    assert!(!log.contains("cannot be accepted"), "{log}");
}
