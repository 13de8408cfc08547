//! The life of a job, from its creation to its deletion.

use super::*;

pub(super) async fn jobs_are_as_they_were_created_and_claimed_in_order_and_once(store: &Store) {
    let new = NewJob { spec: spec(), ..new_job() };
    let first = add_new(store, new.clone()).await;
    assert_eq!((first.id, first.state, &first.spec), (new.id, State::Queued, &new.spec));
    assert_eq!((first.queue_position, first.started_at, &first.worker), (Some(1), None, &None));
    assert_eq!(get(store, first.id).await, first);
    assert_eq!(whats(store, first.id).await, [JobEvent::Queued]);
    let second = create(store).await;
    assert_eq!(second.queue_position, Some(2));
    let (ticket, job) = claim(store).await;
    assert_eq!((ticket.job, job.id), (first.id, first.id));
    assert_eq!((job.state, job.queue_position), (State::Running, None));
    assert!(job.started_at.is_some());
    assert_eq!(job.worker.as_deref(), Some("test"));
    assert_eq!(get(store, second.id).await.queue_position, Some(1));
    assert_eq!(claim(store).await.0.job, second.id);
    assert!(store.claim(1, LEASE).await.expect("claimable").is_empty());
    assert_eq!(store.counts().await.expect("counted"), [0, 2, 0, 0, 0]);
}

pub(super) async fn priorities_order_the_jobs_of_a_tenant(store: &Store) {
    let mut ids = Vec::new();
    for (tenant, priority) in [("a", -100), ("a", 0), ("a", 0), ("a", 100), ("b", 50)] {
        ids.push(add(store, Spec { priority, ..of_tenant(tenant) }).await.id);
    }
    let [low, old, new, high, other] = ids[..] else { panic!("five were made") };
    for (place, id) in (1..).zip([high, old, new, low]) {
        assert_eq!(get(store, id).await.queue_position, Some(place));
    }
    assert_eq!(get(store, other).await.queue_position, Some(1), "jobs of other tenants are not counted");
    let claimed = store.claim(9, LEASE).await.expect("claimable");
    assert_eq!(jobs_of(&claimed), [high, other, old, new, low]);
}

pub(super) async fn a_full_queue_refuses_until_a_job_starts(store: &Store) {
    create(store).await;
    store.check_room("a", None).await.expect("room for one more");
    create(store).await;
    assert_eq!(store.check_room("a", None).await.expect_err("full").kind, Kind::QueueFull);
    let new = new_job();
    assert_eq!(store.create(new.clone()).await.expect_err("full").kind, Kind::QueueFull);
    assert_eq!(store.get(new.id).await, Ok(None));
    claim(store).await;
    create(store).await;
}

pub(super) async fn events_are_numbered_and_read_from_anywhere(store: &Store) {
    let id = create(store).await.id;
    let (ticket, _) = claim(store).await;
    let mut pulses = store.watch(id).await.expect("watchable").expect("a job");
    let before = *pulses.borrow_and_update();
    assert_eq!((before.last_seq, before.ended), (2, false));
    let rows = |numbers: [u32; 2]| numbers.map(|row| JobEvent::Iteration(format!("{{\"iteration\":{row}}}"))).to_vec();
    let progress =
        Progress { iterations: 3, phase: Some(Phase::Boundary), rounds: 2, clusters_left: Some(70), energy: Some(0.1) };
    store.append(ticket, rows([0, 1]), Progress::default()).await.expect("appended");
    store.append(ticket, rows([2, 3]), progress).await.expect("appended");
    assert!(pulses.has_changed().expect("still there"));
    assert_eq!(pulses.borrow_and_update().last_seq, 6);
    assert_eq!(get(store, id).await.progress, progress);

    let all = events(store, id, 0, 99).await;
    assert!(all.iter().map(|event| event.seq).eq(1..=6), "{all:?}");
    assert_eq!(all[1].what, JobEvent::Started(1, "test".to_owned()));
    assert_eq!(all[5].what, JobEvent::Iteration("{\"iteration\":3}".to_owned()));
    assert_eq!(events(store, id, 3, 2).await, all[3..5]);
    assert_eq!(events(store, id, 6, 9).await, []);
    assert_eq!(events(store, id, u64::MAX, usize::MAX).await, []);
}

pub(super) async fn every_end_is_told(store: &Store) {
    let error = Error::new(Kind::InvalidMesh, "line 3: \"x\" is no number");
    for (end, state, problem, summary) in [
        (End::Succeeded(SUMMARY), State::Succeeded, None, Some(SUMMARY)),
        (End::Failed(error.clone()), State::Failed, Some(error.clone()), None),
        (End::Cancelled, State::Cancelled, None, None),
    ] {
        let id = create(store).await.id;
        let pulses = store.watch(id).await.expect("watchable").expect("a job");
        run_to(store, end).await;
        let job = get(store, id).await;
        assert_eq!((job.state, &job.problem, job.summary), (state, &problem, summary));
        assert!(job.ended_at >= job.started_at && job.started_at >= Some(job.created_at));
        assert!(pulses.borrow().ended);
        assert_eq!(events(store, id, 2, 9).await, [Event { seq: 3, what: JobEvent::End(state, problem) }]);
    }
}

pub(super) async fn a_ticket_that_is_over_writes_nothing(store: &Store) {
    let id = create(store).await.id;
    let (ticket, _) = claim(store).await;
    let other = Ticket { attempt: ticket.attempt + 1, ..ticket };
    for stale in [other, ticket] {
        if stale == ticket {
            store.end(ticket, End::Succeeded(SUMMARY)).await.expect("finished");
        }
        let before = (get(store, id).await, events(store, id, 0, 99).await);
        let row = vec![JobEvent::Iteration("{}".to_owned())];
        let appended = store.append(stale, row, Progress::default()).await;
        for written in [appended, store.end(stale, End::Cancelled).await] {
            assert_eq!(written.expect_err("stale").kind, Kind::Conflict);
        }
        assert_eq!((get(store, id).await, events(store, id, 0, 99).await), before);
    }
}

pub(super) async fn a_job_is_cancelled_at_once_while_it_waits_and_by_its_worker_while_it_runs(store: &Store) {
    let first = create(store).await.id;
    let second = create(store).await.id;
    let cancelled = store.cancel(first).await.expect("asked").expect("a job");
    assert_eq!(cancelled.state, State::Cancelled);
    assert_eq!(get(store, first).await, cancelled);
    assert_eq!(get(store, second).await.queue_position, Some(1));
    assert_eq!(whats(store, first).await[1], JobEvent::End(State::Cancelled, None));
    let (ticket, _) = claim(store).await;
    assert_eq!(ticket.job, second);
    let mut pulses = store.watch(second).await.expect("watchable").expect("a job");
    let job = store.cancel(second).await.expect("asked").expect("a job");
    assert_eq!((job.state, job.cancel_requested), (State::Running, true));
    pulses.wait_for(|pulse| pulse.cancel_requested && !pulse.ended).await.expect("told");
    assert_eq!(store.delete(second).await.expect("asked"), Deletion::Live);
    store.end(ticket, End::Cancelled).await.expect("finished");
    assert_eq!(get(store, second).await.state, State::Cancelled);
}

pub(super) async fn an_ended_job_cannot_be_cancelled_and_can_be_deleted(store: &Store) {
    let id = create(store).await.id;
    assert_eq!(store.delete(id).await.expect("asked"), Deletion::Live);
    run_to(store, End::Succeeded(SUMMARY)).await;
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

pub(super) async fn small_blobs_of_the_upload_stay_until_the_end_and_those_of_the_result_from_then_on(store: &Store) {
    let blob = |name: &str, bytes: Vec<u8>| SmallBlob { name: name.to_owned(), bytes: bytes.into() };
    let upload = [blob("mesh", (0..200_000).map(|at| at as u8).collect()), blob("ü/β", Vec::new())];
    let result = [blob("report", b"{}".to_vec()), blob("mesh", vec![7; 70_000])];
    let add = async || {
        let spec = Spec { is_small: true, ..spec() };
        add_new(store, NewJob { spec, upload: upload.to_vec(), ..new_job() }).await.id
    };
    let keeps = async |id: JobId, blobs: &[SmallBlob]| {
        for name in ["mesh", "ü/β", "report", "nothing"] {
            let found = store.blob(id, name).await.expect("readable");
            let expected = blobs.iter().find(|blob| blob.name == name).map(|blob| &blob.bytes);
            assert_eq!(found.as_ref(), expected, "{name}");
        }
    };
    let (succeeded, cancelled) = (add().await, add().await);
    keeps(succeeded, &upload).await;
    let (ticket, _) = claim(store).await;
    store.release(ticket, None).await.expect("released");
    let (ticket, _) = claim(store).await;
    keeps(succeeded, &upload).await;
    let stale = Ticket { attempt: 1, ..ticket };
    let progress = Progress { iterations: 3, ..Progress::default() };
    let rest = Some((vec![JobEvent::Iteration("{}".to_owned())], progress));
    let contents = Contents { bytes: 1 << 40, sha256: "ab".repeat(32) };
    let summary = Summary { is_small: true, blobs: BTreeMap::from([("labels.npy".to_owned(), contents)]), ..SUMMARY };
    let ending = Ending { end: End::Succeeded(summary.clone()), rest, result: result.to_vec() };
    assert_eq!(store.end(stale, ending.clone()).await.expect_err("stale").kind, Kind::Conflict);
    keeps(succeeded, &upload).await;
    store.end(ticket, ending).await.expect("ended");
    keeps(succeeded, &result).await;
    let job = get(store, succeeded).await;
    assert_eq!((job.state, job.summary, job.progress), (State::Succeeded, Some(summary), progress));
    let last = [JobEvent::Iteration("{}".to_owned()), JobEvent::End(State::Succeeded, None)];
    assert_eq!(whats(store, succeeded).await[4..], last);
    store.cancel(cancelled).await.expect("asked");
    keeps(cancelled, &[]).await;
    keeps(succeeded, &result).await;
    store.delete(succeeded).await.expect("deleted");
    keeps(succeeded, &[]).await;
}

pub(super) async fn unknown_jobs_are_unknown_everywhere(store: &Store) {
    let id = JobId::random();
    assert_eq!(store.get(id).await.expect("readable"), None);
    assert_eq!(store.cancel(id).await.expect("asked"), None);
    assert_eq!(store.events(id, 0, 9).await.expect("readable"), None);
    assert!(store.watch(id).await.expect("watchable").is_none());
    let finished = store.end(Ticket { job: id, attempt: 1 }, End::Cancelled).await;
    assert_eq!(finished.expect_err("unknown").kind, Kind::NotFound);
}

pub(super) async fn a_tenant_has_no_more_waiting_jobs_than_it_may(store: &Store) {
    let new = |tenant: &str| NewJob { spec: of_tenant(tenant), most_waiting: Some(2), ..new_job() };
    let at_once = join_all((0..4).map(|_| store.create(new("a")))).await;
    let refused = at_once.iter().filter_map(|created| created.as_ref().err());
    assert!(refused.clone().all(|error| error.kind == Kind::QueueFull && error.message.contains("of this tenant")));
    // services that share a database count at once
    assert!(store.is_shared() || refused.count() == 2);
    assert_eq!(store.create(new("a")).await.expect_err("full").kind, Kind::QueueFull);
    assert_eq!(store.check_room("a", Some(2)).await.expect_err("full").kind, Kind::QueueFull);
    store.check_room("a", None).await.expect("the queue has room");
    store.create(new("b")).await.expect("another tenant's");
}
