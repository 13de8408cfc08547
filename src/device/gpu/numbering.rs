//! The clusters that have memory on the device, and their places in it.
//!
//! A hierarchy numbers its clusters like faces, and few of them are left when the device takes part. So the device has
//! memory for those that have faces when labels are set, in the order of their numbers: a rule that prefers the smaller
//! or the larger number decides the same by places. Only the hash of a pair reads the numbers themselves
//! (`shaders/shared/ties.wgsl`).

use std::borrow::Cow;

use crate::device::FREE;
use crate::error::{Error, Kind, Result};
use crate::parallel;

/// Labels that a thread translates at least.
const LABELS: usize = 1 << 14;

/// The places of clusters.
#[derive(Debug, Default)]
pub(super) struct Numbering {
    /// The number of the cluster at each place, ascending.
    numbers: Vec<u32>,
    /// The place of each cluster, [`FREE`] of those without one.
    places: Vec<u32>,
}

impl Numbering {
    /// A place for each cluster.
    pub(super) fn all(clusters: usize) -> Self {
        let all: Vec<u32> = (0..clusters as u32).collect();
        Self { numbers: all.clone(), places: all }
    }

    /// A place for each of so many clusters that has faces. Fails for a label beyond them.
    pub(super) fn of(labels: &[u32], clusters: usize) -> Result<Self> {
        let mut places = vec![FREE; clusters];
        for &label in labels.iter().filter(|&&label| label != FREE) {
            *places.get_mut(label as usize).ok_or_else(|| unknown(label))? = 0;
        }
        let numbers: Vec<u32> = (0..clusters as u32).filter(|&cluster| places[cluster as usize] != FREE).collect();
        for (place, &cluster) in (0..).zip(&numbers) {
            places[cluster as usize] = place;
        }
        Ok(Self { numbers, places })
    }

    /// The numbers of the clusters, by place.
    pub(super) fn numbers(&self) -> &[u32] {
        &self.numbers
    }

    /// The number of the cluster at a place that the device gave.
    pub(super) fn number(&self, place: u32) -> Result<u32> {
        let wrong =
            || Error::new(Kind::DeviceWrong, format_args!("the gpu computed wrongly: no cluster is at {place}"));
        self.numbers.get(place as usize).copied().ok_or_else(wrong)
    }

    /// The place of a cluster. Fails for one without.
    pub(super) fn place(&self, cluster: u32) -> Result<u32> {
        let place = self.places.get(cluster as usize).copied().filter(|&place| place != FREE);
        place.ok_or_else(|| unknown(cluster))
    }

    /// Places of labels. Fails for a cluster without one.
    pub(super) fn to_places<'a>(&self, labels: &'a [u32]) -> Result<Cow<'a, [u32]>> {
        let is_known =
            |label: u32| label == FREE || self.places.get(label as usize).is_some_and(|&place| place != FREE);
        let wrong = parallel::filter(labels.len(), LABELS, |&face| !is_known(labels[face as usize]));
        if let Some(&face) = wrong.first() {
            return Err(unknown(labels[face as usize]));
        }
        Ok(if self.is_identity() { labels.into() } else { translated(labels, &self.places).into() })
    }

    /// Labels from places.
    pub(super) fn to_labels(&self, places: Vec<u32>) -> Vec<u32> {
        if self.is_identity() { places } else { translated(&places, &self.numbers) }
    }

    /// Whether the place of each cluster is its number.
    fn is_identity(&self) -> bool {
        self.numbers.len() == self.places.len()
    }
}

/// The error of a cluster that the device does not know.
fn unknown(cluster: u32) -> Error {
    Error::internal(format_args!("there is no cluster {cluster}, or it has no faces"))
}

/// What a table has for each label; [`FREE`] where it has nothing, as for free faces.
fn translated(labels: &[u32], table: &[u32]) -> Vec<u32> {
    parallel::map(labels.len(), LABELS, |face| table.get(labels[face] as usize).copied().unwrap_or(FREE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_have_the_order_of_numbers_and_free_faces_stay_free() {
        let labels = [7, 2, FREE, 7, 4];
        let numbering = Numbering::of(&labels, 9).expect("all are below 9");
        assert_eq!(numbering.numbers(), [2, 4, 7]);
        let places = numbering.to_places(&labels).expect("all have places").into_owned();
        assert_eq!(places, [2, 0, FREE, 2, 1]);
        assert_eq!(numbering.to_labels(places), labels);
        assert_eq!([2, 3, 8, 9].map(|cluster| numbering.place(cluster).ok()), [Some(0), None, None, None]);
        assert_eq!([0, 2, 3].map(|place| numbering.number(place).ok()), [Some(2), Some(7), None]);
        assert!(numbering.to_places(&[3]).is_err() && numbering.to_places(&[9]).is_err());
        assert!(Numbering::of(&labels, 7).is_err());
    }

    #[test]
    fn all_clusters_keep_their_numbers() {
        let numbering = Numbering::all(3);
        let labels = [2, FREE, 0];
        assert!(matches!(numbering.to_places(&labels), Ok(Cow::Borrowed(_))));
        assert_eq!(numbering.to_labels(labels.to_vec()), labels);
        assert!(numbering.to_places(&[3]).is_err());
    }
}
