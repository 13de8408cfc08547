//! By how much the distances of a face may change before it could decide otherwise.
//!
//! Slacks are computed in f64 and rounded down by more than their error, so that skipping a face is exact. Distances
//! obey the triangle inequality: they change by no more than proxies drift.

/// The slack of a face that stays in its cluster in the boundary phase: the distance to the nearest other proxy less
/// that to its own. Takes squared distances.
#[inline]
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

    /// The slack before it is rounded; negative, or not a number, where there is none.
    fn exact(self) -> f64 {
        (self.factor * self.other).sqrt() - root(self.own)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_face_without_a_bid_has_none_while_proxies_drift_by_its_slack_and_may_have_one_beyond() {
        let mut cleared = 0;
        for (weight, least_own, least_other) in
            [(1, 2, 1), (7, 8, 5), (1000, 1 << 20, 1 << 33), (u32::MAX, 1 << 33, 1 << 34)]
        {
            for (own, other) in [(0, 4), (100, 1 << 20), (1 << 40, 1 << 50), (1 << 56, 1 << 58), (1 << 57, 1 << 57)] {
                let mut slack = RefinementSlack::new(weight, own, least_own);
                slack.other(other, least_other);
                let (weight, [least_own, least_other]) =
                    (f64::from(weight), [least_own, least_other].map(|least: u64| least as f64));
                let alpha = (least_own / (least_own - weight)).sqrt();
                let beta = (least_other / (least_other + weight)).sqrt();
                let may_gain = |x: f64, y: f64| alpha * (root(own) + x) > beta * (root(other) - y);
                let drift = slack.get() as f64;
                assert!(!slack.is_clear() || !may_gain(drift, 0.0) && !may_gain(0.0, drift), "{slack:?}");
                assert!(may_gain(drift + 3.0, 0.0), "it is no lower than it has to be: {slack:?}");
                cleared += usize::from(slack.is_clear());
            }
        }
        assert!(cleared > 5);
    }

    #[test]
    fn a_face_that_may_outweigh_its_cluster_has_no_slack() {
        for least in [0, 3, 9] {
            let mut slack = RefinementSlack::new(9, 1, least);
            assert!(!slack.is_clear() && slack.get() == 0, "{least}");
            slack.other(1 << 40, 1 << 30);
            assert!(!slack.is_clear() && slack.get() == 0, "{least}");
        }
    }
}
