//! What stands for a cluster when a face is compared with it: a quadric of integers.
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

use glam::DVec3;

use super::kind::Kind;
use super::moments::SHIFT;
use super::monomials::PAIRS;
use super::shape::Shape;
#[cfg(test)]
use super::shape::Tangent;

/// Bits of fraction.
const BITS: i32 = 30;

/// No |s| is larger, an axis.
const FARTHEST: f64 = (1u64 << 28) as f64;

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
    e: u32,
    c: i64,
}

impl Proxy {
    /// That of a shape in units of moments, of a cluster with this mean. None where the shape is out of reach.
    pub fn new(shape: &Shape, mean: DVec3) -> Option<Self> {
        let tangent = shape.tangent(mean);
        let unit = f64::from(1u32 << SHIFT);
        let one = f64::from(1u32 << BITS);
        let round = |x: f64| (x * one + 0.5).floor();
        let at = tangent.point * unit;
        // NaN is refused, too
        if at.abs().max_element().partial_cmp(&FARTHEST).is_none_or(std::cmp::Ordering::is_gt) {
            return None;
        }
        let s = at.to_array().map(|x| (x + 0.5).floor());
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
            b: tangent.normal.to_array().map(|x| round(x) as i32),
            a: a.map(|x| round(libm::ldexp(x, -exponent)) as i32),
            e,
            c: round(c) as i64,
        })
    }

    /// h², the squared distance of a sample, below 2⁵⁶.
    #[inline]
    pub fn squared(&self, sample: [i32; 3]) -> u64 {
        let [x, y, z] = [0, 1, 2].map(|axis| i64::from(sample[axis]) - i64::from(self.s[axis]));
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
        ];
        for shape in shapes {
            let mean = point + DVec3::new(1e5, 3e5, 2e5);
            let proxy = Proxy::new(&shape, mean).expect("a proxy");
            for step in [0.0, 1.0, -100.0, 3000.0] {
                let Tangent { point, normal, curvature, .. } = shape.tangent(mean - DVec3::new(2e3, -1e3, 5e2));
                let h = (step + curvature / 2.0 * step * step) * 64.0;
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
