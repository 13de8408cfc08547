//! A mesh that kills the process: it is given up, and the jobs beside it are not. A real process, killed for real.
#![cfg(all(unix, debug_assertions))]

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::command::Folder;
use reqwest::multipart::{Form, Part};
use reqwest::{Client, RequestBuilder};
use serde_json::Value;
use tesserae_mesh::dev::sample::{self, Sample};
use tesserae_service::TokenFile;

/// File name of the mesh that kills the process.
const KILLER: &str = "killer.obj";

/// Longer than anything here should take on a slow machine.
const PATIENCE: Duration = Duration::from_secs(240);

/// The service, which is started again whenever it dies.
struct Service {
    folder: Folder,
    address: String,
    client: Client,
    child: Child,
    deaths: usize,
}

impl Service {
    fn start(folder: Folder) -> Self {
        let (child, address) = Self::spawn(&folder);
        // the first one to come sets it
        let _ = rustls::crypto::ring::default_provider().install_default();
        let client = Client::builder().timeout(PATIENCE).build().expect("a client");
        Self { folder, address, client, child, deaths: 0 }
    }

    /// A process, and its address; an empty one if a job that it finds kills it before it listens.
    fn spawn(folder: &Folder) -> (Child, String) {
        let more = ["--data-dir", "data", "--tokens", "tokens.json", "--crash-pause", "0", "--log", "info"];
        let mut command = folder.tesserae(&["serve", "--listen", "127.0.0.1:0", "--device", "cpu"]);
        command.args(more).env("TEST_ABORT_AT_FILE", KILLER).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the binary runs");
        let mut log = BufReader::new(child.stderr.take().expect("a pipe"));
        let mut line = String::new();
        let address = loop {
            line.clear();
            if log.read_line(&mut line).expect("text") == 0 {
                break String::new();
            }
            if let Some((_, address)) = line.trim_end().split_once("listening on http://") {
                break address.split(['"', ' ']).next().unwrap_or(address).to_owned();
            }
        };
        std::thread::spawn(move || std::io::copy(&mut log, &mut std::io::sink()));
        (child, address)
    }

    /// The answer to a request, from the next process if this one dies.
    async fn ask(&mut self, request: impl Fn(&Client, &str) -> RequestBuilder) -> Value {
        let started = Instant::now();
        loop {
            if self.child.try_wait().expect("a child").is_some() {
                self.deaths += 1;
                (self.child, self.address) = Self::spawn(&self.folder);
            }
            let answer = request(&self.client, &format!("http://{}", self.address)).send().await;
            if let Ok(answer) = answer
                && let Ok(body) = answer.json::<Value>().await
            {
                return body;
            }
            assert!(started.elapsed() < PATIENCE, "no answer after {} deaths", self.deaths);
        }
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        // It may have died already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[tokio::test]
async fn a_mesh_that_kills_the_process_is_given_up_and_its_neighbours_succeed() {
    let folder = Folder::new();
    let path = folder.path("tokens.json");
    let token = |tenant: &str| TokenFile::change(&path, |file| Ok(file.add(tenant)?.reveal())).expect("made");
    let bad = token("bad");
    let may_read_metrics = |file: &mut TokenFile| {
        file.tenants.get_mut("bad").expect("just made").metrics = true;
        Ok(())
    };
    TokenFile::change(&path, may_read_metrics).expect("made");
    let good: Vec<String> = (0..4).map(|number| token(&format!("good-{number}"))).collect();
    let mut mesh = Vec::new();
    sample::write_obj(&mut mesh, &sample::generate(Sample::Sphere, 300).expect("a sphere")).expect("written");

    let mut service = Service::start(folder);
    let submit = |token: String, file: &'static str, key: usize| {
        let mesh = mesh.clone();
        move |client: &Client, address: &str| {
            let form = Form::new().part("mesh", Part::bytes(mesh.clone()).file_name(file));
            let request = client.post(format!("{address}/v1/jobs?clusters=5")).multipart(form);
            request.bearer_auth(&token).header("idempotency-key", format!("key-{key}"))
        }
    };
    // the killer in the middle, so that it dies with neighbours
    let mut jobs = Vec::new();
    for number in 0..9 {
        let (token, file) = match number {
            4 => (&bad, KILLER),
            _ => (&good[number % 4], "good.obj"),
        };
        let job = service.ask(submit(token.clone(), file, number)).await;
        assert!(job["id"].is_string(), "{job}");
        jobs.push((token.clone(), job["id"].as_str().expect("an id").to_owned()));
    }
    for (number, (token, id)) in jobs.iter().enumerate() {
        let started = Instant::now();
        let ended = loop {
            let get = |client: &Client, address: &str| client.get(format!("{address}/v1/jobs/{id}")).bearer_auth(token);
            let job = service.ask(get).await;
            if !["queued", "running"].contains(&job["state"].as_str().expect("a state")) {
                break job;
            }
            assert!(started.elapsed() < PATIENCE, "it does not end: {job}");
            tokio::time::sleep(Duration::from_millis(10)).await;
        };
        match number {
            4 => assert_eq!(ended["problem"]["type"], "/problems/poison", "{ended}"),
            _ => assert_eq!(ended["state"], "succeeded", "{ended}"),
        }
    }
    assert!((3..=6).contains(&service.deaths), "it died {} times", service.deaths);
    let metrics = service.client.get(format!("http://{}/metrics", service.address)).bearer_auth(&bad).send();
    let metrics = metrics.await.expect("it lives").text().await.expect("text");
    for name in ["poison", "attempts_failed"] {
        let line = format!("\ntesserae_{name}_total{{reason=\"unavailable\"}} 1\n");
        assert!(metrics.contains(&line), "{line:?} is missing:\n{metrics}");
    }
    // what was given up is run again on request, and kills again, and only itself
    let (token, id) = &jobs[4];
    let retry =
        |client: &Client, address: &str| client.post(format!("{address}/v1/jobs/{id}/retry")).bearer_auth(token);
    let deaths = service.deaths;
    let job = service.ask(retry).await;
    assert!(job["state"] != "succeeded", "{job}");
    let started = Instant::now();
    while service.deaths < deaths + 3 {
        let get = |client: &Client, address: &str| client.get(format!("{address}/v1/jobs/{id}")).bearer_auth(token);
        service.ask(get).await;
        assert!(started.elapsed() < PATIENCE, "it died {} times", service.deaths);
    }
}
