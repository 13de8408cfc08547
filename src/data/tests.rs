use super::*;
use crate::export::npz::npy_header;

/// A set of points in a grid whose values are its items' numbers.
fn grid(shape: &[usize], full: bool, mask: Option<Vec<bool>>) -> PointSet {
    let items: usize = shape.iter().product();
    PointSet {
        dimensions: 1,
        values: Values::I4((0..items as i32).collect()),
        weights: None,
        mask,
        shape: shape.to_vec(),
        graph: Graph::Grid { full },
    }
}

/// The edges of what was laid, by items of the upload, the smaller first, ascending.
fn edges<const D: usize>(laid: &Laid<D>, members: &Members) -> Vec<(u32, u32)> {
    let item = |internal: usize| members.item(laid.member[internal]);
    let mut edges = Vec::new();
    for internal in 0..laid.member.len() {
        let row = laid.neighbour_offsets[internal] as usize..laid.neighbour_offsets[internal + 1] as usize;
        let row = &laid.neighbours[row];
        assert!(row.is_sorted_by(|a, b| a < b), "{row:?}");
        edges.extend(row.iter().map(|&other| (item(internal), item(other as usize))).filter(|(a, b)| a < b));
    }
    edges.sort_unstable();
    assert_eq!((edges.len() as u64, 2 * edges.len()), (laid.edges, laid.neighbours.len()));
    edges
}

fn laid(set: &PointSet) -> (Laid<3>, Members) {
    let members = Members::new(set.items(), set.mask.as_deref());
    (lay(set, &members, false).expect("points on the lattice"), members)
}

#[test]
fn neighbours_in_grids_are_those_one_step_away_that_take_part() {
    for shape in [&[1, 1][..], &[7, 5], &[1, 9], &[3, 4, 5], &[2, 1, 2]] {
        let items: usize = shape.iter().product();
        let place = |item: usize| {
            let mut rest = item;
            let mut place = [0i64; 3];
            for (axis, length) in shape.iter().enumerate().rev() {
                (place[axis], rest) = ((rest % length) as i64, rest / length);
            }
            place
        };
        for (full, masked) in [(false, false), (true, false), (false, true), (true, true)] {
            let mask = masked.then(|| (0..items).map(|item| item == 0 || item % 3 != 1).collect::<Vec<_>>());
            let set = grid(shape, full, mask.clone());
            let takes_part = |item: usize| mask.as_ref().is_none_or(|mask| mask[item]);
            let is_edge = |a: usize, b: usize| {
                let steps = (0..3).map(|axis| (place(a)[axis] - place(b)[axis]).abs());
                let (sum, most) = (steps.clone().sum::<i64>(), steps.max());
                takes_part(a) && takes_part(b) && if full { most == Some(1) } else { sum == 1 }
            };
            let pairs = (0..items).flat_map(|a| (a + 1..items).map(move |b| (a, b)));
            let expected: Vec<_> = pairs.filter(|&(a, b)| is_edge(a, b)).map(|(a, b)| (a as u32, b as u32)).collect();
            let (laid, members) = laid(&set);
            assert_eq!(edges(&laid, &members), expected, "{shape:?} {full} {masked}");
        }
    }
}

#[test]
fn edges_mean_the_same_in_one_direction_or_both_and_more_than_once() {
    let with = |indptr: &[i64], indices: &[i64]| PointSet {
        graph: Graph::Rows(Csr::new(indptr.iter().copied(), indices.iter().copied()).expect("rows")),
        shape: vec![4],
        ..grid(&[4, 1], false, None)
    };
    let [upper, both, repeated] = [
        with(&[0, 2, 3, 3, 3], &[1, 2, 2]),
        with(&[0, 2, 4, 6, 6], &[2, 1, 0, 2, 1, 0]),
        with(&[0, 3, 4, 5, 6], &[1, 1, 0, 2, 0, 3]),
    ]
    .map(|set| laid(&set).0);
    assert_eq!(upper, both);
    assert_eq!(upper, repeated);
    assert_eq!((upper.components.len(), upper.edges), (2, 3));
}

#[test]
fn extremes_of_f64_stay_within_the_lattice() {
    let of = |values: Vec<f64>, dimensions: usize| {
        let shape = vec![values.len() / dimensions];
        let set =
            PointSet { dimensions, values: Values::F8(values), shape, graph: Graph::Knn(2), ..grid(&[1], false, None) };
        laid(&set).0
    };
    let largest = of(vec![f64::MAX, f64::MIN, 0.0, f64::MIN_POSITIVE, -1e300, 5e-324], 2);
    assert!(largest.points.iter().flatten().all(|x| x.unsigned_abs() < 1 << 27), "{:?}", largest.points);
    assert!(largest.points.iter().flatten().any(|x| x.unsigned_abs() > 1 << 25));
    let smallest = of(vec![5e-324, 0.0, 1e-323, 0.0], 1);
    assert!(smallest.points.iter().any(|point| point[0] != smallest.points[0][0]), "{:?}", smallest.points);
    let same = of(vec![3.0; 5], 1);
    assert!(same.points.iter().all(|point| *point == [0; 3]));
}

#[test]
fn padding_changes_nothing() {
    let values = (0..120).map(|at| f64::from(at * at % 37)).collect();
    let set = PointSet {
        dimensions: 3,
        values: Values::F8(values),
        shape: vec![40],
        graph: Graph::Knn(3),
        ..grid(&[1], false, None)
    };
    let members = Members::new(40, None);
    let three: Laid<3> = lay(&set, &members, false).expect("points");
    let eight: Laid<8> = lay(&set, &members, false).expect("points");
    assert!(three.points.iter().zip(&eight.points).all(|(a, b)| b[..3] == a[..] && b[3..] == [0; 5]));
    assert_eq!((three.neighbours, three.member, three.weights), (eight.neighbours, eight.member, eight.weights));
}

#[test]
fn what_contradicts_itself_is_refused_in_a_line() {
    let points = |kind: &str, shape: &str, bytes: usize| [&npy_header(kind, shape)[..], &vec![0; bytes]].concat();
    let two = points("<f4", "(2, 3)", 24);
    let grid = Some(Graph::Grid { full: false });
    let nan = [npy_header("<f4", "(1, 1)"), f32::NAN.to_le_bytes().to_vec()].concat();
    for (bytes, graph, words) in [
        (points("<f4", "(0, 3)", 0), None, "no items"),
        (points("<f4", "(3, 0)", 0), None, "columns"),
        (points("<f4", "(1, 65)", 260), None, "65"),
        (points("<f4", "(24,)", 96), None, "items × columns"),
        (points("<f4", "(2, 3)", 20), None, "should hold"),
        (points("<f4", "(18446744073709551615, 3)", 24), None, "should hold"),
        (points(">f4", "(2, 3)", 24), None, "little-endian"),
        (points("<c8", "(2, 3)", 48), None, "little-endian"),
        (nan, None, "item 0, column 0"),
        (two.clone(), grid, "2 or 3 dimensions"),
        (two.clone(), Some(Graph::Knn(0)), "nearest"),
        (two[..30].to_vec(), None, "ends early"),
        (b"PK\x03\x04and nothing".to_vec(), None, "npz"),
    ] {
        let error = read(&bytes, None, graph, 1 << 20).expect_err(words);
        assert!(error.message.contains(words) && !error.message.contains('\n'), "{words}: {error}");
    }
    let set = read(&two, None, None, 1 << 20).expect("points");
    assert_eq!((set.items(), set.dimensions, &set.graph), (2, 3, &Graph::Knn(8)));
}
