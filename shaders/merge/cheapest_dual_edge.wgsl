// The cheapest dual edge of all (P§5.4: the parallel search for the single best edge), first step: the best of each
// workgroup's faces, by exact cost.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read> proxies: array<vec4<i32>>;
@group(0) @binding(4) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(5) var<storage, read_write> bests: array<Best>;
@group(0) @binding(6) var<storage, read_write> lists: Lists;

// Bits of a digit of the long division: a remainder below the divisor's 2³⁵ and a digit fit into 64 bits.
const DIGIT: u32 = 29u;
const DIGIT_MASK: u64 = 0x1ffffffflu;

// ⌊a·b·distance / (a + b)⌋ << shift (dual_edge::exact_cost): a, b < 2³⁴, distance < 2⁵⁸, shift ≤ 30; high and low word.
fn exact_cost(a: u64, b: u64, distance: u64, shift: u32) -> vec2<u64> {
    let a_0 = a & DIGIT_MASK;
    let a_1 = a >> DIGIT;
    let b_0 = b & DIGIT_MASK;
    let b_1 = b >> DIGIT;
    // a·b < 2⁶⁸ in digits, the top one below 2¹⁰
    let low = a_0 * b_0;
    let middle = a_0 * b_1 + a_1 * b_0 + (low >> DIGIT);
    let weight_0 = low & DIGIT_MASK;
    let weight_1 = middle & DIGIT_MASK;
    let weight_2 = a_1 * b_1 + (middle >> DIGIT);
    // a·b·distance < 2¹²⁶ in digits; no sum of two products and a carry reaches 2⁶⁰
    let distance_0 = distance & DIGIT_MASK;
    let distance_1 = distance >> DIGIT;
    let first = weight_0 * distance_0;
    let second = weight_0 * distance_1 + weight_1 * distance_0 + (first >> DIGIT);
    let third = weight_1 * distance_1 + weight_2 * distance_0 + (second >> DIGIT);
    let fourth = weight_2 * distance_1 + (third >> DIGIT);
    // the quotient is below 2⁹², so that its fourth digit holds all the rest of it
    let divisor = a + b;
    let digit_3 = fourth / divisor;
    var rest = ((fourth % divisor) << DIGIT) | (third & DIGIT_MASK);
    let digit_2 = rest / divisor;
    rest = ((rest % divisor) << DIGIT) | (second & DIGIT_MASK);
    let digit_1 = rest / divisor;
    rest = ((rest % divisor) << DIGIT) | (first & DIGIT_MASK);
    let digit_0 = rest / divisor;
    let high_word = (digit_3 << 23u) | (digit_2 >> 6u);
    let low_word = (digit_2 << 58u) | (digit_1 << DIGIT) | digit_0;
    // what the shift moves into the high word, in two steps, as a shift by 64 is none
    let carried = (low_word >> 34u) >> (30u - shift);
    return vec2<u64>((high_word << shift) | carried, low_word << shift);
}

// The dual edge between two clusters.
fn candidate(own: u32, other: u32) -> Candidate {
    let distance = distance_squared(proxies[own], proxies[other]);
    let shift = u32(proxies[own].w);
    let cost = exact_cost(u64(weight_in(own)), u64(weight_in(other)), distance, shift);
    let low = min(own, other);
    let high = max(own, other);
    return Candidate(cost.x, cost.y, tie_of(low, high), low, high);
}

@compute @workgroup_size(WORKGROUP)
fn cheapest_dual_edge(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    var best = NO_CANDIDATE;
    if face != FREE {
        let own = labels[face];
        if own != FREE {
            let end = neighbours[face + 1u];
            for (var at = neighbours[face]; at < end; at++) {
                let other = labels[neighbours[at]];
                // the faces of the other cluster look at it, too
                if own < other && other != FREE {
                    let next = candidate(own, other);
                    if is_better(next, best) {
                        best = next;
                    }
                }
            }
        }
    }
    report_best(local, best, group.y * turn.row + group.x);
}
