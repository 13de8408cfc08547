//! Presets: how much time a clustering may take for how low an energy.
//!
//! What each of them reaches, beside ACVD and pyacvd: `benches/results/2026-11-22-two-cores/quality.md`.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::coarse::Effort;
use crate::surface::Moves;

/// Meshes with fewer faces than this get the best quality: it takes milliseconds.
const TINY: usize = 1_000;

/// How much time to take for how low an energy. Each is as deterministic as the others, and connected.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// A few iterations and no refinement, on the faces and on coarser meshes
    Fast,
    /// Iterations and refinement until no face moves
    #[default]
    Default,
    /// A start that is optimised further, and from which clusters teleport
    Best,
}

impl Quality {
    /// The quality of flat clusterings of a mesh with this many faces: the best of those with fewer than [`TINY`].
    pub fn on(self, faces: usize) -> Self {
        if faces < TINY { Quality::Best } else { self }
    }

    /// Coarse starts. Where moves are connected, iterations on coarse graphs lower the energy at the least cost
    /// (`docs/constants.md`).
    pub fn start(self, moves: Moves) -> Effort {
        match self {
            Quality::Fast => Effort {
                groups_a_cluster: 8,
                least_groups: 0,
                surplus_percent: 20,
                iterations_a_round: 2,
                iterations_a_graph: if moves == Moves::Connected { 8 } else { 3 },
                refine: false,
                teleport_rounds: 0,
                clusters_in_starts: 0,
            },
            Quality::Default => Effort {
                groups_a_cluster: 16,
                least_groups: 1024,
                surplus_percent: 33,
                iterations_a_round: 4,
                iterations_a_graph: u32::MAX,
                refine: false,
                teleport_rounds: 0,
                clusters_in_starts: 800,
            },
            Quality::Best => Effort {
                groups_a_cluster: 16,
                least_groups: 1024,
                surplus_percent: 50,
                iterations_a_round: u32::MAX,
                iterations_a_graph: u32::MAX,
                refine: true,
                teleport_rounds: 12,
                clusters_in_starts: 800,
            },
        }
    }

    /// Iterations of flat clusterings, unless the parameters have another number; None: to the end.
    pub fn max_iterations(self, moves: Moves) -> Option<u32> {
        match self {
            Quality::Fast => Some(if moves == Moves::Connected { 4 } else { 3 }),
            Quality::Default | Quality::Best => None,
        }
    }

    /// Whether flat clusterings refine what the boundary phase has converged to, if that is not switched off.
    pub fn refines(self) -> bool {
        self != Quality::Fast
    }

    /// Iterations of optimisation in a parallel round of a hierarchy between stops, unless the parameters have another
    /// number.
    pub fn iterations_a_round(self) -> u32 {
        match self {
            Quality::Fast => 1,
            Quality::Default => 2,
            Quality::Best => 16,
        }
    }

    /// Faces a cluster from which on parallel rounds of a hierarchy are optimised.
    pub fn optimised_from(self) -> u64 {
        match self {
            Quality::Fast | Quality::Default => 4,
            Quality::Best => 1,
        }
    }
}
