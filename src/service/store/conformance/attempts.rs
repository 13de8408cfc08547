//! Jobs that are claimed more than once: releases, leases, and a crash.

use super::super::database::values;
use super::*;

pub(super) async fn a_released_job_runs_again_in_its_place(store: &Store) {
    let first = create(store).await.id;
    let second = create(store).await.id;
    let mut arrivals = store.arrivals();
    let (ticket, _) = claim(store).await;
    let row = vec![JobEvent::Iteration("{}".to_owned())];
    store.append(ticket, row.clone(), Progress::default()).await.expect("appended");
    arrivals.borrow_and_update();
    assert_eq!(store.release(ticket, None).await, Ok(State::Queued));
    assert!(arrivals.has_changed().expect("still there"), "a worker is told");
    assert_eq!(get(store, first).await.queue_position, Some(1));
    assert_eq!(get(store, second).await.queue_position, Some(2));
    for stale in [
        store.end(ticket, End::Cancelled).await,
        store.append(ticket, row, Progress::default()).await,
        store.release(ticket, None).await.map(drop),
    ] {
        assert_eq!(stale.expect_err("released").kind, Kind::Conflict);
    }

    let claimed = store.claim(9, LEASE).await.expect("claimable");
    assert_eq!(jobs_of(&claimed), [first, second]);
    assert_eq!((claimed[0].0.attempt, claimed[0].1.attempt), (2, 2));
    arrivals.borrow_and_update();
    store.end(claimed[0].0, End::Succeeded(SUMMARY)).await.expect("finished");
    assert!(arrivals.has_changed().expect("still there"), "an end may let another job of the tenant start");
    let last = [JobEvent::Queued, JobEvent::Started(2, "test".to_owned()), JobEvent::End(State::Succeeded, None)];
    assert_eq!(whats(store, first).await[3..], last);
}

pub(super) async fn a_lease_that_is_over_is_reclaimed(store: &Store) {
    let lost = create(store).await.id;
    let kept = create(store).await.id;
    let tickets = [claim(store).await.0, claim(store).await.0];
    assert_eq!(store.reclaim().await, Ok(vec![]));
    assert_eq!(store.heartbeat(&tickets, Duration::ZERO).await, Ok(vec![]));
    assert_eq!(store.heartbeat(&tickets[1..], LEASE).await, Ok(vec![]), "a lease that is over is prolonged");
    assert_eq!(store.reclaim().await, Ok(vec![tickets[0]]));
    assert_eq!(get(store, lost).await.state, State::Queued);
    assert_eq!(get(store, kept).await.state, State::Running);
    assert_eq!(store.heartbeat(&tickets, LEASE).await, Ok(vec![tickets[0]]));
    assert_eq!(claim(store).await.0, Ticket { job: lost, attempt: 2 });
    assert_eq!(store.heartbeat(&tickets, LEASE).await, Ok(vec![tickets[0]]), "another one's by now");
}

pub(super) async fn attempts_whose_lease_is_over_are_counted(store: &Store) {
    let id = create(store).await.id;
    // one that has not begun counts for nothing
    for (begins, expected) in [(false, (0, 0)), (true, (1, 0)), (true, (2, 0)), (true, (3, 1))] {
        let (ticket, _) = claim(store).await;
        if begins {
            store.begin(ticket).await.expect("begun");
        }
        assert_eq!(store.heartbeat(&[ticket], Duration::ZERO).await, Ok(vec![]));
        assert_eq!(store.reclaim().await, Ok(vec![ticket]));
        let Statistics { attempts_failed, given_up, .. } = store.statistics();
        assert_eq!((attempts_failed, given_up), expected);
    }
    assert!(get(store, id).await.keeps_upload(), "it was given up");
}

pub(super) async fn a_job_of_a_later_release_stops_no_other(store: &Store) {
    let webhook = Some("https://a.example/".to_owned());
    let later = add(store, Spec { is_small: true, webhook, ..spec() }).await.id;
    let others = [create(store).await.id, create(store).await.id];
    let write = async |spec: String| {
        let sql = "UPDATE jobs SET spec = $2 WHERE id = $1";
        let written = store.change("test", move |change| change.rows.write(sql, values![later, &*spec]));
        written.await.expect("written");
    };
    write(r#"{"trace_parent":null,"of_a_later_release":1}"#.to_owned()).await;
    assert_eq!(jobs_of(&store.claim(9, Duration::ZERO).await.expect("the others")), others);
    assert_eq!(ids(&store.list(&first(9)).await.expect("listed").jobs), [others[1], others[0]]);
    assert_eq!(store.get(later).await.expect_err("not known here").kind, Kind::Internal);
    assert_eq!(store.reclaim().await.expect("reclaimed").len(), 3, "it waits again");
    assert_eq!(store.statistics().attempts_failed, 0);
    write(serde_json::to_string(&spec()).expect("a text")).await;
    assert_eq!(claim(store).await.0, Ticket { job: later, attempt: 2 }, "as by a worker of that release");
}

/// Everything that was answered is there after a crash; what ran waits again, which counts.
pub(super) async fn a_crash_loses_nothing(store: &Store, after_crash: impl AsyncFn() -> Store) {
    let ended = create(store).await.id;
    let (ticket, _) = claim(store).await;
    let progress = Progress { iterations: 7, energy: Some(0.1), ..Progress::default() };
    let rows = (0..300).map(|row| JobEvent::Iteration(format!("{{\"iteration\":{row},\"name\":\"ü\\\"\"}}"))).collect();
    store.append(ticket, rows, progress).await.expect("appended");
    store.end(ticket, End::Failed(Error::new(Kind::InvalidMesh, "x"))).await.expect("finished");
    let keyed = add_new(store, with_key("a", "k", "digest")).await;
    let (held, _) = claim(store).await;
    store.begin(held).await.expect("begun");
    let asked_to_end = create(store).await.id;
    claim(store).await;
    store.cancel(asked_to_end).await.expect("asked");
    let waiting = create(store).await;
    let before = (get(store, ended).await, events(store, ended, 0, 999).await);

    let again = &after_crash().await;
    assert_eq!(again.statistics().attempts_failed, 1, "of the only job that had begun");
    assert_eq!((get(again, ended).await, events(again, ended, 0, 999).await), before);
    assert_eq!(get(again, waiting.id).await, waiting);
    assert_eq!(get(again, asked_to_end).await.state, State::Cancelled);
    let job = get(again, keyed.id).await;
    assert_eq!((job.state, job.queue_position, job.attempt), (State::Queued, Some(1), 1));
    assert_eq!(again.create(with_key("a", "k", "digest")).await, Ok(Created::Known(job)));
    let stale = again.end(held, End::Succeeded(SUMMARY)).await;
    assert_eq!(stale.expect_err("the claim is over").kind, Kind::Conflict);
    let (ticket, _) = claim(again).await;
    assert_eq!(ticket, Ticket { job: keyed.id, attempt: 2 });
    let started = |attempt| JobEvent::Started(attempt, "test".to_owned());
    let expected = [JobEvent::Queued, started(1), JobEvent::Queued, started(2)];
    assert_eq!(whats(again, keyed.id).await, expected, "numbers go on");
    // the crash counts for the only job that had begun
    again.begin(ticket).await.expect("begun");
    again.release(ticket, Some(Error::internal("x"))).await.expect("released");
    let (ticket, _) = claim(again).await;
    again.begin(ticket).await.expect("begun");
    let end = again.release(ticket, Some(Error::internal("x"))).await;
    assert_eq!(end, Ok(State::Failed));
    // and numbers of jobs are not used again
    let next = create(again).await;
    assert_eq!(ids(&again.list(&first(1)).await.expect("listed").jobs), [next.id]);
}

pub(super) async fn a_job_that_was_given_up_keeps_its_upload_and_runs_again_on_request(store: &Store) {
    let mesh = SmallBlob { name: "mesh".to_owned(), bytes: vec![1, 2, 3].into() };
    let webhook = Some("https://a.example/".to_owned());
    let spec = Spec { is_small: true, webhook, ..spec() };
    let id = add_new(store, NewJob { spec, upload: vec![mesh.clone()], ..new_job() }).await.id;
    assert_eq!(store.retry(id, None).await.expect_err("it waits").kind, Kind::Conflict);
    assert_eq!(store.retry(JobId::random(), None).await.expect_err("unknown").kind, Kind::NotFound);
    let give_up = async || {
        for attempt in 1..=3 {
            let (ticket, _) = claim(store).await;
            // a small upload begins with its claim
            let release = Some(Error::new(Kind::DeviceLost, "the card fell out"));
            let expected = if attempt == 3 { State::Failed } else { State::Queued };
            assert_eq!(store.release(ticket, release).await, Ok(expected), "attempt {attempt}");
        }
    };
    give_up().await;
    assert!(get(store, id).await.keeps_upload());
    for _ in 0..2 {
        assert_eq!(store.blob(id, "mesh").await, Ok(Some(mesh.bytes.clone())));
    }
    let mut pulses = store.watch(id).await.expect("watchable").expect("a job");
    assert!(pulses.borrow_and_update().ended);

    // a full queue takes it no more than a new one
    let others = [create(store).await.id, create(store).await.id];
    assert_eq!(store.retry(id, None).await.expect_err("full").kind, Kind::QueueFull);
    assert!(get(store, id).await.keeps_upload());
    store.cancel(others[0]).await.expect("asked");
    let job = store.retry(id, None).await.expect("it has failed");
    assert_eq!((job.state, job.problem.clone(), job.ended_at), (State::Queued, None, None));
    assert_eq!(job.queue_position, Some(1), "where it was");
    assert_eq!(job, get(store, id).await);
    assert!(!pulses.borrow_and_update().ended, "those who wait are told");
    assert_eq!(store.ended_before(SystemTime::now() + LEASE, 9).await, Ok(vec![others[0]]), "it does not expire");
    // with a fresh count, and another notice of the same end
    give_up().await;
    let earlier = store.notice(id).await.expect("readable").expect("untold");
    assert_eq!(earlier.end, 2);
    store.retry(id, None).await.expect("it has failed again");
    assert_eq!(store.untold().await, Ok(vec![id]));
    let (ticket, _) = claim(store).await;
    assert_eq!(ticket.attempt, 7);
    store.end(ticket, End::Succeeded(SUMMARY)).await.expect("finished");
    assert_eq!(store.untold().await, Ok(vec![id]), "the last end is told");
    store.settle_webhook(id, earlier.ended_at).await.expect("nothing");
    let last = store.notice(id).await.expect("readable").expect("it is another end");
    assert_eq!((last.state, last.end), (State::Succeeded, 3));
    assert_eq!(store.blob(id, "mesh").await, Ok(None), "it is of no use any more");
    assert!(whats(store, id).await.len() > 7, "numbered through all attempts");
    assert_eq!(store.retry(id, None).await.expect_err("it succeeded").kind, Kind::Conflict);
}
