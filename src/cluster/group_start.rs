//! A start by merging [groups](super::grouping) of faces: for large meshes by normals, but not with quality `best`.
//!
//! Where improvement is wanted, clusters of the last groups settle, and [move](Relocation::improved) as a whole, which
//! takes a tenth of the time that it takes on the faces. Then labels go to the finer groups, where clusters
//! [settle](settle::settled) again, and so on. The clustering goes on from there with the faces.

use super::coarse::Start;
use super::connected::settle;
use super::grouping;
use super::merging::{self, Pairs};
use super::numbers;
use super::quality::Quality;
use super::relocation::Relocation;
use crate::device::{Cancel, Device, Ending};
use crate::energy::Functional;
use crate::error::Result;
use crate::surface::DualGraph;

impl Start {
    /// From this many clusters that were merged from groups of faces. The numbers must be possible
    /// ([`super::seeds::shares`]).
    pub fn from_groups<E: Functional>(
        graph: &DualGraph<E>,
        clusters: u64,
        pairs: Pairs,
        improve: bool,
        device: &mut dyn Device<E>,
        cancel: &Cancel,
    ) -> Result<Self> {
        let levels = grouping::levels(graph, clusters as usize);
        let coarsest = levels.last().map_or(graph, |level| &level.graph);
        let mut labels = numbers::compact(&merging::merged(coarsest, clusters as usize, pairs, device, cancel)?);
        let mut ending = Ending::Converged;
        if improve {
            let relocation = Relocation { graph: coarsest, quality: Quality::Default, pairs, cancel };
            (labels, ending) = relocation.improved(labels)?;
        }
        let mut is_bounded = ending == Ending::WorkLimit;
        for (at, level) in levels.iter().enumerate().rev() {
            labels = level.refined(&labels);
            if improve && at > 0 {
                (labels, ending) = settle::settled(&levels[at - 1].graph, labels, cancel)?;
                is_bounded |= ending == Ending::WorkLimit;
            }
        }
        Ok(Self { is_bounded, ..Self::of(graph, labels, clusters as usize) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::Sample;
    use crate::device::cpu::CpuDevice;
    use crate::device::pieces::disconnected_clusters;
    use crate::device::plain::PlainDevice;
    use crate::surface::tests::{assert_clusters_lie_in, of_sample};

    #[test]
    fn starts_have_all_clusters_in_one_piece_with_and_without_improvement_and_on_any_device() {
        let surface = of_sample(Sample::Parts, 4000);
        for (clusters, improve) in [(20, false), (20, true), (150, true), (900, true)] {
            let start = |device: &mut dyn Device| {
                Start::from_groups(&surface, clusters, Pairs::Eighth, improve, device, &Cancel::default())
            };
            let Start { labels, component_of_cluster, .. } = start(&mut CpuDevice::new()).expect("a start");
            assert_eq!(start(&mut PlainDevice::default()).expect("a start").labels, labels);
            assert_eq!(component_of_cluster.len(), clusters as usize);
            assert_clusters_lie_in(&surface, &labels, &component_of_cluster);
            assert_eq!(disconnected_clusters(&surface, clusters as usize, &labels), 0, "{clusters} {improve}");
        }
    }
}
