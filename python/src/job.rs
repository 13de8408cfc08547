//! Parameters; a clustering of a mesh in arrays or in a file.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use serde_json::{Map, Value};
use tesserae_mesh::artifacts::{Artifact, MESH};
use tesserae_mesh::data::image::{self, Image};
use tesserae_mesh::data::{Csr, Graph, PointSet, USUAL_NEIGHBOURS};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::device::select::DeviceChoice;
use tesserae_mesh::error::wrong_json;
use tesserae_mesh::job::{self, DeviceFor, InMemory, PointsInMemory, Prepared, Request, milliseconds};
use tesserae_mesh::mesh::{Beside, Faces, Format, Limits, MeshView};
use tesserae_mesh::parameters::{Neighbours, Parameters};
use tesserae_mesh::surface::Wanted;
use tesserae_mesh::surface::points::OfPoints;
use tesserae_mesh::{Error, Result};

use crate::arrays::{self, Points};
use crate::background::{self, Reporter};
use crate::error::{raised, unreadable};
use crate::outcome::Outcome;

/// What to do with a mesh or points.
#[pyclass(frozen, from_py_object, module = "tesserae_mesh._native")]
#[derive(Clone)]
pub struct Job {
    parameters: Parameters,
    seeds: Option<Vec<u8>>,
    weights: Option<Vec<u8>>,
    device: DeviceChoice,
    adapter: Option<String>,
    limits: Limits,
}

#[pymethods]
impl Job {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "these are the arguments of the class in Python")]
    fn new(
        py: Python<'_>,
        parameters: &str,
        seeds: Option<Vec<u8>>,
        weights: Option<Vec<u8>>,
        device: &str,
        adapter: Option<String>,
        max_faces: Option<u64>,
        max_faces_per_byte: Option<u64>,
        max_bytes: Option<u64>,
    ) -> PyResult<Self> {
        let parameters = raised(py, parsed(parameters))?;
        let device = serde_json::from_value(Value::String(device.to_owned()));
        let device = device.map_err(|error| Error::parameter(format_args!("device {}", wrong_json(&error))));
        let usual = Limits::default();
        let limits = Limits {
            max_faces: max_faces.unwrap_or(usual.max_faces),
            max_faces_per_byte,
            max_bytes: max_bytes.unwrap_or(usual.max_bytes),
        };
        Ok(Self { parameters, seeds, weights, device: raised(py, device)?, adapter, limits })
    }
}

/// The parameters of a JSON object. Each is read by itself first, so that an error has its name.
fn parsed(parameters: &str) -> Result<Parameters> {
    let wrong = |name: &str, error| Error::parameter(format_args!("{name} {}", wrong_json(&error)));
    let members: Map<String, Value> = serde_json::from_str(parameters).map_err(|error| wrong("parameters", error))?;
    for (name, value) in &members {
        let alone = Value::Object(Map::from_iter([(name.clone(), value.clone())]));
        serde_json::from_value::<Parameters>(alone).map_err(|error| wrong(name, error))?;
    }
    serde_json::from_value(Value::Object(members)).map_err(|error| wrong("parameters", error))
}

impl Job {
    /// Clusters a prepared mesh, and says in the report when that began.
    fn run(&self, prepared: &Prepared, begin: Instant, cancel: &Cancel, reporter: &Reporter) -> Result<job::Outcome> {
        cancel.check()?;
        let device = DeviceFor { choice: self.device, adapter: self.adapter.as_deref() };
        let mut outcome = job::run_on(device, None, prepared, cancel, &mut |row| reporter.row(row))?;
        outcome.report.timings_ms.total = milliseconds(begin.elapsed());
        Ok(outcome)
    }

    fn cluster(&self, points: &Points, faces: Faces, cancel: &Cancel, reporter: &Reporter) -> Result<Outcome> {
        let begin = Instant::now();
        let prepared = job::prepare_in_memory(&InMemory {
            mesh: MeshView::new(points.positions(), &faces)?,
            limits: self.limits,
            parameters: &self.parameters,
            seeds: self.seeds.as_deref(),
            weights: self.weights.as_deref(),
        });
        let prepared = prepared.map_err(|refusal| refusal.error)?;
        let outcome = self.run(&prepared, begin, cancel, reporter)?;
        reporter.keep((prepared, faces));
        Ok(Outcome::of(outcome))
    }

    /// What makes points neighbours: these edges, else what the parameters name.
    pub fn graph(&self, edges: Option<Csr>) -> Graph {
        let named = || self.parameters.graph.as_ref().and_then(Neighbours::graph);
        edges.map(Graph::Rows).or_else(named).unwrap_or(Graph::Knn(USUAL_NEIGHBOURS))
    }

    /// Clusters points with neighbours.
    pub fn cluster_points(
        &self,
        set: PointSet,
        begin: Instant,
        cancel: &Cancel,
        reporter: &Reporter,
    ) -> Result<Outcome> {
        let prepared = job::prepare_points_in_memory(PointsInMemory {
            set,
            format: None,
            // the caller has them in memory
            max_items: u64::MAX,
            parameters: &self.parameters,
            seeds: self.seeds.as_deref(),
            started: begin,
        });
        let prepared = prepared.map_err(|refusal| refusal.error)?;
        let outcome = self.run(&prepared, begin, cancel, reporter)?;
        Ok(Outcome::of_points(outcome, prepared))
    }

    /// Clusters the pixels of an image.
    pub fn superpixels(
        &self,
        image: &Image,
        mask: Option<&[bool]>,
        begin: Instant,
        cancel: &Cancel,
        reporter: &Reporter,
    ) -> Result<Outcome> {
        let clusters = self.parameters.clusters.unwrap_or(0);
        let compactness = image::compactness(self.parameters.compactness);
        self.cluster_points(image::superpixels(image, mask, clusters, compactness)?, begin, cancel, reporter)
    }

    /// Clusters the points of triangles: one label a point, -1 where no triangle uses it, and the number of clusters.
    ///
    /// There are no more clusters than positions of points, and components are joined where there are more of them.
    fn cluster_vertices(
        &self,
        points: &Points,
        triangles: &Faces,
        weights: Option<&[f64]>,
        cancel: &Cancel,
        reporter: &Reporter,
    ) -> Result<(Vec<i32>, u64)> {
        let begin = Instant::now();
        let mesh = MeshView::new(points.positions(), triangles)?;
        self.limits.check_faces(triangles.len() as u64)?;
        let wanted = Wanted { weights, ..Wanted::default() };
        let clusters = self.parameters.flat_clusters()?;
        let OfPoints { surface, item_of_point } = OfPoints::build(mesh, clusters, wanted)?;
        let items = surface.faces();
        let (labels, clusters) = if clusters >= items as u64 {
            ((0..items as u32).collect(), items as u64)
        } else {
            let prepared = job::prepare_surface(&self.parameters, mesh, surface).map_err(|refusal| refusal.error)?;
            let outcome = self.run(&prepared, begin, cancel, reporter)?;
            (outcome.labels.unwrap_or_default(), clusters)
        };
        let label = |&item: &u32| labels.get(item as usize).map_or(-1, |&label| label as i32);
        Ok((item_of_point.iter().map(label).collect(), clusters))
    }

    /// Clusters the mesh of a file, or gives the error with which the system refuses to read it.
    fn cluster_file(
        &self,
        path: &Path,
        format: Option<Format>,
        cancel: &Cancel,
        reporter: &Reporter,
    ) -> Result<io::Result<Outcome>> {
        let begin = Instant::now();
        let length = match std::fs::metadata(path) {
            Ok(metadata) => metadata.len(),
            Err(error) => return Ok(Err(error)),
        };
        self.limits.check_bytes(length)?;
        let bytes = match std::fs::read(path) {
            Ok(bytes) => bytes,
            Err(error) => return Ok(Err(error)),
        };
        let recognised = || Format::recognise(Some(&path.to_string_lossy()), &bytes, Some(bytes.len() as u64));
        let format = format.map_or_else(recognised, Ok)?;
        let read = milliseconds(begin.elapsed());
        let kept: [&Artifact; 1] = [&MESH];
        let mut prepared = job::prepare(&Request {
            bytes: &bytes,
            format,
            resources: &Beside { folder: path.parent().map_or_else(PathBuf::new, PathBuf::from) },
            limits: self.limits,
            parameters: &self.parameters,
            seeds: self.seeds.as_deref(),
            weights: self.weights.as_deref(),
            outputs: &kept,
        })?;
        prepared.timings.read = read;
        drop(bytes);
        Ok(Ok(Outcome::of(self.run(&prepared, begin, cancel, reporter)?)))
    }
}

/// Clusters a mesh in arrays. `on_row` is called in this thread.
#[pyfunction]
#[pyo3(signature = (points, connectivity, offsets, job, on_row))]
pub fn cluster(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    connectivity: &Bound<'_, PyAny>,
    offsets: Option<&Bound<'_, PyAny>>,
    job: Job,
    on_row: Option<&Bound<'_, PyAny>>,
) -> PyResult<Outcome> {
    let points = Points::of(points)?;
    let faces = arrays::faces(connectivity, offsets)?;
    background::run(py, move |cancel, reporter| job.cluster(&points, faces, cancel, reporter), on_row)
}

/// Clusters the points of triangles: labels, and how many clusters there are.
#[pyfunction]
#[pyo3(signature = (points, triangles, weights, job))]
pub fn cluster_vertices<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    triangles: &Bound<'py, PyAny>,
    weights: Option<PyReadonlyArray1<'py, f64>>,
    job: Job,
) -> PyResult<(Bound<'py, PyArray1<i32>>, u64)> {
    let points = Points::of(points)?;
    let triangles = arrays::faces(triangles, None)?;
    let weights = weights.map(|weights| weights.as_array().to_vec());
    let (labels, clusters) = background::run(
        py,
        move |cancel, reporter| job.cluster_vertices(&points, &triangles, weights.as_deref(), cancel, reporter),
        None,
    )?;
    Ok((PyArray1::from_vec(py, labels), clusters))
}

/// Clusters the mesh of a file. `on_row` is called in this thread.
#[pyfunction]
#[pyo3(signature = (path, format, job, on_row))]
pub fn cluster_file(
    py: Python<'_>,
    path: PathBuf,
    format: Option<&str>,
    job: Job,
    on_row: Option<&Bound<'_, PyAny>>,
) -> PyResult<Outcome> {
    let format = raised(py, format.map(Format::from_name).transpose())?;
    let file = path.clone();
    let work = move |cancel: &Cancel, reporter: &Reporter| job.cluster_file(&file, format, cancel, reporter);
    background::run(py, work, on_row)?.map_err(|error| unreadable(py, &path, error))
}
