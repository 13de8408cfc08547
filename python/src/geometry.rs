//! A mesh for outputs that are made of one. It has its own copy of the points, in f64.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;
use tesserae_mesh::mesh::{Adjusted, Format, MeshView, PolygonMesh};
use tesserae_mesh::remesh::{Placement, Remesh, remesh};
use tesserae_mesh::{Error, Result};

use crate::arrays::{self, Points};
use crate::background::run_quietly;
use crate::error::{exception, raised};
use crate::picture::{Picture, draw};

/// A mesh.
#[pyclass(frozen, from_py_object, module = "tesserae_mesh._native")]
#[derive(Clone)]
pub struct Geometry {
    /// The mesh.
    pub mesh: Arc<PolygonMesh>,
}

/// Positions, triangles, clusters, sources, and the summary as JSON.
type RemeshArrays<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyDict>, String);

#[pymethods]
impl Geometry {
    #[new]
    #[pyo3(signature = (points, connectivity, offsets))]
    fn new(
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        connectivity: &Bound<'_, PyAny>,
        offsets: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let points = Points::of(points)?;
        let faces = arrays::faces(connectivity, offsets)?;
        let mesh = run_quietly(py, move || {
            let positions = MeshView::new(points.positions(), &faces)?.positions.iter().collect();
            let (parts, warnings, adjusted) = (Vec::new(), Vec::new(), Adjusted::default());
            // encoders look at positions and faces only
            Ok(PolygonMesh { format: Format::Obj, positions, faces, parts, warnings, adjusted })
        })?;
        Ok(Self { mesh: Arc::new(mesh) })
    }

    /// Positions, shape (N, 3).
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.mesh.positions.as_flattened().to_vec())
    }

    /// Corners, face after face.
    fn connectivity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, self.mesh.faces.all_corners())
    }

    /// Where the corners of each face begin and end; none for triangles.
    fn offsets<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<u32>>> {
        let faces = &self.mesh.faces;
        let ends = (0..faces.len()).map(|face| faces.corner_range(face).end as u32);
        (!faces.are_triangles()).then(|| PyArray1::from_vec(py, std::iter::once(0).chain(ends).collect()))
    }

    /// A picture of the clusters, or of the faces: rows of pixels, each red, green, blue and opacity.
    #[pyo3(signature = (labels))]
    fn picture<'py>(
        &self,
        py: Python<'py>,
        labels: Option<&Bound<'py, PyArray1<u32>>>,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let (mesh, labels) = (Arc::clone(&self.mesh), labels.map(arrays::labels).transpose()?);
        let faces = mesh.faces.len();
        let are_wrong =
            |labels: &Vec<u32>| labels.len() != faces || labels.iter().any(|&label| label as usize >= faces);
        if labels.as_ref().is_some_and(are_wrong) {
            return Err(exception(py, &Error::mesh(format_args!("labels must be {faces} numbers below {faces}"))));
        }
        let Picture { width, height, bytes } = run_quietly(py, move || draw(&mesh, labels.as_deref()))?;
        PyArray1::from_vec(py, bytes).reshape([height, width, 4])
    }

    /// A triangle mesh with a vertex a cluster.
    fn remesh<'py>(
        &self,
        py: Python<'py>,
        labels: &Bound<'py, PyArray1<u32>>,
        clusters: u64,
        placement: &str,
    ) -> PyResult<RemeshArrays<'py>> {
        let placement = raised(py, placement_named(placement))?;
        let (mesh, labels) = (Arc::clone(&self.mesh), arrays::labels(labels)?);
        let Remesh { points, triangles, sources, summary } =
            run_quietly(py, move || remesh(&mesh, &labels, clusters, placement))?;
        let source = PyDict::new(py);
        source.set_item("kind", PyArray1::from_iter(py, sources.iter().map(|source| source.kind as u8)))?;
        source.set_item("face", PyArray1::from_iter(py, sources.iter().map(|source| source.face)))?;
        let vertices = sources.iter().flat_map(|source| source.vertices).collect();
        source.set_item("vertices", table(py, vertices)?)?;
        let barycentric = sources.iter().flat_map(|source| source.barycentric).collect();
        source.set_item("barycentric", table(py, barycentric)?)?;
        Ok((
            table(py, points.iter().flat_map(|point| point.to_array()).collect())?,
            table(py, triangles.into_flattened())?,
            PyArray1::from_iter(py, sources.iter().map(|source| source.cluster)),
            source,
            serde_json::to_string(&summary).unwrap_or_default(),
        ))
    }
}

/// An array with rows of three.
fn table<T: numpy::Element>(py: Python<'_>, numbers: Vec<T>) -> PyResult<Bound<'_, PyArray2<T>>> {
    let rows = numbers.len() / 3;
    PyArray1::from_vec(py, numbers).reshape([rows, 3])
}

/// A placement by its name.
pub fn placement_named(name: &str) -> Result<Placement> {
    serde_json::from_value(Value::String(name.to_owned()))
        .map_err(|error| Error::parameter(format_args!("placement {}", tesserae_mesh::error::wrong_json(&error))))
}
