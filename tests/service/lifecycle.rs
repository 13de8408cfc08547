//! Start and stop.

use std::time::{Duration, Instant};

use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_service::{Extras, Server, Settings};
use tokio::net::TcpStream;

use crate::support::*;

#[tokio::test]
async fn an_idle_service_stops_at_once_and_keeps_results_where_it_was_told_to() {
    let mut service = Service::with(|settings| settings.grace_period = 3600, Box::new(CpuDevice::new())).await;
    let job = service.submit("clusters=5", sphere(80_000)).await;
    service.ended(&job).await;
    service.keeps_no("uploads").await;
    let files = service.files();
    assert!(!files.is_empty());
    service.stopped().await;
    assert_eq!(service.files(), files);
    assert!(service.get("/healthz").send().await.is_err(), "it does not listen any more");
}

/// A connection that ends has two seconds for what its client still sends; the least time of three tells.
#[tokio::test]
async fn a_service_stops_without_waiting_for_clients_that_keep_their_connections() {
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    let mut least = Duration::MAX;
    for _ in 0..3 {
        let mut service = Service::start().await;
        let mut kept = TcpStream::connect(service.address).await.expect("connected");
        kept.write_all(b"GET /v1/version HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n").await.expect("sent");
        assert!(kept.read(&mut [0; 4096]).await.expect("answered") > 0);
        let stopping = Instant::now();
        service.stopped().await;
        least = least.min(stopping.elapsed());
    }
    // the last moment, which a stop waits for what does not end, is 2 s
    assert!(least < Duration::from_secs(2), "{least:?}");
}

#[tokio::test]
async fn without_a_folder_nothing_outlasts_the_service() {
    let mut service = Service::with(|settings| settings.data_dir = None, Box::new(CpuDevice::new())).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    assert_eq!(service.ended(&job).await["state"], "succeeded");
    assert!(json(service.get(text(&job["urls"]["labels"]))).await["labels"].is_array());
    assert!(service.files().is_empty(), "the folder is another one");
    service.stopped().await;
}

#[tokio::test]
async fn a_stopping_service_finishes_running_jobs_takes_none_and_says_so() {
    // The service runs on this thread, as the test does.
    let log = Log::default();
    let subscriber = tracing_subscriber::fmt().with_writer(log.clone()).with_ansi(false).finish();
    let _logging = tracing::subscriber::set_default(subscriber);
    let (device, gate) = Held::behind_gate();
    let mut service = Service::with(|settings| settings.meshes_in_memory = 1, device).await;
    let running = service.submit("clusters=5", sphere(300)).await;
    service.reaches(&running, "running").await;
    service.submit("clusters=5", sphere(300)).await;
    service.ask_to_stop();
    let started = Instant::now();
    loop {
        let response = service.get("/readyz").send().await.expect("answered");
        if response.status() == 503 {
            assert!(problem(response, 503, "unavailable").await.contains("stopping"));
            break;
        }
        assert!(started.elapsed() < PATIENCE);
    }
    let request = service.obj("clusters=5", sphere(300));
    refused(request, 503, "unavailable").await;
    assert_eq!(service.get("/healthz").send().await.expect("answered").status(), 200);
    gate.open();
    // the running job ends; the queued one is not begun
    service.stopped().await;
    let log = log.text();
    assert!(log.contains("INFO") && log.contains("stopped"), "{log}");
    assert!(!log.contains("ERROR"), "refusals while it stops are no errors: {log}");
}

#[tokio::test]
async fn what_does_not_end_within_the_grace_period_runs_again_after_a_restart() {
    let (device, gate) = Held::behind_gate();
    let mut service = Service::with(|settings| settings.grace_period = 1, device).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    service.reaches(&job, "running").await;
    let started = Instant::now();
    service.stopped().await;
    assert!(started.elapsed().as_secs() < 10, "{:?}", started.elapsed());
    gate.open();
    // it was not its fault, so it does not count, and runs again
    let service = service.again(|settings| settings.work.max_attempts = 1).await;
    let ended = service.ended(&job).await;
    assert_eq!(ended["state"], "succeeded", "{ended}");
}

#[tokio::test]
async fn a_taken_address_and_a_bad_folder_are_errors() {
    let service = Service::start().await;
    let bind = async |change: &dyn Fn(&mut Settings)| {
        let mut settings = Settings { listen: ([127, 0, 0, 1], 0).into(), ..Settings::default() };
        change(&mut settings);
        Server::bind(settings, Box::new(CpuDevice::new()), description(), Extras::default()).await
    };
    let error = bind(&|settings| settings.listen = service.address).await.expect_err("taken");
    assert!(error.message.contains(&service.address.to_string()), "{error}");
    let error = bind(&|settings| settings.data_dir = Some("/dev/null/x".into())).await.expect_err("no folder");
    assert!(error.message.contains("/dev/null/x"), "{error}");
}
