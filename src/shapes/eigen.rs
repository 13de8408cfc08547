//! Eigenvectors of small symmetric matrices, by Jacobi's method.
//!
//! It needs + − × ÷ √ alone, in a fixed order, so that every machine computes the same bits.

/// Sweeps at most. Matrices of moments take 3 to 6.
const SWEEPS: usize = 12;

/// The eigenvalues of a symmetric matrix, and its eigenvectors as columns, in no particular order.
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
                rotate(&mut of, &mut vectors, p, q);
            }
        }
    }
    (std::array::from_fn(|at| of[at][at]), vectors)
}

/// Turns the axes p and q so that the element between them gets 0.
fn rotate<const N: usize>(of: &mut [[f64; N]; N], vectors: &mut [[f64; N]; N], p: usize, q: usize) {
    let between = of[p][q];
    if between == 0.0 {
        return;
    }
    let ratio = (of[q][q] - of[p][p]) / (2.0 * between);
    let sign = if ratio >= 0.0 { 1.0 } else { -1.0 };
    let tangent = sign / (ratio.abs() + (ratio * ratio + 1.0).sqrt());
    let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
    let sine = tangent * cosine;
    let turn = |a: f64, b: f64| (cosine * a - sine * b, sine * a + cosine * b);
    for row in of.iter_mut().chain(vectors) {
        (row[p], row[q]) = turn(row[p], row[q]);
    }
    for column in 0..N {
        (of[p][column], of[q][column]) = turn(of[p][column], of[q][column]);
    }
    (of[p][q], of[q][p]) = (0.0, 0.0);
}

/// The smallest eigenvalue of a matrix that has none below 0, and its eigenvector.
pub fn smallest<const N: usize>(of: [[f64; N]; N]) -> (f64, [f64; N]) {
    let (values, vectors) = eigen(of);
    let least = (1..N).fold(0, |least, at| if values[at] < values[least] { at } else { least });
    (values[least].max(0.0), vectors.map(|row| row[least]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_are_orthonormal_and_give_the_matrix_back() {
        let mut state = 7u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
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
}
