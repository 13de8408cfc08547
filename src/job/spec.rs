//! What a job does, typed: made once from its parameters. No later stage asks which algorithm has which options.

use super::shapes::ShapesSpec;
use super::{InputFile, Refusal, seed_list};
use crate::cluster::merging::Pairs;
use crate::cluster::quality::Quality;
use crate::cluster::{flat, hierarchy};
use crate::energy;
use crate::error::Error;
use crate::parameters::{Algorithm, Features, Name, Optimize, Parameters, Refine, Seeds, Snapshots, Subdivide};
use crate::surface::Moves;

/// What a job does.
#[derive(Debug, Clone, PartialEq)]
pub struct JobSpec {
    /// How it clusters.
    pub clustering: Clustering,
    /// Whether separate parts are joined where they are nearest.
    pub bridge_components: bool,
    /// What it minimises.
    pub energy: energy::Kind,
    /// Edges that clusters do not cross.
    pub features: Option<Features>,
    /// Power of the curvature that areas are multiplied by.
    pub curvature_exponent: Option<f64>,
    /// Attribute of the vertices that areas are multiplied by.
    pub weight_attribute: Option<String>,
    /// How often triangles are divided; [`divided`](Self::divided) fills in what the mesh decides.
    pub subdivide: Option<Subdivide>,
    /// Iterations whose labels are kept.
    pub snapshots: Option<Snapshots>,
    /// The parameters for the report: with the number of listed seeds, and without what the algorithm leaves out.
    reported: Parameters,
}

/// How a job clusters.
#[derive(Debug, Clone, PartialEq)]
pub enum Clustering {
    /// Boundary-based clustering from many clusters that merge: coarse to fine, or from single faces.
    Coarse(CoarseSpec),
    /// A flat clustering that starts from one face a cluster.
    Seeded {
        /// How clusters are made of the seeds.
        method: Method,
        /// How the seeds are chosen: not [`Seeds::Coarse`].
        seeds: Seeds,
        /// The faces, where they are listed.
        listed: Option<Vec<u32>>,
        /// The rest, of which only the start is another one.
        spec: CoarseSpec,
    },
    /// A hierarchy.
    Hierarchy(hierarchy::Options),
    /// A clustering by shapes, flat or a hierarchy, from single faces that merge.
    Shapes(ShapesSpec),
}

/// What a boundary-based clustering does from many clusters that merge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CoarseSpec {
    /// Number of clusters.
    pub clusters: u64,
    /// What the random choices are drawn from.
    pub seed: u64,
    /// How much time to take.
    pub quality: Quality,
    /// Iterations to stop after, if the caller limits them.
    pub max_iterations: Option<u32>,
    /// Whether refinement and relocation are allowed.
    pub refine: bool,
    /// Leave clusters in the pieces that the optimisation left.
    pub allow_disconnected: bool,
    /// Start from clusters that were merged from single faces, by normals from groups of them, in place of the coarse
    /// start.
    pub is_merged: bool,
    /// What is minimised.
    pub energy: energy::Kind,
}

impl CoarseSpec {
    /// The phases of items that move so.
    pub fn options(&self, moves: Moves) -> flat::Options {
        flat::Options {
            max_iterations: self.max_iterations.or(self.quality.max_iterations(moves)),
            refine: self.refine && self.quality.refines(),
            allow_disconnected: self.allow_disconnected,
        }
    }

    /// The quality whose moves of whole clusters follow the phases, if any: clusters in pieces cannot be moved as a
    /// whole.
    pub fn relocation(&self, faces: usize) -> Option<Quality> {
        (self.refine && !self.allow_disconnected).then(|| relocation(self.quality, self.energy, faces))
    }

    /// Whether a merged start is of groups of faces, not of single ones.
    pub fn merges_groups(&self, faces: usize) -> bool {
        self.energy.is_of_normals() && faces > FEW_FACES_OF_NORMALS && self.quality != Quality::Best
    }

    /// Which pairs merge in a round.
    pub fn pairs(&self) -> Pairs {
        self.of(Algorithm::Pml).merging_pairs()
    }

    /// A parallel hierarchy that ends with as many clusters.
    pub fn as_hierarchy(&self) -> hierarchy::Options {
        hierarchical(&self.of(Algorithm::Pml), 0)
    }

    /// One of the cheapest merges, one after the other.
    pub fn as_sequential_hierarchy(&self) -> hierarchy::Options {
        hierarchical(&self.of(Algorithm::Hr), u64::MAX)
    }

    fn of(&self, algorithm: Algorithm) -> Parameters {
        Parameters { algorithm, clusters: Some(self.clusters), energy: self.energy, ..Parameters::default() }
    }
}

/// How a flat clustering goes on from seeds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Boundary-based clustering ([`flat`]).
    BoundaryBased,
    /// Valette & Chassery 2004 ([`crate::cluster::reference::acvd`]); on the cpu only.
    Acvd,
    /// Cohen-Steiner et al. 2004 ([`crate::cluster::reference::variational`]); on the cpu only.
    Variational,
}

impl JobSpec {
    /// Checks the parameters and a list of seeds.
    pub(super) fn new(parameters: &Parameters, seeds: Option<&[u8]>) -> Result<Self, Refusal> {
        parameters.check(seeds.is_some())?;
        let listed = seeds.map(seed_list::parse).transpose().map_err(Refusal::of(InputFile::Seeds))?;
        let mut settled = parameters.clone();
        if let Some(listed) = &listed {
            let count = listed.len() as u64;
            if let Some(clusters) = parameters.clusters.filter(|&clusters| clusters != count) {
                let error = Error::parameter(format_args!(
                    "{name} and the number of listed seeds differ (leave {name} out): {clusters} and {count}",
                    name = Name::CLUSTERS
                ));
                return Err(Refusal::of(InputFile::Seeds)(error));
            }
            settled.clusters = Some(count);
            settled.seeds = Seeds::Listed;
        }
        if settled.algorithm == Algorithm::Hr {
            settled.optimize = Optimize::None;
        }
        if settled.algorithm == Algorithm::Pml {
            settled.pairs = settled.merging_pairs();
        }
        let starts_coarse = settled.seeds == Seeds::Coarse;
        if settled.algorithm.is_reference() {
            settled.refine = Refine::None;
            if starts_coarse {
                settled.seeds = Seeds::Morton;
            }
        } else if starts_coarse && !settled.algorithm.is_hierarchical() && settled.energy != energy::Kind::default() {
            settled.seeds = Seeds::Merged;
        }
        if settled.energy.is_of_shapes() {
            settled.refine = Refine::None;
        }
        Ok(Self {
            clustering: Clustering::new(&mut settled, listed)?,
            bridge_components: settled.bridge_components,
            energy: settled.energy,
            features: settled.features,
            curvature_exponent: settled.curvature_exponent,
            weight_attribute: settled.weight_attribute.clone(),
            subdivide: settled.subdivide,
            snapshots: settled.snapshots.clone(),
            reported: settled,
        })
    }

    /// The parameters that the report repeats.
    pub fn reported(&self) -> &Parameters {
        &self.reported
    }

    /// How items move whose neighbours may be far from each other as the energy sees them.
    pub(super) fn moves(&self) -> Moves {
        // connected moves by normals would look at all items after every merge
        let has_short_rounds =
            matches!(&self.clustering, Clustering::Hierarchy(options) if options.optimise && options.sequential_at > 0);
        let is_free = self.reported.allow_disconnected || has_short_rounds && self.energy.is_of_normals();
        if is_free { Moves::Free } else { Moves::Connected }
    }

    /// The triangles were divided so often.
    pub(super) fn divided(&mut self, times: u32) {
        self.subdivide = Some(Subdivide::Times(times));
        self.reported.subdivide = self.subdivide;
    }

    /// The same for another number of clusters.
    pub(super) fn with_clusters(&self, clusters: u64) -> Result<Self, Refusal> {
        Self::new(&Parameters { clusters: Some(clusters), ..self.reported.clone() }, None)
    }
}

impl Clustering {
    /// Whether it makes a hierarchy.
    pub fn is_hierarchical(&self) -> bool {
        matches!(self, Self::Hierarchy(_)) || self.tree_of_shapes().is_some()
    }

    /// What to build, of a hierarchy by shapes.
    pub(super) fn tree_of_shapes(&self) -> Option<&hierarchy::Options> {
        match self {
            Self::Shapes(spec) => spec.tree(),
            Self::Coarse(_) | Self::Seeded { .. } | Self::Hierarchy(_) => None,
        }
    }

    /// Whether it begins with a cluster a face, which takes memory.
    pub fn merges_faces(&self) -> bool {
        match self {
            Self::Hierarchy(_) | Self::Shapes(_) => true,
            Self::Coarse(coarse) => coarse.is_merged,
            Self::Seeded { .. } => false,
        }
    }

    /// Whether it starts from faces that the caller listed.
    pub fn has_listed_seeds(&self) -> bool {
        matches!(self, Self::Seeded { listed: Some(_), .. })
    }

    /// Whether it has labels of its own. A whole hierarchy has some at every number of clusters instead.
    pub fn has_labels(&self) -> bool {
        self.clusters().is_some() || !self.is_hierarchical()
    }

    /// Whether each step waits for the one before, so that a gpu is slow at it or cannot do it.
    pub fn is_sequential(&self) -> bool {
        match self {
            Self::Coarse(_) => false,
            Self::Seeded { method, .. } => *method != Method::BoundaryBased,
            Self::Hierarchy(options) => options.sequential_at == u64::MAX,
            Self::Shapes(spec) => spec.tree().is_some_and(|options| options.sequential_at == u64::MAX),
        }
    }

    /// The items that the caller listed as seeds.
    pub(super) fn listed_seeds(&mut self) -> Option<&mut [u32]> {
        match self {
            Self::Seeded { listed, .. } => listed.as_deref_mut(),
            Self::Coarse(_) | Self::Hierarchy(_) | Self::Shapes(_) => None,
        }
    }

    /// The number of clusters that it ends with; none for a whole hierarchy, and where a tolerance decides it.
    pub fn clusters(&self) -> Option<u64> {
        match self {
            Self::Coarse(coarse) => Some(coarse.clusters),
            Self::Seeded { spec, .. } => Some(spec.clusters),
            Self::Hierarchy(options) => options.clusters,
            Self::Shapes(spec) => spec.clusters(),
        }
    }

    fn new(parameters: &mut Parameters, listed: Option<Vec<u32>>) -> Result<Self, Error> {
        let (method, sequential_at) = match parameters.algorithm {
            Algorithm::Bb => (Method::BoundaryBased, None),
            Algorithm::Acvd => (Method::Acvd, None),
            Algorithm::Vc => (Method::Variational, None),
            Algorithm::Pml => (Method::BoundaryBased, Some(parameters.switch_to_ml_at.unwrap_or(0))),
            Algorithm::Ml | Algorithm::Hr => (Method::BoundaryBased, Some(u64::MAX)),
        };
        let tree = sequential_at.map(|sequential_at| hierarchical(parameters, sequential_at));
        if parameters.energy.is_of_shapes() {
            return ShapesSpec::new(parameters, tree).map(Self::Shapes);
        }
        if let Some(options) = tree {
            return Ok(Self::Hierarchy(options));
        }
        let spec = CoarseSpec {
            clusters: parameters.flat_clusters()?,
            seed: parameters.seed,
            quality: parameters.quality,
            max_iterations: parameters.max_iterations,
            refine: parameters.refine == Refine::On,
            allow_disconnected: parameters.allow_disconnected,
            is_merged: parameters.seeds == Seeds::Merged,
            energy: parameters.energy,
        };
        Ok(match parameters.seeds.clone() {
            Seeds::Coarse | Seeds::Merged => Self::Coarse(spec),
            seeds => Self::Seeded { method, seeds, listed, spec },
        })
    }
}

/// By normals, meshes with no more faces than this get all moves of whole clusters, and starts from single faces.
const FEW_FACES_OF_NORMALS: usize = 1 << 13;

/// The quality whose moves of whole clusters follow. By normals, starts of large meshes have made swaps, and the
/// default makes those of `fast`: others lower L2,1 by some 2 % in 5 times the time (`docs/constants.md`).
fn relocation(quality: Quality, energy: energy::Kind, faces: usize) -> Quality {
    match quality {
        Quality::Default if energy.is_of_normals() && faces > FEW_FACES_OF_NORMALS => Quality::Fast,
        quality => quality,
    }
}

/// What the parameters mean to hierarchies whose rounds are sequential from a number of clusters on.
fn hierarchical(parameters: &Parameters, sequential_at: u64) -> hierarchy::Options {
    let refine = parameters.refine == Refine::On;
    hierarchy::Options {
        sequential_at,
        collapse_fraction: parameters.collapse_fraction,
        optimise: parameters.optimizes(),
        refine,
        iterations_a_round: [parameters.quality.iterations_a_round(), u32::MAX]
            .map(|usual| parameters.optimize_iterations.unwrap_or(usual)),
        optimised_from: parameters.quality.optimised_from(),
        ties: parameters.ties,
        pairs: parameters.merging_pairs(),
        clusters: parameters.clusters,
        levels: parameters.levels().to_vec(),
        allow_disconnected: parameters.allow_disconnected,
        // by normals, levels get swaps alone, whatever the size of the mesh
        relocation: (refine && !parameters.allow_disconnected)
            .then(|| relocation(parameters.quality, parameters.energy, usize::MAX)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(parameters: Parameters, seeds: Option<&[u8]>) -> (Clustering, Parameters) {
        let spec = JobSpec::new(&parameters, seeds).expect("a job");
        (spec.clustering, spec.reported)
    }

    #[test]
    fn every_algorithm_becomes_its_kind_of_job() {
        for (algorithm, method) in [
            (Algorithm::Bb, Some(Method::BoundaryBased)),
            (Algorithm::Acvd, Some(Method::Acvd)),
            (Algorithm::Vc, Some(Method::Variational)),
            (Algorithm::Pml, None),
            (Algorithm::Ml, None),
            (Algorithm::Hr, None),
        ] {
            let seeds = if method.is_some() { Seeds::Random } else { Seeds::Coarse };
            let parameters = Parameters { algorithm, clusters: Some(9), seeds, ..Parameters::default() };
            let (made, settled) = spec(parameters.clone(), None);
            match made {
                Clustering::Seeded { method: made, listed: None, spec: CoarseSpec { clusters: 9, .. }, .. } => {
                    assert_eq!(Some(made), method)
                }
                Clustering::Hierarchy(options) => {
                    assert_eq!((method, options.clusters), (None, Some(9)));
                    assert_eq!(options.sequential_at > 0, algorithm != Algorithm::Pml);
                    assert_eq!(options.optimise, algorithm != Algorithm::Hr);
                    assert_eq!(settled.optimize == Optimize::None, algorithm == Algorithm::Hr);
                }
                other => panic!("{algorithm:?}: {other:?}"),
            }
        }
    }

    #[test]
    fn listed_seeds_are_the_number_of_clusters_and_references_do_not_start_coarse() {
        let (made, settled) = spec(Parameters::default(), Some(b"[7, 3]"));
        assert_eq!((settled.clusters, settled.seeds), (Some(2), Seeds::Listed));
        let Clustering::Seeded { seeds: Seeds::Listed, listed, spec: two, .. } = made else { panic!("{made:?}") };
        assert_eq!((listed, two.clusters), (Some(vec![7, 3]), 2));
        let of = |algorithm| Parameters { algorithm, clusters: Some(2), ..Parameters::default() };
        assert!(matches!(spec(of(Algorithm::Bb), None).0, Clustering::Coarse(CoarseSpec { clusters: 2, .. })));
        let (made, settled) = spec(of(Algorithm::Vc), None);
        assert!(matches!(made, Clustering::Seeded { seeds: Seeds::Morton, .. }), "{made:?}");
        assert_eq!((settled.seeds, settled.refine), (Seeds::Morton, Refine::None));
        let refusal = JobSpec::new(&of(Algorithm::Bb), Some(b"[1, 2, 3]")).expect_err("another number");
        assert_eq!(refusal.file, Some(InputFile::Seeds));
    }

    #[test]
    fn qualities_differ_in_which_rounds_they_optimise_and_for_how_long() {
        let of = |quality: Quality| {
            let parameters = Parameters { algorithm: Algorithm::Pml, quality, ..Parameters::default() };
            let Clustering::Hierarchy(options) = spec(parameters, None).0 else { panic!("a hierarchy") };
            (options.optimised_from, options.iterations_a_round)
        };
        assert_eq!(of(Quality::Fast), (4, [1, u32::MAX]));
        assert_eq!(of(Quality::Default), (4, [2, u32::MAX]));
        assert_eq!(of(Quality::Best), (1, [16, u32::MAX]));
    }
}
