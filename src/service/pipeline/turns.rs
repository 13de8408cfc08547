//! Turns at the device: which of the meshes that wait for it is next, and which may pass it by.
//!
//! Turns are shared fairly among tenants by the time that each used the device, divided by its weight ([`fairness`]); a
//! tenant's own meshes come in the order of their arrival. Knows no device.
//!
//! [`fairness`]: crate::service::store::fairness

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use tokio::sync::oneshot;

use crate::service::store::fairness::{Share, Turns};

/// A mesh is short beside another one of at least so many times its cost.
const SHORT: u64 = 4;

/// A queue before the device, in which one mesh at a time has its turn.
#[derive(Debug, Default)]
pub(super) struct Line(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    turns: Turns,
    /// Cost of the mesh that has its turn.
    cost: Option<u64>,
    /// Those that wait, in the order of their arrival. Some may not wait any more.
    waiting: Vec<Waiting>,
}

#[derive(Debug)]
struct Waiting {
    visit: Visit,
    called: oneshot::Sender<Turn>,
}

/// What waits for a turn.
#[derive(Debug, Clone)]
pub(super) struct Visit {
    /// Whose mesh it is.
    pub tenant: Arc<str>,
    /// What that tenant may use.
    pub share: Share,
    /// About how much work it is, in any unit; 0 takes the turn without being charged to anybody.
    pub cost: u64,
}

impl Visit {
    /// For what is done for all tenants.
    pub fn of_nobody() -> Self {
        Self { tenant: "".into(), share: Share::default(), cost: 0 }
    }
}

/// The turn of a mesh, until it is dropped.
#[derive(Debug)]
pub(super) struct Turn {
    line: Arc<Line>,
    visit: Visit,
    started: Instant,
}

impl Line {
    /// Waits for the turn of a mesh.
    pub async fn turn(self: &Arc<Self>, visit: Visit) -> Turn {
        let called = {
            let mut state = self.lock();
            if state.cost.is_none() {
                return self.begin(&mut state, visit);
            }
            let (called, call) = oneshot::channel();
            state.waiting.push(Waiting { visit: visit.clone(), called });
            call
        };
        match called.await {
            Ok(turn) => turn,
            // never: the sender is kept until it is used
            Err(_) => std::future::pending().await,
        }
    }

    /// Whether a mesh is short beside the one that has its turn.
    pub fn is_short(&self, cost: u64) -> bool {
        self.lock().cost.is_some_and(|other| other / SHORT >= cost)
    }

    fn begin(self: &Arc<Self>, state: &mut State, visit: Visit) -> Turn {
        state.cost = Some(visit.cost);
        state.turns.serve(&visit.tenant);
        Turn { line: Arc::clone(self), visit, started: Instant::now() }
    }

    /// The turn of the next one that still waits.
    fn call_next(self: &Arc<Self>, state: &mut State) -> Option<(oneshot::Sender<Turn>, Turn)> {
        state.cost = None;
        state.waiting.retain(|waiting| !waiting.called.is_closed());
        let start = |waiting: &Waiting| state.turns.start(&waiting.visit.tenant);
        let next =
            (0..state.waiting.len()).min_by(|&a, &b| start(&state.waiting[a]).total_cmp(&start(&state.waiting[b])))?;
        let Waiting { visit, called } = state.waiting.remove(next);
        Some((called, self.begin(state, visit)))
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let next = {
            let mut state = self.line.lock();
            if self.visit.cost > 0 {
                let seconds = self.started.elapsed().as_secs_f64();
                state.turns.charge(&self.visit.tenant, seconds, self.visit.share);
            }
            self.line.call_next(&mut state)
        };
        if let Some((called, turn)) = next {
            // One that stopped waiting in this moment drops its turn, which calls the next.
            let _ = called.send(turn);
        }
    }
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt as _;

    use super::*;

    fn visit(tenant: &str, cost: u64) -> Visit {
        Visit { tenant: tenant.into(), share: Share::default(), cost }
    }

    #[tokio::test]
    async fn a_tenant_that_used_nothing_comes_before_one_that_waits_longer() {
        let line = Arc::<Line>::default();
        let first = line.turn(visit("many", 9)).await;
        let mut second = Box::pin(line.turn(visit("many", 9)));
        let mut gone = Box::pin(line.turn(visit("few", 9)));
        let mut other = Box::pin(line.turn(visit("few", 9)));
        for waiting in [&mut second, &mut gone, &mut other] {
            assert!(waiting.now_or_never().is_none(), "the first has its turn");
        }
        drop(gone);
        while first.started.elapsed().is_zero() {}
        drop(first);
        assert!((&mut second).now_or_never().is_none(), "its tenant has used the device");
        let other = other.now_or_never().expect("it has used nothing");
        drop(other);
        drop(second.now_or_never().expect("nobody else waits"));
        assert!(line.turn(visit("many", 9)).now_or_never().is_some(), "the line is empty");
    }

    #[tokio::test]
    async fn a_mesh_is_short_beside_a_longer_one_only() {
        let line = Arc::<Line>::default();
        assert!(!line.is_short(1), "nothing has its turn");
        let turn = line.turn(visit("a", 100)).await;
        assert!(line.is_short(25) && !line.is_short(26));
        drop(turn);
        assert!(!line.is_short(1));
    }
}
