// For each listed face the cluster beside it where it costs least, the smaller number of equal ones; FREE if that is
// not less than in its own. A thread a face. Rust: shapes::moves::Clusters::nearer, and shapes::proxy, which has the
// bounds of all numbers.

const FREE: u32 = 0xffffffffu;

// As device::ShapeWords. What stands for a cluster: Q(x) = x'ᵀA x' + b·x' + c with x' = x − s.
struct Shape {
    c: i64,
    s: array<i32, 3>,
    b: array<i32, 3>,
    a: array<i32, 6>,
    e: u32,
    is_curved: u32,
}

// For each face the index of its first neighbour, one more index for the end, and then the neighbours.
@group(0) @binding(0) var<storage, read> neighbours: array<u32>;
// The same of samples, three words each.
@group(0) @binding(1) var<storage, read> samples: array<i32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read> shapes: array<Shape>;
@group(0) @binding(4) var<storage, read> listed: array<u32>;
@group(0) @binding(5) var<storage, read_write> proposals: array<u32>;

// A row of A times x', 30 bits of fraction, at most 2³¹.
fn bent(sum: i64, e: u32) -> i64 {
    return clamp((sum + ((1li << e) >> 1u)) >> e, -0x80000000li, 0x80000000li);
}

// h² of a sample.
fn squared(shape: Shape, sample: u32) -> u64 {
    let x = i64(samples[sample]) - i64(shape.s[0]);
    let y = i64(samples[sample + 1u]) - i64(shape.s[1]);
    let z = i64(samples[sample + 2u]) - i64(shape.s[2]);
    var t = i64(shape.b[0]) * x + i64(shape.b[1]) * y + i64(shape.b[2]) * z + shape.c;
    if shape.is_curved != 0u {
        let xx = i64(shape.a[0]);
        let xy = i64(shape.a[1]);
        let xz = i64(shape.a[2]);
        let yy = i64(shape.a[3]);
        let yz = i64(shape.a[4]);
        let zz = i64(shape.a[5]);
        t += bent(xx * x + xy * y + xz * z, shape.e) * x;
        t += bent(xy * x + yy * y + yz * z, shape.e) * y;
        t += bent(xz * x + yz * y + zz * z, shape.e) * z;
    }
    let h = clamp((t + 0x20000000li) >> 30u, -0x10000000li, 0x10000000li);
    return u64(h * h);
}

fn cost(face: u32, cluster: u32) -> u64 {
    let shape = shapes[cluster];
    let first = u32(samples[face]);
    let end = u32(samples[face + 1u]);
    var sum = 0lu;
    for (var at = first; at < end; at += 3u) {
        sum += squared(shape, at);
    }
    let count = (end - first) / 3u;
    if count == 3u {
        return sum;
    }
    return 3lu * sum / u64(count);
}

fn proposal(face: u32) -> u32 {
    let own = labels[face];
    var least = cost(face, own);
    var best = FREE;
    var last = own;
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let label = labels[neighbours[at]];
        if label != own && label != last {
            let next = cost(face, label);
            if next < least || (next == least && best != FREE && label < best) {
                best = label;
                least = next;
            }
            last = label;
        }
    }
    return best;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) thread: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var at = thread.x; at < arrayLength(&listed); at += 64u * groups.x) {
        proposals[at] = proposal(listed[at]);
    }
}
