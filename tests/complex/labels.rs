//! Labels at random, of several kinds.

use proptest::prelude::*;
use tesserae_mesh::dev::random;
use tesserae_mesh::mesh::PolygonMesh;

/// How labels are made.
#[derive(Debug, Clone, Copy)]
pub enum Kind {
    /// Each face by itself.
    Noise,
    /// Slabs across a direction.
    Slabs,
    /// The nearest of some faces.
    Nearest,
}

/// A recipe for labels of any mesh.
#[derive(Debug, Clone, Copy)]
pub struct Recipe {
    pub kind: Kind,
    pub clusters: u32,
    /// Faces in 64 whose label is replaced by any.
    pub noise: u32,
    pub seed: u64,
}

pub fn recipe() -> impl Strategy<Value = Recipe> {
    let kind = prop_oneof![Just(Kind::Noise), Just(Kind::Slabs), Just(Kind::Nearest)];
    (kind, 1u32..60, prop_oneof![Just(0u32), Just(1), Just(8)], any::<u64>())
        .prop_map(|(kind, clusters, noise, seed)| Recipe { kind, clusters, noise, seed })
}

impl Recipe {
    /// Labels and their number, at most that of the faces.
    pub fn labels(&self, mesh: &PolygonMesh) -> (Vec<u32>, u64) {
        let faces = mesh.faces.len();
        let clusters = self.clusters.min(faces as u32);
        let mut states = random(self.seed);
        let mut next = |bound: u32| ((states() >> 33) % u64::from(bound)) as u32;
        let size = mesh.positions.as_flattened().iter().fold(f64::MIN_POSITIVE, |size, x| size.max(x.abs()));
        let place = |face: usize| {
            let corners = mesh.faces.corners(face);
            let share = corners.len() as f64;
            corners.iter().fold([0.0; 3], |sum, &corner| {
                let position = mesh.positions[corner as usize];
                [0, 1, 2].map(|axis| sum[axis] + position[axis] / size / share)
            })
        };
        let mut labels: Vec<u32> = match self.kind {
            Kind::Noise => (0..faces).map(|_| next(clusters)).collect(),
            Kind::Slabs => {
                let direction = [0; 3].map(|_| f64::from(next(2001)) / 1000.0 - 1.0);
                let along = |face| place(face).iter().zip(direction).map(|(x, d)| x * d).sum::<f64>();
                (0..faces).map(|face| (((along(face) + 2.0) * f64::from(clusters)) as u32) % clusters).collect()
            }
            Kind::Nearest => {
                let centres: Vec<[f64; 3]> = (0..clusters).map(|_| place(next(faces as u32) as usize)).collect();
                let nearest = |face| {
                    let at = place(face);
                    let distance =
                        |centre: &[f64; 3]| [0, 1, 2].map(|i| (centre[i] - at[i]).powi(2)).iter().sum::<f64>();
                    let by_distance = |a: &usize, b: &usize| distance(&centres[*a]).total_cmp(&distance(&centres[*b]));
                    (0..centres.len()).min_by(by_distance).unwrap_or(0) as u32
                };
                (0..faces).map(nearest).collect()
            }
        };
        for label in &mut labels {
            if next(64) < self.noise {
                *label = next(clusters);
            }
        }
        (labels, u64::from(clusters))
    }
}
