use proptest::prelude::*;

use super::*;
use crate::dev::random;
use crate::energy::cvd::{Cvd, squared_distance};
use crate::energy::{Functional, Item, Sums};
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
        let row = laid.neighbours.of(internal as u32);
        assert!(row.is_sorted_by(|a, b| a < b), "{row:?}");
        edges.extend(row.iter().map(|&other| (item(internal), item(other as usize))).filter(|(a, b)| a < b));
    }
    edges.sort_unstable();
    assert_eq!((edges.len() as u64, 2 * edges.len()), (laid.edges, laid.neighbours.items.len()));
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
        let error = read(&bytes, graph, 1 << 20).expect_err(words);
        assert!(error.message.contains(words) && !error.message.contains('\n'), "{words}: {error}");
    }
    let set = read(&two, None, 1 << 20).expect("points");
    assert_eq!((set.items(), set.dimensions, &set.graph), (2, 3, &Graph::Knn(8)));
}

/// A table of points with edges of its nearest neighbours.
fn table(dimensions: usize, values: Vec<f64>, nearest: u32) -> PointSet {
    let shape = vec![values.len() / dimensions];
    PointSet { dimensions, values: Values::F8(values), shape, graph: Graph::Knn(nearest), ..grid(&[1], false, None) }
}

/// Numbers from −1 to 1 that look random.
fn numbers(count: usize) -> Vec<f64> {
    let mut states = random(1);
    let mut next = || f64::from((states() >> 32) as i32) / f64::from(1u32 << 31);
    (0..count).map(|_| next()).collect()
}

#[test]
fn a_lattice_of_d_coordinates_has_as_many_bits_as_its_squares_leave() {
    for d in 1..=MOST_DIMENSIONS as u128 {
        let bits = bits(d as usize);
        assert!(bits <= 27 && d << (2 * bits) <= 1 << 56, "{d}");
        assert!(bits == 27 || d.next_power_of_two() << (2 * bits + 2) > 1 << 56, "{d} has room for another bit");
        let most = (1u128 << bits) - 1;
        assert!(d * (2 * most) * (2 * most) < 1 << 58, "{d}");
        // a product of a coordinate and the lower half of a sum, over all axes
        assert!(d * most * u128::from(u32::MAX) < 1 << 63, "{d}");
    }
}

/// Sums of the heaviest cluster at the corners of the lattice, against the same in 128 bits.
fn check_extremes<const D: usize>(dimensions: usize) {
    let most = (1 << bits(dimensions)) - 1;
    let corner = |sign: i32| std::array::from_fn(|axis| if axis < dimensions { sign * most } else { 0 });
    let (low, high): ([i32; D], [i32; D]) = (corner(-1), corner(1));
    let expected = dimensions as u128 * (2 * most as u128).pow(2);
    assert_eq!(u128::from(squared_distance(low, high)), expected);
    assert!(expected < 1 << 58);
    for lows in 0..=8 {
        let mut sums = <Cvd<D> as Functional>::Sums::default();
        let (mut total, mut along, mut constant) = (0i128, [0i128; D], 0i128);
        for face in 0..8 {
            let point = if face < lows { low } else { high };
            let weight = (1u32 << 31) - 1;
            let item = Item { point, weight };
            sums.add_face(item, 1);
            constant += Cvd::<D>::constant(item);
            total += i128::from(weight);
            along.iter_mut().zip(point).for_each(|(sum, x)| *sum += i128::from(weight) * i128::from(x));
        }
        let (proxy, explained) = sums.fit().expect("faces");
        let nearest = along.map(|sum| (2 * sum + total).div_euclid(2 * total));
        assert_eq!(proxy.map(i128::from), nearest);
        let product: i128 = nearest.iter().zip(&along).map(|(p, s)| p * s).sum();
        let square: i128 = nearest.iter().map(|p| p * p).sum();
        assert_eq!(explained, 2 * product - total * square);
        assert!(4 * explained >= -(dimensions as i128) * total && explained <= constant && constant < 1 << 90);
        assert!(along.iter().all(|sum| sum.abs() < 1 << 61) && square < 1 << 56);
        assert!((constant << 33) < 1 << 123);
    }
}

#[test]
fn sums_at_the_corners_of_the_lattice_are_those_of_wider_integers() {
    check_extremes::<3>(1);
    check_extremes::<3>(3);
    check_extremes::<8>(4);
    check_extremes::<8>(5);
    check_extremes::<64>(16);
    check_extremes::<64>(17);
    check_extremes::<64>(33);
    check_extremes::<64>(64);
}

#[test]
fn weights_keep_their_ratios_and_their_unit_is_known() {
    let weights = vec![1e-300, 3.5e-300, 0.75e-300, f64::NAN, 9e-300, 2e-300, 1.25e-300, 4e-300];
    let mask = Some(vec![true, true, true, false, true, true, true, true]);
    let edges = Csr::new([0, 1, 2, 2, 2, 3, 4, 5, 5].into_iter(), [1, 2, 5, 6, 7].into_iter()).expect("rows");
    let set = PointSet { weights: Some(weights.clone()), mask, graph: Graph::Rows(edges), ..table(2, numbers(16), 1) };
    let (laid, members) = laid(&set);
    assert_eq!(laid.components.len(), 2);
    for component in &laid.components {
        let sum: u64 = laid.weights[component.range()].iter().map(|&weight| u64::from(weight)).sum();
        assert_eq!(sum, component.weight);
        assert!(((1 << 30)..1 << 34).contains(&sum), "{sum}");
        for internal in component.range() {
            let exponent = component.energy_shift as i32 - laid.weight_exponent;
            let found = libm::ldexp(f64::from(laid.weights[internal]), exponent);
            let source = weights[members.item(laid.member[internal]) as usize];
            assert!((found / source - 1.0).abs() < 1e-8, "{found:e} {source:e}");
        }
    }
    let unweighted = self::laid(&table(2, numbers(16), 1)).0;
    assert!(unweighted.weights.iter().all(|&weight| libm::ldexp(1.0, unweighted.weight_exponent) == f64::from(weight)));
}

#[test]
fn bridges_join_all_components_with_one_edge_less() {
    let check = |dimensions: usize, islands: usize| {
        let items = 2 * islands;
        let indptr = (0..=items as i64).map(|item| (item + 1) / 2);
        let indices = (0..islands as i64).map(|island| 2 * island + 1);
        let pairs: Vec<i64> = indptr.collect();
        let csr = Csr::new(pairs.into_iter(), indices.collect::<Vec<_>>().into_iter()).expect("rows");
        let set = PointSet { graph: Graph::Rows(csr), ..table(dimensions, numbers(items * dimensions), 1) };
        let members = Members::new(items, None);
        let apart: Laid<8> = lay(&set, &members, false).expect("points");
        let joined: Laid<8> = lay(&set, &members, true).expect("points");
        assert_eq!((apart.components.len(), apart.edges), (islands, islands as u64));
        assert_eq!((joined.components.len(), joined.components_found), (1, islands as u64));
        let found = edges(&joined, &members);
        assert_eq!(found.len(), 2 * islands - 1);
        let mut sets = crate::union_find::singletons(items);
        assert!(found.iter().all(|&(a, b)| crate::union_find::join(&mut sets, a, b)), "no edge closes a circle");
    };
    check(2, 40);
    check(5, 1);
    check(5, 40);
    // more than are compared pair by pair
    check(5, 5000);
}

#[test]
fn bridges_in_more_than_three_dimensions_join_the_nearest_means() {
    // islands on a line along the fourth axis, in a shuffled order
    let places = [3.0, 0.0, 4.0, 1.0, 2.0];
    let values = places.iter().flat_map(|&place| [0.0, 0.0, 0.0, place]).collect();
    let csr = Csr::new([0; 6].into_iter(), std::iter::empty::<i64>().collect::<Vec<_>>().into_iter()).expect("rows");
    let set = PointSet { graph: Graph::Rows(csr), ..table(4, values, 1) };
    let members = Members::new(5, None);
    let joined: Laid<8> = lay(&set, &members, true).expect("points");
    assert_eq!(edges(&joined, &members), [(0, 2), (0, 4), (1, 3), (3, 4)]);
}

#[test]
fn a_hub_is_refused_where_the_square_of_its_neighbours_is_most_of_the_work() {
    let star = |leaves: i32| {
        let indptr: Vec<i64> = (0..leaves + 2).map(|row| if row > 0 { leaves.into() } else { 0 }).collect();
        let indices: Vec<i64> = (1..=leaves).map(i64::from).collect();
        PointSet {
            shape: vec![leaves as usize + 1],
            values: Values::I4((0..=leaves).collect()),
            graph: Graph::Rows(Csr::new(indptr.into_iter(), indices.into_iter()).expect("rows")),
            ..grid(&[1], false, None)
        }
    };
    let lay = |set: PointSet| lay::<3>(&set, &Members::new(set.items(), None), false).map(drop);
    assert_eq!(lay(star(3000)), Ok(()));
    let error = lay(star(3100)).expect_err("a hub");
    assert!(error.message.contains("item 0 with 3100 neighbours"), "{error}");
}

#[test]
fn what_is_laid_does_not_depend_on_the_number_of_threads() {
    let set = table(5, [vec![1e20], numbers(5 * 9000 - 1)].concat(), 6);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let members = Members::new(set.items(), None);
        pool.install(|| lay::<8>(&set, &members, true).expect("points"))
    };
    assert!(with(1) == with(4));
}

#[test]
fn columns_that_have_hardly_any_resolution_are_named() {
    let wide = |at: usize| if at == 0 { 1e9 } else { at as f64 };
    let values = |narrow: f64| (0..50).flat_map(|at| [wide(at), 7.0, narrow * at as f64]).collect();
    let warnings = laid(&table(3, values(1.0), 2)).0.warnings;
    assert!(warnings.len() == 2 && warnings[0].starts_with("columns 2 have"), "{warnings:?}");
    let warnings = laid(&table(3, values(1e6), 2)).0.warnings;
    assert_eq!(warnings, Vec::<String>::new());
}

#[test]
fn items_that_an_outlier_makes_alike_are_named_whatever_repeats_there_are() {
    let warnings = |set: &PointSet| {
        let members = Members::new(set.items(), set.mask.as_deref());
        lay::<3>(set, &members, true).expect("points").warnings
    };
    let is_warned = |set: &PointSet| warnings(set).iter().any(|warning| warning.starts_with("items that cannot"));
    // more items than one thread takes, in whole numbers, most of which are there many times
    let numbers = |far: f64| (0..20_000).map(move |at| if at == 7 { far } else { f64::from(at / 40) });
    for graph in [Graph::Knn(2), Graph::Grid { full: false }] {
        let shape = vec![100, 200];
        let set = |far| PointSet { graph: graph.clone(), shape: shape.clone(), ..table(1, numbers(far).collect(), 2) };
        assert!(!is_warned(&set(1e3)) && is_warned(&set(-1e30)), "{:?}", warnings(&set(1e3)));
        let mask = Some((0..20_000).map(|at| at != 7).collect());
        assert!(!is_warned(&PointSet { mask, ..set(-1e30) }), "it takes no part");
    }
    // items of nine places, which mix along the curve
    let square = |at: u32| [at * 7919 % 2000, at * 6367 % 1999].map(|place| f64::from(place) / 2000.0);
    let beside = |far: f64| (0..2000).flat_map(square).chain([far, far]).collect();
    assert!(!is_warned(&table(2, beside(1e3), 8)) && is_warned(&table(2, beside(1e8), 8)));
    // equal items, but for what arithmetic on them adds
    let noise = |at: u32| f64::from(at % 3) * (1.0 + f64::EPSILON * f64::from(at % 5));
    assert!(!is_warned(&table(1, (0..300).map(noise).collect(), 2)));
    assert!(!is_warned(&table(1, vec![3.0; 50], 2)));
    let beside = |at: u32| [f64::from(at), f64::from(at % 3) * 1e-13];
    assert_eq!(warnings(&table(2, (0..300).flat_map(beside).collect(), 2)), Vec::<String>::new());
}

#[test]
fn weights_that_a_large_one_makes_equal_are_named() {
    let warnings = |heavy: f64| {
        let weights = Some((0..50).map(|at| if at == 0 { heavy } else { 1.0 + f64::from(at) }).collect());
        laid(&PointSet { weights, ..table(1, (0..50).map(f64::from).collect(), 20) }).0.warnings
    };
    assert_eq!(warnings(1e6), Vec::<String>::new());
    let heavy = warnings(1e12);
    assert!(heavy.len() == 1 && heavy[0].starts_with("weights of items below 4.65"), "{heavy:?}");
}

#[test]
fn one_item_is_a_component_without_neighbours() {
    for graph in [Graph::Knn(8), Graph::Rows(Csr::new([0, 1].into_iter(), [0].into_iter()).expect("rows"))] {
        let (laid, _) = laid(&PointSet { graph, ..table(2, vec![1e308, -1e308], 1) });
        assert_eq!((laid.points, laid.neighbours, laid.edges), (vec![[0; 3]], Rows::empty(1), 0));
        assert_eq!(laid.components.len(), 1);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn rows_are_edges_in_both_directions_between_those_that_take_part(
        lists in prop::collection::vec(prop::collection::vec(0i64..12, 0..6), 12),
        mask in prop::collection::vec(any::<bool>(), 12),
    ) {
        let mut indptr = vec![0];
        lists.iter().for_each(|list| indptr.push(indptr[indptr.len() - 1] + list.len() as i64));
        let csr = Csr::new(indptr.into_iter(), lists.concat().into_iter()).expect("rows");
        let members = Members::new(12, Some(&mask));
        let rows = csr.rows(&members).expect("few edges");
        for a in 0..12u32 {
            let Some(member) = members.member(a) else { continue };
            let is_edge = |b: u32| lists[a as usize].contains(&b.into()) || lists[b as usize].contains(&a.into());
            let others = (0..12).filter(|&b| b != a && is_edge(b)).filter_map(|b| members.member(b));
            prop_assert_eq!(rows.of(member), others.collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_damaged_array_is_read_or_refused(at in 0usize..140, byte: u8, cut in 0usize..200) {
        let data = numbers(6).iter().flat_map(|x| x.to_le_bytes()).collect();
        let mut bytes = [npy_header("<f4", "(3, 4)"), data].concat();
        bytes[at] = byte;
        bytes.truncate(cut.max(6));
        let graph = if byte % 2 == 0 { None } else { Some(Graph::Grid { full: true }) };
        if let Ok(set) = read(&bytes, graph, 1 << 20) {
            prop_assert!(lay::<64>(&set, &Members::new(set.items(), None), false).is_ok());
        }
    }
}
