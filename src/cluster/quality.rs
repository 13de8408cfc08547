//! Presets: how much time a clustering may take for how low an energy.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::coarse::Effort;

/// How much time to take for how low an energy. Each is as deterministic as the others, and connected.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// A few iterations from a simple start, without refinement
    Fast,
    /// To a minimum that lies as low as ACVD's or lower
    #[default]
    Default,
    /// A start that is optimised further
    Best,
}

impl Quality {
    /// Coarse starts.
    pub fn start(self) -> Effort {
        match self {
            Quality::Fast => Effort {
                groups_a_cluster: 8,
                surplus_percent: 0,
                iterations_a_round: 0,
                iterations_a_graph: 4,
                refine: false,
            },
            Quality::Default => Effort {
                groups_a_cluster: 16,
                surplus_percent: 33,
                iterations_a_round: 4,
                iterations_a_graph: u32::MAX,
                refine: false,
            },
            Quality::Best => Effort {
                groups_a_cluster: 16,
                surplus_percent: 50,
                iterations_a_round: u32::MAX,
                iterations_a_graph: u32::MAX,
                refine: true,
            },
        }
    }

    /// Iterations of flat clusterings, unless another number is asked for; None: to the end.
    pub fn max_iterations(self) -> Option<u32> {
        match self {
            Quality::Fast => Some(2),
            Quality::Default | Quality::Best => None,
        }
    }

    /// Whether flat clusterings refine what the boundary phase has converged to, if that is not switched off.
    pub fn refines(self) -> bool {
        self != Quality::Fast
    }

    /// Iterations of optimisation in a parallel round of a hierarchy between stops, unless another number is asked for.
    pub fn iterations_a_round(self) -> u32 {
        match self {
            Quality::Fast => 2,
            Quality::Default => 4,
            Quality::Best => 16,
        }
    }
}
