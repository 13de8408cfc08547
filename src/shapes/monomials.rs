//! Which products of three coordinates there are up to degree 4, and where each stands in a list of its degree.

/// Axes of the products of two coordinates.
pub const PAIRS: [[usize; 2]; 6] = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]];

/// Axes of the products of three.
pub const TRIPLES: [[usize; 3]; 10] =
    [[0, 0, 0], [0, 0, 1], [0, 0, 2], [0, 1, 1], [0, 1, 2], [0, 2, 2], [1, 1, 1], [1, 1, 2], [1, 2, 2], [2, 2, 2]];

/// Axes of the products of four.
pub const QUADRUPLES: [[usize; 4]; 15] = [
    [0, 0, 0, 0],
    [0, 0, 0, 1],
    [0, 0, 0, 2],
    [0, 0, 1, 1],
    [0, 0, 1, 2],
    [0, 0, 2, 2],
    [0, 1, 1, 1],
    [0, 1, 1, 2],
    [0, 1, 2, 2],
    [0, 2, 2, 2],
    [1, 1, 1, 1],
    [1, 1, 1, 2],
    [1, 1, 2, 2],
    [1, 2, 2, 2],
    [2, 2, 2, 2],
];

/// Where the product of these coordinates stands in its list: the number of products before it. `axes` in any order.
pub const fn place<const N: usize>(axes: [usize; N]) -> usize {
    // a product is given by how many of its axes are not x, and how many are z
    let (mut others, mut z, mut at) = (0, 0, 0);
    while at < N {
        others += (axes[at] > 0) as usize;
        z += (axes[at] == 2) as usize;
        at += 1;
    }
    others * (others + 1) / 2 + z
}

/// The axes but the one at `left_out`.
pub fn without<const N: usize, const M: usize>(axes: [usize; N], left_out: usize) -> [usize; M] {
    std::array::from_fn(|at| axes[at + usize::from(at >= left_out)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_product_stands_at_its_place_whatever_the_order_of_its_axes() {
        for (at, axes) in PAIRS.into_iter().enumerate() {
            assert_eq!((place(axes), place([axes[1], axes[0]])), (at, at));
        }
        for (at, [a, b, c]) in TRIPLES.into_iter().enumerate() {
            assert_eq!([place([a, b, c]), place([c, a, b]), place([b, c, a])], [at; 3]);
        }
        for (at, axes) in QUADRUPLES.into_iter().enumerate() {
            let [a, b, c, d] = axes;
            assert_eq!([place(axes), place([d, b, a, c])], [at; 2]);
            assert_eq!(without::<4, 3>(axes, 2), [a, b, d]);
        }
    }
}
