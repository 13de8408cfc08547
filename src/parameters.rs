//! The parameters of a job: defined once, for the command line, the query string and the JSON part.

mod check;
mod features;
mod levels;
mod neighbours;
mod seeds;
mod shapes;
mod snapshots;
mod subdivide;

use clap::builder::{OsStringValueParser, TypedValueParser};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use self::features::Features;
use self::heading::{CLUSTERS, COMPARISON, HIERARCHIES, OUTPUTS, REMESH};
pub use self::levels::Levels;
pub use self::neighbours::Neighbours;
pub use self::seeds::Seeds;
pub use self::shapes::{Length, Shapes};
pub use self::snapshots::Snapshots;
pub use self::subdivide::Subdivide;
use crate::cluster::merging::Pairs;
use crate::cluster::quality::Quality;
use crate::device::dual_edge::Ties;
use crate::energy;
pub use crate::error::names::{self, Name};
use crate::error::{Error, Result};

/// Headings of the help, under which flags are grouped.
pub mod heading {
    /// What is read.
    pub const INPUT: &str = "Input";
    /// What clusters are like.
    pub const CLUSTERS: &str = "Clusters";
    /// What is written.
    pub const OUTPUTS: &str = "Outputs";
    /// What hierarchies are like.
    pub const HIERARCHIES: &str = "Hierarchies";
    /// What a remesh is like.
    pub const REMESH: &str = "Remesh";
    /// What is not accepted.
    pub const LIMITS: &str = "Limits";
    /// What the paper does otherwise.
    pub const COMPARISON: &str = "Comparison with the paper";
}

/// The parameters of a job. Flags, query parameters and JSON members have the same names and meanings.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Parameters {
    /// How to cluster: bb makes flat clusters, pml a hierarchy
    ///
    /// bb is boundary-based clustering (Parallel Mesh Clustering, section 3). pml (parallel multilevel), ml
    /// (multilevel) and hr (hierarchical, one merge a step and no optimisation) make hierarchies. acvd (Valette &
    /// Chassery 2004) and vc (variational clustering, Cohen-Steiner et al. 2004) make flat clusters one face after the
    /// other on the cpu, to compare with.
    #[arg(long, value_enum, default_value_t, help_heading = CLUSTERS)]
    pub algorithm: Algorithm,

    /// Meshes: what to minimise
    ///
    /// cvd: area × squared distance to the mean place of the cluster, for compact clusters. l21: area × squared
    /// distance of the unit normal to the mean normal, for clusters that are as flat as can be. planes: area × squared
    /// distance to a plane. shapes: the same with spheres, cylinders or cones, too.
    #[arg(long, value_enum, default_value_t, help_heading = CLUSTERS)]
    pub energy: energy::Kind,

    /// Energy shapes: types of shapes, of plane,sphere,cylinder,cone; all but cone when left out; planes always
    #[arg(long, value_name = "TYPES", help_heading = CLUSTERS, hide_short_help = true)]
    pub shapes: Option<Shapes>,

    /// Energy shapes: distances below it are noise, which no curved shape stands for; as a share of the diagonal
    /// of the mesh, 0.0003 or a tenth of the tolerance when left out, or with a u behind it as a length, 0.5u
    #[arg(long, value_name = "R", allow_negative_numbers = true, help_heading = CLUSTERS, hide_short_help = true)]
    pub resolution: Option<Length>,

    /// Energies planes and shapes, in place of a number: few clusters, such that no corner of a face is further than
    /// this from the shape of its cluster; as a share of the diagonal of the mesh, 0.001, or with a u behind it as a
    /// length, 0.5u
    #[arg(long, value_name = "T", allow_negative_numbers = true, help_heading = CLUSTERS, hide_short_help = true)]
    pub tolerance: Option<Length>,

    /// Number of clusters; may be left out when seeds are listed, except of images, with a tolerance, and for
    /// hierarchies, which then go to the top
    // the command line has a list of them
    #[arg(skip)]
    #[schema(minimum = 1)]
    pub clusters: Option<u64>,

    /// How much time to take for how low an energy, for bb and pml
    ///
    /// With fast, bb stops after 3 iterations on the faces (4 for points and normals) and does not refine, then swaps
    /// clusters as long as that pays. The default also tries another start where swaps pay, and merges and splits that
    /// pay later. best also optimises its start further, and goes on as long as the energy falls.
    #[arg(long, value_enum, default_value_t, help_heading = CLUSTERS)]
    pub quality: Quality,

    /// Where flat clusters start: coarse (begins with 33 percent more clusters on a coarser mesh, 20 with quality fast
    /// and 50 with best, and merges the cheapest pairs), merged (merges single faces, or by l21 groups of them), morton
    /// (stratified by area along a Morton curve), random (as in the paper) or file:PATH with a list of face numbers;
    /// acvd and vc take morton for coarse, energies other than cvd merged
    #[arg(
        long,
        default_value_t,
        value_name = "coarse|merged|morton|random|file:PATH",
        help_heading = CLUSTERS,
        hide_short_help = true,
        value_parser = OsStringValueParser::new().try_map(Seeds::from_argument)
    )]
    #[schema(value_type = String, example = "coarse")]
    pub seeds: Seeds,

    /// Number that the random choices of seeds are drawn from
    #[arg(long, default_value_t = 0, value_name = "N", allow_negative_numbers = true, help_heading = CLUSTERS,
          hide_short_help = true)]
    pub seed: u64,

    /// Stop a flat clustering after this many iterations, converged or not, and without moves of whole clusters; when
    /// left out, unlimited, and 3 with quality fast, 4 for points and normals, which moves whole clusters all the same
    #[arg(long, value_name = "N", allow_negative_numbers = true, help_heading = COMPARISON, hide_short_help = true)]
    pub max_iterations: Option<u32>,

    /// Refine what boundary-based optimisation ends with by exact gains (lower energy), or leave it as it is; acvd and
    /// vc have nothing to refine, and flat clusterings with quality fast do not
    #[arg(long, value_enum, default_value_t, help_heading = COMPARISON, hide_short_help = true)]
    pub refine: Refine,

    /// Accept clusters in several pieces, as the optimisation left them
    #[arg(long, help_heading = CLUSTERS, hide_short_help = true)]
    pub allow_disconnected: bool,

    /// Join separate parts where they are nearest, as if they shared an edge: one tree over all of them, or fewer
    /// clusters than parts
    #[arg(long, help_heading = CLUSTERS, hide_short_help = true)]
    pub bridge_components: bool,

    /// Do not let clusters cross edges at which the surface bends by more than so many degrees (40 is safe), or, with
    /// groups, at which OBJ groups or materials or glTF primitives meet; 30,groups is both. Clusters are shared among
    /// the regions that such edges enclose
    #[arg(long, value_name = "ANGLE,groups", allow_negative_numbers = true, help_heading = CLUSTERS,
          hide_short_help = true)]
    pub features: Option<Features>,

    /// Keep the labels at iterations of a flat clustering: N for every N-th, or a list, 0,6,46 (a single one with a
    /// comma behind it); 0 is the initial growth
    #[arg(long, value_name = "N|LIST", help_heading = OUTPUTS, hide_short_help = true)]
    pub snapshots: Option<Snapshots>,

    /// Divide every triangle into four so many times before it is clustered, or (auto) until there are 30 faces a
    /// cluster: for the remesh of a coarse mesh by a flat clustering. There are no labels of faces then
    #[arg(long, value_name = "N|auto", help_heading = REMESH, hide_short_help = true)]
    pub subdivide: Option<Subdivide>,

    /// Let clusters be smaller where the surface bends: areas are multiplied by curvature (over its root mean square,
    /// kept within a factor of 100 of it) to this power; from 0, which is nothing, to 10
    #[arg(long, value_name = "G", allow_negative_numbers = true, help_heading = CLUSTERS, hide_short_help = true)]
    #[schema(minimum = 0, maximum = 10)]
    pub curvature_exponent: Option<f64>,

    /// glTF: multiply areas by this attribute of the vertices, a number above 0 each; its name begins with an
    /// underscore
    #[arg(long, value_name = "NAME", help_heading = CLUSTERS, hide_short_help = true)]
    pub weight_attribute: Option<String>,

    /// Points: what makes them neighbours; when left out, the edges that come with the points, else knn:8
    ///
    /// knn:Q: one is among the Q nearest of the other. grid: places in a grid of 2 or 3 dimensions, before that of the
    /// columns; grid:full with corners. FILE.npz: the edges of a sparse matrix, as scipy.sparse.save_npz writes it.
    #[arg(long, value_name = "knn:Q|grid|grid:full|FILE.npz", help_heading = CLUSTERS)]
    #[schema(value_type = Option<String>, example = "knn:8")]
    pub graph: Option<Neighbours>,

    /// Images: how much the place of a pixel counts beside its colour, as in SLIC: usually 10
    #[arg(long, value_name = "M", allow_negative_numbers = true, help_heading = CLUSTERS)]
    #[schema(minimum = 0.001, maximum = 1000000)]
    pub compactness: Option<f64>,

    /// Hierarchies: optimise after the merges of a round, or not, which gives a strictly nested tree; hr never does.
    /// Rounds of pml do so once clusters have 4 faces on average, with quality best from the first on; levels and the
    /// end always
    #[arg(long, value_enum, default_value_t, help_heading = HIERARCHIES, hide_short_help = true)]
    pub optimize: Optimize,

    /// Hierarchies: at most this many iterations in a round that is optimised, except at levels and at the end; when
    /// left out, 2 in parallel rounds (1 with quality fast, 16 with best) and as many as it takes in those of ml
    #[arg(long, value_name = "N", help_heading = HIERARCHIES, hide_short_help = true)]
    #[schema(minimum = 1)]
    pub optimize_iterations: Option<u32>,

    /// pml: go on as ml, one merge a step, once this many clusters or fewer are left
    #[arg(long, value_name = "N", help_heading = HIERARCHIES, hide_short_help = true)]
    #[schema(minimum = 1)]
    pub switch_to_ml_at: Option<u64>,

    /// ml, hr and pml after its switch: merge this percentage of the clusters a step, the cheapest pairs first, instead
    /// of one pair; above 0, at most 50
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true, help_heading = COMPARISON,
          hide_short_help = true)]
    #[schema(exclusive_minimum = 0, maximum = 50)]
    pub collapse_fraction: Option<f64>,

    /// Hierarchies: which of equally cheap pairs merges first
    #[arg(long, value_enum, default_value_t, help_heading = COMPARISON, hide_short_help = true)]
    pub ties: Ties,

    /// pml: which of the pairs that chose each other merge in a round; energies other than cvd take eighth for
    /// cheaper-half
    #[arg(long, value_enum, default_value_t, help_heading = COMPARISON, hide_short_help = true)]
    pub pairs: Pairs,

    /// Hierarchies: numbers of clusters to stop at on the way and to optimise at until no move is left; of an image
    /// without a number, the smallest decides the size of superpixels
    #[arg(long, value_name = "K1,K2,…", help_heading = HIERARCHIES, hide_short_help = true)]
    pub levels: Option<Levels>,
}

impl Parameters {
    /// The number of clusters of a flat clustering.
    pub fn flat_clusters(&self) -> Result<u64> {
        let missing =
            || Error::parameter(format_args!("{} is missing: say how many clusters you want", Name::CLUSTERS));
        self.clusters.ok_or_else(missing)
    }

    /// Whether the rounds of a hierarchy optimise.
    pub fn optimizes(&self) -> bool {
        self.optimize == Optimize::On && self.algorithm != Algorithm::Hr
    }

    /// Which pairs merge in parallel rounds: energies other than cvd leave few out of half of the pairs where costs
    /// jump.
    pub fn merging_pairs(&self) -> Pairs {
        match self.pairs {
            Pairs::CheaperHalf if self.energy != energy::Kind::default() => Pairs::Eighth,
            pairs => pairs,
        }
    }

    /// The number of superpixels whose size decides how much the place of a pixel counts: the smallest that is given.
    pub fn superpixels(&self) -> Option<u64> {
        self.clusters.or_else(|| self.levels().iter().min().copied())
    }

    /// The numbers of clusters to stop at on the way.
    pub fn levels(&self) -> &[u64] {
        self.levels.as_ref().map_or(&[], |levels| &levels.0)
    }
}

/// A clustering algorithm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Algorithm {
    /// Boundary-based clustering (Parallel Mesh Clustering, section 3)
    #[default]
    Bb,
    /// Parallel multilevel clustering: all pairs that choose each other merge at once, then the faces move (Parallel
    /// Mesh Clustering, section 4)
    Pml,
    /// Multilevel clustering: the cheapest pair merges, then the faces move (Parallel Mesh Clustering, section 4)
    Ml,
    /// Hierarchical clustering: the cheapest pair merges; Ward's method on neighbouring clusters
    Hr,
    /// Approximated centroidal Voronoi diagrams: sequential energy minimisation by local queries (Valette & Chassery
    /// 2004); a reference, on the cpu
    Acvd,
    /// Variational clustering: all clusters grown anew in every iteration, by a priority queue (Cohen-Steiner et al.
    /// 2004); a reference, on the cpu
    Vc,
}

impl Algorithm {
    /// As it is written in flags, queries and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Algorithm::Bb => "bb",
            Algorithm::Pml => "pml",
            Algorithm::Ml => "ml",
            Algorithm::Hr => "hr",
            Algorithm::Acvd => "acvd",
            Algorithm::Vc => "vc",
        }
    }

    /// Whether it makes a hierarchy.
    pub fn is_hierarchical(self) -> bool {
        match self {
            Algorithm::Bb | Algorithm::Acvd | Algorithm::Vc => false,
            Algorithm::Pml | Algorithm::Ml | Algorithm::Hr => true,
        }
    }

    /// Whether it is one of those that are there to compare with ([`crate::cluster::reference`]), on the cpu only.
    pub fn is_reference(self) -> bool {
        match self {
            Algorithm::Acvd | Algorithm::Vc => true,
            Algorithm::Bb | Algorithm::Pml | Algorithm::Ml | Algorithm::Hr => false,
        }
    }
}

/// Whether to optimise between the merges of a hierarchy.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Optimize {
    /// Optimise after the merges of a round
    #[default]
    On,
    /// Only merge: the tree is strictly nested
    None,
}

/// Whether to refine after boundary-based optimisation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Refine {
    /// Refine
    #[default]
    On,
    /// Boundary-based optimisation alone
    None,
}

#[cfg(test)]
mod tests;
