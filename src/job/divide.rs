//! Meshes that are divided before they are clustered: how often, and whether there is room for that.

use super::JobSpec;
use crate::error::{Error, Result};
use crate::mesh::divide::{Origin, divided, faces_after};
use crate::mesh::{Format, Limits, PolygonMesh};
use crate::parameters::{Name, Subdivide};

/// The number of faces that memory is needed for: of a file with `faces` faces, after they are divided.
///
/// Where faces may be polygons, they are taken for two triangles each until they are read.
pub(super) fn faces(faces: u64, format: Format, spec: &JobSpec) -> u64 {
    let triangles = match format {
        Format::Obj | Format::Ply | Format::Off => faces.saturating_mul(2),
        Format::Glb | Format::Gltf | Format::Stl => faces,
    };
    match spec.subdivide {
        None => faces,
        Some(Subdivide::Times(times)) => faces_after(triangles, times),
        // the last division begins with too few faces
        Some(Subdivide::Auto) => triangles.max(clusters(spec).saturating_mul(4 * Subdivide::ENOUGH)),
    }
}

/// A whole hierarchy ends with one cluster.
fn clusters(spec: &JobSpec) -> u64 {
    spec.clustering.clusters().unwrap_or(1)
}

/// Divides a mesh as its job says, and writes down there how often. None if it stays as it is.
pub(super) fn divide(
    mesh: &mut PolygonMesh,
    spec: &mut JobSpec,
    limits: &Limits,
    foreseen: u64,
) -> Result<Option<Origin>> {
    let Some(subdivide) = spec.subdivide else { return Ok(None) };
    let triangles = mesh.faces.triangles();
    let times = subdivide.times(triangles, clusters(spec));
    spec.divided(times);
    if times == 0 {
        return Ok(None);
    }
    let count = faces_after(triangles, times);
    limits.check_faces(count)?;
    if count > foreseen {
        return Err(Error::too_large(format_args!(
            "the mesh has more triangles in its polygons than there is memory for once {} has divided them: cut them \
             into triangles first; {count}",
            Name::SUBDIVIDE
        )));
    }
    let (mut fine, origin) = divided(mesh, times)?;
    fine.warnings = std::mem::take(&mut mesh.warnings);
    *mesh = fine;
    Ok(Some(origin))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::{Sample, generate};
    use crate::parameters::Parameters;

    fn spec(subdivide: Subdivide) -> JobSpec {
        let parameters = Parameters { clusters: Some(100), subdivide: Some(subdivide), ..Default::default() };
        JobSpec::new(&parameters, None).expect("a job")
    }

    #[test]
    fn divisions_are_written_down_and_foreseen() {
        for (sample, subdivide, times) in [
            (Sample::Knot, Subdivide::Auto, 1),
            (Sample::Quads, Subdivide::Auto, 0),
            (Sample::Quads, Subdivide::Times(2), 2),
            (Sample::Knot, Subdivide::Times(0), 0),
        ] {
            let mut mesh = generate(sample, 2000).expect("a sample");
            let (before, triangles) = (mesh.faces.len() as u64, mesh.faces.triangles());
            let mut spec = spec(subdivide);
            let foreseen = faces(before, Format::Obj, &spec);
            let origin = divide(&mut mesh, &mut spec, &Limits::default(), foreseen).expect("room");
            assert_eq!(spec.reported().subdivide, Some(Subdivide::Times(times)));
            assert_eq!(origin.is_some(), times > 0);
            let after = if times > 0 { faces_after(triangles, times) } else { before };
            assert_eq!(mesh.faces.len() as u64, after);
            assert!(after <= foreseen, "{after} {foreseen}");
        }
    }

    #[test]
    fn too_many_faces_are_refused_before_they_are_made() {
        let mut mesh = generate(Sample::Knot, 2000).expect("a sample");
        let mut spec = spec(Subdivide::Times(10));
        let limits = Limits::default();
        let error = divide(&mut mesh, &mut spec, &limits, u64::MAX).expect_err("too many");
        assert!(error.message.contains("--max-faces"), "{error}");
        let limits = Limits { max_faces: u64::MAX, ..limits };
        let error = divide(&mut mesh, &mut spec, &limits, 5).expect_err("not foreseen");
        assert!(error.message.contains("polygons"), "{error}");
    }
}
