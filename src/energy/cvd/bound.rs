//! By how much the distances of a face may change before it could decide otherwise.
//!
//! Slacks are computed in f64 and rounded down by more than their error, so that skipping a face is exact. Distances
//! obey the triangle inequality: they change by no more than proxies drift.

/// The slack of a face that stays in its cluster in the boundary phase: the distance to the nearest other proxy less
/// that to its own. Takes squared distances.
pub fn boundary_slack(own: u64, nearest_other: u64) -> u64 {
    // distances are below 2²⁹, so that the error of a root is far below 1
    let difference = root(nearest_other) - root(own);
    (difference - 1.0).max(0.0) as u64
}

/// The root of a squared distance, which is below 2⁶³: signed numbers are converted faster.
#[inline]
fn root(squared_distance: u64) -> f64 {
    (squared_distance.cast_signed() as f64).sqrt()
}

/// The slack of a face that has no bid in refinement.
///
/// Its gain stays negative while `√α·(d_a + x) ≤ √β·(d_b − y)`, where its own proxy drifts by x and another by y,
/// `α = M_a/(M_a − w)` and `β = M_b/(M_b + w)`. Both factors are taken at the least weights that the clusters may have
/// (`least_weight`), where they are worst. As √β ≤ 1 ≤ √α, the condition follows from
/// `√α·(x + y) ≤ √β·d_b − √α·d_a`.
#[derive(Debug, Clone, Copy)]
pub struct RefinementSlack {
    weight: f64,
    /// √α.
    root: f64,
    /// √α·d_a.
    own: f64,
    slack: f64,
}

impl RefinementSlack {
    /// For a face of some weight, and the squared distance and least weight of its own cluster.
    pub fn new(weight: u32, squared_distance: u64, least_weight: u64) -> Self {
        let weight = f64::from(weight);
        let least = least_weight.cast_signed() as f64;
        if least <= weight {
            return Self { weight, root: 1.0, own: 0.0, slack: f64::NEG_INFINITY };
        }
        let root = (least / (least - weight)).sqrt();
        Self { weight, root, own: root * self::root(squared_distance), slack: f64::INFINITY }
    }

    /// Takes another cluster into account.
    pub fn other(&mut self, squared_distance: u64, least_weight: u64) {
        let least = least_weight.cast_signed() as f64;
        let other = (squared_distance.cast_signed() as f64 * (least / (least + self.weight))).sqrt();
        self.slack = self.slack.min((other - self.own) / self.root);
    }

    /// The slack; 0 where the face may have a bid.
    pub fn get(self) -> u64 {
        (self.slack - 1.0).max(0.0) as u64
    }

    /// Whether the face surely has no bid.
    pub fn is_clear(self) -> bool {
        self.slack >= 1.0
    }
}
