//! Whether labels and energy that a gpu gave belong together.
//!
//! A driver that computes wrongly in one of thousands of dispatches gives labels that look like any others. The device
//! adds up the energy over the whole run, from the sums of the first labels and each change since. Here it is computed
//! anew, from the labels alone, in integers on the host. Both are exact, so a difference is an error of the device; and
//! an error in sums, proxies, moves or labels makes a difference, unless it repeats itself in all of them.

use crate::device::FREE;
use crate::device::cpu::clusters::Clusters;
use crate::energy::{Functional, LatticeEnergy};
use crate::error::{Error, Kind, Result};
use crate::parallel;
use crate::surface::DualGraph;

/// Labels that a thread checks at least.
const LABELS_A_THREAD: usize = 1 << 16;

/// Fails with [`Kind::DeviceWrong`] where labels that a gpu gave do not have the energy that it gave. The graph comes
/// with the component of each cluster.
pub(super) fn verify<E: Functional>(
    gpu: &str,
    graph: (&DualGraph<E>, &[u32]),
    labels: &[u32],
    energy: LatticeEnergy,
) -> Result<()> {
    let why = match energy_of(graph.0, graph.1, labels) {
        Ok(expected) if expected == energy => return Ok(()),
        Ok(expected) => {
            format!("its labels explain {} of the energy, by its own sums {}", expected.explained, energy.explained)
        }
        Err(label) => format!("clusters are below {}, and a face got {label}", graph.1.len()),
    };
    Err(Error::new(Kind::DeviceWrong, format_args!("the gpu {gpu} computed wrongly: {why}")))
}

/// What labels explain of the energy; free faces count for none. An error is a label that names no cluster.
fn energy_of<E: Functional>(
    graph: &DualGraph<E>,
    component_of_cluster: &[u32],
    labels: &[u32],
) -> Result<LatticeEnergy, u32> {
    let clusters = component_of_cluster.len();
    let is_wrong = |&face: &u32| labels[face as usize] as usize >= clusters && labels[face as usize] != FREE;
    if let Some(&face) = parallel::filter(labels.len(), LABELS_A_THREAD, is_wrong).first() {
        return Err(labels[face as usize]);
    }
    Ok(Clusters::of(graph, component_of_cluster, labels).energy())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cluster::seeds;
    use crate::dev::sample::{Sample, generate};
    use crate::device::plain;
    use crate::surface::Surface;

    #[test]
    fn it_is_the_energy_of_the_definition_and_changes_with_each_label() {
        let surface = Surface::build(&generate(Sample::Parts, 2000).expect("a sample")).expect("a surface");
        let seeds = seeds::stratified(&surface.graph, &vec![5; surface.components.len()], 1);
        let components = &seeds.component_of_cluster;
        let of = |labels: &[u32]| energy_of(&surface.graph, components, labels).map(|energy| energy.explained);
        let mut labels = seeds.labels(surface.faces());
        assert_eq!(of(&labels), Ok(plain::explained(&surface, components, &labels)), "free faces");
        labels = plain::grow(&surface, &labels);
        let expected = plain::explained(&surface, components, &labels);
        assert_eq!(of(&labels), Ok(expected));
        for face in [0, 999] {
            labels[face] ^= 1;
            assert_ne!(of(&labels), Ok(expected), "face {face}");
            labels[face] ^= 1;
        }
        labels[7] = components.len() as u32;
        assert_eq!(of(&labels), Err(components.len() as u32));
    }
}
