//! Hierarchies.

use std::io::Cursor;
use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use tesserae_mesh::hierarchy::json::Limits;
use tesserae_mesh::hierarchy::stored::Stored;
use tesserae_mesh::{Error, mesh};

use crate::background::run_quietly;
use crate::error::raised;

/// A hierarchy.
#[pyclass(frozen, module = "tesserae_mesh._native")]
pub struct Tree {
    /// The hierarchy.
    pub stored: Arc<Stored>,
}

/// Of each round: clusters left, energy, merges, moves.
type Rounds<'py> =
    (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u64>>);

#[pymethods]
impl Tree {
    /// Reads what `write` gave.
    #[staticmethod]
    #[pyo3(signature = (data, max_faces))]
    fn read(py: Python<'_>, data: Vec<u8>, max_faces: Option<u64>) -> PyResult<Self> {
        let max_faces = max_faces.unwrap_or(mesh::Limits::default().max_faces);
        let length = data.len() as u64;
        let stored = run_quietly(py, move || Stored::read(Cursor::new(data), length, max_faces))?;
        Ok(Self { stored: Arc::new(stored) })
    }

    /// Number of faces.
    #[getter]
    fn faces(&self) -> u32 {
        self.stored.tree.faces
    }

    /// Number of clusters that the last round left.
    #[getter]
    fn roots(&self) -> u32 {
        self.stored.tree.roots()
    }

    /// Shape of the items, of points.
    fn shape(&self) -> Option<Vec<usize>> {
        self.stored.shape()
    }

    /// Where it comes from, as JSON.
    fn header(&self) -> String {
        serde_json::to_string(&self.stored.header).unwrap_or_default()
    }

    /// The rounds, finest first.
    fn rounds<'py>(&self, py: Python<'py>) -> Rounds<'py> {
        let rounds = &self.stored.tree.rounds;
        let before = |at: usize| at.checked_sub(1).map_or((0, 0), |at| (rounds[at].merges_end, rounds[at].moves_end));
        let merges = rounds.iter().enumerate().map(|(at, round)| round.merges_end - before(at).0);
        let moves = rounds.iter().enumerate().map(|(at, round)| round.moves_end - before(at).1);
        (
            PyArray1::from_iter(py, rounds.iter().map(|round| round.clusters)),
            PyArray1::from_iter(py, rounds.iter().map(|round| round.energy)),
            PyArray1::from_iter(py, merges),
            PyArray1::from_iter(py, moves),
        )
    }

    /// Labels, energy, rounds replayed, and merges on top, at a number of clusters.
    fn cut<'py>(&self, py: Python<'py>, clusters: u64) -> PyResult<(Bound<'py, PyArray1<u32>>, f64, u32, u32)> {
        let stored = Arc::clone(&self.stored);
        let cut = run_quietly(py, move || stored.labels_at(clusters))?;
        Ok((PyArray1::from_vec(py, cut.labels), cut.energy, cut.rounds, cut.extra_merges))
    }

    /// scipy's linkage matrix, a row a merge.
    fn linkage<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let stored = Arc::clone(&self.stored);
        let rows = run_quietly(py, move || Ok(stored.linkage()?.rows().flatten().collect::<Vec<f64>>()))?;
        let count = rows.len() / 4;
        PyArray1::from_vec(py, rows).reshape([count, 4])
    }

    /// The file `.tsr`.
    fn write<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let stored = Arc::clone(&self.stored);
        let bytes = run_quietly(py, move || written(|out| stored.write(out)))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// The tree as JSON, without what comes after fewer or before as few clusters as the limits say.
    #[pyo3(signature = (min_clusters, max_clusters))]
    fn json(&self, py: Python<'_>, min_clusters: Option<u64>, max_clusters: Option<u64>) -> PyResult<String> {
        let limits = Limits { min_clusters, max_clusters, clusters: None };
        raised(py, limits.check())?;
        let stored = Arc::clone(&self.stored);
        let bytes = run_quietly(py, move || written(|out| stored.write_json(out, limits)))?;
        Ok(String::from_utf8(bytes)?)
    }
}

/// What is written.
pub fn written(write: impl FnOnce(&mut dyn std::io::Write) -> std::io::Result<()>) -> tesserae_mesh::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    write(&mut bytes).map_err(|error| Error::internal(format_args!("cannot write an output: {error}")))?;
    Ok(bytes)
}
