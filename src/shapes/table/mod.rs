//! The shapes of a clustering, for reports: in units of the file, fitted to the corners of the final clusters.
//!
//! Nothing here touches labels. Shapes that decide labels have the error of chords in them, since they are compared
//! with the middles of edges; corners of a part without noise lie on its shapes.

mod borders;
mod extent;
mod torus;

use glam::DVec3;
use serde::Serialize;
use utoipa::ToSchema;

use super::faces::members;
use super::geometric;
use super::kind::Kind;
use super::moments::SHIFT;
use super::shape::Shape;
use super::tolerance::Tolerance;
use crate::parallel;
use crate::surface::Surface;
use crate::surface::corners::Corners;

pub use self::borders::Neighbour;
use self::torus::Ring;
pub use self::torus::Torus;

/// The shape of a cluster. Lengths in units of the file, angles in degrees.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ClusterShape {
    /// The label.
    pub label: u32,
    /// The type of the shape.
    #[serde(rename = "type")]
    #[schema(rename = "type")]
    pub kind: Kind,
    /// Number of faces.
    pub faces: u64,
    /// Their area.
    pub area: f64,
    /// Distances of the corners of faces from the shape.
    pub residual: Deviation,
    /// Angles between the normals of faces and that of the shape beside them.
    pub normal_deviation: Deviation,
    /// Of a plane.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane: Option<Plane>,
    /// Of a sphere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sphere: Option<Sphere>,
    /// Of a cylinder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cylinder: Option<Cylinder>,
    /// Of a cone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cone: Option<Cone>,
    /// The torus of which the cluster is a slice, where it is much nearer to the corners than the curved shape.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torus: Option<Torus>,
    /// The clusters beside it, by label.
    pub neighbours: Vec<Neighbour>,
}

/// How far faces are from a shape.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, ToSchema)]
pub struct Deviation {
    /// The root of the mean square by area.
    pub rms: f64,
    /// The largest.
    pub max: f64,
}

/// A plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Plane {
    /// A point of it, near the mean of the corners.
    pub point: [f64; 3],
    /// Its unit normal, along the mean normal of the faces.
    pub normal: [f64; 3],
}

/// A sphere.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Sphere {
    /// Its centre.
    pub centre: [f64; 3],
    /// Its radius.
    pub radius: f64,
    /// Whether normals of faces point away from the centre, as on a ball; false of a bowl.
    pub convex: bool,
}

/// A cylinder.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Cylinder {
    /// A point of its axis.
    pub point: [f64; 3],
    /// Along the axis, a unit vector.
    pub axis: [f64; 3],
    /// Its radius.
    pub radius: f64,
    /// Whether normals of faces point away from the axis, as on a rod; false of a hole.
    pub convex: bool,
    /// Where it begins and ends along the axis, from `point` on.
    pub extent: [f64; 2],
    /// How much of the circle it covers, in degrees: 360 all around.
    pub angle: f64,
}

/// A cone, on one side of its apex.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Cone {
    /// Its apex.
    pub apex: [f64; 3],
    /// From the apex into the cone, a unit vector.
    pub axis: [f64; 3],
    /// Half the opening angle, between the axis and the surface, in degrees.
    pub half_angle: f64,
    /// Whether normals of faces point away from the axis, as on a tip; false of a countersink.
    pub convex: bool,
    /// Where it begins and ends along the axis, from the apex on.
    pub extent: [f64; 2],
    /// How much of the circle it covers, in degrees: 360 all around.
    pub angle: f64,
}

/// The shapes of clusters. `labels` are those of the faces in internal order, `shapes` those that decided them, in
/// units of moments. A shape that decided is reported as it is where the faces are within the tolerance of it, and not
/// of the one that is fitted to their corners.
pub fn table(
    surface: &Surface,
    corners: &Corners,
    labels: &[u32],
    shapes: &[Shape],
    tolerance: Option<Tolerance<'_>>,
) -> Vec<ClusterShape> {
    let members = members(labels, shapes.len(), |_| true);
    let unit = f64::from(1u32 << SHIFT);
    let mut rows = parallel::map(members.len(), 1, |label| {
        let (members, shape) = (&members[label], &shapes[label]);
        let cluster = Cluster { surface, corners, members };
        let decided = shape.scaled(unit);
        let places: Vec<(DVec3, f64)> = cluster.weighted_corners().collect();
        let fitted = geometric::fit(&places, &decided);
        let of_corners = fitted.scaled(1.0 / unit);
        let admits = |tolerance: Tolerance<'_>, shape: &Shape| tolerance.admits(shape, members.iter().copied());
        let keeps = tolerance.is_some_and(|tolerance| !admits(tolerance, &of_corners) && admits(tolerance, shape));
        let shape = if keeps { &decided } else { &fitted };
        ClusterShape { torus: cluster.torus(&places, shape), ..cluster.row(label as u32, shape) }
    });
    borders::add(surface, corners, labels, &mut rows);
    if !surface.items.loose.is_empty() {
        let internal = surface.items.internal_faces();
        for loose in &surface.items.loose {
            rows[labels[internal[loose.host as usize] as usize] as usize].faces += 1;
        }
    }
    rows
}

/// The faces of a cluster.
#[derive(Clone, Copy)]
struct Cluster<'a> {
    surface: &'a Surface,
    corners: &'a Corners,
    members: &'a [u32],
}

impl Cluster<'_> {
    /// The places of all corners, each with its part of the weight of its face.
    fn weighted_corners(&self) -> impl Iterator<Item = (DVec3, f64)> + '_ {
        self.members.iter().flat_map(move |&face| {
            let positions = self.corners.positions_of(face);
            let weight = f64::from(self.surface.items.weights[face as usize]) / self.corners.of(face).len() as f64;
            positions.map(move |position| (position, weight))
        })
    }

    fn row(&self, label: u32, shape: &Shape) -> ClusterShape {
        let frame = self.surface.frame();
        let scale = libm::ldexp(1.0, -frame.exponent);
        let place = |at: DVec3| frame.source_position(at).to_array();
        let length = |length: f64| length * scale;
        let (mut residual, mut turn, mut outwards, mut area) = (Sum::default(), Sum::default(), 0.0, 0.0);
        for &face in self.members {
            let (of_face, normal, place) = self.surface.area_normal_and_place(face);
            area += of_face;
            outwards += normal.dot(shape.tangent(place).normal);
        }
        let side = if outwards < 0.0 { -1.0 } else { 1.0 };
        for &face in self.members {
            let (of_face, normal, place) = self.surface.area_normal_and_place(face);
            if of_face > 0.0 {
                let beside = side * shape.tangent(place).normal;
                turn.add(libm::atan2(normal.cross(beside).length(), normal.dot(beside)).to_degrees(), of_face);
            }
            let corners = self.corners.of(face).len() as f64;
            self.corners.positions_of(face).for_each(|at| residual.add(shape.distance(at).abs(), of_face / corners));
        }
        let convex = side > 0.0;
        let (mut plane, mut sphere, mut cylinder, mut cone) = (None, None, None, None);
        match *shape {
            Shape::Plane { point, normal } => {
                plane = Some(Plane { point: place(point), normal: (side * normal).to_array() });
            }
            Shape::Sphere { centre, radius } => {
                sphere = Some(Sphere { centre: place(centre), radius: length(radius), convex });
            }
            Shape::Cylinder { point, axis, radius } => {
                let axis = up(axis);
                let extent = extent::along(*self, point, axis).map(length);
                let angle = extent::around(*self, point, axis);
                let (point, axis, radius) = (place(point), axis.to_array(), length(radius));
                cylinder = Some(Cylinder { point, axis, radius, convex, extent, angle });
            }
            Shape::Cone { apex, axis, slope } => {
                let extent = extent::along(*self, apex, axis).map(length);
                let angle = extent::around(*self, apex, axis);
                let half_angle = libm::atan(slope).to_degrees();
                cone = Some(Cone { apex: place(apex), axis: axis.to_array(), half_angle, convex, extent, angle });
            }
        }
        ClusterShape {
            label,
            kind: shape.kind(),
            faces: self.members.len() as u64,
            area: length(length(area)),
            residual: residual.deviation().scaled(scale),
            normal_deviation: turn.deviation(),
            plane,
            sphere,
            cylinder,
            cone,
            torus: None,
            neighbours: Vec::new(),
        }
    }

    /// The torus that is much nearer to the corners than a shape is.
    fn torus(&self, places: &[(DVec3, f64)], shape: &Shape) -> Option<Torus> {
        if self.members.len() < torus::FEWEST_FACES {
            return None;
        }
        let normal = |&face: &u32| {
            let (area, normal, place) = self.surface.area_normal_and_place(face);
            (area > 0.0).then_some((place, normal / area, area))
        };
        let normals: Vec<(DVec3, DVec3, f64)> = self.members.iter().filter_map(normal).collect();
        let ring = Ring::of(places, &normals, shape)?;
        let outwards: f64 = normals.iter().map(|&(place, normal, area)| area * normal.dot(ring.normal(place))).sum();
        let mut residual = Sum::default();
        places.iter().for_each(|&(at, weight)| residual.add(ring.distance(at).abs(), weight));
        let frame = self.surface.frame();
        let scale = libm::ldexp(1.0, -frame.exponent);
        Some(Torus {
            centre: frame.source_position(ring.centre).to_array(),
            axis: up(ring.axis).to_array(),
            major_radius: ring.major * scale,
            minor_radius: ring.minor * scale,
            convex: outwards > 0.0,
            residual: residual.deviation().scaled(scale),
        })
    }
}

/// Of the two directions of an axis, the one whose largest coordinate is above 0.
fn up(axis: DVec3) -> DVec3 {
    if axis.max_element() > -axis.min_element() { axis } else { -axis }
}

/// A sum of squares.
#[derive(Default)]
struct Sum {
    squares: f64,
    weight: f64,
    most: f64,
}

impl Sum {
    fn add(&mut self, value: f64, weight: f64) {
        self.squares += weight * value * value;
        self.weight += weight;
        self.most = self.most.max(value);
    }

    fn deviation(&self) -> Deviation {
        let mean = if self.weight > 0.0 { self.squares / self.weight } else { 0.0 };
        Deviation { rms: mean.sqrt(), max: self.most }
    }
}

impl Deviation {
    fn scaled(self, by: f64) -> Self {
        Self { rms: self.rms * by, max: self.max * by }
    }
}

#[cfg(test)]
mod tests;
