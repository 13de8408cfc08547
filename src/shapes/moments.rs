//! Moments of clusters: exact sums over the samples of their faces, which add up when clusters merge.
//!
//! A sample x counts at y = x / 64, rounded, |y| ≤ 2²¹, so that sums of products of four coordinates fit 128 bits. The
//! samples of a face weigh three times the face in all, less than 2³⁵·⁶ in a cluster. Planes need the moments up to
//! degree 2; those of degree 3 and 4 and of normals are apart ([`Higher`]).

use super::faces::Faces;
use super::monomials::{PAIRS, QUADRUPLES, TRIPLES};

/// Log₂ of the lattice units in a unit of moments.
pub const SHIFT: u32 = 6;

/// Moments up to degree 2.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Moments {
    /// Σ w, below 2³⁵·⁶.
    pub weight: i64,
    /// Σ w·y, below 2⁵⁶·⁶ an axis.
    pub first: [i64; 3],
    /// Σ w·y·y, below 2⁷⁷·⁶.
    pub second: [i128; 6],
}

/// Moments of degree 3 and 4, and of normals.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Higher {
    /// Σ w·n with normals of length 2¹⁴, below 2⁴⁸.
    pub normal: [i64; 3],
    /// Σ w·n·n, below 2⁶².
    pub normals: [i64; 6],
    /// Σ w·y·y·y, below 2⁹⁸·⁶.
    pub third: [i128; 10],
    /// Σ w·y·y·y·y, below 2¹¹⁹·⁶.
    pub fourth: [i128; 15],
}

impl Moments {
    /// Those of a face.
    pub fn of(faces: &Faces, face: u32) -> Self {
        let mut moments = Self::default();
        each_sample(faces, face, |weight, y| moments.add_sample(weight, y));
        moments
    }

    /// Those of some faces together.
    pub fn of_all(faces: &Faces, members: &[u32]) -> Self {
        let mut all = Self::default();
        members.iter().for_each(|&face| all.add(&Self::of(faces, face)));
        all
    }

    fn add_sample(&mut self, weight: i64, y: [i64; 3]) {
        self.weight += weight;
        for (sum, y) in self.first.iter_mut().zip(y) {
            *sum += weight * y;
        }
        for (sum, [a, b]) in self.second.iter_mut().zip(PAIRS) {
            *sum += i128::from(y[a] * y[b]) * i128::from(weight);
        }
    }

    /// Those that add up to none with these.
    pub fn negated(&self) -> Self {
        let Self { weight, first, second } = *self;
        Self { weight: -weight, first: first.map(|sum| -sum), second: second.map(|sum| -sum) }
    }

    /// Adds those of other faces.
    pub fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        add(&mut self.first, &other.first);
        add(&mut self.second, &other.second);
    }

    /// Those of two clusters together.
    pub fn with(mut self, other: &Self) -> Self {
        self.add(other);
        self
    }
}

impl Higher {
    /// Those that add up to none with these.
    pub fn negated(&self) -> Self {
        let Self { normal, normals, third, fourth } = *self;
        Self {
            normal: normal.map(|sum| -sum),
            normals: normals.map(|sum| -sum),
            third: third.map(|sum| -sum),
            fourth: fourth.map(|sum| -sum),
        }
    }

    /// Those of a face.
    pub fn of(faces: &Faces, face: u32) -> Self {
        let mut moments = Self::default();
        each_sample(faces, face, |weight, y| moments.add_sample(weight, y));
        let normal = faces.normal(face);
        moments.normal = normal.map(|n| i64::from(faces.weight(face)) * n);
        for (sum, [a, b]) in moments.normals.iter_mut().zip(PAIRS) {
            *sum = i64::from(faces.weight(face)) * (normal[a] * normal[b]);
        }
        moments
    }

    fn add_sample(&mut self, weight: i64, y: [i64; 3]) {
        for (sum, [a, b, c]) in self.third.iter_mut().zip(TRIPLES) {
            *sum += i128::from(y[a] * y[b]) * i128::from(y[c] * weight);
        }
        for (sum, [a, b, c, d]) in self.fourth.iter_mut().zip(QUADRUPLES) {
            *sum += i128::from(y[a] * y[b]) * i128::from(y[c] * y[d]) * i128::from(weight);
        }
    }

    /// Those of some faces together.
    pub fn of_all(faces: &Faces, members: &[u32]) -> Self {
        let mut all = Self::default();
        members.iter().for_each(|&face| all.add(&Self::of(faces, face)));
        all
    }

    /// Adds those of other faces.
    pub fn add(&mut self, other: &Self) {
        add(&mut self.normal, &other.normal);
        add(&mut self.normals, &other.normals);
        add(&mut self.third, &other.third);
        add(&mut self.fourth, &other.fourth);
    }

    /// Those of two clusters together.
    pub fn with(mut self, other: &Self) -> Self {
        self.add(other);
        self
    }
}

fn add<T: Copy + std::ops::AddAssign, const N: usize>(sums: &mut [T; N], others: &[T; N]) {
    for (sum, &other) in sums.iter_mut().zip(others) {
        *sum += other;
    }
}

/// Calls `visit` with the weight and the place, in units of moments, of each sample of a face.
fn each_sample(faces: &Faces, face: u32, mut visit: impl FnMut(i64, [i64; 3])) {
    const HALF: i64 = 1 << (SHIFT - 1);
    let samples = faces.samples(face);
    let (third, count) = (i64::from(faces.weight(face)), samples.len() as i64);
    for (number, sample) in (0..).zip(samples) {
        // the parts add up to the whole, whatever the rounding; those of a triangle are thirds
        let part = |number: i64| 3 * third * number / count;
        let weight = if count == 3 { third } else { part(number + 1) - part(number) };
        visit(weight, sample.map(|x| (i64::from(x) + HALF) >> SHIFT));
    }
}
