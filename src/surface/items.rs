//! What is clustered: the faces of a mesh, or the items of other data.

use std::ops::Deref;

use super::components::Component;
use super::graph::DualGraph;
use super::lattice::PIECE;
use super::loose::Loose;
use super::order;
use crate::energy::{Energy, Functional, LatticeEnergy, Merged, Sums};
use crate::parallel;

/// What algorithms and reports need of what is clustered.
#[derive(Debug)]
pub struct Items<E: Functional = Energy> {
    /// What devices see of it; fields and methods of the graph can be used as those of the items.
    pub graph: DualGraph<E>,
    /// The face of the upload that each internal face is.
    pub upload_face: Vec<u32>,
    /// Faces of the upload that are no internal face, ascending.
    pub loose: Vec<Loose>,
    /// Σ over faces of their constant part of the energy, in units of the finest component.
    pub(crate) moment: i128,
    /// From the lattice to the source.
    pub units: Units<E>,
    /// Whether feature edges keep faces apart that share an edge.
    pub has_features: bool,
    /// What messages call them.
    pub noun: &'static str,
}

/// From the lattice to source units.
#[derive(Debug, Clone, Copy)]
pub struct Units<E: Functional = Energy> {
    /// Lattice coordinate = (source coordinate − centre) × 2^exponent.
    pub centre: E::Position,
    /// Power of two between lengths in the source and on the lattice.
    pub exponent: i32,
    /// Log₂ of what a weight of 1 in the finest component counts in the source.
    pub weight_exponent: i32,
    /// What a weight × relative density of 1 counts in source units.
    pub density: f64,
}

impl<E: Functional> Units<E> {
    /// A position of the lattice in the source.
    pub fn source_position(&self, mut position: E::Position) -> E::Position {
        for (x, centre) in position.as_mut().iter_mut().zip(self.centre.as_ref()) {
            *x = libm::ldexp(*x, -self.exponent) + centre;
        }
        position
    }
}

impl<E: Functional> Items<E> {
    /// The items of a graph, none of them loose.
    pub fn new(graph: DualGraph<E>, upload_face: Vec<u32>, units: Units<E>) -> Self {
        let moment_of = |component: &Component| {
            // of small components, of which there may be as many as faces, by one thread
            let first = component.first_face as usize;
            let moments = parallel::ranges(component.faces as usize, PIECE, &|range| -> i128 {
                range.map(|item| E::constant(graph.face(first + item))).sum()
            });
            moments.into_iter().sum::<i128>() << component.energy_shift
        };
        let moment = graph.components.iter().map(moment_of).sum();
        Self { graph, upload_face, loose: Vec::new(), moment, units, has_features: false, noun: "faces" }
    }

    /// Number of faces of the upload, loose ones included.
    pub fn upload_faces(&self) -> usize {
        self.upload_face.len() + self.loose.len()
    }

    /// The internal face that each face of the upload is: the inverse of `upload_face`.
    /// [`NO_FACE`](super::order::NO_FACE) of a loose one.
    pub fn internal_faces(&self) -> Vec<u32> {
        order::inverse(&self.upload_face, self.upload_faces())
    }

    /// Labels of internal faces as labels of the upload's faces.
    pub fn in_upload_order(&self, internal: &[u32]) -> Vec<u32> {
        let mut labels = vec![0; self.upload_faces()];
        for (&face, &label) in self.upload_face.iter().zip(internal) {
            labels[face as usize] = label;
        }
        for loose in &self.loose {
            labels[loose.face as usize] = labels[loose.host as usize];
        }
        labels
    }

    /// F in source units (weight × length²), exact until this one conversion; infinite when f64 cannot hold it.
    pub fn energy(&self, energy: LatticeEnergy) -> f64 {
        self.source_of_lattice((self.moment - energy.explained) as f64, 0)
    }

    /// A sum of weight × squared lattice length in source units; of a component with this `energy_shift`.
    pub fn source_of_lattice(&self, lattice: f64, energy_shift: u32) -> f64 {
        let exponent = self.units.weight_exponent - 2 * self.units.exponent + energy_shift as i32;
        libm::ldexp(lattice, exponent) * self.units.density
    }

    /// What becomes of two clusters of a component that merge. `moment` is the constant part of both.
    pub fn merged(&self, a: &E::Sums, b: &E::Sums, moment: i128, component: u32) -> Merged {
        let shift = self.components[component as usize].energy_shift;
        let mut sums = *a;
        sums.add(b, 1);
        let energy = |lattice: i128| self.source_of_lattice(lattice as f64, shift);
        let position = self.units.source_position(sums.mean());
        let mut proxy = [0.0; 3];
        proxy.iter_mut().zip(position.as_ref()).for_each(|(to, from)| *to = *from);
        Merged {
            cost: energy(a.rise(b)),
            energy: energy(moment - sums.explained()),
            faces: sums.faces(),
            weight: libm::ldexp(sums.weight() as f64, self.units.weight_exponent + shift as i32) * self.units.density,
            proxy,
            shape: None,
        }
    }
}

impl<E: Functional> Deref for Items<E> {
    type Target = DualGraph<E>;

    fn deref(&self) -> &DualGraph<E> {
        &self.graph
    }
}
