//! What stands for a cluster when a face is compared with it: a quadric of integers, or a cone.
//!
//! Q(x) = x'ᵀA x' + b·x' + c with x' = x − s, |∇Q| = 1 on the shape. Of a plane A = 0 and b is the normal; of a sphere
//! A = κ/2·I, of a cylinder A = κ/2·(I − a aᵀ), b is the normal at s, κ = 1 over the radius, and s the point of the
//! shape nearest to the mean of the cluster. For the true distance h, Q = h + κh²/2: no root and no division, and it
//! becomes a plane as κ → 0.
//!
//! | number | form | bound |
//! |---|---|---|
//! | x' | lattice units | 2²⁸·⁶ an axis |
//! | b, A·2^e | 30 bits of fraction; e so that the largest of A·2^e is from ½ to 1 | 2³⁰ |
//! | u = A x' | 30 bits of fraction, at most 2³¹ (beyond 4 radii) | before: 2⁶¹ |
//! | t = u·x' + b·x' + c | 30 bits of fraction | 2⁶² |
//! | h = Q(x) | lattice units, at most 2²⁸ | h² < 2⁵⁶ |
//!
//! Of a cone, h is the distance itself from the nearest generator, since Q / |∇Q| is no quadric near the apex:
//! h = ρ·cos − z·sin + c with the cosine and sine of half the opening angle, x' = x − s, s the foot of the mean on the
//! axis b, ρ = |x' × b| and z = x'·b. Beyond the apex, the distance from the cone is larger.
//!
//! Where s and c are within 2²⁸, distances from a cone have 2 bits of fraction; slices of flat cones, whose axis is up
//! to 2³⁰ away, have none.
//!
//! | number | form | bound with 2 bits | with none |
//! |---|---|---|---|
//! | x' | lattice units, s rounded | 2²⁸·⁶ an axis | 2³⁰·² |
//! | b, cos, sin | 30 bits of fraction | 2³⁰ | 2³⁰ |
//! | x' × b, x'·b | before they are rounded | 2⁵⁹·⁵ an axis, 2⁶⁰·² | 2⁶¹ |
//! | (x' × b)² | twice the bits | 2⁶²·⁸ | 2⁶² |
//! | ρ, its root rounded to nearest; z | the bits | 2³¹·⁴ | 2³¹ |
//! | c | 30 bits more | 2⁶⁰ | 2⁶⁰ |
//! | ρ·cos − z·sin + c | 30 bits more | 2⁶² | 2⁶² |

mod words;

use glam::DVec3;

pub use self::words::ON_DEVICES;
use super::kind::Kind;
use super::moments::SHIFT;
use super::monomials::PAIRS;
use super::shape::Shape;
#[cfg(test)]
use super::shape::Tangent;

/// Bits of fraction.
const BITS: i32 = 30;

/// Those of the distances in a cone's whose axis is not far away.
const CONE_BITS: i32 = 2;

/// No |s| is larger, an axis; of cones with [`CONE_BITS`], neither is |c|.
const FARTHEST: f64 = (1u64 << 28) as f64;

/// No |s| and no |c| is larger of cones whose distances have no bits of fraction.
const FARTHEST_OF_CONES: f64 = (1u64 << 30) as f64;

/// No |h| is larger.
const LARGEST: i64 = 1 << 28;

/// A proxy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Proxy {
    /// The type of its shape.
    pub kind: Kind,
    s: [i32; 3],
    b: [i32; 3],
    a: [i32; 6],
    /// Of a cone, the bits of fraction of its distances.
    e: u32,
    c: i64,
}

impl Proxy {
    /// That of a shape in units of moments, of a cluster with this mean. None where the shape is out of reach.
    pub fn new(shape: &Shape, mean: DVec3) -> Option<Self> {
        if let Shape::Cone { apex, axis, slope } = *shape {
            return Self::of_cone(apex, axis, slope, mean);
        }
        let tangent = shape.tangent(mean);
        let unit = f64::from(1u32 << SHIFT);
        let at = tangent.point * unit;
        let s = rounded(at, FARTHEST)?;
        let c = tangent.normal.dot(DVec3::from(s) - at);
        let half = tangent.curvature / unit / 2.0;
        let axis = tangent.axis.unwrap_or(DVec3::ZERO);
        let of_axes = |[i, j]: [usize; 2]| half * (f64::from(u8::from(i == j)) - axis[i] * axis[j]);
        let a = PAIRS.map(of_axes);
        let (_, exponent) = libm::frexp(a.iter().fold(0.0, |most, x| x.abs().max(most)));
        // that of 0, of a plane, is 0
        let e = u32::try_from(-exponent).ok()?;
        Some(Self {
            kind: shape.kind(),
            s: s.map(|x| x as i32),
            b: tangent.normal.to_array().map(|x| fixed(x) as i32),
            a: a.map(|x| fixed(libm::ldexp(x, -exponent)) as i32),
            e,
            c: fixed(c),
        })
    }

    fn of_cone(apex: DVec3, axis: DVec3, slope: f64, mean: DVec3) -> Option<Self> {
        let unit = f64::from(1u32 << SHIFT);
        let s = rounded((apex + (mean - apex).dot(axis) * axis) * unit, FARTHEST_OF_CONES)?;
        let cosine = 1.0 / (1.0 + slope * slope).sqrt();
        let sine = slope * cosine;
        let c = -(DVec3::from(s) - apex * unit).dot(axis) * sine;
        let reach = s.iter().fold(c.abs(), |reach, x| reach.max(x.abs()));
        // NaN is refused, too
        if c.is_nan() || reach > FARTHEST_OF_CONES {
            return None;
        }
        let bits = if reach <= FARTHEST { CONE_BITS } else { 0 };
        let [cosine, sine] = [cosine, sine].map(|x| fixed(x) as i32);
        Some(Self {
            kind: Kind::Cone,
            s: s.map(|x| x as i32),
            b: axis.to_array().map(|x| fixed(x) as i32),
            a: [cosine, sine, 0, 0, 0, 0],
            e: bits as u32,
            c: fixed(c) << bits,
        })
    }

    /// h², the squared distance of a sample, below 2⁵⁶.
    #[inline]
    pub fn squared(&self, sample: [i32; 3]) -> u64 {
        let from @ [x, y, z] = [0, 1, 2].map(|axis| i64::from(sample[axis]) - i64::from(self.s[axis]));
        if self.kind == Kind::Cone {
            return self.squared_of_cone(from);
        }
        let [p, q, r] = self.b.map(i64::from);
        let mut t = p * x + q * y + r * z + self.c;
        if self.kind != Kind::Plane {
            let [xx, xy, xz, yy, yz, zz] = self.a.map(i64::from);
            let half = (1i64 << self.e) >> 1;
            let u = |sum: i64| ((sum + half) >> self.e).clamp(-1 << 31, 1 << 31);
            t += u(xx * x + xy * y + xz * z) * x;
            t += u(xy * x + yy * y + yz * z) * y;
            t += u(xz * x + yz * y + zz * z) * z;
        }
        let h = ((t + (1 << (BITS - 1))) >> BITS).clamp(-LARGEST, LARGEST);
        (h * h) as u64
    }

    fn squared_of_cone(&self, [x, y, z]: [i64; 3]) -> u64 {
        let [p, q, r] = self.b.map(i64::from);
        let [cosine, sine, ..] = self.a.map(i64::from);
        let bits = self.e as i32;
        let rounded = |sum: i64, bits: i32| (sum + (1 << (bits - 1))) >> bits;
        let across = [y * r - z * q, z * p - x * r, x * q - y * p].map(|sum| rounded(sum, BITS - bits));
        let from_axis = root(across.map(|x| (x * x) as u64).iter().sum());
        let along = rounded(p * x + q * y + r * z, BITS - bits);
        let t = from_axis as i64 * cosine - along * sine + self.c;
        let h = rounded(t, BITS + bits).clamp(-LARGEST, LARGEST);
        (h * h) as u64
    }

    /// What a face with these samples costs for each of its weight: three times the mean h², rounded down, which is
    /// three times the mean over a triangle. Below 2⁵⁷·⁶.
    #[inline]
    pub fn cost(&self, samples: &[[i32; 3]]) -> u64 {
        if let &[a, b, c] = samples {
            return self.squared(a) + self.squared(b) + self.squared(c);
        }
        let sum: u64 = samples.iter().map(|&sample| self.squared(sample)).sum();
        3 * sum / samples.len() as u64
    }
}

/// A place rounded to the lattice, if none of its coordinates is larger.
fn rounded(at: DVec3, farthest: f64) -> Option<[f64; 3]> {
    // NaN is refused, too
    let is_near = at.abs().max_element().partial_cmp(&farthest).is_some_and(std::cmp::Ordering::is_le);
    is_near.then(|| at.to_array().map(|x| (x + 0.5).floor()))
}

/// A number with [`BITS`] of fraction.
fn fixed(x: f64) -> i64 {
    (x * f64::from(1u32 << BITS) + 0.5).floor() as i64
}

/// The root of a number below 2⁶³, rounded to nearest.
fn root(of: u64) -> u64 {
    let near = ((of as f64).sqrt() + 0.5) as u64;
    // the root of the f64 is off by less than 2⁻²⁰: (n + ½)² is n·(n + 1) + ¼
    if of > near * (near + 1) {
        near + 1
    } else if near > 0 && of <= near * (near - 1) {
        near - 1
    } else {
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAR: i32 = (1 << 27) - 1;

    fn lattice(at: DVec3) -> [i32; 3] {
        (at * 64.0).to_array().map(|x| (x + 0.5).floor() as i32)
    }

    #[test]
    fn squared_distances_are_those_of_the_shape() {
        let axis = DVec3::new(0.48, -0.64, 0.6);
        let point = DVec3::new(3e5, -2e5, 1e5);
        let shapes = [
            Shape::Plane { point, normal: axis },
            Shape::Sphere { centre: point, radius: 4e5 },
            Shape::Cylinder { point, axis, radius: 4e5 },
            Shape::Sphere { centre: point - 1e8 * axis, radius: 1e8 },
            Shape::Cone { apex: point, axis, slope: 0.6 },
            Shape::Cone { apex: point - 4e7 * axis, axis, slope: 0.01 },
            Shape::Cone { apex: point - 1e4 * axis, axis, slope: 30.0 },
            Shape::Cone { apex: point - 1.5e7 * DVec3::new(0.8, 0.6, 0.0) - 1e6 * axis, axis, slope: 15.0 },
        ];
        for shape in shapes {
            let mean = point + DVec3::new(1e5, 3e5, 2e5);
            let proxy = Proxy::new(&shape, mean).expect("a proxy");
            for step in [0.0, 1.0, -100.0, 3000.0] {
                let Tangent { point, normal, curvature, .. } = shape.tangent(mean - DVec3::new(2e3, -1e3, 5e2));
                let second = if shape.kind() == Kind::Cone { 0.0 } else { curvature / 2.0 };
                let h = (step + second * step * step) * 64.0;
                let measured = (proxy.squared(lattice(point + step * normal)) as f64).sqrt();
                assert!((measured - h.abs()).abs() < 4.0 + 1e-6 * h.abs(), "{shape:?} {step}: {measured} {h}");
            }
        }
    }

    #[test]
    fn the_farthest_samples_of_the_smallest_and_largest_shapes_fit() {
        let corner = DVec3::splat(f64::from(FAR) / 64.0);
        let axis = DVec3::splat(1.0) / 3f64.sqrt();
        for shape in [
            Shape::Plane { point: corner, normal: axis },
            Shape::Sphere { centre: corner, radius: 1.0 },
            Shape::Cylinder { point: corner, axis: DVec3::X, radius: 1.0 },
            Shape::Sphere { centre: corner + axis * f64::from(1 << 27), radius: f64::from(1 << 27) },
            Shape::Cone { apex: corner, axis, slope: 1.0 },
            Shape::Cone { apex: corner * 1.9, axis: -axis, slope: 3.0 },
            Shape::Cone { apex: -corner * 60.0, axis, slope: 1.0 / 128.0 },
            // the axis as far away as may be, on both sides, with little and with much slope
            Shape::Cone { apex: corner * 7.9 - 2.1e9 * axis, axis, slope: 1.0 / 128.0 },
            Shape::Cone { apex: -corner * 6.5, axis: DVec3::new(0.8, -0.6, 0.0), slope: 32.0 },
        ] {
            let proxy = Proxy::new(&shape, corner).expect("a proxy");
            for signs in 0..8 {
                let sample = [0, 1, 2].map(|bit| if signs >> bit & 1 == 0 { FAR } else { -FAR });
                assert!(proxy.squared(sample) <= 1 << 56);
                assert!(proxy.cost(&[sample; 3]) <= 3 << 56 && proxy.cost(&[sample; 64]) <= 3 << 56);
            }
        }
        // a shape out of reach has no proxy
        assert_eq!(Proxy::new(&Shape::Plane { point: DVec3::splat(1e8), normal: axis }, corner * 100.0), None);
    }
}
