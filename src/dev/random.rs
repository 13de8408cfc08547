//! Numbers that look random and are the same in every run, for tests.

/// States of a linear congruential generator; their upper bits are the better ones.
pub fn random(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state
    }
}
