//! The shape that stands for a cluster: of the allowed types, the one with the smallest energy.

use glam::DVec3;

use super::central::{Central, CentralHigher};
use super::eigen::smallest_value;
use super::fit::{self, Fit, Known};
use super::kind::Kind;
use super::moments::{Higher, Moments};
use super::prices::Prices;
use super::tolerance::Tolerance;

/// Types beside planes.
const CURVED: usize = Kind::ALL.len() - 1;

/// Fewer faces have no curved shape.
pub const FEWEST_FACES: u32 = 3;

/// A shape and the energy of its cluster.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    /// The fit.
    pub fit: Fit,
    /// Mean square × weight + price: weight × squared units of moments.
    pub energy: f64,
}

/// The fits of a cluster.
#[derive(Debug, Clone, Copy)]
pub struct Candidates {
    central: Central,
    /// The energy of its plane.
    plane: f64,
    curved: [Option<Candidate>; CURVED],
    /// No mean square of distances may be larger.
    most: f64,
}

/// The best fit of a cluster.
#[derive(Debug, Clone, Copy)]
pub struct Best {
    /// Its energy: weight × squared units of moments.
    pub energy: f64,
    /// Its type.
    pub kind: Kind,
    /// Its axis, if it has one.
    pub axis: Option<DVec3>,
    /// Whether its mean square is within the tolerance.
    pub is_within: bool,
}

/// What shapes clusters may have.
#[derive(Debug, Clone, Copy)]
pub struct Allowed<'a> {
    /// Types, in the order of [`Kind::ALL`], planes among them.
    pub kinds: &'a [Kind],
    /// What they cost in each component.
    pub prices: &'a [Prices],
    /// How far corners may be from them.
    pub tolerance: Option<Tolerance<'a>>,
}

impl Allowed<'_> {
    /// Whether there are others than planes.
    pub fn are_curved(&self) -> bool {
        self.kinds.len() > 1
    }

    /// Fits the types to a cluster of a component, but none that its price alone makes dearer than another. `higher` is
    /// called if a curved type is tried; `axes` are for cylinders and cones to begin with.
    pub fn fits(
        &self,
        component: u32,
        moments: &Moments,
        higher: impl FnOnce() -> Option<Higher>,
        axes: &[DVec3],
    ) -> Candidates {
        let prices = &self.prices[component as usize];
        let central = Central::of(moments);
        let plane = smallest_value(central.matrix()) * central.weight;
        let most = self.tolerance.map_or(f64::INFINITY, |tolerance| tolerance.mean_square());
        // a plane beyond the tolerance is no alternative
        let mut least = if plane <= most * central.weight { plane } else { f64::INFINITY };
        let mut candidates = Candidates { central, plane, curved: [None; CURVED], most };
        let may_pay = |kind: Kind, least: f64| kind != Kind::Plane && least > prices.of_kind(kind);
        if !self.kinds.iter().any(|&kind| may_pay(kind, least)) {
            return candidates;
        }
        let Some(higher) = higher() else { return candidates };
        let higher = CentralHigher::of(&central, moments, &higher);
        let known = Known { central: &central, higher: &higher, axes };
        for (place, &kind) in candidates.curved.iter_mut().zip(&self.kinds[1..]) {
            if may_pay(kind, least)
                && let Some(fit) = fit::of_kind(kind, known)
            {
                let energy = fit.mean_square * central.weight + prices.of_kind(kind);
                if fit.mean_square <= most {
                    least = least.min(energy);
                }
                *place = Some(Candidate { fit, energy });
            }
        }
        candidates
    }
}

impl Candidates {
    /// The mean of the cluster, in units of moments.
    pub fn mean(&self) -> DVec3 {
        self.central.mean
    }

    /// All of them, the plane first.
    pub fn all(&self) -> impl Iterator<Item = Candidate> {
        let plane = Candidate { fit: fit::plane(&self.central), energy: self.plane };
        [Some(plane)].into_iter().chain(self.curved).flatten()
    }

    /// The first with the smallest energy of those within the tolerance, or of all if none is.
    pub fn best(&self) -> Best {
        let weight = self.central.weight;
        let is_within = self.plane <= self.most * weight;
        let plane = Best { energy: self.plane, kind: Kind::Plane, axis: None, is_within };
        self.curved.iter().flatten().fold(plane, |best, candidate| {
            let is_within = candidate.fit.mean_square <= self.most;
            let is_better = match is_within == best.is_within {
                true => candidate.energy < best.energy,
                false => is_within,
            };
            let shape = &candidate.fit.shape;
            let other = || Best { energy: candidate.energy, kind: shape.kind(), axis: shape.axis(), is_within };
            if is_better { other() } else { best }
        })
    }

    /// Those within the tolerance, by their energies.
    pub fn within(&self) -> Vec<Candidate> {
        let mut within: Vec<Candidate> =
            self.all().filter(|candidate| candidate.fit.mean_square <= self.most).collect();
        within.sort_by(|a, b| a.energy.total_cmp(&b.energy));
        within
    }
}
