//! What every store must do: one suite, run on each.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use futures_util::future::join_all;
use tesserae_mesh::error::{Error, Kind};
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::mesh::Format;
use tesserae_mesh::parameters::Parameters;
use tesserae_mesh::report::Phase;

use super::terms::{Page, Statistics};
use super::tests::{RULES, SUMMARY, new_job};
use super::{
    Contents, Created, Deletion, End, Ending, Event, Idempotency, Job, JobEvent, JobId, ListQuery, NewJob, Notice,
    Progress, Rules, SmallBlob, Spec, State, Store, Summary, Ticket,
};

mod at_once;
mod attempts;
mod histories;
mod life;
mod lists;
#[cfg(feature = "postgres")]
mod postgres;
mod sqlite;

/// Runs the suite: `empty` makes a store, and `after_crash` opens what the last one has on disk right now.
async fn run(empty: impl AsyncFn(Rules) -> Store, after_crash: impl AsyncFn() -> Store) {
    let make = async |max_queued| empty(Rules { max_queued, ..RULES }).await;
    life::jobs_are_as_they_were_created_and_claimed_in_order_and_once(&make(9).await).await;
    life::a_full_queue_refuses_until_a_job_starts(&make(2).await).await;
    life::a_tenant_has_no_more_waiting_jobs_than_it_may(&make(9).await).await;
    life::events_are_numbered_and_read_from_anywhere(&make(9).await).await;
    life::every_end_is_told(&make(9).await).await;
    life::a_ticket_that_is_over_writes_nothing(&make(9).await).await;
    life::a_job_is_cancelled_at_once_while_it_waits_and_by_its_worker_while_it_runs(&make(9).await).await;
    life::an_ended_job_cannot_be_cancelled_and_can_be_deleted(&make(9).await).await;
    life::small_blobs_of_the_upload_stay_until_the_end_and_those_of_the_result_from_then_on(&make(9).await).await;
    life::unknown_jobs_are_unknown_everywhere(&make(9).await).await;
    lists::pages_hold_every_job_once_and_go_on_only_at_their_own_cursors(&make(99).await).await;
    lists::a_tenant_sees_only_its_own_jobs(&make(99).await).await;
    lists::every_end_with_a_webhook_is_untold_until_settled(&make(99).await).await;
    lists::the_oldest_job_that_waits_is_known(&make(9).await).await;
    at_once::arrivals_wake_a_worker(&make(9).await).await;
    at_once::many_at_once_lose_nothing(Arc::new(make(1000).await)).await;
    at_once::a_key_stands_for_one_request(&make(9).await).await;
    at_once::the_same_key_at_once_gives_one_job(&make(1000).await).await;
    attempts::a_released_job_runs_again_in_its_place(&make(9).await).await;
    attempts::a_lease_that_is_over_is_reclaimed(&make(9).await).await;
    attempts::attempts_whose_lease_is_over_are_counted(&make(9).await).await;
    attempts::a_job_of_a_later_release_stops_no_other(&make(9).await).await;
    attempts::a_job_that_was_given_up_keeps_its_upload_and_runs_again_on_request(&make(2).await).await;
    life::priorities_order_the_jobs_of_a_tenant(&make(9).await).await;
    lists::a_worker_is_known_with_its_jobs(&make(9).await).await;
    lists::ended_jobs_are_found_by_their_age(&make(9).await).await;
    attempts::a_crash_loses_nothing(&make(9).await, after_crash).await;
}

/// Long enough that no lease ends by itself.
const LEASE: Duration = Duration::from_secs(3600);

/// The tenant of jobs whose tenant is of no matter.
const TENANT: &str = "größe & co";

fn first(limit: usize) -> ListQuery {
    ListQuery { tenant: TENANT.to_owned(), limit, ..ListQuery::default() }
}

fn spec() -> Spec {
    Spec {
        tenant: TENANT.to_owned(),
        trace_parent: Some("00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01".to_owned()),
        parameters: Parameters { clusters: Some(7), seed: u64::MAX, ..Parameters::default() },
        file_name: Some("größe.gltf".to_owned()),
        format: InputFormat::Mesh(Format::Gltf),
        bytes: 1 << 40,
        buffers: vec!["a b.bin".to_owned(), "ü/β.bin".to_owned()],
        listed_seeds: true,
        has_weights: true,
        ..new_job().spec
    }
}

async fn create(store: &Store) -> Job {
    add(store, spec()).await
}

async fn add(store: &Store, spec: Spec) -> Job {
    add_new(store, NewJob { spec, ..new_job() }).await
}

/// Adds a job whose key, if it has one, is new.
async fn add_new(store: &Store, new: NewJob) -> Job {
    match store.create(new).await.expect("created") {
        Created::New(job) => job,
        Created::Known(job) => panic!("its key is known: {job:?}"),
    }
}

async fn claim(store: &Store) -> (Ticket, Job) {
    store.claim(1, LEASE).await.expect("claimable").pop().expect("a job")
}

/// What happens within a minute.
async fn soon<T>(happens: impl Future<Output = T>) -> T {
    tokio::time::timeout(Duration::from_secs(60), happens).await.expect("in time")
}

/// Claims a job and ends it.
async fn run_to(store: &Store, end: End) -> JobId {
    let ticket = claim(store).await.0;
    store.end(ticket, end).await.expect("finished");
    ticket.job
}

async fn get(store: &Store, id: JobId) -> Job {
    store.get(id).await.expect("readable").expect("a job")
}

async fn events(store: &Store, id: JobId, after: u64, limit: usize) -> Vec<Event> {
    store.events(id, after, limit).await.expect("readable").expect("a job")
}

fn of_tenant(tenant: &str) -> Spec {
    Spec { tenant: tenant.to_owned(), ..spec() }
}

fn with_key(tenant: &str, key: &str, request: &str) -> NewJob {
    let idempotency = Some(Idempotency { key: key.to_owned(), request: request.to_owned() });
    NewJob { spec: of_tenant(tenant), idempotency, ..new_job() }
}

/// What all events of a job say, whose numbers are without gaps.
async fn whats(store: &Store, id: JobId) -> Vec<JobEvent> {
    let events = events(store, id, 0, usize::MAX).await;
    assert!(events.iter().map(|event| event.seq).eq(1..=events.len() as u64), "{events:?}");
    events.into_iter().map(|event| event.what).collect()
}

fn ids(jobs: &[Job]) -> Vec<JobId> {
    jobs.iter().map(|job| job.id).collect()
}

fn jobs_of(claimed: &[(Ticket, Job)]) -> Vec<JobId> {
    claimed.iter().map(|(ticket, _)| ticket.job).collect()
}
