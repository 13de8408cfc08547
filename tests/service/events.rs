//! The stream of events: complete, resumable, ending.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use reqwest::Response;
use serde_json::Value;
use tesserae_service::Settings;

use crate::support::*;

/// An event as it was received.
#[derive(Debug, Clone, PartialEq)]
struct Event {
    id: u64,
    name: String,
    data: Value,
}

/// A stream that is being read.
struct Stream {
    response: Response,
    text: String,
}

impl Stream {
    async fn open(service: &Service, job: &Value, last: Option<u64>) -> Self {
        let mut request = service.get(text(&job["urls"]["events"]));
        if let Some(last) = last {
            request = request.header("last-event-id", last.to_string());
        }
        let response = request.send().await.expect("answered");
        assert_eq!(response.status(), 200);
        assert_eq!(response.headers()["content-type"], "text/event-stream");
        assert_eq!(response.headers()["x-accel-buffering"], "no", "proxies pass events on at once");
        Self { response, text: String::new() }
    }

    /// The next block of lines; none when the stream has closed.
    async fn block(&mut self) -> Option<String> {
        loop {
            if let Some(end) = self.text.find("\n\n") {
                let block = self.text[..end].to_owned();
                self.text.drain(..end + 2);
                return Some(block);
            }
            let chunk = self.response.chunk().await.expect("readable")?;
            self.text.push_str(std::str::from_utf8(&chunk).expect("text"));
        }
    }

    /// Numbers of the events `labels` up to the end, of each the faces and the pairs of a face and its label.
    async fn labels(&mut self) -> Vec<(u64, Vec<[u32; 2]>)> {
        let mut all = Vec::new();
        while let Some(block) = self.block().await {
            let Some(data) = block.strip_prefix("event: labels\ndata: ") else { continue };
            let data: Value = serde_json::from_str(data).expect("JSON");
            let bytes = STANDARD.decode(text(&data["changes"])).expect("base64");
            let numbers: Vec<u32> = bytes.as_chunks().0.iter().map(|&four| u32::from_le_bytes(four)).collect();
            all.push((data["faces"].as_u64().expect("a number"), numbers.as_chunks().0.to_vec()));
        }
        all
    }

    /// The next event; none when the stream has closed.
    async fn next(&mut self) -> Option<Event> {
        loop {
            let block = self.block().await?;
            let field = |name: &str| {
                let line = block.lines().find_map(|line| line.strip_prefix(name));
                line.map(|value| value.trim_start().to_owned())
            };
            if let (Some(id), Some(name), Some(data)) = (field("id:"), field("event:"), field("data:")) {
                let id = id.parse().expect("a number");
                return Some(Event { id, name, data: serde_json::from_str(&data).expect("JSON") });
            }
        }
    }

    async fn rest(&mut self) -> Vec<Event> {
        let mut events = Vec::new();
        while let Some(event) = self.next().await {
            events.push(event);
        }
        events
    }
}

#[tokio::test]
async fn a_live_stream_holds_every_iteration_of_the_report_and_ends() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    let job = service.submit("clusters=20&seeds=random", sphere(4000)).await;
    let mut stream = Stream::open(&service, &job, None).await;
    let first = stream.next().await.expect("an event");
    assert_eq!((first.id, first.name.as_str(), &first.data["state"]), (1, "state", &"queued".into()));
    let second = stream.next().await.expect("an event");
    assert_eq!((second.id, second.name.as_str(), &second.data["state"]), (2, "state", &"running".into()));
    gate.open();
    let mut events = vec![first, second];
    events.extend(stream.rest().await);
    let ids: Vec<u64> = events.iter().map(|event| event.id).collect();
    assert_eq!(ids, (1..=events.len() as u64).collect::<Vec<_>>());
    let end = events.last().expect("an event");
    assert_eq!(end.name, "end");
    assert_eq!(end.data, serde_json::json!({"state": "succeeded", "problem": null}));
    let rows: Vec<Value> =
        events.iter().filter(|event| event.name == "iteration").map(|event| event.data.clone()).collect();
    let report = json(service.get(text(&job["urls"]["report"]))).await;
    assert_eq!(Value::from(rows.clone()), report["iterations"]);
    assert!(rows.len() > 3, "{rows:?}");

    // an ended job replays the same and closes
    assert_eq!(Stream::open(&service, &job, None).await.rest().await, events);
    assert_eq!(Stream::open(&service, &job, Some(0)).await.rest().await, events);
}

#[tokio::test]
async fn a_stream_that_drops_anywhere_resumes_without_loss_or_repetition() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    let job = service.submit("clusters=20&seeds=random", sphere(4000)).await;
    let mut seen = Vec::new();
    let mut last = None;
    let mut drops = 0;
    loop {
        let mut stream = Stream::open(&service, &job, last).await;
        for _ in 0..2 {
            let Some(event) = stream.next().await else { break };
            last = Some(event.id);
            seen.push(event);
        }
        gate.open();
        drops += 1;
        if seen.last().is_some_and(|event: &Event| event.name == "end") {
            break;
        }
    }
    assert!(drops > 3);
    assert_eq!(seen, Stream::open(&service, &job, None).await.rest().await);
}

#[tokio::test]
async fn resuming_after_the_end_tells_the_client_to_stay_away() {
    let service = Service::start().await;
    let job = service.submit("clusters=5", sphere(300)).await;
    service.ended(&job).await;
    let events = Stream::open(&service, &job, None).await.rest().await;
    let url = text(&job["urls"]["events"]);
    let response = service.get(url).header("last-event-id", events.len().to_string()).send().await.expect("answered");
    assert_eq!(response.status(), 204);
    let tail = Stream::open(&service, &job, Some(events.len() as u64 - 1)).await.rest().await;
    assert_eq!(tail, events[events.len() - 1..]);
    for bad in ["", "x", "-1", "1.5", "99999999999999999999999"] {
        let detail = refused(service.get(url).header("last-event-id", bad), 400, "bad-request").await;
        assert!(detail.contains("Last-Event-ID"), "{detail}");
    }
}

#[tokio::test]
async fn a_stream_resumed_beyond_the_log_still_has_the_end() {
    for keeps_jobs in [true, false] {
        let (device, gate) = Held::behind_gate();
        let change = |settings: &mut Settings| settings.data_dir = settings.data_dir.take().filter(|_| keeps_jobs);
        let service = Service::with(change, device).await;
        let job = service.submit("clusters=5", sphere(300)).await;
        service.reaches(&job, "running").await;
        let far = [1000, i64::MAX as u64];
        let mut waiting = Vec::new();
        for last in far {
            waiting.push(Stream::open(&service, &job, Some(last)).await);
        }
        gate.open();
        service.ended(&job).await;
        for stream in &mut waiting {
            let events = tokio::time::timeout(PATIENCE, stream.rest()).await.expect("it ends");
            assert_eq!(events.last().expect("an event").name, "end");
        }
        let end = Stream::open(&service, &job, None).await.rest().await.pop().expect("an event");
        for last in far {
            assert_eq!(Stream::open(&service, &job, Some(last)).await.rest().await, std::slice::from_ref(&end));
        }
    }
}

#[tokio::test]
async fn a_failed_and_a_cancelled_job_end_their_streams() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|settings| settings.meshes_in_memory = 1, device).await;
    let first = service.submit("clusters=5", sphere(300)).await;
    let failing = service.submit("clusters=1", b"f 1 2 3\n".to_vec()).await;
    let cancelled = service.submit("clusters=5", sphere(300)).await;
    let mut stream = Stream::open(&service, &cancelled, None).await;
    service.delete(path(&cancelled)).send().await.expect("answered");
    let events = stream.rest().await;
    assert_eq!(events.last().expect("an event").data["state"], "cancelled");
    let mut stream = Stream::open(&service, &failing, None).await;
    gate.open();
    let events = stream.rest().await;
    let end = &events.last().expect("an event").data;
    assert_eq!(end["state"], "failed");
    assert_eq!(end["problem"]["type"], "/problems/invalid-mesh");
    assert_eq!(end["problem"]["instance"], path(&failing));
    service.ended(&first).await;
}

#[tokio::test]
async fn quiet_streams_are_kept_open_by_comments() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    let mut stream = Stream::open(&service, &job, None).await;
    stream.next().await;
    stream.next().await;
    let comment = tokio::time::timeout(PATIENCE, stream.block()).await.expect("in time");
    assert!(comment.expect("still open").starts_with(':'));
    gate.open();
    assert_eq!(stream.rest().await.last().expect("an event").name, "end");
}

#[tokio::test]
async fn stopping_ends_streams_with_a_hint() {
    let (device, gate) = Held::behind_gate();
    let mut service = Service::with(|settings| settings.grace_period = 30, device).await;
    let job = service.submit("clusters=5", sphere(300)).await;
    let mut stream = Stream::open(&service, &job, None).await;
    stream.next().await;
    stream.next().await;
    service.ask_to_stop();
    let last = tokio::time::timeout(PATIENCE, stream.block()).await.expect("in time");
    let last = last.expect("a last word");
    assert!(last.contains("retry: 2000") || last.contains("retry:2000"), "{last}");
    assert_eq!(stream.block().await, None);
    gate.open();
    service.stopped().await;
}

#[tokio::test]
async fn labels_of_a_running_job_are_shown_to_those_that_want_them_and_change_nothing() {
    for query in ["clusters=20&seeds=random", "algorithm=pml", "clusters=20&subdivide=1"] {
        let (device, gate) = Held::behind_gate();
        let service = Service::with(|_| {}, device).await;
        // above the meshes that are worked on beside the device
        let job = service.submit(query, sphere(10_000)).await;
        service.reaches(&job, "running").await;
        let url = format!("{}?labels=true", text(&job["urls"]["events"]));
        let mut watching = Stream { response: service.get(&url).send().await.expect("answered"), text: String::new() };
        let mut other = Stream::open(&service, &job, None).await;
        gate.open();
        assert!(other.labels().await.is_empty(), "{query}");
        let shown = watching.labels().await;
        let faces = service.ended(&job).await["result"]["faces"].as_u64().expect("a number");
        if query.contains("subdivide") {
            assert!(shown.is_empty(), "labels of other faces");
            continue;
        }
        let (first, changes) = shown.first().unwrap_or_else(|| panic!("{query}: no labels"));
        assert_eq!(*first, faces);
        let named: Vec<u64> = changes.iter().map(|&[face, _]| u64::from(face)).collect();
        assert_eq!(named, (0..faces).collect::<Vec<_>>(), "{query}");
        let mut clusters: Vec<u32> = changes.iter().map(|&[_, label]| label).collect();
        clusters.sort_unstable();
        clusters.dedup();
        assert!(clusters.len() >= 20 && clusters.iter().all(|&label| u64::from(label) < faces), "{query}");

        let again = service.submit(query, sphere(10_000)).await;
        service.ended(&again).await;
        let cut = if query.contains("pml") { "&clusters=20" } else { "" };
        let bytes = async |job: &Value| {
            let url = format!("{}/labels?format=npy{cut}", path(job));
            let response = service.get(&url).send().await.expect("answered");
            assert_eq!(response.status(), 200);
            response.bytes().await.expect("bytes")
        };
        assert!(bytes(&job).await == bytes(&again).await, "{query}: labels differ where a client watched");
    }
}

#[tokio::test]
async fn the_stream_refuses_queries_that_it_does_not_have() {
    let service = Service::start().await;
    let job = service.submit("clusters=5", sphere(300)).await;
    let url = text(&job["urls"]["events"]);
    for bad in ["labels=1", "label=true", "labels=true&labels=true"] {
        refused(service.get(&format!("{url}?{bad}")), 422, "invalid-parameter").await;
    }
}

#[tokio::test]
async fn a_hundred_readers_see_the_same() {
    let (device, gate) = Held::behind_gate();
    let service = Service::with(|_| {}, device).await;
    let job = service.submit("clusters=20", sphere(2000)).await;
    let mut readers = Vec::new();
    for _ in 0..100 {
        let mut stream = Stream::open(&service, &job, None).await;
        readers.push(tokio::spawn(async move { stream.rest().await }));
    }
    gate.open();
    let expected = Stream::open(&service, &job, None).await.rest().await;
    for reader in readers {
        assert_eq!(reader.await.expect("no panic"), expected);
    }
}
