use super::*;
use crate::dev::random;
use crate::dev::sample::generate_part;
use crate::mesh::{Faces, Format, PolygonMesh};
use crate::shapes::given::as_given;

/// The true patches of a part, and the shapes that are reported of them from a start that is somewhat off.
fn reported(noise: f64) -> Vec<ClusterShape> {
    let (mesh, truth) = generate_part(3000, noise).expect("a part");
    let surface = Surface::build(&mesh).expect("a surface").with_normals((&mesh).into());
    let corners = surface.corners((&mesh).into());
    let labels: Vec<u32> = surface.items.upload_face.iter().map(|&face| truth[face as usize]).collect();
    let frame = surface.frame();
    let turned = |at: [f64; 3]| {
        let [x, y, z] = at;
        DVec3::new(0.8 * x - 0.36 * y + 0.48 * z, 0.6 * x + 0.48 * y - 0.64 * z, 0.8 * y + 0.6 * z)
    };
    let place = |at: [f64; 3]| frame.position(turned(at).to_array()) / 64.0;
    let length = |length: f64| libm::ldexp(length, frame.exponent) / 64.0;
    let plane = Shape::Plane { point: DVec3::ZERO, normal: DVec3::X };
    let cylinder = |x: f64, y: f64, radius: f64| Shape::Cylinder {
        point: place([x, y, 0.3]),
        axis: (turned([0.02, 0.01, 1.0])).normalize(),
        radius: length(radius * 0.97),
    };
    let sphere = Shape::Sphere { centre: place([0.01, 0.0, 1.1]), radius: length(1.12) };
    let corner = |x: f64, y: f64| cylinder(x, y, 0.5);
    let shapes = [
        plane,
        corner(1.5, 1.0),
        plane,
        corner(-1.5, 1.0),
        plane,
        corner(-1.5, -1.0),
        plane,
        corner(1.5, -1.0),
        plane,
        sphere,
        plane,
        cylinder(0.0, 0.0, 0.6),
        plane,
    ];
    table(&surface, &corners, &labels, &shapes, None)
}

#[test]
fn shapes_of_a_part_are_its_own_to_six_digits() {
    let rows = reported(0.0);
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6, "{a} {b}");
    for row in &rows {
        assert!(row.residual.max < 1e-6 && row.normal_deviation.rms < 12.0, "{row:?}");
    }
    let axis = DVec3::new(0.48, -0.64, 0.6);
    for label in [1, 3, 5, 7] {
        let cylinder = rows[label].cylinder.expect("a cylinder");
        near(cylinder.radius, 0.5);
        assert!((cylinder.angle - 90.0).abs() < 1e-4, "{cylinder:?}");
        near(cylinder.extent[1] - cylinder.extent[0], 1.0);
        near(DVec3::from(cylinder.axis).dot(axis).abs(), 1.0);
        assert!(cylinder.convex);
    }
    let boss = rows[11].cylinder.expect("a cylinder");
    near(boss.radius, 0.6);
    assert_eq!(boss.angle, 360.0);
    let bowl = rows[9].sphere.expect("a sphere");
    near(bowl.radius, 1.1);
    assert!(!bowl.convex);
    let top = rows[8].plane.expect("a plane");
    near(DVec3::from(top.normal).dot(axis), 1.0);
    // the top has the sides, and the bowl inside
    let beside: Vec<u32> = rows[8].neighbours.iter().map(|neighbour| neighbour.label).collect();
    assert_eq!(beside, [0, 1, 2, 3, 4, 5, 6, 7, 9]);
    let side = &rows[8].neighbours[0];
    near(side.length, 2.0);
    assert!((side.angle - 90.0).abs() < 1e-4, "{side:?}");
    let rim = &rows[11].neighbours[0];
    assert!(rim.label == 10 && (rim.angle + 90.0).abs() < 3.0, "{rim:?}");
}

#[test]
fn noise_leaves_residuals_of_its_size() {
    let rows = reported(0.05);
    let deviation = 0.0005 * DVec3::new(4.0, 3.0, 1.7).length();
    for row in &rows {
        assert!(row.residual.rms < 1.5 * deviation && row.residual.max > row.residual.rms, "{row:?}");
    }
    let boss = rows[11].cylinder.expect("a cylinder");
    assert!((boss.radius - 0.6).abs() < 2e-3 && boss.radius != 0.6, "{boss:?}");
}

/// The angle between the two sides of a roof, each a cluster, that bends by 40°; with another triangle at the ridge
/// where there is one.
fn bend_of_a_roof(right: [u32; 4], thin: Option<[u32; 3]>) -> f64 {
    let (sin, cos) = libm::sincos(20f64.to_radians());
    let positions = vec![
        [0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [-cos, 0.0, -sin],
        [-cos, 1.0, -sin],
        [cos, 0.0, -sin],
        [cos, 1.0, -sin],
    ];
    let mut faces = Faces::default();
    faces.push(&[0, 1, 3, 2]);
    faces.push(&right);
    thin.iter().for_each(|corners| faces.push(corners));
    let mesh = PolygonMesh::of_one_part(Format::Obj, positions, faces);
    let surface = Surface::build(&mesh).expect("a surface").with_normals((&mesh).into());
    let labels: Vec<u32> = surface.items.upload_face.iter().map(|&face| u32::from(face == 1)).collect();
    let plane = Shape::Plane { point: DVec3::ZERO, normal: DVec3::X };
    let rows = table(&surface, &surface.corners((&mesh).into()), &labels, &[plane, plane], None);
    rows[0].neighbours[0].angle
}

#[test]
fn angles_at_borders_take_winding_and_faces_without_area_into_account() {
    let (right, turned) = ([1, 0, 4, 5], [5, 4, 0, 1]);
    assert!((bend_of_a_roof(right, None) - 40.0).abs() < 1e-4, "{}", bend_of_a_roof(right, None));
    assert!((bend_of_a_roof(turned, None) - 40.0).abs() < 1e-4, "{}", bend_of_a_roof(turned, None));
    // a face without area between both, of the first cluster
    assert!((bend_of_a_roof(right, Some([0, 1, 0])) - 40.0).abs() < 1e-4);
}

/// The shape of a slice of a surface of revolution as one cluster: `profile` has the distance from the axis and the
/// height at places from 0 to 1; with noise in percent of the diagonal.
fn slice(turn: f64, noise: f64, kinds: &[Kind], profile: impl Fn(f64) -> [f64; 2]) -> ClusterShape {
    let (around, along) = ((turn / 10.0) as u32 + 6, 8u32);
    let mut states = random(1);
    let mut next = || (states() >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
    let mut positions = Vec::new();
    for (row, column) in (0..=along).flat_map(|row| (0..=around).map(move |column| (row, column))) {
        let [from_axis, height] = profile(f64::from(row) / f64::from(along));
        let (sine, cosine) = libm::sincos((turn * f64::from(column) / f64::from(around)).to_radians());
        // uniform, with the deviation of the noise; most slices are some 3 wide
        let off = [0; 3].map(|_| next() * 3f64.sqrt() * noise / 100.0 * 3.0);
        let [x, y, z] = [from_axis * cosine + off[0], from_axis * sine + off[1], height + off[2]];
        positions.push([0.8 * x - 0.36 * y + 0.48 * z, 0.6 * x + 0.48 * y - 0.64 * z, 0.8 * y + 0.6 * z]);
    }
    let mut faces = Faces::default();
    for a in (0..along).flat_map(|row| (0..around).map(move |column| row * (around + 1) + column)) {
        let b = a + around + 1;
        faces.push(&[a, a + 1, b + 1]);
        faces.push(&[a, b + 1, b]);
    }
    let mesh = PolygonMesh::of_one_part(Format::Obj, positions, faces);
    let surface = Surface::build(&mesh).expect("a surface").with_normals((&mesh).into());
    let corners = surface.corners((&mesh).into());
    let samples = surface.samples(&corners);
    let faces = crate::shapes::faces::Faces { graph: &surface.items.graph, samples: &samples };
    let clustering = as_given(faces, kinds, 1.0, vec![0; surface.items.upload_face.len()], 1).expect("a shape");
    table(&surface, &corners, &clustering.labels, &clustering.shapes, None).remove(0)
}

/// Of a fillet: from the top of the tube out, or in.
fn tube(major: f64, from: f64) -> impl Fn(f64) -> [f64; 2] {
    move |at| {
        let (sine, cosine) = libm::sincos((from + 90.0 * at).to_radians());
        [major + 0.5 * cosine, 0.5 * sine]
    }
}

#[test]
fn slices_of_tori_are_named() {
    for noise in [0.0, 0.05] {
        for (major, from) in [(2.0, 0.0), (2.0, 90.0), (0.8, 90.0), (4.0, 0.0)] {
            for turn in [30.0, 45.0, 90.0, 180.0, 360.0] {
                let row = slice(turn, noise, &Kind::ALL, tube(major, from));
                let torus = row.torus.unwrap_or_else(|| panic!("{turn}° of {major}, {from}, {noise}: {row:?}"));
                let off = if noise > 0.0 { 0.02 } else { 1e-6 };
                let near = |a: f64, b: f64| assert!((a - b).abs() <= off * b, "{turn}° of {major}: {row:?}");
                near(torus.major_radius, major);
                near(torus.minor_radius, 0.5);
                near(DVec3::from(torus.axis).dot(DVec3::new(0.48, -0.64, 0.6)).abs(), 1.0);
                assert!(DVec3::from(torus.centre).length() <= off * major, "{row:?}");
                assert!(torus.convex && torus.residual.rms < 0.5 * row.residual.rms);
            }
        }
    }
}

#[test]
fn spheres_cylinders_and_cones_are_no_tori() {
    let sphere = |at: f64| tube(0.0, -30.0)(at).map(|x| 2.0 * x);
    for noise in [0.0, 0.05, 0.5] {
        for turn in [30.0, 90.0, 180.0, 360.0] {
            for kinds in [&Kind::ALL[..], &Kind::ALL[..3], &Kind::ALL[..2]] {
                for row in [
                    slice(turn, noise, kinds, sphere),
                    slice(turn, noise, kinds, |at| [1.0, 2.0 * at]),
                    slice(turn, noise, kinds, |at| [1.0 + at, 1.5 * at]),
                ] {
                    assert_eq!(row.torus, None, "{turn} {noise}: {row:?}");
                }
            }
        }
    }
}
