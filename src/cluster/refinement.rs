//! Refinement: moves that lower the energy, but fail the paper's boundary test.
//!
//! The boundary test of P§3.2 holds the proxies; P§7 concedes that it therefore ends above ACVD. A face of weight w
//! that moves from cluster a to b shifts both proxies, and the energy with respect to exact means falls by
//!
//! ```text
//! gain = w·|g − P_a|²·M_a/(M_a − w) − w·|g − P_b|²·M_b/(M_b + w)
//! ```
//!
//! which can be positive where the boundary test fails. Gains of moves at the same time do not add up: applied to all faces at once, they
//! oscillate for ever. So a cluster takes part in one exchange of faces with one other cluster at a time.
//!
//! # Definition of an iteration
//!
//! 1. Every face considers the clusters of its neighbours, except its own, and bids for the one with the largest
//!    [`gain`] per weight (the smaller cluster number of equal ones), if that is positive. A face that is alone in its
//!    cluster does not bid, nor does one that was refused in this phase and none of whose clusters (own, neighbours') has
//!    gained or lost a face since.
//! 2. Each cluster takes the best bid to leave it or to enter it: the largest packed [`bid`], of equal ones the face with
//!    the smallest internal number. A bid that both its clusters take wins; a cluster is in one winning bid at most.
//! 3. All faces that bid for the same move, from a to b, join the winner. If F_a + F_b falls, exactly, with all of them
//!    moved and some face left in a, they all move. Otherwise, if it falls with the winner alone, the winner moves.
//!    Otherwise the winner is refused.
//!
//! The phase ends when there are no bids. Bids and the packed form are integers; they only propose. What decides is F
//! with respect to the lattice proxies before and after, in 128 bits.
//!
//! # F never rises, and the phase ends
//!
//! A cluster takes part in one exchange at most, so the changes of F of all exchanges of an iteration add up exactly, and
//! each is negative. An iteration without moves refuses at least one face (the best bid of all wins at both its clusters)
//! and nothing makes new bids until something moves, so there are finitely many of those in a row.
//!
//! # Connected refinement
//!
//! Moves at the same time can cut a cluster in two, and so can a single one. Where repairs and phases go round in circles,
//! this variant ends the run: no face joins a winner, and a winner that would leave its cluster in pieces is refused.
//! A cluster loses one face an iteration at most and gains only neighbouring faces, so connected clusters stay connected;
//! the rest of the proof is as above.
//!
//! # Why together
//!
//! One face a pair and iteration is what makes the tail long: a cluster that has to drift by the width of a face moves a
//! dozen of them, one after the other. Faces that cross the same border in the same direction pull the proxies the same
//! way, so the joint gain is seldom less than the sum of the single ones.

/// A cluster as a bidding face sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Side {
    /// |g − P|² < 2⁵⁸.
    pub squared_distance: u64,
    /// M < 2³⁴.
    pub weight: u64,
}

/// What moving a face of weight `weight` lowers the energy by, per weight, in units of squared lattice length; rounded,
/// and only ever used to rank bids. `from.weight > weight`.
///
/// M/(M − w) = 1 + w/(M − w), and M/(M + w) = 1 − w/(M + w): the second terms are 32-bit fractions. Where the face is
/// heavier than the rest of its cluster, the first is taken as 1.
pub fn gain(weight: u32, from: Side, to: Side) -> i64 {
    let w = u64::from(weight);
    let scaled = |distance: u64, rest: u64| {
        let fraction = ((w << 32) / rest).min(u64::from(u32::MAX));
        // (distance · fraction) / 2³², the upper and the lower half of the distance apart
        (distance >> 32) * fraction + (((distance & 0xffff_ffff) * fraction) >> 32)
    };
    let leave = from.squared_distance + scaled(from.squared_distance, from.weight - w);
    let enter = to.squared_distance - scaled(to.squared_distance, to.weight + w);
    leave as i64 - enter as i64
}

/// `gain · weight` of a positive gain as a float of 7 bits of exponent and 25 of mantissa; the order of the codes is the
/// order of the values. At least 1.
pub fn bid(gain: i64, weight: u32) -> u32 {
    let gain = gain as u64;
    // 32 bits of the gain are enough to rank it, and their product with the weight fits
    let drop = (32 - gain.leading_zeros() as i32).max(0) as u32;
    let product = (gain >> drop) * u64::from(weight);
    let top = 63 - product.leading_zeros();
    let mantissa = if top > 25 { product >> (top - 25) } else { product << (25 - top) };
    (((top + drop) << 25) | (mantissa as u32 & ((1 << 25) - 1))) + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gain_is_the_difference_of_exact_energies() {
        // one axis: cluster a has faces at 0, 0, 10, cluster b at 12, 14; all of weight 5; the face at 10 goes to b
        let from = Side { squared_distance: 44_444_444, weight: 15 }; // (10 − 10/3)² in millionths
        let to = Side { squared_distance: 9_000_000, weight: 10 };
        // energies with means: a 200/3·5 → 0; b 2·5 → (4 + 0 + 4)·5
        let exact = (200.0 / 3.0 + 2.0 - 8.0) * 1e6;
        assert!((gain(5, from, to) as f64 - exact).abs() < 2.0, "{} {exact}", gain(5, from, to));
    }

    #[test]
    fn bids_are_in_the_order_of_their_values() {
        let mut values = Vec::new();
        for gain_bits in [1, 5, 20, 31, 32, 33, 45, 59] {
            for gain in [(1i64 << gain_bits) - 1, 1 << gain_bits] {
                for weight in [1u32, 2, 3, 1000, 1 << 20, u32::MAX] {
                    values.push((i128::from(gain) * i128::from(weight), bid(gain, weight)));
                }
            }
        }
        values.sort_unstable();
        for pair in values.windows(2) {
            // 25 bits of mantissa: values that differ by less than 2⁻²⁴ may be taken for equal
            let apart = pair[1].0 - pair[0].0 > pair[0].0 >> 24;
            assert!(!apart || pair[0].1 < pair[1].1, "{pair:?}");
        }
        assert!(values.iter().all(|&(_, bid)| bid > 0));
    }
}
