//! Eigenvectors of small symmetric matrices, by Jacobi's method. The smallest eigenvalue alone is by Newton's, which
//! takes a tenth of the time (`benches/results/2026-11-29-two-cores/shapes.md`).
//!
//! It needs + − × ÷ √ alone, in a fixed order, so that every machine computes the same bits. That of
//! `remesh/quadric.rs` rounds otherwise, and the bytes of remeshes hang on it.

/// Sweeps at most. Matrices of moments take 3 to 6.
const SWEEPS: usize = 12;

/// About the second eigenvalue over the largest, from which on rounding moves the smallest by less than 10⁻⁹ of the
/// largest.
const FLATTEST: f64 = 1e-6;

/// Steps of Newton's method. Matrices of moments take 3 to 6.
const STEPS: usize = 8;

/// The eigenvalues of a symmetric matrix, and its eigenvectors as columns, in no particular order: turns axes until it
/// is diagonal. Its upper half counts.
pub fn eigen<const N: usize>(mut of: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut vectors = std::array::from_fn(|row| std::array::from_fn(|column| f64::from(u8::from(row == column))));
    for _ in 0..SWEEPS {
        let (mut beside, mut along) = (0.0, 0.0);
        for p in 0..N {
            along += of[p][p] * of[p][p];
            for q in p + 1..N {
                beside += of[p][q] * of[p][q];
            }
        }
        // what is left turns no vector by as much as its rounding
        if beside <= along * (f64::EPSILON * f64::EPSILON / 16.0) {
            break;
        }
        for p in 0..N {
            for q in p + 1..N {
                if of[p][q] != 0.0 {
                    let turn = turned(&mut of, p, q);
                    for row in &mut vectors {
                        (row[p], row[q]) = turn.of(row[p], row[q]);
                    }
                }
            }
        }
    }
    (std::array::from_fn(|at| of[at][at]), vectors)
}

/// The smallest eigenvalue of a matrix that has none below 0, and its eigenvector.
pub fn smallest<const N: usize>(of: [[f64; N]; N]) -> (f64, [f64; N]) {
    let (values, vectors) = eigen(of);
    let least = (1..N).fold(0, |least, at| if values[at] < values[least] { at } else { least });
    (values[least].max(0.0), vectors.map(|row| row[least]))
}

/// The smallest eigenvalue alone. The characteristic polynomial rises up to it, ever less steeply, so that steps of
/// Newton's method from 0 on come to it from below. Where the two smaller eigenvalues are next to nothing, or next to
/// each other (within a quarter or so), it is that of Jacobi's method.
pub fn smallest_value(of: [[f64; 3]; 3]) -> f64 {
    let [[a, d, e], [_, b, f], [_, _, c]] = of;
    let trace = a + b + c;
    let minors = (b * c - f * f) + (a * c - e * e) + (a * b - d * d);
    let determinant = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e);
    if minors > FLATTEST * trace * trace {
        let mut value = 0.0;
        for _ in 0..STEPS {
            let below = determinant - ((value - trace) * value + minors) * value;
            let slope = (3.0 * value - 2.0 * trace) * value + minors;
            let next = value + below / slope;
            if next <= value * (1.0 + 4.0 * f64::EPSILON) {
                return value;
            }
            value = next;
        }
    }
    smallest(of).0
}

/// A turn of two axes.
struct Turn {
    sine: f64,
    cosine: f64,
}

impl Turn {
    #[inline]
    fn of(&self, a: f64, b: f64) -> (f64, f64) {
        (self.cosine * a - self.sine * b, self.sine * a + self.cosine * b)
    }
}

/// Turns the axes p < q so that the element between them gets 0.
#[inline]
fn turned<const N: usize>(of: &mut [[f64; N]; N], p: usize, q: usize) -> Turn {
    let between = of[p][q];
    let ratio = (of[q][q] - of[p][p]) / (2.0 * between);
    let sign = if ratio >= 0.0 { 1.0 } else { -1.0 };
    let tangent = sign / (ratio.abs() + (ratio * ratio + 1.0).sqrt());
    let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
    let turn = Turn { sine: tangent * cosine, cosine };
    of[p][p] -= tangent * between;
    of[q][q] += tangent * between;
    of[p][q] = 0.0;
    for k in 0..p {
        (of[k][p], of[k][q]) = turn.of(of[k][p], of[k][q]);
    }
    for k in p + 1..q {
        (of[p][k], of[k][q]) = turn.of(of[p][k], of[k][q]);
    }
    for k in q + 1..N {
        (of[p][k], of[q][k]) = turn.of(of[p][k], of[q][k]);
    }
    turn
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::random;

    #[test]
    fn eigenvectors_are_orthonormal_and_give_the_matrix_back() {
        let mut states = random(7);
        let mut next = || (states() >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
        for scale in [1.0, 1e-9, 1e20] {
            let half: [[f64; 4]; 4] = std::array::from_fn(|_| std::array::from_fn(|_| next() * scale));
            let of: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| half[i][j] + half[j][i]));
            let (values, vectors) = eigen(of);
            for i in 0..4 {
                for j in 0..4 {
                    let product: f64 = (0..4).map(|k| vectors[k][i] * vectors[k][j]).sum();
                    assert!((product - f64::from(u8::from(i == j))).abs() < 1e-14);
                    let back: f64 = (0..4).map(|k| vectors[i][k] * values[k] * vectors[j][k]).sum();
                    assert!((back - of[i][j]).abs() < 1e-14 * 4.0 * scale);
                }
            }
        }
        assert_eq!(eigen([[0.0; 3]; 3]).0, [0.0; 3]);
        let (least, vector) = smallest([[3.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]]);
        assert_eq!((least, vector), (1.0, [0.0, 1.0, 0.0]));
    }

    #[test]
    fn the_smallest_eigenvalue_alone_is_nearly_the_same() {
        let turned = |values: [f64; 3]| {
            // columns of a rotation by whole numbers over 3
            let axes = [[1.0, 2.0, 2.0], [2.0, 1.0, -2.0], [2.0, -2.0, 1.0]].map(|row: [f64; 3]| row.map(|x| x / 3.0));
            std::array::from_fn(|i| {
                std::array::from_fn(|j| (0..3).map(|k| axes[k][i] * values[k] * axes[k][j]).sum::<f64>())
            })
        };
        for values in [
            [1.0, 3.0, 2.0],
            [0.0, 1.0, 2.0],
            [1e-9, 1.0, 1.0],
            [1e-3, 1e-3, 1.0],
            [1.0, 1.0, 1.0],
            [0.7e-6, 1.1e-6, 1.0],
            [3e-6, 4e-6, 1.0],
            [1e-12, 1e-9, 1.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, 0.0],
            [0.9, 1.0, 1e5],
        ] {
            let least = values.iter().copied().fold(f64::INFINITY, f64::min);
            let largest = values.iter().copied().fold(0.0, f64::max);
            let found = smallest_value(turned(values));
            assert!((found - least).abs() <= 1e-9 * largest, "{values:?}: {found}");
        }
        assert_eq!(smallest_value([[2.0, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 0.0]]), 0.0, "flat without rounding");
    }
}
