//! Refinement: moves that lower the energy, but fail the paper's boundary test.
//!
//! The boundary test of P§3.2 holds the proxies; P§7 concedes that it therefore ends above ACVD. A face of weight w
//! that moves from cluster a to b shifts both proxies, and the energy with respect to exact means falls by
//!
//! ```text
//! gain = w·|g − P_a|²·M_a/(M_a − w) − w·|g − P_b|²·M_b/(M_b + w)
//! ```
//!
//! which can be positive where the boundary test fails. Gains of moves at the same time do not add up: applied to all
//! faces at once, they oscillate for ever. So a cluster exchanges faces with one other cluster at a time.
//!
//! # Definition of an iteration
//!
//! 1. Every face considers the clusters of its neighbours, except its own, and bids for the one with the largest
//!    [`gain`] per weight (the smaller cluster number of equal ones), if that is positive. A face that is alone in its
//!    cluster does not bid, nor does one that was refused in this phase and none of whose clusters (own, neighbours')
//!    has gained or lost a face since.
//! 2. Each cluster takes the best bid to leave it or to enter it: the largest packed [`bid`], of equal ones the face
//!    with the smallest internal number. A bid that both its clusters take wins; a cluster is in one winning bid at
//!    most.
//! 3. All faces that bid for the same move, from a to b, join the winner. If F_a + F_b falls, exactly, with all of them
//!    moved and some face left in a, they all move. Otherwise, if it falls with the winner alone, the winner moves.
//!    Otherwise the winner is refused.
//!
//! The phase ends when there are no bids. Bids and the packed form are integers; they only propose. What decides is F
//! with respect to the lattice proxies before and after, in 128 bits.
//!
//! # F never rises, and the phase ends
//!
//! A cluster takes part in one exchange at most, so the changes of F of all exchanges of an iteration add up exactly,
//! and each is negative. An iteration without moves refuses at least one face (the best bid of all wins at both its
//! clusters) and nothing makes new bids until something moves, so there are finitely many of those in a row.
//!
//! # Why together
//!
//! With one face a pair and iteration the tail is long: a cluster that drifts by the width of a face moves a dozen of
//! them, one after the other. Faces that cross a border in the same direction pull the proxies the same way, so the
//! joint gain is seldom less than the sum of the single ones.
//!
//! [`gain`]: crate::energy::Functional::gain
//! [`bid`]: crate::energy::Functional::bid
