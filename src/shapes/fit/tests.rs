use super::*;
use crate::dev::random;
use crate::energy::OfPoints;
use crate::shapes::faces::Faces;
use crate::shapes::moments::{Higher, Moments};
use crate::shapes::proxy::Proxy;
use crate::shapes::shape::across;
use crate::surface::samples::Samples;
use crate::surface::{Component, DualGraph, Moves, Rows};

/// Faces with a normal at points of a shape.
fn faces_at(points: &[(DVec3, DVec3)]) -> (DualGraph<OfPoints<3>>, Samples) {
    let faces: Vec<_> = points
        .iter()
        .map(|&(at, normal)| {
            let sample = at.to_array().map(|x| (x + 0.5).floor() as i32);
            (vec![sample], (normal * f64::from(1 << 14)).to_array().map(|x| (x + 0.5).floor() as i16))
        })
        .collect();
    let count = faces.len() as u32;
    let graph = DualGraph {
        points: vec![[0; 3]; faces.len()],
        weights: (0..count).map(|at| 1000 + at % 7).collect(),
        neighbours: Rows::empty(faces.len()),
        components: vec![Component { first_face: 0, faces: count, weight: 0, energy_shift: 0 }],
        moves: Moves::Free,
    };
    (graph, Samples::new(&faces))
}

fn fitted(kind: Kind, points: &[(DVec3, DVec3)]) -> (Option<Fit>, Central) {
    let (graph, samples) = faces_at(points);
    let faces = Faces { graph: &graph, samples: &samples };
    let (mut moments, mut higher) = (Moments::default(), Higher::default());
    for face in 0..points.len() as u32 {
        moments.add(&Moments::of(&faces, face));
        higher.add(&Higher::of(&faces, face));
    }
    let central = Central::of(&moments);
    let higher = CentralHigher::of(&central, &moments, &higher);
    (of_kind(kind, Known { central: &central, higher: &higher, axes: &[] }), central)
}

/// Points on a part of a surface that is given by two numbers from 0 to 1.
fn grid(of: impl Fn(f64, f64) -> (DVec3, DVec3)) -> Vec<(DVec3, DVec3)> {
    (0..300).map(|at| of(f64::from(at % 20) / 19.0, f64::from(at / 20) / 14.0)).collect()
}

const AXIS: DVec3 = DVec3::new(0.48, -0.64, 0.6);

#[test]
fn true_shapes_are_found() {
    let (centre, radius) = (DVec3::new(3e7, -2e7, 5e7), 4e7);
    let u = across(AXIS);
    let v = AXIS.cross(u);
    let round = |angle: f64| libm::cos(angle) * u + libm::sin(angle) * v;
    let unit = f64::from(1 << crate::shapes::moments::SHIFT);
    let plane = grid(|a, b| (centre + a * 2e7 * u + b * 1e7 * v, AXIS));
    let Some(Fit { shape: Shape::Plane { normal, .. }, mean_square }) = fitted(Kind::Plane, &plane).0 else {
        panic!("a plane")
    };
    assert!(normal.dot(AXIS).abs() > 1.0 - 1e-11 && mean_square < 1.0, "{normal} {mean_square}");
    // a cap of a sphere, and a quarter of a cylinder
    let sphere = grid(|a, b| {
        let normal = libm::cos(b) * AXIS + libm::sin(b) * round(a * 6.0);
        (centre + radius * normal, normal)
    });
    let Some(Fit { shape: Shape::Sphere { centre: at, radius: of }, .. }) = fitted(Kind::Sphere, &sphere).0 else {
        panic!("a sphere")
    };
    assert!((at * unit - centre).length() < 1e-5 * radius && (of * unit - radius).abs() < 1e-5 * radius);
    let cylinder = grid(|a, b| (centre + radius * round(a * 1.6) + b * 3e7 * AXIS, round(a * 1.6)));
    let Some(Fit { shape: Shape::Cylinder { point, axis, radius: of }, .. }) = fitted(Kind::Cylinder, &cylinder).0
    else {
        panic!("a cylinder")
    };
    assert!(axis.dot(AXIS).abs() > 1.0 - 1e-8, "{axis}");
    let off = (point * unit - centre).cross(AXIS).length();
    assert!(off < 1e-4 * radius && (of * unit - radius).abs() < 1e-4 * radius, "{off} {of}");
    // a plane is no sphere: its radius is out of range
    let flat = grid(|a, b| (a * 2e7 * DVec3::X + b * 1e7 * DVec3::Y, DVec3::Z));
    assert_eq!(fitted(Kind::Sphere, &flat).0, None);
}

/// The mean squared Taubin distance of a sphere, by sums over the points.
fn taubin(points: &[DVec3], weights: &[f64], [x, y, z, radius]: [f64; 4]) -> f64 {
    let centre = DVec3::new(x, y, z);
    let (mut value, mut gradient, mut weight) = (0.0, 0.0, 0.0);
    for (&point, w) in points.iter().zip(weights) {
        let square = (point - centre).length_squared();
        value += w * (square - radius * radius) * (square - radius * radius);
        gradient += w * 4.0 * square;
        weight += w;
    }
    value / gradient * weight / weight
}

#[test]
fn no_sphere_nearby_has_a_smaller_taubin_distance() {
    let mut states = random(3);
    let mut noise = || (states() >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
    let points = grid(|a, b| {
        let normal = DVec3::new(libm::sin(b) * libm::cos(a * 3.0), libm::sin(b) * libm::sin(a * 3.0), libm::cos(b));
        (5e7 * normal, normal)
    });
    let points: Vec<_> = points.into_iter().map(|(at, n)| (at + 3e6 * n * noise(), n)).collect();
    let Some(Fit { shape: Shape::Sphere { centre, radius }, mean_square }) = fitted(Kind::Sphere, &points).0 else {
        panic!("a sphere")
    };
    let at: Vec<DVec3> = points.iter().map(|&(at, _)| at / 64.0).collect();
    let weights: Vec<f64> = (0..at.len()).map(|number| (1000 + number % 7) as f64).collect();
    let own = [centre.x, centre.y, centre.z, radius];
    let least = taubin(&at, &weights, own);
    assert!((least / mean_square - 1.0).abs() < 1e-4, "{least} {mean_square}");
    for number in 0..4 {
        for turn in [-1.0, 1.0] {
            let mut other = own;
            other[number] += turn * 1e-3 * radius;
            assert!(taubin(&at, &weights, other) > least, "{number} {turn}");
        }
    }
}

/// Points of a cone around [`AXIS`], and normals: from the apex to `height`, `arc` of the circle in radians, moved by
/// `noise`.
fn cone(apex: DVec3, slope: f64, heights: [f64; 2], arc: f64, noise: f64) -> Vec<(DVec3, DVec3)> {
    let u = across(AXIS);
    let v = AXIS.cross(u);
    let mut states = random(5);
    let mut next = || (states() >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
    let points = grid(|a, b| {
        let out = libm::cos(a * arc) * u + libm::sin(a * arc) * v;
        let along = heights[0] + b * (heights[1] - heights[0]);
        (apex + along * (AXIS + slope * out), (out - slope * AXIS).normalize())
    });
    points.into_iter().map(|(at, normal)| (at + noise * next() * normal, normal)).collect()
}

#[test]
fn true_cones_are_found_from_their_apex_on_far_from_it_and_inside_out() {
    let apex = DVec3::new(3e7, -2e7, 4e7);
    let unit = f64::from(1 << crate::shapes::moments::SHIFT);
    for (slope, heights, arc, side) in [
        (0.6, [0.0, 5e7], 6.1, 1.0),
        (0.6, [2e7, 5e7], 1.6, -1.0),
        (2.0, [1e7, 2e7], 6.1, 1.0),
        (8.0, [1e6, 4e6], 3.0, -1.0),
        (0.02, [4e8, 5e8], 3.0, 1.0),
    ] {
        let points = cone(apex - heights[0] * AXIS, slope, heights, arc, 0.0);
        let points: Vec<_> = points.into_iter().map(|(at, normal)| (at, side * normal)).collect();
        let fit = fitted(Kind::Cone, &points).0.unwrap_or_else(|| panic!("no cone: {slope} {heights:?}"));
        let Shape::Cone { apex: found, axis, slope: of } = fit.shape else { panic!("{fit:?}") };
        let off = (found * unit - apex + heights[0] * AXIS).length();
        assert!(axis.dot(AXIS) > 1.0 - 1e-8 && (of / slope - 1.0).abs() < 1e-4, "{slope} {heights:?}: {axis} {of}");
        assert!(off < 1e-3 * heights[1] && fit.mean_square < 1.0, "{slope} {heights:?}: {off} {fit:?}");
    }
    // cylinders, planes and double cones are none
    let cylinder = cone(apex - 5e9 * AXIS, 0.004, [5e9, 5.05e9], 3.0, 0.0);
    assert_eq!(fitted(Kind::Cone, &cylinder).0, None);
    let mut both = cone(apex, 0.6, [1e7, 5e7], 6.1, 0.0);
    both.extend(cone(apex, 0.6, [-5e7, -1e7], 6.1, 0.0));
    assert_eq!(fitted(Kind::Cone, &both).0, None);
}

#[test]
fn short_slices_of_cones_are_found() {
    for slope in [1.0, 7.0] {
        for radii in [[1e8, 2e8], [1.9e8, 3.8e8]] {
            let foot = (radii[0] + radii[1]) / 2.0;
            let apex = -foot * across(AXIS) - foot / slope * AXIS;
            let points = cone(apex, slope, radii.map(|radius| radius / slope), 0.35, 0.0);
            let fit = fitted(Kind::Cone, &points).0.unwrap_or_else(|| panic!("no cone: {slope} {radii:?}"));
            let Shape::Cone { axis, slope: found, .. } = fit.shape else { panic!("{fit:?}") };
            assert!(axis.dot(AXIS) > 1.0 - 1e-4 && (found / slope - 1.0).abs() < 0.02, "{slope} {radii:?}: {fit:?}");
            assert!(Proxy::new(&fit.shape, DVec3::ZERO).is_some(), "{fit:?}");
        }
    }
}

#[test]
fn no_cone_nearby_has_a_smaller_taubin_distance() {
    for (slope, heights, arc) in [(0.6, [1e7, 6e7], 3.0), (0.1, [2e8, 2.6e8], 2.0)] {
        let points = cone(DVec3::new(1e7, 0.0, -3e7) - heights[0] * AXIS, slope, heights, arc, 1e6);
        let fit = fitted(Kind::Cone, &points).0.expect("a cone");
        let Shape::Cone { apex, axis, slope } = fit.shape else { panic!("{fit:?}") };
        let at: Vec<DVec3> = points.iter().map(|&(at, _)| at / 64.0).collect();
        let weights: Vec<f64> = (0..at.len()).map(|number| (1000 + number % 7) as f64).collect();
        let mean = at.iter().sum::<DVec3>() / at.len() as f64;
        let foot = apex + (mean - apex).dot(axis) * axis;
        let radius = slope * (foot - apex).length();
        let (u, v) = (across(axis), axis.cross(across(axis)));
        // of the cone whose foot, axis, radius and slope differ by these
        let taubin = |[x, y, turn_u, turn_v, r, s]: [f64; 6]| {
            let (foot, axis) = (foot + x * u + y * v, (axis + turn_u * u + turn_v * v).normalize());
            let (mut value, mut gradient) = (0.0, 0.0);
            for (&at, w) in at.iter().zip(&weights) {
                let (along, all) = ((at - foot).dot(axis), (at - foot).length_squared());
                let (across, at) = (all - along * along, radius + r + (slope + s) * along);
                value += w * (across - at * at) * (across - at * at);
                gradient += w * 4.0 * (across + (slope + s) * (slope + s) * at * at);
            }
            value / gradient
        };
        let least = taubin([0.0; 6]);
        assert!((least / fit.mean_square - 1.0).abs() < 1e-4, "{least} {}", fit.mean_square);
        for number in 0..6 {
            for turn in [-1.0, 1.0] {
                let mut other = [0.0; 6];
                other[number] = turn * if matches!(number, 0 | 1 | 4) { 3e-3 * radius } else { 3e-3 };
                assert!(taubin(other) > least, "{slope} {number} {turn}: {} {least}", taubin(other));
            }
        }
    }
}

#[test]
fn moments_of_a_union_are_the_sum_and_central_ones_those_about_the_mean() {
    let far = (1 << 27) - 1;
    let points: Vec<_> = [[far, -far, far], [far, far, -far], [-far, 1, 17], [far, -far + 64, far - 640]]
        .map(|at| (DVec3::from(at.map(f64::from)), DVec3::Z))
        .to_vec();
    let (mut graph, samples) = faces_at(&points);
    // three times the largest sum of weights, in one face of the largest and others
    graph.weights = vec![u32::MAX, u32::MAX, u32::MAX, u32::MAX - 4];
    let faces = Faces { graph: &graph, samples: &samples };
    let (mut moments, mut higher) = (Moments::default(), Higher::default());
    for face in 0..4 {
        let (of_face, higher_of_face) = (Moments::of(&faces, face), Higher::of(&faces, face));
        assert_eq!(moments.with(&of_face), of_face.with(&moments));
        moments.add(&of_face);
        higher.add(&higher_of_face);
    }
    let weights: Vec<f64> = graph.weights.iter().map(|&weight| 3.0 * f64::from(weight)).collect();
    let at: Vec<DVec3> = (0..4)
        .map(|face| DVec3::from(faces.samples(face)[0].map(|x| f64::from(((i64::from(x) + 32) >> 6) as i32))))
        .collect();
    let all: f64 = weights.iter().sum();
    assert_eq!(moments.weight as f64, all);
    let mean = at.iter().zip(&weights).map(|(&at, &w)| at * w).sum::<DVec3>() / all;
    let central = Central::of(&moments);
    assert!((central.mean - mean).length() < 1e-9 * mean.length());
    let of = |axes: &[usize]| {
        let product = |at: &DVec3| axes.iter().map(|&axis| (*at - mean)[axis]).product::<f64>();
        at.iter().zip(&weights).map(|(at, w)| product(at) * w).sum::<f64>() / all
    };
    let higher = CentralHigher::of(&central, &moments, &higher);
    let near = |a: f64, b: f64, degree: i32| (a - b).abs() < 1e-12 * 4.4e6f64.powi(degree);
    for (at, axes) in crate::shapes::monomials::PAIRS.iter().enumerate() {
        assert!(near(central.second[at], of(axes), 2));
    }
    for (at, axes) in crate::shapes::monomials::TRIPLES.iter().enumerate() {
        assert!(near(higher.third[at], of(axes), 3));
    }
    for (at, axes) in crate::shapes::monomials::QUADRUPLES.iter().enumerate() {
        assert!(near(higher.fourth[at], of(axes), 4), "{axes:?} {} {}", higher.fourth[at], of(axes));
    }
}
