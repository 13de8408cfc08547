//! Relaxed trials: merges and splits are judged after what surrounds them has settled.
//!
//! # Definition
//!
//! A round:
//!
//! 1. Merges (the cheapest first) and splits (those that gain most first) take turns at claiming a region: their
//!    clusters and those beside, if no other trial has claimed any of them. There are at most k/8 merges and as many
//!    splits.
//! 2. Each trial is made on a copy of its region and [settles](mod@super::settle) there, where nothing outside takes
//!    part. What F changes by is exact, whatever the other trials do, because their regions have no cluster in common.
//! 3. Merges (the smallest rise first) meet splits (the largest fall first), as long as the sum of both falls. Those
//!    trials are kept, the others discarded, and the kept regions settle.
//!
//! F falls with each round that keeps a trial.
//!
//! # Why
//!
//! A [paying swap](super::swap) counts only the merge and the split. After either, the clusters around gain, too, and
//! more so where clusters have few faces.

use rayon::prelude::*;

use super::candidates::Candidates;
use super::clusters::Clusters;
use super::settle::settle;
use super::split::restricted;
use crate::device::Cancel;
use crate::energy::Functional;
use crate::error::Result;

/// A round tries one in this many clusters.
const TRIALS_OF: usize = 8;

/// What a trial does.
#[derive(Debug, Clone, Copy)]
enum Attempt {
    Merge(u32, u32),
    Split(u32),
}

impl Attempt {
    /// The clusters that it merges or splits.
    fn clusters(self) -> impl Iterator<Item = u32> {
        match self {
            Attempt::Merge(a, b) => [Some(a), Some(b)],
            Attempt::Split(cluster) => [Some(cluster), None],
        }
        .into_iter()
        .flatten()
    }
}

/// A trial, before it is made.
struct Claim {
    attempt: Attempt,
    /// Its clusters and those beside, ascending.
    region: Vec<u32>,
}

/// A trial that was made.
struct Trial {
    /// What F rises by; negative where it falls.
    rise: i128,
    /// The faces of the region, ascending, and the cluster of each after the trial.
    faces: Vec<u32>,
    labels: Vec<u32>,
    region: Vec<u32>,
}

/// The number of the cluster that a split makes, until it has one.
const NEW: u32 = u32::MAX;

/// Makes one round. Returns the number of pairs of a merge and a split that were kept.
pub fn round<E: Functional>(
    clusters: &mut Clusters<'_, E>,
    candidates: &mut Candidates,
    cancel: &Cancel,
) -> Result<usize> {
    candidates.refresh(clusters);
    candidates.split(clusters, |_| true);
    let claims = claims(clusters, candidates);
    let state = &*clusters;
    let made: Result<Vec<(bool, Trial)>> = claims
        .into_par_iter()
        .map(|claim| Ok((matches!(claim.attempt, Attempt::Merge(..)), claim.made(state, candidates, cancel)?)))
        .collect();
    let (mut merges, mut splits): (Vec<_>, Vec<_>) = made?.into_iter().partition(|&(is_merge, _)| is_merge);
    // both sorts are stable, so ties are in the order of the claims
    merges.sort_by_key(|(_, trial)| trial.rise);
    splits.sort_by_key(|(_, trial)| trial.rise);
    let pairs = merges.into_iter().zip(splits).take_while(|((_, merge), (_, split))| merge.rise + split.rise < 0);
    let mut changed = Vec::new();
    let mut kept = 0;
    for ((_, merge), (_, split)) in pairs {
        clusters.relabel(&merge.faces, &merge.labels);
        let number = clusters.free_number();
        let labels: Vec<u32> = split.labels.iter().map(|&label| if label == NEW { number } else { label }).collect();
        clusters.relabel(&split.faces, &labels);
        changed.extend(merge.region.into_iter().chain(split.region).chain([number]));
        kept += 1;
    }
    changed.retain(|&cluster| !clusters.faces(cluster).is_empty());
    changed.sort_unstable();
    changed.dedup();
    settle(clusters, changed, u32::MAX, cancel)?;
    Ok(kept)
}

/// Merges and splits take turns at claiming regions.
fn claims<E: Functional>(clusters: &Clusters<'_, E>, candidates: &Candidates) -> Vec<Claim> {
    let most = clusters.count().div_ceil(TRIALS_OF);
    let mut merges = candidates.merges().into_iter().map(|(_, a, b)| Attempt::Merge(a, b));
    let mut splits = candidates.splits().into_iter().map(|(_, cluster)| Attempt::Split(cluster));
    let mut is_claimed = vec![false; clusters.numbers()];
    // clusters beside a claimed one, which stay so: none is searched more than twice, however many merges name it
    let mut is_refused = is_claimed.clone();
    let mut claim = |mut attempts: &mut dyn Iterator<Item = Attempt>| {
        (&mut attempts).find_map(|attempt| {
            let mut region = Vec::new();
            for cluster in attempt.clusters() {
                if is_claimed[cluster as usize] || is_refused[cluster as usize] {
                    return None;
                }
                let beside = clusters.beside(cluster);
                if beside.iter().any(|&cluster| is_claimed[cluster as usize]) {
                    is_refused[cluster as usize] = true;
                    return None;
                }
                region.push(cluster);
                region.extend(beside);
            }
            region.sort_unstable();
            region.dedup();
            region.iter().for_each(|&cluster| is_claimed[cluster as usize] = true);
            Some(Claim { attempt, region })
        })
    };
    let mut claims = Vec::new();
    for _ in 0..most {
        let (merge, split) = (claim(&mut merges), claim(&mut splits));
        if merge.is_none() && split.is_none() {
            break;
        }
        claims.extend(merge.into_iter().chain(split));
    }
    claims
}

impl Claim {
    /// Makes the trial on a copy of its region.
    fn made<E: Functional>(
        self,
        clusters: &Clusters<'_, E>,
        candidates: &Candidates,
        cancel: &Cancel,
    ) -> Result<Trial> {
        let Self { attempt, region } = self;
        let mut faces: Vec<u32> = region.iter().flat_map(|&cluster| clusters.faces(cluster)).copied().collect();
        faces.sort_unstable();
        let graph = restricted(clusters.graph, &faces, clusters.shift(region[0]));
        let local = |cluster: u32| region.binary_search(&cluster).unwrap_or_default() as u32;
        let mut part = Clusters::new(&graph, faces.iter().map(|&face| local(clusters.label(face))).collect());
        let before = part.energy();
        let changed = match attempt {
            Attempt::Merge(a, b) => vec![part.merge(local(a), local(b))],
            Attempt::Split(cluster) => {
                let leaving = candidates.known_split(cluster).map_or(&[][..], |split| &split.leaving);
                let leaving: Vec<u32> =
                    leaving.iter().map(|face| faces.binary_search(face).unwrap_or_default() as u32).collect();
                let cluster = local(cluster);
                vec![cluster, part.split(cluster, &leaving)]
            }
        };
        settle(&mut part, changed, u32::MAX, cancel)?;
        let label = |&label: &u32| region.get(label as usize).copied().unwrap_or(NEW);
        let labels = part.labels().iter().map(label).collect();
        Ok(Trial { rise: before.explained - part.energy().explained, faces, labels, region })
    }
}
