//! Relaxed trials: merges and splits are judged after what surrounds them has settled.
//!
//! # Definition
//!
//! A round:
//!
//! 1. Merges (the cheapest first) and splits (those that gain most first) take turns at claiming a region: their
//!    clusters and those beside, if no other trial has claimed any of them. There are at most k/8 merges and as many
//!    splits.
//! 2. Each trial is made on a copy of its region and [settles](mod@crate::cluster::connected::settle) there, where
//!    nothing outside takes part. What F changes by is exact, whatever the other trials do, because their regions have
//!    no cluster in common.
//! 3. Merges (the smallest rise first) meet splits (the largest fall first), as long as the sum of both falls. Those
//!    trials are kept, the others discarded, and the kept regions settle.
//!
//! F falls with each round that keeps a trial.
//!
//! # Why
//!
//! A [paying swap](super::swap) counts only the merge and the split. After either, the clusters around gain, too, and
//! more so where clusters have few faces.

use super::offers::Offers;
use super::split::restricted;
use crate::cluster::connected::Clusters;
use crate::cluster::connected::settle::settle;
use crate::device::Cancel;
use crate::energy::Functional;
use crate::error::Result;
use crate::parallel;

/// A round tries one in this many clusters.
const TRIALS_OF: usize = 8;

/// A trial, before it is made.
struct Claim {
    /// The pair that merges, or the cluster that is split.
    own: Vec<u32>,
    /// Its clusters and those beside, ascending.
    region: Vec<u32>,
}

/// A trial that was made.
struct Trial<'a> {
    claim: &'a Claim,
    /// What F rises by; negative where it falls.
    rise: i128,
    /// The faces of the region, and the cluster of each after the trial.
    labels: Vec<(u32, u32)>,
}

/// The number of the cluster that a split makes, until it has one.
const NEW: u32 = u32::MAX;

/// Makes one round. Returns the number of pairs of a merge and a split that were kept.
pub fn round<E: Functional>(offers: &mut Offers<'_, E>, cancel: &Cancel) -> Result<usize> {
    let claims = claims(offers);
    let trials = parallel::map(claims.len(), 1, |nth| claims[nth].made(offers, cancel));
    let mut trials = trials.into_iter().collect::<Result<Vec<Trial<'_>>>>()?;
    // the sort is stable, so ties are in the order of the claims
    trials.sort_by_key(|trial| trial.rise);
    let (merges, splits): (Vec<_>, Vec<_>) = trials.into_iter().partition(|trial| trial.claim.own.len() == 2);
    let pairs = merges.into_iter().zip(splits).take_while(|(merge, split)| merge.rise + split.rise < 0);
    let clusters = &mut offers.clusters;
    let mut changed = Vec::new();
    let mut kept = 0;
    for (merge, split) in pairs {
        clusters.relabel(merge.labels.into_iter());
        let number = clusters.free_number();
        let named = split.labels.into_iter().map(|(face, label)| (face, if label == NEW { number } else { label }));
        clusters.relabel(named);
        changed.extend(merge.claim.region.iter().chain(&split.claim.region).chain([&number]));
        kept += 1;
    }
    changed.retain(|&cluster| !clusters.faces(cluster).is_empty());
    changed.sort_unstable();
    changed.dedup();
    settle(clusters, changed, u32::MAX, cancel)?;
    Ok(kept)
}

/// Merges and splits take turns at claiming regions.
fn claims<E: Functional>(offers: &mut Offers<'_, E>) -> Vec<Claim> {
    let mut merges = offers.merges().into_iter().map(|(_, a, b)| vec![a, b]);
    let mut splits = offers.splits(|_, _| true).into_iter().map(|(_, cluster)| vec![cluster]);
    let clusters = &offers.clusters;
    let mut is_claimed = vec![false; clusters.numbers().len()];
    // clusters beside a claimed one, which stay so: none is searched more than twice, however many merges name it
    let mut is_refused = is_claimed.clone();
    let mut claim = |own: Vec<u32>| {
        let mut region = own.clone();
        for &cluster in &own {
            if is_claimed[cluster as usize] || is_refused[cluster as usize] {
                return None;
            }
            let beside = clusters.beside(cluster);
            if beside.iter().any(|&cluster| is_claimed[cluster as usize]) {
                is_refused[cluster as usize] = true;
                return None;
            }
            region.extend(beside);
        }
        region.sort_unstable();
        region.dedup();
        region.iter().for_each(|&cluster| is_claimed[cluster as usize] = true);
        Some(Claim { own, region })
    };
    let turns = clusters.count().div_ceil(TRIALS_OF);
    (0..turns).flat_map(|_| [merges.find_map(&mut claim), splits.find_map(&mut claim)]).flatten().collect()
}

impl Claim {
    /// Makes the trial on a copy of its region.
    fn made<E: Functional>(&self, offers: &Offers<'_, E>, cancel: &Cancel) -> Result<Trial<'_>> {
        let (Self { own, region }, clusters) = (self, &offers.clusters);
        let mut faces: Vec<u32> = region.iter().flat_map(|&cluster| clusters.faces(cluster)).copied().collect();
        faces.sort_unstable();
        let graph = restricted(clusters.graph, &faces, clusters.totals(region[0]).shift);
        let place = |of: u32, among: &[u32]| among.binary_search(&of).unwrap_or_default() as u32;
        let mut part = Clusters::new(&graph, faces.iter().map(|&face| place(clusters.label(face), region)).collect());
        let before = part.energy();
        let changed = match own[..] {
            [a, b] => vec![part.merge(place(a, region), place(b, region))],
            _ => {
                let leaving: Vec<u32> = offers.leaving(own[0]).iter().map(|&face| place(face, &faces)).collect();
                vec![place(own[0], region), part.split(&leaving)]
            }
        };
        settle(&mut part, changed, u32::MAX, cancel)?;
        let label = |&label: &u32| region.get(label as usize).copied().unwrap_or(NEW);
        let labels = faces.iter().copied().zip(part.labels().iter().map(label)).collect();
        Ok(Trial { rise: before.explained - part.energy().explained, labels, claim: self })
    }
}
