//! From what the device gave to results: labels in upload order and their hash, energies from source positions, the
//! report.
//!
//! Needs no device, so that this can go on while the device works on the next mesh.

use std::f64::consts::LOG10_2;
use std::time::Instant;

use sha2::{Digest, Sha256};

use super::shapes::LastShapes;
use super::subject::with_items;
use super::{Clustered, Outcome, Points, Prepared, Shaped, Subject, finite, hierarchical, milliseconds};
use crate::device::{FREE, pieces};
use crate::error::{Error, Result};
use crate::hierarchy::stored::{Mask, Stored};
use crate::report::{Energy, Report, Timings};
use crate::surface::Surface;
use crate::surface::lattice::COORDINATE_BITS;
use crate::surface::of_faces::OfFaces;

/// Makes the results of what a device gave.
pub fn finish(prepared: &Prepared, clustered: Clustered) -> Result<Outcome> {
    let started = Instant::now();
    let spec = &prepared.spec;
    let Clustered { labels, clusters, initial, tree, mut snapshots, shapes, .. } = clustered;
    let (energies, (disconnected_clusters, numbered)) = rayon::join(
        || match (&prepared.subject, &shapes) {
            (Subject::Shapes(shaped), Some(shapes)) => Energies::of_shapes(shaped, shapes, &labels, clusters),
            (subject, _) => Energies::of(subject, initial.as_deref(), &labels, clusters),
        },
        || {
            let keep_numbers = spec.clustering.has_listed_seeds();
            with_items!(&prepared.subject, |items| rayon::join(
                || pieces::disconnected_clusters(items, clusters, &labels),
                || Numbered::of(items.in_upload_order(&labels), clusters, keep_numbers),
            ))
        },
    );
    let energy = Energy {
        functional: spec.energy.name().to_owned(),
        weighted_by: prepared.weighted_by.clone(),
        initial: energies.initial.and_then(finite),
        final_: finite(energies.last),
        total: energies.total.and_then(finite),
        explained: energies.total.and_then(|total| finite(1.0 - energies.last / total)),
        hexagon_ratio: energies.hexagon_ratio,
        l21: energies.l21.and_then(finite),
    };
    let feature_edges_inside = prepared.subject.feature_edges_inside(&labels);
    let (mut table_of_shapes, mut tolerance, mut beyond_tolerance) = (None, None, None);
    let (labels, labels_sha256) = if spec.clustering.has_labels() {
        let of_run = labels;
        let Numbered { labels, number_of_cluster } = numbered?;
        if let (Subject::Shapes(shaped), Some(shapes)) = (&prepared.subject, &shapes) {
            let table = shaped.table(shapes, &of_run, &number_of_cluster);
            (tolerance, beyond_tolerance) = shaped.tolerance(shapes, &table).unzip();
            table_of_shapes = Some(table);
        }
        let labels = prepared.subject.with_masked(labels);
        with_items!(&prepared.subject, |items| {
            snapshots.renumber(&items.upload_face, &items.loose, &number_of_cluster);
        });
        if let Some(Points { members, .. }) = prepared.subject.points() {
            snapshots.spread(|member| members.item(member), members.items(), FREE);
        }
        let sha256 = labels_sha256(&labels);
        (Some(labels), Some(sha256))
    } else {
        (None, None)
    };
    let hierarchy = match tree {
        Some(tree) => {
            let header = hierarchical::header(&prepared.input, spec.reported())?;
            let mask = prepared.subject.points().and_then(|points| Mask::new(points.set.mask.as_deref()?));
            Some(Stored { header, mask, tree })
        }
        None => None,
    };
    let mut warnings = [prepared.warnings.clone(), clustered.warnings].concat();
    warnings.extend(beyond_tolerance.flatten());
    let largest = energies.initial.unwrap_or(0.0).max(energies.last);
    match &prepared.subject {
        Subject::Mesh(surface, _) => warnings.extend(out_of_range(surface, largest)),
        Subject::Normals(surface, _) => warnings.extend(out_of_range(surface, largest)),
        Subject::Shapes(shaped) => warnings.extend(out_of_range(&shaped.surface, largest)),
        Subject::Points(_) if largest.is_finite() => {}
        Subject::Points(_) => warnings.push(
            "energies are too large for f64 and null; labels are not affected; divide the coordinates or the weights"
                .to_owned(),
        ),
    }
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
        disconnected_clusters,
        feature_edges_inside,
        energy,
        shapes: table_of_shapes,
        tolerance,
        iterations: clustered.iterations,
        levels: clustered.levels,
        timings_ms,
        labels_sha256,
        snapshots: snapshots.iterations(),
        remesh: None,
        warnings,
    };
    let table = match (prepared.subject.points(), &labels) {
        (Some(points), Some(labels)) if prepared.wants_table => Some(points.table(labels, clusters as u64)),
        _ => None,
    };
    Ok(Outcome {
        labels,
        table,
        hierarchy,
        shape: prepared.subject.points().map(|points| points.set.shape.clone()),
        snapshots,
        mesh: prepared.mesh.clone(),
        origin: prepared.origin.clone(),
        report,
    })
}

/// A warning where the mesh is so large or small that its energies leave the range of f64.
fn out_of_range<E: OfFaces>(surface: &Surface<E>, energy: f64) -> Option<String> {
    /// Lengths below 2 to this power have energies that f64 cannot hold exactly.
    const SMALL: i32 = -240;
    // log₂ of the longest side of the bounding box, rounded up
    let exponent = COORDINATE_BITS + 1 - surface.frame().exponent;
    let what = if !energy.is_finite() {
        "too large for f64 and null"
    } else if energy < f64::MIN_POSITIVE && exponent < SMALL {
        "too small for f64 and 0 or not exact"
    } else {
        return None;
    };
    Some(format!(
        "energies are {what}, since they grow with powers of lengths; labels are not affected; scale the \
         mesh to a size near 1; its longest side is about 1e{}",
        (f64::from(exponent) * LOG10_2).round()
    ))
}

/// Energies of the report, source units.
struct Energies {
    initial: Option<f64>,
    last: f64,
    /// With one cluster, of points.
    total: Option<f64>,
    hexagon_ratio: Option<f64>,
    l21: Option<f64>,
}

impl Energies {
    fn of(subject: &Subject, initial: Option<&[u32]>, labels: &[u32], clusters: usize) -> Self {
        match subject {
            Subject::Mesh(surface, _) => Self::of_faces(surface, initial, labels, clusters),
            Subject::Normals(surface, _) => Self::of_faces(surface, initial, labels, clusters),
            Subject::Shapes(shaped) => Self::of_faces(&shaped.surface, initial, labels, clusters),
            Subject::Points(points) => {
                let of = |labels: &[u32]| points.energy(|item| labels[item], clusters);
                let ((initial, last), total) =
                    rayon::join(|| rayon::join(|| initial.map(of), || of(labels)), || points.energy(|_| 0, 1));
                Self { initial, last, total: Some(total), hexagon_ratio: None, l21: None }
            }
        }
    }

    fn of_shapes(shaped: &Shaped, fitted: &LastShapes, labels: &[u32], clusters: usize) -> Self {
        let l21 = shaped.surface.l21(labels, clusters);
        let (initial, last) = fitted.energies;
        Self { initial, last, total: None, hexagon_ratio: None, l21 }
    }

    fn of_faces<E: OfFaces>(surface: &Surface<E>, initial: Option<&[u32]>, labels: &[u32], clusters: usize) -> Self {
        let initial = initial.map(|labels| surface.source_energy(labels, clusters));
        let (last, hexagon_ratio) = surface.energy_and_hexagon_ratio(labels, clusters);
        Self { initial, last, total: None, hexagon_ratio, l21: surface.l21(labels, clusters) }
    }
}

/// Labels in upload order.
struct Numbered {
    labels: Vec<u32>,
    /// What each of the device's labels became.
    number_of_cluster: Vec<u32>,
}

impl Numbered {
    /// Those of listed seeds keep their numbers, others are numbered by the first face that carries them. Checks that
    /// every cluster has a face.
    fn of(mut labels: Vec<u32>, clusters: usize, keep_numbers: bool) -> Result<Self> {
        /// Of a cluster without faces.
        const NONE: u32 = u32::MAX;
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
            return Err(Error::internal(format_args!("{seen} of {clusters} clusters have faces")));
        }
        Ok(Self { labels, number_of_cluster })
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
