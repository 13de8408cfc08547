//! Turns at the device: which of the meshes that wait for it is next, and which are clustered beside it.
//!
//! Turns are shared fairly among tenants by the time that each used the device, divided by its weight
//! ([`virtual_times`]); a tenant's own meshes come in the order of their arrival. Knows no device.
//!
//! [`virtual_times`]: super::virtual_times

use std::sync::Arc;
use std::time::Instant;

use parking_lot::Mutex;
use tokio::sync::oneshot;

use super::virtual_times::VirtualTimes;
use crate::queue::Share;

/// A mesh is short beside another one of at least this multiple of its cost.
const SHORT: u64 = 4;

/// A queue before the device, in which one mesh at a time has its turn.
#[derive(Debug, Default)]
pub(super) struct Line(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    virtual_times: VirtualTimes,
    /// Cost of the mesh that has its turn.
    cost: Option<u64>,
    /// Visits that wait, in the order of their arrival; some may have given up.
    waiting: Vec<Waiting>,
}

#[derive(Debug)]
struct Waiting {
    visit: Visit,
    /// Whether it may be sent [`Place::Beside`].
    may_pass: bool,
    called: oneshot::Sender<Place>,
}

/// Where a mesh is clustered.
#[derive(Debug)]
pub(super) enum Place {
    /// At the device.
    Turn(Turn),
    /// Beside the device: the mesh there has at least four times the cost.
    Beside,
}

/// A mesh that waits for its turn.
#[derive(Debug, Clone)]
pub(super) struct Visit {
    /// The tenant of the mesh.
    pub tenant: Arc<str>,
    /// The share of that tenant.
    pub share: Share,
    /// Approximate work, in any unit; a turn of cost 0 is charged to no tenant.
    pub cost: u64,
}

impl Visit {
    /// For what is done for all tenants.
    pub fn of_nobody() -> Self {
        Self { tenant: "".into(), share: Share::default(), cost: 0 }
    }
}

/// Whether a mesh of that cost is short beside another one.
fn is_short(cost: u64, other: u64) -> bool {
    cost <= other / SHORT
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
        loop {
            if let Place::Turn(turn) = self.wait(visit.clone(), false).await {
                return turn;
            }
        }
    }

    /// Waits for the turn of a mesh, or until the mesh that has its turn is so long that this one is short beside it.
    pub async fn place(self: &Arc<Self>, visit: Visit) -> Place {
        self.wait(visit, true).await
    }

    async fn wait(self: &Arc<Self>, visit: Visit, may_pass: bool) -> Place {
        let call = {
            let mut state = self.0.lock();
            match state.cost {
                None => return Place::Turn(self.begin(&mut state, visit)),
                Some(other) if may_pass && is_short(visit.cost, other) => return Place::Beside,
                Some(_) => {}
            }
            let (called, call) = oneshot::channel();
            state.waiting.push(Waiting { visit, may_pass, called });
            call
        };
        match call.await {
            Ok(place) => place,
            // never: the sender is kept until it is used
            Err(_) => std::future::pending().await,
        }
    }

    fn begin(self: &Arc<Self>, state: &mut State, visit: Visit) -> Turn {
        state.cost = Some(visit.cost);
        state.virtual_times.serve(&visit.tenant);
        for passing in state.waiting.extract_if(.., |one| one.may_pass && is_short(one.visit.cost, visit.cost)) {
            // A visit that stopped waiting needs no place.
            let _ = passing.called.send(Place::Beside);
        }
        Turn { line: Arc::clone(self), visit, started: Instant::now() }
    }

    /// The turn of the next one that still waits.
    fn call_next(self: &Arc<Self>, state: &mut State) -> Option<(oneshot::Sender<Place>, Turn)> {
        state.cost = None;
        state.waiting.retain(|waiting| !waiting.called.is_closed());
        let start = |waiting: &Waiting| state.virtual_times.start(&waiting.visit.tenant);
        let next =
            (0..state.waiting.len()).min_by(|&a, &b| start(&state.waiting[a]).total_cmp(&start(&state.waiting[b])))?;
        let Waiting { visit, called, .. } = state.waiting.remove(next);
        Some((called, self.begin(state, visit)))
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let next = {
            let mut state = self.line.0.lock();
            if self.visit.cost > 0 {
                let seconds = self.started.elapsed().as_secs_f64();
                state.virtual_times.charge(&self.visit.tenant, seconds, self.visit.share);
            }
            self.line.call_next(&mut state)
        };
        if let Some((called, turn)) = next {
            // One that stopped waiting in this moment drops its turn, which calls the next.
            let _ = called.send(Place::Turn(turn));
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
        let turn = line.turn(visit("a", 100)).await;
        assert!(matches!(line.place(visit("b", 25)).now_or_never(), Some(Place::Beside)));
        assert!(line.place(visit("b", 26)).now_or_never().is_none());
        assert!(line.turn(visit("b", 25)).now_or_never().is_none(), "it must not go beside");
        drop(turn);
        assert!(matches!(line.place(visit("b", 1)).now_or_never(), Some(Place::Turn(_))), "the line is empty");
    }

    #[tokio::test]
    async fn short_meshes_that_wait_go_beside_a_long_one_once_it_has_its_turn() {
        let line = Arc::<Line>::default();
        let first = line.turn(visit("first", 10)).await;
        let mut long = Box::pin(line.place(visit("a", 100)));
        let mut short = Box::pin(line.place(visit("b", 10)));
        let mut similar = Box::pin(line.place(visit("c", 30)));
        let mut fixed = Box::pin(line.turn(visit("d", 10)));
        for waiting in [&mut long, &mut short, &mut similar] {
            assert!(waiting.now_or_never().is_none(), "the first has its turn");
        }
        assert!((&mut fixed).now_or_never().is_none(), "the first has its turn");
        drop(first);
        let Some(Place::Turn(turn)) = long.now_or_never() else { panic!("it came first") };
        assert!(matches!((&mut short).now_or_never(), Some(Place::Beside)), "it was asked again");
        assert!((&mut similar).now_or_never().is_none(), "it is not short");
        assert!((&mut fixed).now_or_never().is_none(), "it must not go beside");
        drop(turn);
        assert!(matches!(similar.now_or_never(), Some(Place::Turn(_))), "it is next");
        assert!(fixed.now_or_never().is_some(), "nothing else waits");
    }
}
