//! From what the device gave to results: labels in upload order and their hash, energies from source positions, the
//! report.
//!
//! Needs no device, so that this can go on while the device works on the next mesh.

use std::f64::consts::LOG10_2;
use std::time::Instant;

use sha2::{Digest, Sha256};

use super::{Clustered, Outcome, Prepared, finite, hierarchical, milliseconds};
use crate::device::pieces;
use crate::energy::Functional as _;
use crate::error::{Error, Kind, Result};
use crate::hierarchy::stored::Stored;
use crate::report::{Energy, Report, Timings};
use crate::surface::Surface;

/// Makes the results of what a device gave for this mesh.
pub fn finish(prepared: &Prepared, clustered: Clustered) -> Result<Outcome> {
    let started = Instant::now();
    let Prepared { surface, spec, plan, .. } = prepared;
    let Clustered { mut labels, clusters, initial, tree, mut snapshots, .. } = clustered;
    if tree.is_some() {
        hierarchical::number(&mut labels, clusters)?;
    }
    let results = Results::of(surface, initial.as_deref(), &labels, clusters, spec.clustering.has_listed_seeds());
    let energy = Energy {
        functional: crate::energy::Energy::NAME.to_owned(),
        weighted_by: prepared.weighted_by.clone(),
        initial: results.initial_energy.and_then(finite),
        final_: finite(results.energy),
        hexagon_ratio: results.hexagon_ratio,
    };
    let (labels, labels_sha256) = if plan.has_labels() {
        let Numbered { labels, number_of_cluster, sha256 } = results.labels?;
        snapshots.renumber(&surface.upload_face, &surface.loose, &number_of_cluster);
        (Some(labels), Some(sha256))
    } else {
        (None, None)
    };
    let hierarchy = match tree {
        Some(tree) => Some(Stored { header: hierarchical::header(&prepared.input, spec.reported())?, tree }),
        None => None,
    };
    let mut warnings = [prepared.warnings.clone(), clustered.warnings].concat();
    warnings.extend(out_of_range(surface, results.initial_energy.unwrap_or(0.0).max(results.energy)));
    let timings_ms = Timings {
        upload: milliseconds(clustered.upload),
        cluster: milliseconds(clustered.cluster),
        download: milliseconds(started.elapsed()),
        ..prepared.timings
    };
    let report = Report {
        input: prepared.input.clone(),
        algorithm: spec.reported().algorithm,
        parameters: spec.reported().clone(),
        device: clustered.device,
        clusters: clusters as u64,
        disconnected_clusters: results.disconnected_clusters,
        energy,
        iterations: clustered.iterations,
        levels: clustered.levels,
        timings_ms,
        labels_sha256,
        snapshots: snapshots.iterations(),
        remesh: None,
        warnings,
    };
    Ok(Outcome { labels, hierarchy, snapshots, mesh: prepared.mesh.clone(), origin: prepared.origin.clone(), report })
}

/// A warning where the mesh is so large or small that its energies leave the range of f64.
fn out_of_range(surface: &Surface, energy: f64) -> Option<String> {
    /// Lengths below 2 to this power have energies that f64 cannot hold exactly.
    const SMALL: i32 = -240;
    let exponent = surface.longest_side_exponent();
    let what = if !energy.is_finite() {
        "too large for f64 and null"
    } else if energy < f64::MIN_POSITIVE && exponent < SMALL {
        "too small for f64 and 0 or not exact"
    } else {
        return None;
    };
    Some(format!(
        "energies are {what}, since they grow with the fourth power of lengths; labels are not affected; scale the \
         mesh to a size near 1; its longest side is about 1e{}",
        (f64::from(exponent) * LOG10_2).round()
    ))
}

/// What the report says of labels, computed in parallel.
struct Results {
    /// Source units.
    initial_energy: Option<f64>,
    energy: f64,
    hexagon_ratio: Option<f64>,
    disconnected_clusters: u64,
    labels: Result<Numbered>,
}

/// Labels in upload order.
struct Numbered {
    labels: Vec<u32>,
    /// What each of the device's labels became.
    number_of_cluster: Vec<u32>,
    sha256: String,
}

impl Results {
    fn of(surface: &Surface, initial: Option<&[u32]>, internal: &[u32], clusters: usize, keep_numbers: bool) -> Self {
        let labels = || Numbered::of(surface, internal, clusters, keep_numbers);
        let energies = || {
            let initial = initial.map(|labels| surface.source_energy(labels, clusters));
            (initial, surface.energy_and_hexagon_ratio(internal, clusters))
        };
        let (disconnected_clusters, ((initial_energy, (energy, hexagon_ratio)), labels)) = rayon::join(
            || pieces::disconnected_clusters(surface, clusters, internal),
            || rayon::join(energies, labels),
        );
        Self { initial_energy, energy, hexagon_ratio, disconnected_clusters, labels }
    }
}

impl Numbered {
    /// Those of listed seeds keep their numbers, others are numbered by the first face that carries them. Checks that
    /// every cluster has a face.
    fn of(surface: &Surface, internal: &[u32], clusters: usize, keep_numbers: bool) -> Result<Self> {
        /// Of a cluster without faces.
        const NONE: u32 = u32::MAX;
        let mut labels = surface.in_upload_order(internal);
        let mut number_of_cluster = vec![NONE; clusters];
        let mut seen = 0;
        for label in &mut labels {
            let number = &mut number_of_cluster[*label as usize];
            if *number == NONE {
                *number = if keep_numbers { *label } else { seen };
                seen += 1;
            }
            *label = *number;
        }
        if seen as usize != clusters {
            return Err(Error::new(Kind::Internal, format_args!("{seen} of {clusters} clusters have faces")));
        }
        let sha256 = labels_sha256(&labels);
        Ok(Self { labels, number_of_cluster, sha256 })
    }
}

/// SHA-256 of labels as u32 little-endian, lower-case hexadecimal.
pub fn labels_sha256(labels: &[u32]) -> String {
    let mut hash = Sha256::new();
    let mut bytes = Vec::with_capacity(4 * 16_384);
    for chunk in labels.chunks(16_384) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(|label| label.to_le_bytes()));
        hash.update(&bytes);
    }
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::{Sample, generate};

    #[test]
    fn meshes_whose_energies_leave_f64_are_warned_about() {
        let mesh = generate(Sample::Knot, 500).expect("a sample");
        for (power, words) in [(0, None), (270, Some("null")), (-290, Some("too small")), (1000, Some("null"))] {
            let mut scaled = mesh.clone();
            scaled.positions.iter_mut().for_each(|p| *p = p.map(|x| libm::ldexp(x, power)));
            let surface = Surface::build(&scaled).expect("a surface");
            let energy = surface.source_energy(&vec![0; surface.faces()], 1);
            let warning = out_of_range(&surface, energy);
            match words {
                None => assert_eq!(warning, None),
                Some(words) => {
                    let warning = warning.expect("a warning");
                    assert!(warning.contains(words) && warning.contains("scale the mesh"), "{warning}");
                }
            }
        }
        // no energy at all is no reason to warn
        let surface = Surface::build(&mesh).expect("a surface");
        assert_eq!(out_of_range(&surface, 0.0), None);
    }
}
