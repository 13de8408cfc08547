use super::*;
use crate::export::npz::npy_header;

const FLOATS: [&str; 2] = ["<f4", "<f8"];

fn file(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = [MAGIC, &[version, 0]].concat();
    match version {
        1 => bytes.extend((header.len() as u16).to_le_bytes()),
        _ => bytes.extend((header.len() as u32).to_le_bytes()),
    }
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

#[test]
fn arrays_of_all_versions_and_shapes_are_read() {
    let data: Vec<u8> = [0.5f32, -1.0, 2.0, 3.0, 4.0, 5.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    for version in 1..=3 {
        // the order of the keys, spaces and quotes are as they come
        for header in [
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 2), }   \n",
            "{\"shape\":(3,2),'fortran_order':False,'descr':\"<f4\"}",
        ] {
            let bytes = file(version, header, &data);
            let array = parse(&bytes, "array", &FLOATS, "floats").expect("an array");
            assert_eq!((array.kind, &array.shape[..], array.len()), ("<f4", &[3, 2][..], 6));
            assert_eq!(array.floats(), [0.5, -1.0, 2.0, 3.0, 4.0, 5.0]);
        }
    }
    let scalar = [&npy_header("<f8", "()"), &2.5f64.to_le_bytes()[..]].concat();
    assert_eq!(parse(&scalar, "array", &FLOATS, "floats").expect("a scalar").floats(), [2.5]);
    let empty = npy_header("<f8", "(0, 9)");
    assert!(parse(&empty, "array", &FLOATS, "floats").expect("no elements").is_empty());
    // one dimension is in both orders at once
    let line = file(1, "{'descr': '<f8', 'fortran_order': True, 'shape': (1,)}", &[0; 8]);
    assert_eq!(parse_flat(&line, "array", &FLOATS, "floats").expect("one dimension").floats(), [0.0]);
}

#[test]
fn whole_numbers_and_flags_of_every_type_are_read() {
    let read = |kind: &'static str, data: &[u8]| {
        let array = Array { kind, shape: vec![1], data: data.to_vec().into() };
        (array.whole_numbers().collect::<Vec<_>>(), array.is_set().collect::<Vec<_>>())
    };
    assert_eq!(read("<i4", &[255, 255, 255, 255]), (vec![-1], vec![true]));
    assert_eq!(read("<u4", &[255, 255, 255, 255]), (vec![i64::from(u32::MAX)], vec![true]));
    assert_eq!(read("<i8", &[254, 255, 255, 255, 255, 255, 255, 255]), (vec![-2], vec![true]));
    assert_eq!(read("<u8", &[255; 8]), (vec![i64::MAX], vec![true]));
    let set = |kind: &'static str, data: &[u8]| read(kind, data).1;
    assert_eq!(set("|b1", &[0, 1, 2]), [false, true, true]);
    assert_eq!(set("<f8", &[(-0.0f64).to_le_bytes(), 1e-320f64.to_le_bytes()].concat()), [false, true]);
    assert_eq!(set("<f4", &f32::NAN.to_le_bytes()), [true]);
    assert_eq!(set("<i4", &i32::MIN.to_le_bytes()), [true]);
}

#[test]
fn what_is_no_such_array_is_one_clear_line() {
    let header = |kind: &str, order: &str, shape: &str| {
        format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}}}")
    };
    let of = |kind: &str, shape: &str, bytes: usize| file(1, &header(kind, "False", shape), &vec![0; bytes]);
    for (bytes, words) in [
        (b"x".to_vec(), "numpy.save"),
        (MAGIC.to_vec(), "ends early"),
        (b"\x93NUMPY\x09\x00\x00\x00".to_vec(), "unknown version: 9"),
        (b"\x93NUMPY\x01\x00\xff\xff{}".to_vec(), "ends early"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}".to_vec(), "more than 65536 bytes: 4294967295"),
        (file(1, "", &[]), "cannot be read"),
        (file(1, "{'shape': (1,)}", &[0; 4]), "cannot be read"),
        (file(1, "{'descr': '<f4', 'shape': (1,)}", &[0; 4]), "cannot be read"),
        (file(1, &header("<f4", "0", "(1,)"), &[0; 4]), "cannot be read"),
        (of("<f4", "(-1,)", 4), "cannot be read"),
        (of("<f4", "(1)", 4), "cannot be read"),
        (of("<f4", "('1',)", 4), "cannot be read"),
        // a string that has the type inside is not the type
        (file(1, "{'descr': \"'<f4'\", 'fortran_order': False, 'shape': (1,)}", &[0; 4]), "must hold floats"),
        (file(1, "{'descr': [('<f4', '<f4')], 'fortran_order': False, 'shape': (1,)}", &[0; 4]), "must hold floats"),
        (of(">f8", "(1,)", 8), "must hold floats, as numpy's astype makes them: {'descr': '>f8'"),
        (of("|O", "(1,)", 8), "must hold floats"),
        (of("<f8", "(2,)", 8), "2 numbers of 8 bytes, but its data has bytes: 8"),
        (of("<f8", "(2, 3)", 8), "2 × 3 numbers of 8 bytes"),
        (of("<f8", "()", 0), "1 numbers"),
        (of("<f8", "(18446744073709551615,)", 8), "its data has bytes: 8"),
        (of("<f8", "(2305843009213693952, 8)", 0), "its data has bytes: 0"),
        (of("<f8", "(99999999999999999999,)", 8), "cannot be read"),
        (file(1, &header("<f4", "True", "(2, 1)"), &[0; 8]), "numpy.ascontiguousarray"),
    ] {
        let error = parse(&bytes, "array", &FLOATS, "floats").expect_err(words);
        assert!(error.message.contains(words) && !error.message.contains('\n'), "{error}");
    }
    let error = parse_flat(&of("<f4", "(2, 1)", 8), "array", &FLOATS, "floats").expect_err("two dimensions");
    assert!(error.message.contains("one dimension, not the shape: [2, 1]"), "{error}");
}
