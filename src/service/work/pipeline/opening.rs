//! From the files of an upload to a job that is ready to be clustered, once there is memory for it.

use std::collections::HashMap;

use axum::body::Bytes;
use tesserae_mesh::artifacts::Artifact;
use tesserae_mesh::error::{Error, Result};
use tesserae_mesh::job::{self, InputFormat, PointsRequest, Prepared};
use tesserae_mesh::mesh::{Limits, Resources};
use tesserae_mesh::parameters::Seeds;
use tokio::runtime::Handle;
use tokio_util::sync::CancellationToken;

use super::memory::{Needed, Reading, Slot};
use crate::store::Spec;

/// What the files of an upload hold.
pub(super) struct Contents {
    /// The mesh, then its buffers; or the points.
    pub mesh: Vec<Bytes>,
    pub seeds: Option<Bytes>,
    pub weights: Option<Bytes>,
    pub graph: Option<Bytes>,
}

/// Gets memory for what is to be built; false leaves it to a later call.
pub(super) type Admits<'a> = dyn FnMut(Needed) -> Result<bool> + 'a;

/// Reads the mesh or the points of a job, once there is memory for them.
pub(super) fn open(
    spec: &Spec,
    contents: &Contents,
    limits: Limits,
    admits: &mut Admits<'_>,
) -> Result<Option<Prepared>> {
    let Contents { mesh, seeds, weights, graph } = contents;
    let [seeds, weights, graph] = [seeds, weights, graph].map(Option::as_deref);
    let (bytes, buffers) = mesh.split_first().map_or((&[][..], &[][..]), |(mesh, buffers)| (&mesh[..], buffers));
    let parameters = &spec.parameters;
    let outputs: Vec<&Artifact> = spec.kept.artifacts(spec.format).collect();
    let outputs = &outputs[..];
    match spec.format {
        InputFormat::Mesh(format) => {
            let resources = &Parts(spec.buffers.iter().cloned().zip(buffers.iter().cloned()).collect());
            let request = job::Request { bytes, format, resources, limits, parameters, seeds, weights, outputs };
            let needed = |opened: &job::Opened<'_>| Needed::of_faces(opened.faces(), Some(&opened.spec().clustering));
            let build = |opened: job::Opened<'_>| match admits(needed(&opened))? {
                true => opened.prepare().map(Some).map_err(|refusal| refusal.error),
                false => Ok(None),
            };
            job::open(&request, build).map_err(|refusal| refusal.error).flatten()
        }
        InputFormat::Points(format) => {
            let request = PointsRequest { bytes, format, limits, parameters, graph, seeds, weights, outputs };
            let size = request.size().map_err(|refusal| refusal.error)?;
            let merges_items = parameters.algorithm.is_hierarchical() || parameters.seeds == Seeds::Merged;
            match admits(Needed::of_points(size, merges_items))? {
                true => job::prepare_points(&request).map(Some).map_err(|refusal| refusal.error),
                false => Ok(None),
            }
        }
    }
}

/// Reads a mesh, on all threads once it has its memory, for which a blocking thread waits until the job is
/// `broken_off`. Without that, it gives back what reads the mesh, and its memory, if that is not small: what a thread
/// for small meshes waits for may itself wait for such a thread.
pub(super) fn open_with<F>(
    open: F,
    memory: Reading,
    broken_off: Option<&CancellationToken>,
    slot: &Slot,
) -> Result<(F, Option<Reading>, Option<Prepared>)>
where
    F: Fn(&mut Admits<'_>) -> Result<Option<Prepared>>,
{
    let mut left = Some(memory);
    let prepared = open(&mut |need| {
        let Some(memory) = left.take() else { return Ok(true) };
        match (memory.build_small(need), broken_off) {
            (Ok(held), _) => slot.holds(held),
            (Err(memory), Some(broken_off)) => {
                let built = Handle::current().block_on(broken_off.run_until_cancelled(memory.build(need)));
                slot.holds(built.unwrap_or_else(|| Err(Error::cancelled()))?);
            }
            (Err(memory), None) => left = Some(memory),
        }
        Ok(left.is_none())
    })?;
    Ok((open, left, prepared))
}

/// The buffers that came with a mesh: the only files that it can refer to, by exactly their names.
struct Parts(HashMap<String, Bytes>);

impl Resources for Parts {
    fn load(&self, uri: &str, max_bytes: u64) -> Result<Vec<u8>> {
        let content = self.0.get(uri).ok_or_else(|| {
            Error::mesh(format_args!(
                "the mesh refers to a buffer that did not come with it (send it as a part named buffer with this file \
                 name): {uri:?}"
            ))
        })?;
        let bytes = content.len() as u64;
        if bytes > max_bytes {
            return Err(Error::too_large(format_args!(
                "a buffer has more bytes than the limit of {max_bytes}, {bytes}: {uri:?}"
            )));
        }
        Ok(content.to_vec())
    }
}

#[cfg(test)]
mod tests {
    use tesserae_mesh::error::Kind;

    use super::*;

    #[test]
    fn a_mesh_gets_at_the_parts_by_their_names_and_at_nothing_else() {
        let contents = [("a/b c.bin", "first"), ("../x", "second")];
        let parts = Parts(contents.map(|(name, content)| (name.to_owned(), Bytes::from(content))).into());
        assert_eq!(parts.load("a/b c.bin", 5).as_deref(), Ok(&b"first"[..]));
        // a name is a name, whatever it looks like
        assert_eq!(parts.load("../x", 9).as_deref(), Ok(&b"second"[..]));
        assert_eq!(parts.load("a/b c.bin", 4).map_err(|error| error.kind), Err(Kind::TooLarge));
        for uri in ["buffer-0", "mesh", "/etc/passwd", "../buffer-0", "b c.bin", ""] {
            let error = parts.load(uri, 100).expect_err(uri);
            assert_eq!(error.kind, Kind::InvalidMesh);
        }
    }
}
