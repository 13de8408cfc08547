//! Which jobs are found: pages, tenants, ages, and notices; and which workers.

use super::*;
use crate::store::Worker;

pub(super) async fn pages_hold_every_job_once_and_go_on_only_at_their_own_cursors(store: &Store) {
    let mut newest_first = Vec::new();
    for _ in 0..7 {
        newest_first.insert(0, create(store).await.id);
    }
    let mut query = first(3);
    let mut seen = Vec::new();
    loop {
        let page = store.list(&query).await.expect("listed");
        seen.extend(ids(&page.jobs));
        // What is added or deleted between pages moves nothing.
        create(store).await;
        let Some(next) = page.next else { break };
        assert_eq!(page.jobs.len(), 3);
        query.cursor = Some(next);
    }
    assert_eq!(seen, newest_first);
    for foreign in ["", "7", "%%", "AAAA", "ü", "-", "7-x", "x-00000000-0000-4000-8000-000000000000"] {
        query.cursor = Some(foreign.to_owned());
        assert_eq!(store.list(&query).await.expect_err(foreign).kind, Kind::InvalidParameter, "{foreign}");
    }

    let (ticket, running) = claim(store).await;
    let only = store.list(&ListQuery { state: Some(State::Running), ..first(1) }).await.expect("listed");
    assert_eq!(only, Page { jobs: vec![running], next: None });
    let queued = store.list(&ListQuery { state: Some(State::Queued), ..first(100) }).await.expect("listed");
    let (newest, oldest) = (queued.jobs[0].queue_position, queued.jobs[8].queue_position);
    assert_eq!((queued.jobs.len(), newest, oldest), (9, Some(9), Some(1)));
    store.end(ticket, End::Cancelled).await.expect("finished");
    let ended = store.list(&ListQuery { state: Some(State::Cancelled), ..first(9) }).await.expect("listed");
    assert_eq!(ids(&ended.jobs), [ticket.job]);
}

pub(super) async fn a_tenant_sees_only_its_own_jobs(store: &Store) {
    let mut mine = Vec::new();
    for turn in 0..5 {
        let job = add(store, of_tenant(["mine", "Mine"][turn % 2])).await;
        if turn % 2 == 0 {
            mine.insert(0, job.id);
        }
    }
    let (_, running) = claim(store).await;
    assert_eq!(running.spec.tenant, "mine");
    let list = |state, cursor, limit| ListQuery { tenant: "mine".to_owned(), state, cursor, limit };
    let first = store.list(&list(None, None, 2)).await.expect("listed");
    let rest = store.list(&list(None, first.next, 2)).await.expect("listed");
    assert_eq!([ids(&first.jobs), ids(&rest.jobs)].concat(), mine);
    assert_eq!(rest.next, None, "what others have is no next page");
    let queued = store.list(&list(Some(State::Queued), None, 9)).await.expect("listed");
    assert_eq!(ids(&queued.jobs), mine[..2]);
    let unknown = ListQuery { tenant: "unknown".to_owned(), limit: 9, ..ListQuery::default() };
    assert_eq!(store.list(&unknown).await.expect("listed"), Page::default());
}

pub(super) async fn the_oldest_job_that_waits_is_known(store: &Store) {
    assert_eq!(store.oldest_queued().await, Ok(None));
    let first = create(store).await;
    let second = create(store).await;
    assert_eq!(store.oldest_queued().await, Ok(Some(first.created_at)));
    claim(store).await;
    assert_eq!(store.oldest_queued().await, Ok(Some(second.created_at)));
    store.cancel(second.id).await.expect("asked");
    assert_eq!(store.oldest_queued().await, Ok(None));
}

pub(super) async fn ended_jobs_are_found_by_their_age(store: &Store) {
    let mut ended = Vec::new();
    for _ in 0..3 {
        create(store).await;
        ended.push(run_to(store, End::Cancelled).await);
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

pub(super) async fn every_end_with_a_webhook_is_untold_until_settled(store: &Store) {
    let mut endings = store.endings();
    assert!(endings.has_changed().expect("still there"), "the teller looks before it waits");
    endings.borrow_and_update();
    let mut ids = Vec::new();
    for _ in 0..4 {
        let hooked = Spec { webhook: Some("https://a.example/x?y=1".to_owned()), ..spec() };
        ids.push(add(store, hooked).await.id);
    }
    let silent = create(store).await.id;
    assert_eq!(store.untold().await.expect("readable"), []);
    store.cancel(ids[3]).await.expect("asked");
    assert!(endings.has_changed().expect("still there"));
    let mut ended = vec![ids[3]];
    for end in [End::Succeeded(SUMMARY), End::Failed(Error::new(Kind::InvalidMesh, "x")), End::Cancelled] {
        endings.borrow_and_update();
        ended.push(run_to(store, end).await);
        assert!(endings.has_changed().expect("still there"));
    }
    assert_eq!(run_to(store, End::Cancelled).await, silent);
    assert_eq!(store.untold().await.expect("readable"), ended, "without a webhook there is no notice");
    let ended_at = get(store, ended[1]).await.ended_at.expect("ended");
    store.settle_webhook(ended[1], ended_at - LEASE).await.expect("another end");
    assert_eq!(store.untold().await.expect("readable"), ended);
    store.settle_webhook(ended[1], ended_at).await.expect("settled");
    store.settle_webhook(ended[1], ended_at).await.expect("settled again");
    store.settle_webhook(JobId::random(), ended_at).await.expect("nothing");
    assert_eq!(store.untold().await.expect("readable"), [&ended[..1], &ended[2..]].concat());
    // what was promised outlasts the job
    for (id, state, problem) in
        [(ended[0], State::Cancelled, None), (ended[2], State::Failed, Some(Error::new(Kind::InvalidMesh, "x")))]
    {
        let job = get(store, id).await;
        store.delete(id).await.expect("deleted");
        let notice = Notice {
            job: id,
            webhook: job.spec.webhook.expect("hooked"),
            trace_parent: job.spec.trace_parent,
            state,
            problem,
            ended_at: job.ended_at.expect("ended"),
            end: 1,
        };
        assert_eq!(store.notice(id).await.expect("readable"), Some(notice));
    }
    assert_eq!(store.untold().await.expect("readable"), [&ended[..1], &ended[2..]].concat());
    let notice = store.notice(ended[0]).await.expect("readable").expect("untold");
    store.settle_webhook(ended[0], notice.ended_at).await.expect("settled");
    assert_eq!(store.untold().await.expect("readable"), ended[2..]);
    for id in [ended[0], silent, JobId::random()] {
        assert_eq!(store.notice(id).await.expect("readable"), None);
    }
}

async fn announced(store: &Store) -> Worker {
    store.announce("w", "a device").await.expect("announced");
    let mut workers = store.workers().await.expect("readable");
    assert_eq!(workers.len(), 1, "{workers:?}");
    workers.remove(0)
}

pub(super) async fn a_worker_is_known_with_its_jobs(store: &Store) {
    assert_eq!(store.workers().await, Ok(vec![]), "it was not announced");
    let worker = announced(store).await;
    assert_eq!((&*worker.name, &*worker.version), ("w", env!("CARGO_PKG_VERSION")));
    assert_eq!((worker.device.as_deref(), worker.jobs.len()), (Some("a device"), 0));
    for _ in 0..2 {
        create(store).await;
    }
    let (ticket, job) = claim(store).await;
    let again = announced(store).await;
    assert_eq!((again.id, again.started_at, &*again.jobs), (worker.id, worker.started_at, &[job.id][..]));
    assert!(again.seen_at >= worker.seen_at);
    store.end(ticket, End::Cancelled).await.expect("finished");
    assert!(announced(store).await.jobs.is_empty());
}
