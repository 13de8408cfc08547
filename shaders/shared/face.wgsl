// Faces: a centroid and, in the fourth number, the bits of a weight. Proxies: a position and something else.

fn square(number: i32) -> u64 {
    let magnitude = u64(u32(abs(number)));
    return magnitude * magnitude;
}

// Squared distance of a centroid from a proxy; both are below 2²⁷ an axis, so it is below 2⁵⁸.
fn distance_squared(face: vec4<i32>, proxy: vec4<i32>) -> u64 {
    let apart = face.xyz - proxy.xyz;
    return square(apart.x) + square(apart.y) + square(apart.z);
}

// Weight of a face. By way of u64, because naga extends the sign when it makes an i64 of a u32.
fn weight_of(face: vec4<i32>) -> i64 {
    return i64(u64(u32(face.w)));
}

// weight·centroid.
fn moment_of(face: vec4<i32>) -> vec3<i64> {
    let weight = weight_of(face);
    return vec3<i64>(i64(face.x) * weight, i64(face.y) * weight, i64(face.z) * weight);
}
