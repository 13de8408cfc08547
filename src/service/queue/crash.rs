//! After a crash: which job it counts for, and what starts alone. The [queue](super) has the reasons.

use std::time::{Duration, SystemTime};

use super::job::{Change, Standing};
use super::rules::Rules;
use super::view::{Tenant, View};

/// Time alone after the first crash.
const ALONE: Duration = Duration::from_secs(30);

/// Doublings of [`ALONE`] at most: to 22 days.
const DOUBLINGS: u32 = 16;

/// For how long at most a worker that has other jobs waits for them before it starts a suspect of that many crashes;
/// and for how long after the start it claims nothing else.
pub(super) fn alone(crashes: u32) -> Duration {
    ALONE * (1 << crashes.saturating_sub(1).min(DOUBLINGS))
}

/// The changes of the running jobs of a worker that crashed. The crash counts only if it has one possible cause: a
/// single job that had begun.
pub(crate) fn crashed(jobs: &[Standing]) -> Vec<Change> {
    let begun = jobs.iter().filter(|job| job.has_begun).count();
    jobs.iter().map(|job| Change::Crashed { counts: job.has_begun && begun == 1 }).collect()
}

/// What suspects let a worker claim.
#[derive(Debug, PartialEq)]
pub(super) enum Allowed {
    /// Nothing until then, as a suspect runs alone, or is to.
    Nothing(SystemTime),
    /// Only the suspect of the tenant at this index.
    Suspect(usize),
    /// Jobs that are no suspects. The next suspect may start at that time, if one waits.
    Others(Option<SystemTime>),
}

/// What suspects let the worker claim now. `is_entitled` says which tenants are below their limits; `limit` is 0 when
/// the worker is full.
pub(super) fn allowed(
    view: &View,
    limit: usize,
    is_entitled: impl Fn(&Tenant) -> bool,
    rules: &Rules,
    now: SystemTime,
) -> Allowed {
    // times that are further away than they can be come from a clock that was set back: they are over
    let is_alone = |job: &&Standing| job.suspicion > 0 && job.started_at.is_some_and(|start| start <= now);
    let until = view.mine.iter().filter(is_alone).filter_map(|job| Some(job.started_at? + alone(job.suspicion))).max();
    if let Some(until) = until.filter(|until| *until > now) {
        return Allowed::Nothing(until);
    }
    let waiting = view.tenants.iter().enumerate().filter(|(_, tenant)| is_entitled(tenant));
    let waiting = waiting.filter_map(|(index, tenant)| {
        let suspect = tenant.suspect.as_ref()?;
        let is_in_reach = suspect.not_before <= now + rules.crash_pause;
        let start = if is_in_reach { suspect.not_before } else { SystemTime::UNIX_EPOCH };
        Some((start, suspect.number, suspect.crashes, index))
    });
    let Some((start, _, crashes, index)) = waiting.min() else { return Allowed::Others(None) };
    let latest = start + alone(crashes);
    if start > now {
        Allowed::Others(Some(start))
    } else if limit > 0 && (view.mine.is_empty() || latest <= now) {
        Allowed::Suspect(index)
    } else if latest > now && view.is_least_busy {
        Allowed::Nothing(latest)
    } else {
        Allowed::Others((latest > now).then_some(latest))
    }
}
