//! What is wrong with the service right now, by name: the reasons in `/readyz` and in the metrics.
//!
//! Code that finds a part of the service broken reports it here, and clears it when the part works again. A part that
//! fails makes the service not ready. A degraded part is listed; jobs are taken all the same.

use std::collections::BTreeMap;

use parking_lot::Mutex;
use serde::Serialize;
use utoipa::ToSchema;

/// A part of the service that can be broken
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[schema(as = ServicePart)]
pub(crate) enum Part {
    /// The process itself: it fails while it stops.
    Process,
    /// Where jobs and events are kept.
    Store,
    /// The folder of uploads and results.
    Disk,
    /// What clusters.
    Device,
    /// The file of tokens.
    Tokens,
}

impl Part {
    pub const ALL: [Part; 5] = [Part::Process, Part::Store, Part::Disk, Part::Device, Part::Tokens];

    /// As it is written in JSON and in metrics.
    pub fn name(self) -> &'static str {
        match self {
            Part::Process => "process",
            Part::Store => "store",
            Part::Disk => "disk",
            Part::Device => "device",
            Part::Tokens => "tokens",
        }
    }
}

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Severity {
    /// Jobs are taken, but something is not as it should be.
    Degraded,
    /// No jobs are taken.
    Failing,
}

/// What is wrong with a part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub(crate) struct Condition {
    /// The part.
    part: Part,
    /// How bad it is.
    severity: Severity,
    /// What is wrong, for people.
    #[schema(example = "the disk is full")]
    detail: String,
}

#[derive(Debug, Default)]
pub(crate) struct Health {
    wrong: Mutex<BTreeMap<Part, Condition>>,
}

impl Condition {
    /// The same without what only the operator is to know, such as paths.
    pub fn without_detail(self) -> Self {
        let detail = match (self.part, self.severity) {
            (Part::Process, _) => "the service is stopping",
            (_, Severity::Degraded) => "works, but not as it should",
            (_, Severity::Failing) => "does not work",
        };
        Self { detail: detail.to_owned(), ..self }
    }
}

impl Health {
    /// `part` works, but not as it should.
    pub fn degrade(&self, part: Part, detail: impl Into<String>) {
        self.set(part, Severity::Degraded, detail.into());
    }

    /// `part` does not work: jobs cannot be taken.
    pub fn fail(&self, part: Part, detail: impl Into<String>) {
        self.set(part, Severity::Failing, detail.into());
    }

    pub fn clear(&self, part: Part) {
        if self.wrong.lock().remove(&part).is_some() {
            tracing::info!(part = part.name(), "works again");
        }
    }

    /// Everything that is wrong, in the order of [`Part::ALL`].
    pub fn conditions(&self) -> Vec<Condition> {
        self.wrong.lock().values().cloned().collect()
    }

    pub fn severity(&self, part: Part) -> Option<Severity> {
        self.wrong.lock().get(&part).map(|condition| condition.severity)
    }

    fn set(&self, part: Part, severity: Severity, detail: String) {
        let condition = Condition { part, severity, detail };
        let mut wrong = self.wrong.lock();
        if wrong.get(&part) != Some(&condition) {
            tracing::warn!(part = part.name(), ?severity, "{}", condition.detail);
            wrong.insert(part, condition);
        }
    }
}

/// Why these conditions keep the service from taking jobs, for people; none when they do not.
pub(crate) fn why_not_ready(conditions: &[Condition]) -> Option<String> {
    let failing = conditions.iter().filter(|condition| condition.severity == Severity::Failing);
    let reasons: Vec<_> = failing.map(|condition| format!("{}: {}", condition.part.name(), condition.detail)).collect();
    (!reasons.is_empty()).then(|| reasons.join("; "))
}
