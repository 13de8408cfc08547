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
/// (`least_weight`), where they are worst. As √β ≤ 1 ≤ √α, the condition follows from `x + y ≤ √(β/α)·d_b − d_a`.
#[derive(Debug, Clone, Copy)]
pub struct RefinementSlack {
    weight: f64,
    /// d_a².
    own: u64,
    /// 1/α; not above 0 where the cluster may become lighter than the face.
    factor: f64,
    /// The least β·d_b².
    other: f64,
}

impl RefinementSlack {
    /// For a face of some weight, and the squared distance and least weight of its own cluster.
    pub fn new(weight: u32, squared_distance: u64, least_weight: u64) -> Self {
        let weight = f64::from(weight);
        let least = least_weight.cast_signed() as f64;
        Self { weight, own: squared_distance, factor: (least - weight) / least, other: f64::INFINITY }
    }

    /// Takes another cluster into account.
    pub fn other(&mut self, squared_distance: u64, least_weight: u64) {
        let least = least_weight.cast_signed() as f64;
        self.other = self.other.min(squared_distance.cast_signed() as f64 * (least / (least + self.weight)));
    }

    /// The slack; 0 where the face may have a bid.
    pub fn get(self) -> u64 {
        (self.exact() - 1.0).max(0.0) as u64
    }

    /// Whether the face surely has no bid.
    pub fn is_clear(self) -> bool {
        self.exact() >= 1.0
    }

    /// The slack before it is rounded; not a number where there is none.
    fn exact(self) -> f64 {
        (self.factor * self.other).sqrt() - root(self.own)
    }
}
