//! The events of a job as a stream (`text/event-stream`): what happened so far, then what happens.
//!
//! A stream holds no events of its own but reads the job's log by number, a page at a time, and waits for the job's
//! pulse when it has read all. So nothing is lost between the past and the present, a reader that drops can go on
//! anywhere, and a slow one costs a page of memory. A stream whose token is taken back or replaced ends.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::IntoResponse;
use axum::response::sse::{Event as Sent, KeepAlive, Sse};
use futures_util::future::OptionFuture;
use futures_util::stream;
use serde::{Deserialize, Serialize};
use tesserae_mesh::error::{Error, Kind, Result};
use tokio::sync::watch;
use utoipa::{IntoParams, ToSchema};

use crate::guard::access::Caller;
use crate::guard::access::tokens::Tokens;
use crate::guard::problem::{Answer, Problem, Problematic};
use crate::guard::query;
use crate::http::state::{App, Shared};
use crate::store::live::{LabelsEvent, Watcher};
use crate::store::{Event, JobEvent, JobId, Pulse, State, no_such_job};
use crate::work::urls;

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct EventsQuery {
    /// Events `labels` too
    #[serde(default)]
    labels: bool,
}

/// Data of the event `state`.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct StateEvent {
    /// The state that the job entered.
    state: State,
    /// Of `running`: the number of the attempt, which iterations and rounds up to the next state are of.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    attempt: Option<u32>,
    /// Of `running`: the name of the process that makes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    worker: Option<String>,
}

/// Data of the event `end`.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct EndEvent {
    /// The state that the job ended in.
    state: State,
    /// Why it failed.
    problem: Option<Problem>,
}

/// One event of the stream, as its three fields
#[expect(dead_code, reason = "describes the stream for openapi.yaml")]
#[derive(ToSchema)]
pub(crate) struct StreamEvent {
    /// Number of the event, from 1 without gaps; none of `labels`.
    #[schema(example = "7")]
    id: String,
    /// `state`, `iteration`, `round`, `labels` or `end`.
    #[schema(example = "state")]
    event: String,
    /// JSON: a `StateEvent`, a row of the report's `iterations` or `levels`, a `LabelsEvent`, or an `EndEvent`.
    #[schema(example = r#"{"state":"running"}"#)]
    data: String,
}

/// Follow a job
///
/// Events `state` ({state}, and of `running` {attempt, worker}), `iteration` (a row of the report's `iterations`),
/// `round` (a row of its `levels`) and `end` ({state, problem}), after which the stream closes unless the job was run
/// again; comments keep a quiet stream open. An attempt that was broken off is made again from the beginning: `state`
/// tells the number of the attempt that the following iterations and rounds are of, and their numbers begin again. The
/// id of an event is its number, from 1 without gaps. With `Last-Event-ID` the stream begins after that event; when it
/// is the last one of an ended job, the answer is 204, which tells an EventSource not to come back. A number beyond the
/// last event counts as that event, and the stream of an ended job has its `end` then.
///
/// With `labels=true` there are events `labels` ({faces, changes}) without an id while the job is clustered: at most
/// four a second, for up to 300,000 faces or items, none of them divided or masked, where this process runs the job.
/// There are none of `acvd`, `vc` and hierarchies of planes and shapes, and of a stream while 32 others have them.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/events", tag = "jobs", operation_id = "streamEvents",
    params(
        EventsQuery,
        ("Last-Event-ID" = Option<u64>, Header,
         description = "Number of the last event that is known; 0 or absent for none"),
    ),
    responses(
        (status = 200, description = "The events", body = StreamEvent, content_type = "text/event-stream"),
        (status = 204, description = "The job has ended with that event"),
        (status = 400, response = Problematic),
    ),
)]
pub(crate) async fn stream(
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Answer {
    let EventsQuery { labels } = query::read(&uri)?;
    let id = shared.job(&caller, &id).await?.id;
    let mut after = last_event_id(&headers)?;
    let mut pulses = shared.store.watch(id).await?.ok_or_else(|| no_such_job(id))?;
    let pulse = *pulses.borrow_and_update();
    // a pulse may be older than an event that a client has read
    if after > pulse.last_seq && shared.store.events(id, after - 1, 1).await?.is_none_or(|page| page.is_empty()) {
        after = pulse.last_seq.saturating_sub(u64::from(pulse.ended));
    }
    if pulse.ended && after >= pulse.last_seq {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let reader = Reader {
        tokens: shared.access.tokens.subscribe(),
        caller,
        watcher: labels.then(|| shared.live.watch(id)).flatten(),
        shared,
        id,
        after,
        page: VecDeque::new(),
        pulses,
        closing: false,
    };
    let events = stream::unfold(reader, |mut reader| async move {
        let event = reader.next().await?;
        Some((Ok::<_, Infallible>(event), reader))
    });
    // nginx and proxies like it hold an answer back until they have much of it, but for this header
    let unbuffered = [("x-accel-buffering", "no")];
    // proxies close a quiet stream after a minute, the shortest after 20 s
    let comments = KeepAlive::new().interval(Duration::from_secs(15));
    Ok((unbuffered, Sse::new(events).keep_alive(comments)).into_response())
}

struct Reader {
    shared: Arc<Shared>,
    id: JobId,
    /// Number of the last event that was read.
    after: u64,
    page: VecDeque<Event>,
    pulses: watch::Receiver<Pulse>,
    /// Gets labels of the running job, if the client does.
    watcher: Option<Watcher>,
    /// The client, and what changes when its token may be gone.
    caller: Caller,
    tokens: watch::Receiver<Arc<Tokens>>,
    /// Whether the last event was the last one.
    closing: bool,
}

impl Reader {
    /// The next event, once there is one; none at the end.
    async fn next(&mut self) -> Option<Sent> {
        loop {
            if self.closing || !self.tokens.borrow().has(&self.caller.0) {
                return None;
            }
            // the last labels come before the end; others when no event waits
            if matches!(self.page.front(), Some(Event { what: JobEvent::End(..), .. }))
                && let Some(labels) = self.watcher.as_mut().and_then(Watcher::now)
            {
                return labels_sent(&labels);
            }
            if let Some(event) = self.page.pop_front() {
                self.after = event.seq;
                let is_last = self.page.is_empty() && self.pulses.borrow().last_seq <= event.seq;
                self.closing = is_last && matches!(event.what, JobEvent::End(..));
                return self.sent(event);
            }
            // seen before reading, so that what happens while reading is noticed
            self.pulses.borrow_and_update();
            let page = self.shared.store.events(self.id, self.after, 256).await;
            let unread = |error: &_| tracing::error!(%error, job = %self.id, "events cannot be read");
            self.page = page.inspect_err(unread).ok()??.into();
            if !self.page.is_empty() {
                continue;
            }
            tokio::select! {
                biased;
                changed = self.pulses.changed() => changed.ok()?,
                Some(labels) = OptionFuture::from(self.watcher.as_mut().map(Watcher::next)) => {
                    return labels_sent(&labels);
                }
                // looked at above
                _ = self.tokens.changed() => {}
                () = self.shared.stop.cancelled() => {
                    self.closing = true;
                    return Some(Sent::default().retry(Duration::from_secs(2)).comment("the service is stopping"));
                }
            }
        }
    }

    fn sent(&self, event: Event) -> Option<Sent> {
        let entered =
            |sent: Sent, state, attempt, worker| sent.event("state").json_data(StateEvent { state, attempt, worker });
        let sent = Sent::default().id(event.seq.to_string());
        let sent = match event.what {
            JobEvent::Queued => entered(sent, State::Queued, None, None),
            JobEvent::Started(attempt, worker) => entered(sent, State::Running, Some(attempt), Some(worker)),
            JobEvent::Iteration(row) => Ok(sent.event("iteration").data(row)),
            JobEvent::Round(row) => Ok(sent.event("round").data(row)),
            JobEvent::End(state, error) => {
                let problem = error.map(|error| Problem::new(&error, urls::path(self.id)));
                sent.event("end").json_data(EndEvent { state, problem })
            }
        };
        sent.inspect_err(|error| tracing::error!(%error, job = %self.id, "an event cannot be written")).ok()
    }
}

fn labels_sent(labels: &LabelsEvent) -> Option<Sent> {
    Sent::default().event("labels").json_data(labels).ok()
}

fn last_event_id(headers: &HeaderMap) -> Result<u64> {
    let Some(value) = headers.get("last-event-id") else { return Ok(0) };
    let text = value.to_str().unwrap_or("?").trim();
    // as far as the signed 64 bits of the description go
    text.parse().ok().filter(|&id: &u64| i64::try_from(id).is_ok()).ok_or_else(|| {
        let message = format_args!("Last-Event-ID must be the id of an event of this job, a number, not {text:?}");
        Error::new(Kind::BadRequest, message)
    })
}
