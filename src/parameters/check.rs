//! Which parameters contradict each other, or what they are about.

use super::{Algorithm, Name, Optimize, Parameters, Seeds, Subdivide};
use crate::cluster::merging::Pairs;
use crate::cluster::quality::Quality;
use crate::data::image;
use crate::device::dual_edge::Ties;
use crate::energy;
use crate::error::{Error, Result};

impl Parameters {
    /// Checks what can be checked without the mesh. `listed` says whether seeds come as a list.
    pub fn check(&self, listed: bool) -> Result<()> {
        self.check_values()?;
        self.check_shapes(listed)?;
        if self.seeds == Seeds::Listed && !listed {
            return Err(Error::parameter("seeds are said to be listed, but no list came with the request"));
        }
        if self.seeds == Seeds::Merged && self.algorithm.is_reference() {
            return Err(Error::parameter(format_args!(
                "{} goes with bb, not with the algorithm {}, which grows clusters from single faces",
                Name::SEEDS.with("merged"),
                self.algorithm.name()
            )));
        }
        let (goes_with, contradictions) = if self.algorithm.is_hierarchical() {
            let are_all = !self.energy.is_of_shapes();
            let flat = if are_all { "flat clusterings (bb, acvd, vc)" } else { "flat clusterings (bb)" };
            (flat, self.flat_only(listed))
        } else {
            if !listed && self.tolerance.is_none() {
                self.flat_clusters()?;
            }
            ("hierarchies (pml, ml, hr)", self.hierarchical_only())
        };
        if let Some((name, _)) = contradictions.into_iter().find(|(_, given)| *given) {
            return Err(self.contradiction(name, goes_with));
        }
        if self.algorithm.is_hierarchical() { self.check_hierarchy() } else { self.check_subdivide(listed) }
    }

    /// Checks each value by itself: what nothing that may still come can make right.
    pub fn check_values(&self) -> Result<()> {
        let zero = |name: Name| Err(Error::parameter(format_args!("{name} must be at least 1, not 0")));
        if self.clusters == Some(0) {
            return zero(Name::CLUSTERS);
        }
        if self.optimize_iterations == Some(0) {
            return Err(Error::parameter(format_args!(
                "{} must be at least 1 ({} leaves them out), not 0",
                Name::OPTIMIZE_ITERATIONS,
                Name::OPTIMIZE.with("none")
            )));
        }
        if self.switch_to_ml_at == Some(0) {
            return zero(Name::SWITCH_TO_ML_AT);
        }
        if let Some(exponent) = self.curvature_exponent.filter(|exponent| !(0.0..=10.0).contains(exponent)) {
            return Err(Error::parameter(format_args!(
                "{} must be from 0 to 10, not {exponent}",
                Name::CURVATURE_EXPONENT
            )));
        }
        if let Some(name) = self.weight_attribute.as_ref().filter(|name| name.len() < 2 || !name.starts_with('_')) {
            return Err(Error::parameter(format_args!(
                "{} must begin with an underscore, as the names of such attributes do, not {name:?}",
                Name::WEIGHT_ATTRIBUTE
            )));
        }
        if self.quality != Quality::Default && !matches!(self.algorithm, Algorithm::Bb | Algorithm::Pml) {
            return Err(self.contradiction(Name::QUALITY, "bb and pml"));
        }
        if let Some(features) = self.features.filter(|_| self.bridge_components) {
            return Err(Error::parameter(format_args!(
                "{} joins what {} keeps apart: leave one of them out: {features}",
                Name::BRIDGE_COMPONENTS,
                Name::FEATURES
            )));
        }
        self.compactness.map_or(Ok(()), image::check_compactness)?;
        match self.collapse_fraction {
            // no number is not above 0 either
            Some(percent) if !(percent > 0.0 && percent <= 50.0) => Err(Error::parameter(format_args!(
                "{} must be above 0 and at most 50 percent, not {percent}",
                Name::COLLAPSE_FRACTION
            ))),
            _ => Ok(()),
        }
    }

    /// Refuses what means nothing to a mesh.
    pub fn check_mesh(&self) -> Result<()> {
        if let Some(graph) = &self.graph {
            return Err(Error::parameter(format_args!(
                "{} goes with points, not with a mesh, whose faces are neighbours by their edges: {graph}",
                Name::GRAPH
            )));
        }
        match self.compactness {
            Some(compactness) => Err(Error::parameter(format_args!(
                "{} goes with images, not with a mesh: {compactness}",
                Name::COMPACTNESS
            ))),
            None => Ok(()),
        }
    }

    /// Refuses what means nothing to points.
    pub fn check_points(&self) -> Result<()> {
        let of_meshes = [
            (Name::CURVATURE_EXPONENT, self.curvature_exponent.is_some()),
            (Name::FEATURES, self.features.is_some()),
            (Name::WEIGHT_ATTRIBUTE, self.weight_attribute.is_some()),
            (Name::SUBDIVIDE, self.subdivide.is_some()),
            (Name::ENERGY, self.energy != energy::Kind::default()),
            (Name::SHAPES, self.shapes.is_some()),
            (Name::RESOLUTION, self.resolution.is_some()),
            (Name::TOLERANCE, self.tolerance.is_some()),
        ];
        match of_meshes.into_iter().find(|&(_, is_given)| is_given) {
            Some((name, _)) => {
                Err(Error::parameter(format_args!("{name} goes with meshes, not with points: leave it out")))
            }
            None => Ok(()),
        }
    }

    /// Checks what goes with shapes, and refuses what does not.
    fn check_shapes(&self, listed: bool) -> Result<()> {
        let of_shapes = [(Name::SHAPES, self.shapes.is_some()), (Name::RESOLUTION, self.resolution.is_some())];
        if self.energy != energy::Kind::Shapes
            && let Some((name, _)) = of_shapes.into_iter().find(|&(_, is_given)| is_given)
        {
            return Err(Error::parameter(format_args!(
                "{name} goes with {}, not with the energy {}",
                Name::ENERGY.with("shapes"),
                self.energy.name()
            )));
        }
        if !self.energy.is_of_shapes() {
            return match self.tolerance {
                Some(tolerance) => Err(Error::parameter(format_args!(
                    "{} goes with {} or shapes, not with the energy {}: {tolerance}",
                    Name::TOLERANCE,
                    Name::ENERGY.with("planes"),
                    self.energy.name()
                ))),
                None => Ok(()),
            };
        }
        if self.algorithm.is_reference() {
            return Err(Error::parameter(format_args!(
                "the energy {} goes with the algorithms bb, pml, ml and hr, not with {}",
                self.energy.name(),
                self.algorithm.name()
            )));
        }
        let others = [
            (Name::WEIGHT_ATTRIBUTE, self.weight_attribute.is_some()),
            (Name::CURVATURE_EXPONENT, self.curvature_exponent.is_some()),
            (Name::QUALITY, self.quality != Quality::Default),
            (Name::SEEDS, listed || !matches!(self.seeds, Seeds::Coarse | Seeds::Merged)),
            (Name::SEED, self.seed != 0),
            (Name::ALLOW_DISCONNECTED, self.allow_disconnected),
            (Name::OPTIMIZE_ITERATIONS, self.optimize_iterations.is_some()),
            (Name::COLLAPSE_FRACTION, self.collapse_fraction.is_some()),
            (Name::TIES, self.ties != Ties::Hash),
            (Name::PAIRS, !matches!(self.pairs, Pairs::CheaperHalf | Pairs::Eighth)),
        ];
        match others.into_iter().find(|&(_, is_given)| is_given) {
            Some((name, _)) => Err(self.is_not_of_shapes(name)),
            None => self.check_tolerance(),
        }
    }

    /// Refuses what needs a number of clusters where a tolerance decides that.
    fn check_tolerance(&self) -> Result<()> {
        let Some(tolerance) = self.tolerance else { return Ok(()) };
        let others = [
            (Name::CLUSTERS, self.clusters.is_some()),
            (Name::SNAPSHOTS, self.snapshots.is_some()),
            (Name::SUBDIVIDE, self.subdivide == Some(Subdivide::Auto)),
        ];
        match others.into_iter().find(|&(_, is_given)| is_given) {
            Some((name, _)) => Err(Error::parameter(format_args!(
                "{name} does not go with {}, which decides how many clusters there are: leave one out: {tolerance}",
                Name::TOLERANCE
            ))),
            None => Ok(()),
        }
    }

    /// The error for a parameter that energies of shapes do not have.
    pub fn is_not_of_shapes(&self, name: Name) -> Error {
        Error::parameter(format_args!("{name} does not go with the energy {}: leave it out", self.energy.name()))
    }

    /// Parameters of flat clusterings only, and whether each was given.
    fn flat_only(&self, listed: bool) -> Vec<(Name, bool)> {
        vec![
            (Name::SEEDS, listed || self.seeds != Seeds::Coarse),
            (Name::SEED, self.seed != 0),
            (Name::MAX_ITERATIONS, self.max_iterations.is_some()),
            (Name::TOLERANCE, self.tolerance.is_some()),
            (Name::SNAPSHOTS, self.snapshots.is_some()),
            (Name::SUBDIVIDE, self.subdivide.is_some()),
        ]
    }

    /// Parameters of hierarchies only, and whether each was given.
    fn hierarchical_only(&self) -> Vec<(Name, bool)> {
        vec![
            (Name::OPTIMIZE, self.optimize != Optimize::On),
            (Name::OPTIMIZE_ITERATIONS, self.optimize_iterations.is_some()),
            (Name::SWITCH_TO_ML_AT, self.switch_to_ml_at.is_some()),
            (Name::COLLAPSE_FRACTION, self.collapse_fraction.is_some()),
            (Name::TIES, self.ties != Ties::Hash),
            (Name::PAIRS, self.pairs != Pairs::CheaperHalf),
            (Name::LEVELS, !self.levels().is_empty()),
        ]
    }

    /// Refuses what is said about single faces or vertices if these are divided.
    fn check_subdivide(&self, listed: bool) -> Result<()> {
        let others = [
            (Name::SEEDS, listed),
            (Name::SNAPSHOTS, self.snapshots.is_some()),
            (Name::WEIGHT_ATTRIBUTE, self.weight_attribute.is_some()),
        ];
        match others.into_iter().find(|&(_, is_given)| is_given && self.subdivide.is_some()) {
            Some((name, _)) => Err(Error::parameter(format_args!(
                "{} divides the faces that {name} is about: leave one of them out",
                Name::SUBDIVIDE
            ))),
            None => Ok(()),
        }
    }

    /// Checks the parameters of a hierarchy.
    fn check_hierarchy(&self) -> Result<()> {
        if self.optimize_iterations.is_some() && !self.optimizes() {
            let name = Name::OPTIMIZE_ITERATIONS;
            return Err(match self.algorithm {
                Algorithm::Hr => Error::parameter(format_args!(
                    "{name} does not go with the algorithm hr, which does not optimise; take ml"
                )),
                _ => Error::parameter(format_args!("{name} does not go with {}", Name::OPTIMIZE.with("none"))),
            });
        }
        if self.pairs != Pairs::CheaperHalf && self.algorithm != Algorithm::Pml {
            return Err(self.contradiction(Name::PAIRS, "pml"));
        }
        if self.switch_to_ml_at.is_some() && self.algorithm != Algorithm::Pml {
            return Err(self.contradiction(Name::SWITCH_TO_ML_AT, "pml"));
        }
        if self.collapse_fraction.is_some() && self.algorithm == Algorithm::Pml && self.switch_to_ml_at.is_none() {
            return Err(
                self.contradiction(Name::COLLAPSE_FRACTION, &format!("ml, hr and pml with {}", Name::SWITCH_TO_ML_AT))
            );
        }
        match (self.clusters, self.levels().iter().min()) {
            (Some(clusters), Some(&level)) if level < clusters => Err(Error::parameter(format_args!(
                "{} must not be below {}, {clusters}: {level}",
                Name::LEVELS,
                Name::CLUSTERS
            ))),
            _ => Ok(()),
        }
    }

    /// The error for a parameter that the algorithm does not have.
    fn contradiction(&self, name: Name, goes_with: &str) -> Error {
        Error::parameter(format_args!("{name} goes with {goes_with}, not with the algorithm {}", self.algorithm.name()))
    }
}
