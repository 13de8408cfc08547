//! What a clustering gives.

use std::sync::Arc;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use tesserae_mesh::artifacts::{ALL, Artifact, Choices, Content, Form, Labels, Need};
use tesserae_mesh::cluster::record::Record;
use tesserae_mesh::hierarchy::stored::Stored;
use tesserae_mesh::job::Prepared;
use tesserae_mesh::report::Report;
use tesserae_mesh::{Error, Result};

use crate::arrays;
use crate::background::run_quietly;
use crate::error::raised;
use crate::geometry::{Geometry, placement_named};
use crate::tree::{Tree, written};

/// What a clustering gave.
#[pyclass(frozen, module = "tesserae_mesh._native")]
pub struct Outcome {
    labels: Option<Arc<Vec<u32>>>,
    /// Of points: what was clustered, for tables of clusters.
    points: Option<Arc<Prepared>>,
    stored: Option<Arc<Stored>>,
    snapshots: Arc<Record>,
    report: Arc<Report>,
    geometry: Option<Geometry>,
}

impl Outcome {
    /// The results of a job.
    pub fn of(outcome: tesserae_mesh::job::Outcome) -> Self {
        Self {
            labels: outcome.labels.map(Arc::new),
            points: None,
            stored: outcome.hierarchy.map(Arc::new),
            snapshots: Arc::new(outcome.snapshots),
            report: Arc::new(outcome.report),
            geometry: outcome.mesh.map(|mesh| Geometry { mesh }),
        }
    }

    /// The results of a job on points.
    pub fn of_points(outcome: tesserae_mesh::job::Outcome, prepared: Prepared) -> Self {
        Self { points: Some(Arc::new(prepared)), ..Self::of(outcome) }
    }
}

#[pymethods]
impl Outcome {
    #[getter]
    fn clusters(&self) -> u64 {
        self.report.clusters
    }

    /// Of the final labels, in source units; none where it overflows.
    #[getter]
    fn energy(&self) -> Option<f64> {
        self.report.energy.final_
    }

    #[getter]
    fn hexagon_ratio(&self) -> Option<f64> {
        self.report.energy.hexagon_ratio
    }

    #[getter]
    fn faces(&self) -> u64 {
        self.report.input.items()
    }

    /// One label a face or item, 2³² − 1 of an item that a mask leaves out; none for a whole hierarchy.
    fn labels<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<u32>>> {
        self.labels.as_deref().map(|labels| PyArray1::from_slice(py, labels))
    }

    /// What was unusual, in words.
    fn warnings(&self) -> Vec<String> {
        self.report.warnings.clone()
    }

    /// The report as JSON.
    fn report(&self, py: Python<'_>) -> PyResult<String> {
        let not_json = |error| Error::internal(format_args!("the report cannot be written: {error}"));
        raised(py, serde_json::to_string(&*self.report).map_err(not_json))
    }

    /// The labels of the requested iterations.
    fn snapshots<'py>(&self, py: Python<'py>) -> PyResult<Vec<(u32, Bound<'py, PyArray1<u32>>)>> {
        let mut all = Vec::new();
        self.snapshots.replay(|iteration, labels| {
            all.push((iteration, PyArray1::from_slice(py, labels)));
            Ok::<(), PyErr>(())
        })?;
        Ok(all)
    }

    /// The hierarchy, of hierarchical algorithms.
    fn tree(&self) -> Option<Tree> {
        self.stored.clone().map(|stored| Tree { stored })
    }

    /// The mesh, if a file was read.
    fn geometry(&self) -> Option<Geometry> {
        self.geometry.clone()
    }

    /// An output as the bytes of its file. With `cut`, that of other labels with this number of clusters.
    #[pyo3(signature = (form, geometry, cut, placement, ply_vertex_colours, force))]
    #[expect(clippy::too_many_arguments, reason = "these are the arguments of the method in Python")]
    fn encode<'py>(
        &self,
        py: Python<'py>,
        form: &str,
        geometry: Option<Geometry>,
        cut: Option<(Bound<'py, PyArray1<u32>>, u64)>,
        placement: &str,
        ply_vertex_colours: bool,
        force: bool,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let (artifact, form) = raised(py, form_named(form))?;
        let choices =
            Choices { placement: raised(py, placement_named(placement))?, ply_vertex_colours, force, is_plain: false };
        let cut = cut.map(|(labels, clusters)| Ok::<_, PyErr>((arrays::labels(&labels)?, clusters))).transpose()?;
        let (labels, points, stored) = (self.labels.clone(), self.points.clone(), self.stored.clone());
        let (snapshots, report) = (Arc::clone(&self.snapshots), Arc::clone(&self.report));
        let bytes = run_quietly(py, move || {
            let labels = match &cut {
                Some((labels, clusters)) => Some(Labels::new(*clusters, labels)),
                None => labels.as_deref().map(|labels| Labels::new(report.clusters, labels)),
            };
            let points = points.as_ref().and_then(|prepared| prepared.subject.points());
            let is_made_of_table = artifact.needs(Need::Mesh) && artifact.is_of_points;
            let table = match (points, labels) {
                (Some(points), Some(Labels { labels, clusters, .. })) if is_made_of_table => {
                    Some(points.table(labels, clusters))
                }
                _ => None,
            };
            let content = Content {
                labels,
                points: table.as_ref(),
                shape: points.map(|points| &points.set.shape[..]),
                snapshots: cut.is_none().then_some(&*snapshots),
                hierarchy: stored.as_deref(),
                report: cut.is_none().then_some(&*report),
                is_indented: true,
                mesh: geometry.as_ref().map(|geometry| &*geometry.mesh),
                choices,
                ..Content::default()
            };
            check(artifact, form, &content)?;
            let encoding = (form.encode)(&content)?;
            written(encoding)
        })?;
        Ok(PyBytes::new(py, &bytes))
    }
}

/// The output whose file has this name.
fn form_named(name: &str) -> Result<(&'static Artifact, &'static Form)> {
    let forms = || ALL.iter().flat_map(|artifact| artifact.forms.iter().map(move |form| (*artifact, form)));
    forms().find(|(_, form)| form.file == name).ok_or_else(|| {
        let names: Vec<&str> = forms().map(|(_, form)| form.file).collect();
        Error::not_found(format_args!("there is no output of that name, only {}: {name:?}", names.join(", ")))
    })
}

/// Refuses an output that is made of something the clustering does not have.
fn check(artifact: &Artifact, form: &Form, content: &Content<'_>) -> Result<()> {
    let missing = artifact.needs.iter().find_map(|need| match need {
        Need::Labels => content.labels.is_none().then_some("labels: a whole hierarchy has them at cut(k)"),
        Need::Hierarchy => content.hierarchy.is_none().then_some("a hierarchy: take the algorithm pml, ml or hr"),
        Need::Snapshots => content.snapshots.is_none().then_some("the run's own labels, which a cut has not"),
        Need::Shapes => {
            let shapes = content.report.and_then(|report| report.shapes.as_ref());
            shapes.is_none().then_some("shapes: take the energy planes or shapes")
        }
        Need::Report => content.report.is_none().then_some("the run's own report, which a cut has not"),
        Need::Mesh => (content.mesh.is_none() && content.points.is_none()).then_some("the mesh"),
        Need::Image => Some("an image in a file, on the command line or over HTTP"),
        // a mesh that is clustered here is never divided
        Need::Faces => None,
    });
    match missing {
        Some(what) => Err(Error::conflict(format_args!("the output {} needs {what}", form.file))),
        None => Ok(()),
    }
}
