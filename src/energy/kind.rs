//! Which energies there are.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// An energy that a job can minimise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
#[schema(as = EnergyKind)]
pub enum Kind {
    /// By position: area × squared distance to the mean of the cluster; compact clusters (centroidal Voronoi diagram)
    #[default]
    Cvd,
    /// By normal: area × squared distance of the unit normal to the mean of the cluster; flat clusters (Cohen-Steiner
    /// et al. 2004)
    L21,
    /// By plane: area × squared distance to the plane of the cluster; planar clusters (Cohen-Steiner et al. 2004)
    Planes,
    /// By shape: the same with planes, spheres, cylinders or cones (Wu & Kobbelt 2005)
    Shapes,
}

impl Kind {
    /// As it is written in flags, queries, JSON and reports.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Cvd => "cvd",
            Kind::L21 => "l21",
            Kind::Planes => "planes",
            Kind::Shapes => "shapes",
        }
    }

    /// Whether it sees the normals of faces.
    pub fn is_of_normals(self) -> bool {
        self == Kind::L21
    }

    /// Whether it compares faces with shapes in place of points.
    pub fn is_of_shapes(self) -> bool {
        matches!(self, Kind::Planes | Kind::Shapes)
    }
}
