//! The table of types of shapes.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A type of shape that stands for a cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[schema(as = ShapeType)]
pub enum Kind {
    /// A plane.
    Plane,
    /// A sphere.
    Sphere,
    /// A circular cylinder.
    Cylinder,
    /// One half of a circular cone.
    Cone,
}

impl Kind {
    /// All of them, in the order in which fits are tried.
    pub const ALL: [Kind; 4] = [Kind::Plane, Kind::Sphere, Kind::Cylinder, Kind::Cone];

    /// Those that clusters may have by default.
    pub const USUAL: [Kind; 3] = [Kind::Plane, Kind::Sphere, Kind::Cylinder];

    /// As it is written in flags, queries and reports.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Plane => "plane",
            Kind::Sphere => "sphere",
            Kind::Cylinder => "cylinder",
            Kind::Cone => "cone",
        }
    }

    /// How many prices it costs: how many numbers it has beyond those of a plane. Types are in this order.
    pub fn prices(self) -> u32 {
        self as u32
    }
}
