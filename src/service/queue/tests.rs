//! Each rule, and random histories of all of them.

pub(crate) mod history;
pub(crate) mod model;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, SystemTime};

use futures_util::FutureExt;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;

use self::history::{New, RULES, Step, Stored, histories, play, state};
use self::model::{Altered, Model, claiming};
use super::{Change, Picks, Standing, State, Suspect, Tenant, Turn, View, Waiting, claim, crashed};

fn seen(history: &[Step], workers: usize, altered: Altered, ends: bool) -> Vec<String> {
    let mut model = Model::new(workers, altered);
    play(history, &mut model, ends).now_or_never().expect("the model does not wait")
}

proptest! {
    /// What must hold for every queue is checked by [`play`].
    #[test]
    fn rules_hold_in_every_history(history in histories(), workers in 1..4usize) {
        seen(&history, workers, Altered::Nothing, true);
    }
}

/// Whether altered rules are noticed in some of 100 histories.
fn is_noticed(is_other: impl Fn(&[Step]) -> bool) -> bool {
    let mut runner = TestRunner::deterministic();
    (0..100).any(|_| is_other(&histories().new_tree(&mut runner).expect("a history").current()))
}

#[test]
fn other_rules_are_noticed() {
    let seen = |history: &[Step], altered, ends| seen(history, 2, altered, ends);
    assert!(is_noticed(|history| seen(history, Altered::Suspects, false) != seen(history, Altered::Nothing, false)));
    let panics = |history: &[Step], altered| catch_unwind(AssertUnwindSafe(|| seen(history, altered, true))).is_err();
    let fails = |altered| is_noticed(|history| panics(history, altered));
    assert!(fails(Altered::Blame), "an innocent job is given up");
    assert!(!fails(Altered::Nothing));
}

fn tenant(name: &str, running: u64, next: f64, numbers: std::ops::Range<i64>) -> Tenant {
    let waiting = numbers.map(|number| Waiting { urgency: 0, number }).collect();
    Tenant { name: name.to_owned(), running, next, waiting, suspect: None }
}

fn view(tenants: Vec<Tenant>) -> View {
    View { tenants, clock: 0.0, mine: Vec::new(), is_least_busy: true }
}

fn now() -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_secs(1 << 30)
}

#[test]
fn tenants_are_served_within_one_job_of_their_weights_and_a_pause_gives_no_credit() {
    let (mut next, mut clock, mut served) = ([0.0; 2], 0.0f64, [0.0; 2]);
    for turn in 0..2400 {
        // nothing of `a` waits for a while
        let rests = (400..1000).contains(&turn);
        let tenants = vec![tenant("a", 0, next[0], 0..i64::from(!rests)), tenant("b", 0, next[1], 1..2)];
        let picks = claim(View { clock, ..view(tenants) }, &claiming(0, 1, 0, 3), &RULES, now());
        let index = usize::from(picks.turns[0].tenant == "b");
        (next[index], clock) = (picks.turns[0].next, picks.turns[0].served);
        if !rests {
            served[index] += 1.0;
            let turns = f64::from(if turn < 400 { turn } else { turn - 600 } + 1);
            let slack = if turn < 400 { 1.0 } else { 2.0 };
            let is_fair = |jobs: f64, share: f64| (jobs - turns * share).abs() <= slack;
            assert!(is_fair(served[0], 0.25) && is_fair(served[1], 0.75), "{served:?}");
        }
    }
}

#[test]
fn running_jobs_by_weight_come_first_then_turns_then_age_and_limits_and_newcomers_hold() {
    let picks = |a: u64, b: u64, c: u64, next_of_a: f64, limit, newcomers| {
        let tenants = vec![tenant("b", b, 0.0, 20..29), tenant("a", a, next_of_a, 10..19), tenant("c", c, 0.0, 30..39)];
        claim(view(tenants), &claiming(0, limit, newcomers, 4), &RULES, now()).numbers
    };
    assert_eq!(picks(1, 3, 1, 0.0, 1, 0), [20], "3 of weight 4 are fewer than 1");
    assert_eq!(picks(1, 4, 1, 0.0, 1, 0), [10], "the older one of equals");
    assert_eq!(picks(1, 4, 1, 0.5, 1, 0), [20], "the earlier turn of equals");
    assert_eq!(picks(9, 9, 0, 0.0, 3, 0), [30, 20, 21], "one of the limit of 1");
    assert_eq!(picks(0, 1, 1, 0.0, 0, 5), [10], "one of each newcomer");
    assert_eq!(picks(0, 0, 1, 0.0, 6, 0), [10, 20, 21, 22, 23, 11]);
}

#[test]
fn a_suspect_starts_alone_and_waits_for_that_in_bounded_time() {
    let seconds = |seconds: u64| Duration::from_secs(seconds);
    let due = now();
    let suspect = Suspect { number: 9, crashes: 2, not_before: due };
    let tenants = || vec![Tenant { suspect: Some(suspect), ..tenant("a", 0, 0.0, 0..2) }];
    let running = Standing { state: State::Running, started_at: Some(due), ..Standing::default() };
    let picks = |mine: &[Standing], at, limit, is_least_busy| {
        let view = View { mine: mine.to_vec(), is_least_busy, ..view(tenants()) };
        let Picks { numbers, again, .. } = claim(view, &claiming(0, limit, 1, 1), &RULES, at);
        (numbers, again)
    };
    assert_eq!(picks(&[], due, 8, true), (vec![9], None), "nothing beside it");
    assert_eq!(picks(&[], due - seconds(1), 8, true), (vec![0, 1], Some(due)), "it pauses");
    let latest = due + seconds(60);
    assert_eq!(picks(&[running], due + seconds(59), 0, true), (vec![], Some(latest)), "others end first");
    assert_eq!(picks(&[], due, 0, true), (vec![], Some(latest)), "a place becomes free first");
    assert_eq!(picks(&[running], due + seconds(59), 8, false), (vec![0, 1], Some(latest)), "another worker waits");
    assert_eq!(picks(&[running], latest, 8, true), (vec![9], None), "others take too long");
    assert_eq!(picks(&[running], latest, 0, true), (vec![0], None), "it takes no place for newcomers");
    let alone = Standing { suspicion: 3, ..running };
    assert_eq!(picks(&[alone], due + seconds(119), 8, false), (vec![], Some(due + seconds(120))), "one runs alone");
    assert_eq!(picks(&[alone], due + seconds(120), 8, true), (vec![9], None));
    // the clock was set back
    let before = due - RULES.crash_pause - seconds(1);
    assert_eq!(picks(&[alone], before, 8, true), (vec![9], None));
    let capped = vec![Tenant { suspect: Some(suspect), ..tenant("c", 1, 0.0, 0..2) }];
    assert_eq!(claim(view(capped), &claiming(0, 8, 0, 1), &RULES, due), Picks::default(), "its tenant is at its limit");
    let turns = claim(view(tenants()), &claiming(0, 8, 1, 1), &RULES, due).turns;
    assert_eq!(turns, [Turn { tenant: "a".to_owned(), served: 0.0, next: 1.0 }], "it is a turn like any other");
    assert_eq!([1, 2, 8].map(claim::alone), [30, 60, 3840].map(seconds));
    assert!(claim::alone(u32::MAX) < seconds(1 << 22));
}

#[test]
fn a_job_is_claimed_once_blamed_alone_and_begins_anew_with_a_retry() {
    let apply = |job: Standing, change| job.apply(change, &RULES, now());
    let claim = Change::Claim("w".into(), Duration::ZERO);
    let (running, _) = apply(Standing { is_small: true, ..Standing::default() }, claim.clone()).expect("it waits");
    assert_eq!(apply(running, claim), Err(State::Running));
    let claimed = Standing { has_begun: false, ..running };
    let blamed = |counts: [bool; 2]| counts.map(|counts| Change::Crashed { counts });
    assert_eq!(crashed(&[claimed, running]), blamed([false, true]));
    assert_eq!(crashed(&[running, running]), blamed([false, false]), "either may have caused it");
    let ended = Standing { state: State::Succeeded, ..running };
    assert_eq!(apply(ended, Change::Cancel), Ok((ended, None)), "it stays");
    let failed = Standing { state: State::Failed, suspicion: 5, cancel_requested: true, ..running };
    let (again, _) = apply(failed, Change::Retry).expect("it failed");
    assert_eq!((again.uncounted, again.suspicion, again.not_before), (again.attempt, 1, Some(now())));
    assert!(!again.cancel_requested && !again.has_begun);
}

/// On a worker that is never idle: jobs take 40 seconds, and one is claimed every 20.
#[tokio::test]
async fn a_late_killer_among_many_jobs_is_given_up_and_they_are_not() {
    let mut model = Model::new(1, Altered::Nothing);
    let mut running = Vec::new();
    let new = |tenant| New { tenant, priority: 0, is_small: true, kills_after: None };
    model.create(new("a")).await;
    for round in 0..1000 {
        model.create(new("b")).await;
        let claimed = model.claim(0, 1, 0).await;
        running.extend(claimed.into_iter().map(|(job, attempt)| (job, attempt, round)));
        model.wait(20).await;
        if running.iter().any(|(job, _, start)| *job == 0 && start + 5 == round) {
            running.clear();
            model.crash(0).await;
        }
        for (job, attempt, _) in running.extract_if(.., |(job, _, start)| *job > 0 && *start < round) {
            assert!(model.change(job, Change::End { attempt, state: State::Succeeded, problem: None }).await);
        }
    }
    let mut states = Vec::new();
    for job in 0..600 {
        states.push(state(&model.events(job).await));
    }
    assert_eq!(states[0], State::Failed);
    assert!(states[1..].iter().all(|state| *state == State::Succeeded), "{states:?}");
}
