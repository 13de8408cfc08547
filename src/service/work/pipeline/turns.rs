//! Turns at the device: first come, first served, since claims are fair already. A short mesh does not wait for a long
//! one that has its turn. Knows no device.

use std::sync::Arc;

use tokio::sync::{Mutex, OwnedMutexGuard, watch};

/// A queue before the device, in which one mesh at a time has its turn.
#[derive(Debug, Default)]
pub(super) struct Line {
    turn: Arc<Mutex<()>>,
    /// Cost of the mesh that has its turn; 0 without one.
    cost: Arc<watch::Sender<u64>>,
}

/// The turn of a mesh, until it is dropped.
#[derive(Debug)]
pub(super) struct Turn {
    cost: Arc<watch::Sender<u64>>,
    _turn: OwnedMutexGuard<()>,
}

impl Line {
    /// Waits for the turn of a mesh of that cost.
    pub async fn turn(&self, cost: u64) -> Turn {
        let turn = Arc::clone(&self.turn).lock_owned().await;
        self.cost.send_replace(cost);
        Turn { cost: Arc::clone(&self.cost), _turn: turn }
    }

    /// Waits for the turn of a mesh; none once it is short beside the mesh that has its turn: a quarter of that one's
    /// cost, or less.
    pub async fn turn_unless_short(&self, cost: u64) -> Option<Turn> {
        let mut other = self.cost.subscribe();
        tokio::select! {
            biased;
            turn = self.turn(cost) => Some(turn),
            _ = other.wait_for(|other| cost <= other / 4) => None,
        }
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        self.cost.send_replace(0);
    }
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt as _;

    use super::*;

    #[tokio::test]
    async fn short_meshes_go_beside_a_long_one_and_others_wait_in_their_order() {
        let line = Line::default();
        let first = line.turn(10).await;
        assert!(line.turn_unless_short(2).now_or_never().expect("it need not wait").is_none());
        let mut long = Box::pin(line.turn_unless_short(100));
        let mut short = Box::pin(line.turn_unless_short(10));
        let mut similar = Box::pin(line.turn_unless_short(30));
        let mut fixed = Box::pin(line.turn(10));
        assert!((&mut long).now_or_never().is_none() && (&mut short).now_or_never().is_none());
        assert!((&mut similar).now_or_never().is_none() && (&mut fixed).now_or_never().is_none());
        drop(first);
        let turn = long.now_or_never().expect("it came first").expect("a turn");
        assert!((&mut short).now_or_never().expect("it need not wait").is_none());
        assert!((&mut similar).now_or_never().is_none(), "it is not short");
        assert!((&mut fixed).now_or_never().is_none(), "it must not go beside");
        drop((turn, short));
        assert!(similar.now_or_never().expect("it is next").is_some());
        assert!(fixed.now_or_never().is_some(), "nothing else waits");
        assert!(line.turn_unless_short(1).now_or_never().expect("the line is empty").is_some());
    }
}
