//! What every store must do: one suite, run on each.

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use async_trait::async_trait;

use super::{
    Created, Deletion, End, Event, Idempotency, Job, JobId, JobStore, ListQuery, NewJob, Page, Progress, Release,
    Rules, Spec, State, Summary, Ticket, What,
};
use crate::error::{Error, Kind};
use crate::mesh::Format;
use crate::parameters::Parameters;
use crate::report::Phase;

/// What is tested.
#[async_trait]
pub(in crate::service) trait Subject: Sync {
    /// An empty store.
    async fn empty(&self, rules: Rules) -> Box<dyn JobStore>;

    /// What the last store that [`empty`](Self::empty) made has on disk right now, opened as after a crash; none when a
    /// crash leaves nothing.
    async fn after_crash(&self, _rules: Rules) -> Option<Box<dyn JobStore>> {
        None
    }
}

/// Runs the whole suite.
pub(in crate::service) async fn run(subject: &dyn Subject) {
    let make = async |max_queued| subject.empty(Rules { max_queued, ..RULES }).await;
    a_new_job_is_as_it_was_created(make(9).await.as_ref()).await;
    jobs_are_claimed_in_order_and_once(make(9).await.as_ref()).await;
    a_full_queue_refuses_until_a_job_starts(make(2).await.as_ref()).await;
    events_are_numbered_and_read_from_anywhere(make(9).await.as_ref()).await;
    every_end_is_told(make(9).await.as_ref()).await;
    a_ticket_that_is_over_writes_nothing(make(9).await.as_ref()).await;
    a_queued_job_is_cancelled_at_once(make(9).await.as_ref()).await;
    a_running_job_is_asked_to_end(make(9).await.as_ref()).await;
    an_ended_job_cannot_be_cancelled_and_can_be_deleted(make(9).await.as_ref()).await;
    unknown_jobs_are_unknown_everywhere(make(9).await.as_ref()).await;
    pages_hold_every_job_once(make(99).await.as_ref()).await;
    a_tenant_sees_only_its_own_jobs(make(99).await.as_ref()).await;
    every_end_with_a_webhook_is_untold_until_settled(make(99).await.as_ref()).await;
    a_foreign_cursor_is_refused(make(9).await.as_ref()).await;
    arrivals_wake_a_worker(Arc::from(make(9).await)).await;
    many_at_once_lose_nothing(Arc::from(make(1000).await)).await;
    a_key_stands_for_one_request(make(9).await.as_ref()).await;
    the_same_key_at_once_gives_one_job(Arc::from(make(1000).await)).await;
    a_released_job_runs_again_in_its_place(make(9).await.as_ref()).await;
    a_job_that_fails_too_often_is_given_up(make(9).await.as_ref()).await;
    a_lease_that_is_over_is_reclaimed(make(9).await.as_ref()).await;
    a_released_job_that_was_to_end_ends(make(9).await.as_ref()).await;
    ended_jobs_are_found_by_their_age(make(9).await.as_ref()).await;
    a_crash_loses_nothing(subject).await;
}

const RULES: Rules = Rules { max_queued: 9, max_attempts: 3 };

/// Long enough that no lease ends by itself.
const LEASE: Duration = Duration::from_secs(3600);

fn spec(name: &str) -> Spec {
    Spec {
        tenant: "größe & co".to_owned(),
        trace_parent: Some("00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01".to_owned()),
        webhook: None,
        parameters: Parameters { clusters: Some(7), seed: u64::MAX, ..Parameters::default() },
        file_name: Some(name.to_owned()),
        format: Format::Gltf,
        bytes: 1 << 40,
        buffers: vec!["a b.bin".to_owned(), "ü/β.bin".to_owned()],
        listed_seeds: true,
        has_weights: true,
    }
}

async fn create(store: &dyn JobStore) -> Job {
    add(store, JobId::random(), spec("mesh.gltf")).await
}

async fn add(store: &dyn JobStore, id: JobId, spec: Spec) -> Job {
    match store.create(NewJob { id, spec, idempotency: None }).await.expect("created") {
        Created::New(job) => job,
        Created::Known(job) => panic!("no key was given: {job:?}"),
    }
}

async fn claim(store: &dyn JobStore) -> (Ticket, Job) {
    store.claim(1, LEASE).await.expect("claimable").pop().expect("a job")
}

async fn get(store: &dyn JobStore, id: JobId) -> Job {
    store.get(id).await.expect("readable").expect("a job")
}

async fn events(store: &dyn JobStore, id: JobId, after: u64, limit: usize) -> Vec<Event> {
    store.events(id, after, limit).await.expect("readable").expect("a job")
}

const SUMMARY: Summary = Summary { faces: 12, clusters: 7, has_labels: true };

async fn a_new_job_is_as_it_was_created(store: &dyn JobStore) {
    let id = JobId::random();
    let job = add(store, id, spec("größe.gltf")).await;
    assert_eq!((job.id, job.state), (id, State::Queued));
    assert_eq!(job.spec, spec("größe.gltf"));
    assert_eq!(job.queue_position, Some(1));
    assert_eq!(job.started_at, None);
    assert_eq!(get(store, id).await, job);
    assert_eq!(create(store).await.queue_position, Some(2));
    assert_eq!(events(store, id, 0, 9).await, [Event { seq: 1, what: What::State(State::Queued) }]);
}

async fn jobs_are_claimed_in_order_and_once(store: &dyn JobStore) {
    let first = create(store).await;
    let second = create(store).await;
    let (ticket, job) = claim(store).await;
    assert_eq!((ticket.job, job.id), (first.id, first.id));
    assert_eq!((job.state, job.queue_position), (State::Running, None));
    assert!(job.started_at.is_some());
    assert_eq!(get(store, second.id).await.queue_position, Some(1));
    assert_eq!(claim(store).await.0.job, second.id);
    assert!(store.claim(1, LEASE).await.expect("claimable").is_empty());
    assert_eq!(store.counts().await.expect("counted"), [0, 2, 0, 0, 0]);
}

async fn a_full_queue_refuses_until_a_job_starts(store: &dyn JobStore) {
    create(store).await;
    store.check_room().await.expect("room for one more");
    create(store).await;
    assert_eq!(store.check_room().await.expect_err("full").kind, Kind::QueueFull);
    let id = JobId::random();
    let refused = store.create(NewJob { id, spec: spec("x"), idempotency: None }).await.expect_err("full");
    assert_eq!(refused.kind, Kind::QueueFull);
    assert_eq!(store.get(id).await.expect("readable"), None);
    claim(store).await;
    create(store).await;
}

async fn events_are_numbered_and_read_from_anywhere(store: &dyn JobStore) {
    let id = create(store).await.id;
    let (ticket, _) = claim(store).await;
    let mut pulses = store.watch(id).await.expect("watchable").expect("a job");
    let before = *pulses.borrow_and_update();
    assert_eq!((before.last_seq, before.ended), (2, false));
    let rows =
        |range: std::ops::Range<u32>| range.map(|row| What::Iteration(format!("{{\"iteration\":{row}}}"))).collect();
    let progress =
        Progress { iterations: 3, phase: Some(Phase::Boundary), rounds: 2, clusters_left: Some(70), energy: Some(0.1) };
    store.append(ticket, rows(0..2), Progress::default()).await.expect("appended");
    store.append(ticket, rows(2..4), progress).await.expect("appended");
    assert!(pulses.has_changed().expect("still there"));
    assert_eq!(pulses.borrow_and_update().last_seq, 6);
    assert_eq!(get(store, id).await.progress, progress);

    let all = events(store, id, 0, 99).await;
    assert_eq!(all.iter().map(|event| event.seq).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6]);
    assert_eq!(all[1].what, What::State(State::Running));
    assert_eq!(all[5].what, What::Iteration("{\"iteration\":3}".to_owned()));
    assert_eq!(events(store, id, 3, 2).await, all[3..5]);
    assert_eq!(events(store, id, 6, 9).await, []);
    assert_eq!(events(store, id, u64::MAX, usize::MAX).await, []);
}

async fn every_end_is_told(store: &dyn JobStore) {
    let error = Error::new(Kind::InvalidMesh, "line 3: \"x\" is no number");
    for (end, state, problem, summary) in [
        (End::Succeeded(SUMMARY), State::Succeeded, None, Some(SUMMARY)),
        (End::Failed(error.clone()), State::Failed, Some(error.clone()), None),
        (End::Cancelled, State::Cancelled, None, None),
    ] {
        let id = create(store).await.id;
        let pulses = store.watch(id).await.expect("watchable").expect("a job");
        let (ticket, _) = claim(store).await;
        store.finish(ticket, end).await.expect("finished");
        let job = get(store, id).await;
        assert_eq!((job.state, &job.problem, job.summary), (state, &problem, summary));
        assert!(job.ended_at >= job.started_at && job.started_at >= Some(job.created_at));
        assert!(pulses.borrow().ended);
        let last = events(store, id, 2, 9).await;
        assert_eq!(last.len(), 1);
        assert_eq!(last[0].what, What::End(state, problem));
    }
}

async fn a_ticket_that_is_over_writes_nothing(store: &dyn JobStore) {
    let id = create(store).await.id;
    let (ticket, _) = claim(store).await;
    let other = Ticket { attempt: ticket.attempt + 1, ..ticket };
    for stale in [other, ticket] {
        if stale == ticket {
            store.finish(ticket, End::Succeeded(SUMMARY)).await.expect("finished");
        }
        let before = (get(store, id).await, events(store, id, 0, 99).await);
        let row = vec![What::Iteration("{}".to_owned())];
        let appended = store.append(stale, row, Progress::default()).await;
        assert_eq!(appended.expect_err("stale").kind, Kind::Conflict);
        let finished = store.finish(stale, End::Cancelled).await;
        assert_eq!(finished.expect_err("stale").kind, Kind::Conflict);
        assert_eq!((get(store, id).await, events(store, id, 0, 99).await), before);
    }
}

async fn a_queued_job_is_cancelled_at_once(store: &dyn JobStore) {
    let first = create(store).await.id;
    let second = create(store).await.id;
    let cancelled = store.cancel(first).await.expect("asked").expect("a job");
    assert_eq!(cancelled.state, State::Cancelled);
    assert_eq!(get(store, first).await, cancelled);
    assert_eq!(get(store, second).await.queue_position, Some(1));
    assert_eq!(claim(store).await.0.job, second);
    assert_eq!(events(store, first, 1, 9).await[0].what, What::End(State::Cancelled, None));
}

async fn a_running_job_is_asked_to_end(store: &dyn JobStore) {
    let id = create(store).await.id;
    let (ticket, _) = claim(store).await;
    let mut pulses = store.watch(id).await.expect("watchable").expect("a job");
    let job = store.cancel(id).await.expect("asked").expect("a job");
    assert_eq!((job.state, job.cancel_requested), (State::Running, true));
    pulses.wait_for(|pulse| pulse.cancel_requested && !pulse.ended).await.expect("told");
    assert_eq!(store.delete(id).await.expect("asked"), Deletion::Live);
    store.finish(ticket, End::Cancelled).await.expect("finished");
    assert_eq!(get(store, id).await.state, State::Cancelled);
}

async fn an_ended_job_cannot_be_cancelled_and_can_be_deleted(store: &dyn JobStore) {
    let id = create(store).await.id;
    assert_eq!(store.delete(id).await.expect("asked"), Deletion::Live);
    let (ticket, _) = claim(store).await;
    store.finish(ticket, End::Succeeded(SUMMARY)).await.expect("finished");
    let job = store.cancel(id).await.expect("asked").expect("a job");
    assert_eq!((job.state, job.cancel_requested), (State::Succeeded, false));
    let mut pulses = store.watch(id).await.expect("watchable").expect("a job");
    pulses.borrow_and_update();
    assert_eq!(store.delete(id).await.expect("asked"), Deletion::Deleted);
    assert_eq!(store.get(id).await.expect("readable"), None);
    assert!(pulses.changed().await.is_err(), "who waits is told");
    assert_eq!(store.delete(id).await.expect("asked"), Deletion::Unknown);
    assert_eq!(store.counts().await.expect("counted"), [0; 5]);
}

async fn unknown_jobs_are_unknown_everywhere(store: &dyn JobStore) {
    let id = JobId::random();
    assert_eq!(store.get(id).await.expect("readable"), None);
    assert_eq!(store.cancel(id).await.expect("asked"), None);
    assert_eq!(store.events(id, 0, 9).await.expect("readable"), None);
    assert!(store.watch(id).await.expect("watchable").is_none());
    let ticket = Ticket { job: id, attempt: 1 };
    let finished = store.finish(ticket, End::Cancelled).await;
    assert_eq!(finished.expect_err("unknown").kind, Kind::NotFound);
}

async fn pages_hold_every_job_once(store: &dyn JobStore) {
    let mut newest_first = Vec::new();
    for _ in 0..7 {
        newest_first.insert(0, create(store).await.id);
    }
    let mut query = ListQuery { limit: 3, ..ListQuery::default() };
    let mut seen = Vec::new();
    loop {
        let page = store.list(&query).await.expect("listed");
        seen.extend(page.jobs.iter().map(|job| job.id));
        // What is added or deleted between pages moves nothing.
        create(store).await;
        let Some(next) = page.next else { break };
        assert_eq!(page.jobs.len(), 3);
        query.cursor = Some(next);
    }
    assert_eq!(seen, newest_first);

    let (_, running) = claim(store).await;
    let only =
        store.list(&ListQuery { state: Some(State::Running), limit: 1, ..ListQuery::default() }).await.expect("listed");
    assert_eq!(only.jobs, [running]);
    assert_eq!(only.next, None);
    let queued = store
        .list(&ListQuery { state: Some(State::Queued), limit: 100, ..ListQuery::default() })
        .await
        .expect("listed");
    assert_eq!(queued.jobs.len(), 9);
    assert_eq!(queued.jobs[8].queue_position, Some(1));
    assert_eq!(queued.jobs[0].queue_position, Some(9));
}

async fn a_tenant_sees_only_its_own_jobs(store: &dyn JobStore) {
    let mut mine = Vec::new();
    for turn in 0..5 {
        let tenant = ["mine", "Mine"][turn % 2].to_owned();
        let job = add(store, JobId::random(), Spec { tenant, ..spec("x") }).await;
        if turn % 2 == 0 {
            mine.insert(0, job.id);
        }
    }
    let (_, running) = claim(store).await;
    assert_eq!(running.spec.tenant, "mine");
    assert_eq!(store.queued_of("mine").await.expect("counted"), 2);
    assert_eq!(store.queued_of("nobody").await.expect("counted"), 0);
    let list = |state, cursor, limit| ListQuery { tenant: Some("mine".to_owned()), state, cursor, limit };
    let first = store.list(&list(None, None, 2)).await.expect("listed");
    let rest = store.list(&list(None, first.next, 2)).await.expect("listed");
    assert_eq!(first.jobs.iter().chain(&rest.jobs).map(|job| job.id).collect::<Vec<_>>(), mine);
    assert_eq!(rest.next, None, "what others have is no next page");
    let queued = store.list(&list(Some(State::Queued), None, 9)).await.expect("listed");
    assert_eq!(queued.jobs.iter().map(|job| job.id).collect::<Vec<_>>(), mine[..2]);
    let nobody = ListQuery { tenant: Some("nobody".to_owned()), limit: 9, ..ListQuery::default() };
    assert_eq!(store.list(&nobody).await.expect("listed"), Page::default());
}

async fn every_end_with_a_webhook_is_untold_until_settled(store: &dyn JobStore) {
    let mut endings = store.endings();
    assert!(endings.has_changed().expect("still there"), "the teller looks before it waits");
    endings.borrow_and_update();
    let hooked = || Spec { webhook: Some("https://a.example/x?y=1".to_owned()), ..spec("x") };
    let mut ids = Vec::new();
    for _ in 0..4 {
        ids.push(add(store, JobId::random(), hooked()).await.id);
    }
    let silent = create(store).await.id;
    assert_eq!(store.untold().await.expect("readable"), []);
    store.cancel(ids[3]).await.expect("asked");
    assert!(endings.has_changed().expect("still there"));
    let mut ended = vec![ids[3]];
    for end in [End::Succeeded(SUMMARY), End::Failed(Error::new(Kind::InvalidMesh, "x")), End::Cancelled] {
        let (ticket, _) = claim(store).await;
        endings.borrow_and_update();
        store.finish(ticket, end).await.expect("finished");
        assert!(endings.has_changed().expect("still there"));
        ended.push(ticket.job);
    }
    let (ticket, _) = claim(store).await;
    assert_eq!(ticket.job, silent);
    store.finish(ticket, End::Cancelled).await.expect("finished");
    assert_eq!(store.untold().await.expect("readable"), ended, "without a webhook there is nobody to tell");
    store.settle_webhook(ended[1]).await.expect("settled");
    store.settle_webhook(ended[1]).await.expect("settled again");
    store.settle_webhook(JobId::random()).await.expect("nothing");
    store.delete(ended[0]).await.expect("deleted");
    assert_eq!(store.untold().await.expect("readable"), ended[2..]);
}

fn with_key(tenant: &str, key: &str, request: &str) -> NewJob {
    NewJob {
        id: JobId::random(),
        spec: Spec { tenant: tenant.to_owned(), ..spec("x") },
        idempotency: Some(Idempotency { key: key.to_owned(), request: request.to_owned() }),
    }
}

async fn a_key_stands_for_one_request(store: &dyn JobStore) {
    assert!(!store.knows_key("a", "k").await.expect("readable"));
    let Created::New(first) = store.create(with_key("a", "k", "digest")).await.expect("created") else {
        panic!("the key is new")
    };
    assert!(store.knows_key("a", "k").await.expect("readable"));
    let again = store.create(with_key("a", "k", "digest")).await.expect("known");
    assert_eq!(again, Created::Known(first.clone()));
    let other = store.create(with_key("a", "k", "another digest")).await.expect_err("another request");
    assert_eq!(other.kind, Kind::KeyReused);
    assert!(other.message.contains("\"k\""), "{other}");
    // keys are a tenant's own
    assert!(matches!(store.create(with_key("b", "k", "another digest")).await, Ok(Created::New(_))));
    assert_eq!(store.counts().await.expect("counted"), [2, 0, 0, 0, 0]);
    // the key stays with an ended job, and goes with it
    let (ticket, _) = claim(store).await;
    store.finish(ticket, End::Succeeded(SUMMARY)).await.expect("finished");
    let again = store.create(with_key("a", "k", "digest")).await.expect("known");
    assert!(matches!(again, Created::Known(job) if job.id == first.id && job.state == State::Succeeded));
    store.delete(first.id).await.expect("deleted");
    assert!(matches!(store.create(with_key("a", "k", "another digest")).await, Ok(Created::New(_))));
}

async fn the_same_key_at_once_gives_one_job(store: Arc<dyn JobStore>) {
    let clients: Vec<_> = (0..40)
        .map(|client| {
            let store = Arc::clone(&store);
            let key = ["p", "q"][client % 2];
            tokio::spawn(async move {
                match store.create(with_key("a", key, "digest")).await.expect("created") {
                    Created::New(job) | Created::Known(job) => (key, job.id),
                }
            })
        })
        .collect();
    let mut ids = Vec::new();
    for client in clients {
        ids.push(client.await.expect("no panic"));
    }
    ids.sort();
    ids.dedup();
    assert_eq!(ids.iter().map(|(key, _)| *key).collect::<Vec<_>>(), ["p", "q"]);
    assert_eq!(store.counts().await.expect("counted"), [2, 0, 0, 0, 0]);
}

async fn a_released_job_runs_again_in_its_place(store: &dyn JobStore) {
    let first = create(store).await.id;
    let second = create(store).await.id;
    let mut arrivals = store.arrivals();
    let (ticket, _) = claim(store).await;
    let row = vec![What::Iteration("{}".to_owned())];
    store.append(ticket, row.clone(), Progress::default()).await.expect("appended");
    arrivals.borrow_and_update();
    assert_eq!(store.release(ticket, Release::Free).await, Ok(State::Queued));
    assert!(arrivals.has_changed().expect("still there"), "a worker is told");
    assert_eq!(get(store, first).await.queue_position, Some(1));
    assert_eq!(get(store, second).await.queue_position, Some(2));
    for stale in [store.finish(ticket, End::Cancelled).await, store.append(ticket, row, Progress::default()).await] {
        assert_eq!(stale.expect_err("released").kind, Kind::Conflict);
    }
    assert_eq!(store.release(ticket, Release::Free).await.expect_err("released").kind, Kind::Conflict);

    let claimed = store.claim(9, LEASE).await.expect("claimable");
    assert_eq!(claimed.iter().map(|(ticket, _)| ticket.job).collect::<Vec<_>>(), [first, second]);
    assert_eq!((claimed[0].0.attempt, claimed[0].1.attempt), (2, 2));
    store.finish(claimed[0].0, End::Succeeded(SUMMARY)).await.expect("finished");
    let whats: Vec<_> = events(store, first, 0, 99).await;
    assert_eq!(whats.iter().map(|event| event.seq).collect::<Vec<_>>(), (1..=6).collect::<Vec<_>>());
    assert_eq!(whats[3].what, What::State(State::Queued));
    assert_eq!(whats[4].what, What::State(State::Running));
}

async fn a_job_that_fails_too_often_is_given_up(store: &dyn JobStore) {
    let id = create(store).await.id;
    let failure = || Release::Failed(Error::new(Kind::DeviceLost, "the card fell out"));
    for attempt in 1..=4 {
        let (ticket, _) = claim(store).await;
        assert_eq!(ticket.attempt, attempt);
        // the second attempt is broken off without fault
        let release = if attempt == 2 { Release::Free } else { failure() };
        let expected = if attempt == 4 { State::Failed } else { State::Queued };
        assert_eq!(store.release(ticket, release).await, Ok(expected), "attempt {attempt}");
    }
    let job = get(store, id).await;
    assert_eq!(job.state, State::Failed);
    let problem = job.problem.expect("a reason");
    assert_eq!(problem.kind, Kind::Poison);
    assert!(problem.message.contains("3 attempts") && problem.message.contains("the card fell out"), "{problem}");
    assert!(store.claim(1, LEASE).await.expect("claimable").is_empty());
}

async fn a_lease_that_is_over_is_reclaimed(store: &dyn JobStore) {
    let lost = create(store).await.id;
    let kept = create(store).await.id;
    let now = SystemTime::now();
    let tickets: Vec<_> =
        store.claim(2, LEASE).await.expect("claimable").into_iter().map(|(ticket, _)| ticket).collect();
    assert_eq!(store.reclaim(now).await, Ok(vec![]));
    assert_eq!(store.heartbeat(&tickets[1..], now + 3 * LEASE).await, Ok(vec![]));
    assert_eq!(store.reclaim(now + 2 * LEASE).await, Ok(vec![tickets[0]]));
    assert_eq!(get(store, lost).await.state, State::Queued);
    assert_eq!(get(store, kept).await.state, State::Running);
    assert_eq!(store.heartbeat(&tickets, now + 3 * LEASE).await, Ok(vec![tickets[0]]));
    assert_eq!(claim(store).await.0, Ticket { job: lost, attempt: 2 });
    assert_eq!(store.heartbeat(&tickets, now + 3 * LEASE).await, Ok(vec![tickets[0]]), "another one's by now");
}

async fn a_released_job_that_was_to_end_ends(store: &dyn JobStore) {
    let id = create(store).await.id;
    let (ticket, _) = claim(store).await;
    store.cancel(id).await.expect("asked");
    assert_eq!(store.release(ticket, Release::Free).await, Ok(State::Cancelled));
    assert_eq!(get(store, id).await.state, State::Cancelled);
}

async fn ended_jobs_are_found_by_their_age(store: &dyn JobStore) {
    let mut ended = Vec::new();
    for _ in 0..3 {
        create(store).await;
        let (ticket, _) = claim(store).await;
        store.finish(ticket, End::Cancelled).await.expect("finished");
        ended.push(ticket.job);
    }
    create(store).await;
    let later = SystemTime::now() + LEASE;
    let all = store.ended_before(later, 99).await.expect("readable");
    assert_eq!(all.len(), 3);
    assert!(ended.iter().all(|id| all.contains(id)));
    assert_eq!(store.ended_before(later, 2).await.expect("readable"), all[..2]);
    assert_eq!(store.ended_before(SystemTime::now() - LEASE, 9).await, Ok(vec![]));
    store.delete(all[0]).await.expect("deleted");
    assert_eq!(store.ended_before(later, 99).await.expect("readable"), all[1..]);
}

/// Everything that was answered is there after a crash; what ran waits again, which counts.
async fn a_crash_loses_nothing(subject: &dyn Subject) {
    let store = subject.empty(RULES).await;
    let ended = create(store.as_ref()).await.id;
    let (ticket, _) = claim(store.as_ref()).await;
    let progress = Progress { iterations: 7, energy: Some(0.1), ..Progress::default() };
    let rows = (0..300).map(|row| What::Iteration(format!("{{\"iteration\":{row},\"name\":\"ü\\\"\"}}"))).collect();
    store.append(ticket, rows, progress).await.expect("appended");
    store.finish(ticket, End::Failed(Error::new(Kind::InvalidMesh, "x"))).await.expect("finished");
    let Created::New(keyed) = store.create(with_key("a", "k", "digest")).await.expect("created") else {
        panic!("the key is new")
    };
    let (held, _) = claim(store.as_ref()).await;
    let asked_to_end = create(store.as_ref()).await.id;
    claim(store.as_ref()).await;
    store.cancel(asked_to_end).await.expect("asked");
    let waiting = create(store.as_ref()).await;
    let before = (get(store.as_ref(), ended).await, events(store.as_ref(), ended, 0, 999).await);

    let Some(again) = subject.after_crash(RULES).await else { return };
    let again = again.as_ref();
    assert_eq!((get(again, ended).await, events(again, ended, 0, 999).await), before);
    assert_eq!(get(again, waiting.id).await, Job { queue_position: Some(2), ..waiting.clone() });
    assert_eq!(get(again, asked_to_end).await.state, State::Cancelled);
    let job = get(again, keyed.id).await;
    assert_eq!((job.state, job.queue_position, job.attempt), (State::Queued, Some(1), 1));
    assert_eq!(again.create(with_key("a", "k", "digest")).await, Ok(Created::Known(job)));
    let stale = again.finish(held, End::Succeeded(SUMMARY)).await;
    assert_eq!(stale.expect_err("the claim is over").kind, Kind::Conflict);
    let (ticket, _) = claim(again).await;
    assert_eq!(ticket, Ticket { job: keyed.id, attempt: 2 });
    let seqs: Vec<_> = events(again, keyed.id, 0, 9).await.into_iter().map(|event| (event.seq, event.what)).collect();
    let states = [State::Queued, State::Running, State::Queued, State::Running].map(What::State);
    assert_eq!(seqs, (1..).zip(states).collect::<Vec<_>>(), "numbers go on");
    // crashes count
    again.release(ticket, Release::Failed(Error::new(Kind::Internal, "x"))).await.expect("released");
    let (ticket, _) = claim(again).await;
    let end = again.release(ticket, Release::Failed(Error::new(Kind::Internal, "x"))).await;
    assert_eq!(end, Ok(State::Failed));
    // and numbers of jobs are not used again
    let next = create(again).await;
    let page = again.list(&ListQuery { limit: 1, ..ListQuery::default() }).await.expect("listed");
    assert_eq!(page.jobs[0].id, next.id);
}

async fn a_foreign_cursor_is_refused(store: &dyn JobStore) {
    for cursor in ["", "7", "%%", "AAAA", "ü"] {
        let query = ListQuery { cursor: Some(cursor.to_owned()), limit: 5, ..ListQuery::default() };
        let refused = store.list(&query).await.expect_err(cursor);
        assert_eq!(refused.kind, Kind::InvalidParameter, "{cursor}");
    }
}

async fn arrivals_wake_a_worker(store: Arc<dyn JobStore>) {
    let mut arrivals = store.arrivals();
    assert!(arrivals.has_changed().expect("still there"), "a worker looks before it waits");
    arrivals.borrow_and_update();
    let worker = tokio::spawn({
        let store = Arc::clone(&store);
        async move {
            arrivals.changed().await.expect("still there");
            claim(store.as_ref()).await.0.job
        }
    });
    let id = create(store.as_ref()).await.id;
    let claimed = tokio::time::timeout(Duration::from_secs(10), worker).await;
    assert_eq!(claimed.expect("in time").expect("no panic"), id);
}

async fn many_at_once_lose_nothing(store: Arc<dyn JobStore>) {
    let clients: Vec<_> = (0..50)
        .map(|_| {
            let store = Arc::clone(&store);
            tokio::spawn(async move { create(store.as_ref()).await.id })
        })
        .collect();
    let workers: Vec<_> = (0..8)
        .map(|_| {
            let store = Arc::clone(&store);
            tokio::spawn(async move {
                let mut arrivals = store.arrivals();
                let mut claimed = Vec::new();
                loop {
                    arrivals.borrow_and_update();
                    while let Some((ticket, _)) = store.claim(1, LEASE).await.expect("claimable").pop() {
                        let row = vec![What::Iteration("{}".to_owned())];
                        store.append(ticket, row, Progress::default()).await.expect("appended");
                        store.finish(ticket, End::Succeeded(SUMMARY)).await.expect("finished");
                        claimed.push(ticket.job);
                    }
                    let patience = Duration::from_millis(200);
                    if tokio::time::timeout(patience, arrivals.changed()).await.is_err() {
                        return claimed;
                    }
                }
            })
        })
        .collect();
    let mut created = Vec::new();
    for client in clients {
        created.push(client.await.expect("no panic"));
    }
    let mut claimed = Vec::new();
    for worker in workers {
        claimed.extend(worker.await.expect("no panic"));
    }
    created.sort();
    claimed.sort();
    assert_eq!(created, claimed);
    for id in created {
        let events = events(store.as_ref(), id, 0, 99).await;
        assert_eq!(events.len(), 4);
    }
}
