//! A clustering of points with neighbours: of any number of coordinates, or the pixels of an image.
//!
//! `tesserae_mesh/_points.py` brings arrays into the types that are read here. Their layout is free; they are copied
//! once.

use std::time::Instant;

use numpy::ndarray::{ArrayView, Dimension};
use numpy::{PyReadonlyArray1, PyReadonlyArray3, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use tesserae_mesh::Result;
use tesserae_mesh::data::image::{Image, Samples};
use tesserae_mesh::data::{Csr, PointSet, Values};

use crate::background;
use crate::error::raised;
use crate::job::Job;
use crate::outcome::Outcome;

/// Coordinates, those of an item in the last dimension.
#[derive(FromPyObject)]
pub enum Coordinates<'py> {
    /// 4-byte floats.
    F4(PyReadonlyArrayDyn<'py, f32>),
    /// 8-byte floats.
    F8(PyReadonlyArrayDyn<'py, f64>),
    /// Bytes.
    U1(PyReadonlyArrayDyn<'py, u8>),
    /// 2-byte whole numbers.
    U2(PyReadonlyArrayDyn<'py, u16>),
    /// 4-byte whole numbers with a sign.
    I4(PyReadonlyArrayDyn<'py, i32>),
}

impl Coordinates<'_> {
    fn shape(&self) -> Vec<usize> {
        match self {
            Self::F4(array) => array.as_array().shape().to_vec(),
            Self::F8(array) => array.as_array().shape().to_vec(),
            Self::U1(array) => array.as_array().shape().to_vec(),
            Self::U2(array) => array.as_array().shape().to_vec(),
            Self::I4(array) => array.as_array().shape().to_vec(),
        }
    }

    fn values(&self, py: Python<'_>) -> Values {
        match self {
            Self::F4(array) => Values::F4(copied(py, array.as_array())),
            Self::F8(array) => Values::F8(copied(py, array.as_array())),
            Self::U1(array) => Values::U1(copied(py, array.as_array())),
            Self::U2(array) => Values::U2(copied(py, array.as_array())),
            Self::I4(array) => Values::I4(copied(py, array.as_array())),
        }
    }
}

/// Edges as compressed rows: `indptr` and `indices`.
#[derive(FromPyObject)]
pub enum Edges<'py> {
    /// Of 4 bytes.
    Narrow(PyReadonlyArray1<'py, i32>, PyReadonlyArray1<'py, i32>),
    /// Of 8 bytes.
    Wide(PyReadonlyArray1<'py, i64>, PyReadonlyArray1<'py, i64>),
}

impl Edges<'_> {
    fn rows(&self, py: Python<'_>) -> PyResult<Csr> {
        let rows = match self {
            Self::Narrow(indptr, indices) => csr(py, indptr.as_array(), indices.as_array()),
            Self::Wide(indptr, indices) => csr(py, indptr.as_array(), indices.as_array()),
        };
        raised(py, rows)
    }
}

/// Samples of an image: height × width × channels.
#[derive(FromPyObject)]
pub enum Pixels<'py> {
    /// Of 8 bits.
    U8(PyReadonlyArray3<'py, u8>),
    /// Of 16 bits.
    U16(PyReadonlyArray3<'py, u16>),
}

impl Pixels<'_> {
    fn image(&self, py: Python<'_>) -> Image {
        let ((height, width, channels), samples) = match self {
            Self::U8(array) => (array.as_array().dim(), Samples::U8(copied(py, array.as_array()))),
            Self::U16(array) => (array.as_array().dim(), Samples::U16(copied(py, array.as_array()))),
        };
        Image { width, height, channels, samples }
    }
}

/// Clusters points: coordinates of the shape of the items × d, and flat arrays with an entry an item. Neighbours are as
/// the edges, else the job's parameters say. `on_row` is called in this thread.
#[pyfunction]
#[pyo3(signature = (coordinates, weights, mask, edges, job, on_row))]
pub fn cluster_points<'py>(
    py: Python<'py>,
    coordinates: Coordinates<'py>,
    weights: Option<PyReadonlyArray1<'py, f64>>,
    mask: Option<PyReadonlyArray1<'py, bool>>,
    edges: Option<Edges<'py>>,
    job: Job,
    on_row: Option<&Bound<'py, PyAny>>,
) -> PyResult<Outcome> {
    let begin = Instant::now();
    let mut shape = coordinates.shape();
    let set = PointSet {
        dimensions: shape.pop().unwrap_or(0),
        values: coordinates.values(py),
        weights: weights.map(|weights| copied(py, weights.as_array())),
        mask: mask.map(|mask| copied(py, mask.as_array())),
        shape,
        graph: job.graph(edges.map(|edges| edges.rows(py)).transpose()?),
    };
    background::run(py, move |cancel, reporter| job.cluster_points(set, begin, cancel, reporter), on_row)
}

/// Clusters the pixels of an image; `mask` has an entry a pixel. `on_row` is called in this thread.
#[pyfunction]
#[pyo3(signature = (pixels, mask, job, on_row))]
pub fn superpixels<'py>(
    py: Python<'py>,
    pixels: Pixels<'py>,
    mask: Option<PyReadonlyArray1<'py, bool>>,
    job: Job,
    on_row: Option<&Bound<'py, PyAny>>,
) -> PyResult<Outcome> {
    let begin = Instant::now();
    let image = pixels.image(py);
    let mask: Option<Vec<bool>> = mask.map(|mask| copied(py, mask.as_array()));
    let work = move |cancel: &_, reporter: &_| job.superpixels(&image, mask.as_deref(), begin, cancel, reporter);
    background::run(py, work, on_row)
}

/// The elements of an array in its order.
fn copied<T: Copy + Send + Sync, D: Dimension>(py: Python<'_>, view: ArrayView<'_, T, D>) -> Vec<T> {
    py.detach(|| match view.as_slice() {
        Some(elements) => elements.to_vec(),
        None => view.iter().copied().collect(),
    })
}

fn csr<T: Copy + Into<i64> + Send + Sync, D: Dimension>(
    py: Python<'_>,
    indptr: ArrayView<'_, T, D>,
    indices: ArrayView<'_, T, D>,
) -> Result<Csr> {
    let number = |&number: &T| number.into();
    py.detach(|| Csr::new(indptr.iter().map(number), indices.iter().map(number)))
}
