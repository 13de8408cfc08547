//! Outputs: everything that a job can be written as, in one table, [`ALL`].
//!
//! Flags of the command line, names and extensions of files, blobs that the service stores, the media types that
//! `Accept` chooses from, `GET /v1/formats`, the OpenAPI document and the table in `docs/results.md` come from it. A
//! new output is a file here with its [`Artifact`], and a row of [`ALL`]; if it is served and not made of a mesh, also
//! a member of `urls`.
//!
//! An encoder turns a [`Content`] into bytes. It knows no HTTP, no flags and no folders. [`Need`] says what of a job it
//! is made of; a job keeps that until it is written.

mod boundaries;
mod choices;
mod clusters;
mod graph;
mod hierarchy;
mod image;
mod labels;
mod means;
mod mesh;
mod npy;
mod remesh;
mod report;
mod shapes;
mod snapshots;
mod submeshes;

use std::io::{self, Write};
use std::sync::OnceLock;

use utoipa::ToSchema;
use utoipa::openapi::{RefOr, Schema};

use crate::cluster::record::Record;
use crate::data::PointTable;
use crate::error::{Error, Result};
pub use crate::export::npz::npy_header;
use crate::hierarchy::json::Limits;
use crate::hierarchy::stored::Stored;
use crate::mesh::PolygonMesh;
use crate::mesh::divide::Origin;
use crate::parameters::Parameters;
use crate::remesh::Remesh;
use crate::report::Report;

pub use boundaries::BOUNDARIES;
pub use choices::{Choice, Choices};
pub use clusters::CLUSTERS;
pub use graph::GRAPH;
pub use hierarchy::{HIERARCHY, HIERARCHY_JSON, HIERARCHY_TSR, LINKAGE_NPY};
pub use labels::{CutKind, LABELS, LABELS_BIN, LABELS_JSON, LABELS_NPY, LABELS_PNG, Labels};
pub use means::MEANS;
pub use mesh::MESH;
pub use remesh::{REMESH, REMESH_SOURCE};
pub use report::{REPORT, REPORT_JSON};
pub use shapes::SHAPES;
pub use snapshots::{SNAPSHOTS, SNAPSHOTS_JSON, SNAPSHOTS_NPY};
pub use submeshes::SUBMESHES;

/// Every output. The report is last: it has the time that writing the others took.
pub static ALL: [&Artifact; 13] = [
    &LABELS,
    &SNAPSHOTS,
    &HIERARCHY,
    &MESH,
    &SUBMESHES,
    &GRAPH,
    &BOUNDARIES,
    &CLUSTERS,
    &MEANS,
    &REMESH,
    &REMESH_SOURCE,
    &SHAPES,
    &REPORT,
];

/// An output.
#[derive(Debug)]
pub struct Artifact {
    /// Its name, and the last segment of its route.
    pub name: &'static str,
    /// What it is, in a sentence.
    pub about: &'static str,
    /// What it is made of.
    pub needs: &'static [Need],
    /// What it can be written as, the default first.
    pub forms: &'static [Form],
    /// What a request for it may choose, besides the form.
    pub choices: &'static [Choice],
    /// Flags of the command line that write it.
    pub flags: &'static [Flag],
    /// Whether points have it, too, in place of a mesh.
    pub is_of_points: bool,
    /// Whether it has a route. Those of outputs without a mesh serve the stored forms, unless they have a handler of
    /// their own.
    pub is_served: bool,
}

/// What an output can be written as.
#[derive(Debug)]
pub struct Form {
    /// Name of the blob, and of a download; its extension is that of files on the command line.
    pub file: &'static str,
    /// Media type (`application/x-npy` is not registered with IANA, but usual).
    pub media_type: &'static str,
    /// Whether the service stores it. It makes the others on request.
    pub is_stored: bool,
    /// Its schema, of JSON.
    pub schema: Option<fn(&mut Schemas) -> String>,
    /// Finds what is wrong with the content, and then writes it.
    pub encode: for<'a> fn(&Content<'a>) -> Result<Encoding<'a>>,
}

/// Schemas of JSON by their names, for the OpenAPI document.
pub type Schemas = Vec<(String, RefOr<Schema>)>;

/// Adds the schema of a type and all that it refers to; gives its name.
fn schema_of<T: ToSchema>(schemas: &mut Schemas) -> String {
    T::schemas(schemas);
    schemas.push((T::name().into_owned(), T::schema()));
    T::name().into_owned()
}

/// Writes an output.
pub type Encoding<'a> = Box<dyn FnOnce(&mut dyn Write) -> io::Result<()> + 'a>;

/// A flag of the command line. It writes the forms whose files have its name, all if it is the only flag of its output.
/// It takes any file name if JSON is the only form.
#[derive(Debug)]
pub struct Flag {
    /// Its name, with dashes.
    pub name: &'static str,
    /// What stands for its value in the help.
    pub value: &'static str,
    /// Its help.
    pub help: &'static str,
}

/// Something that outputs are made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// One label a face.
    Labels,
    /// Clusters of the faces that were read, not of parts of them.
    Faces,
    /// The labels of the requested iterations.
    Snapshots,
    /// The hierarchy.
    Hierarchy,
    /// Shapes of the clusters, in the report.
    Shapes,
    /// The report.
    Report,
    /// Faces and positions of the mesh as they were read.
    Mesh,
    /// The colours of an image.
    Image,
}

impl Need {
    /// Whether jobs with these parameters have it. A whole hierarchy has labels at every number of clusters, so it has
    /// none of its own. (A flat clustering without a number of clusters has listed seeds.)
    fn is_met(self, parameters: &Parameters) -> bool {
        let is_hierarchical = parameters.algorithm.is_hierarchical();
        match self {
            Need::Labels => !is_hierarchical || parameters.clusters.is_some(),
            Need::Faces => parameters.subdivide.is_none(),
            Need::Snapshots => parameters.snapshots.is_some(),
            Need::Hierarchy => is_hierarchical,
            Need::Shapes => parameters.energy.is_of_shapes(),
            Need::Report | Need::Mesh | Need::Image => true,
        }
    }
}

impl Artifact {
    /// Whether jobs with these parameters have it.
    pub fn is_made(&self, parameters: &Parameters) -> bool {
        self.lacks(parameters).is_none()
    }

    /// Why jobs with these parameters do not have it: the first of its needs that is not met.
    pub fn lacks(&self, parameters: &Parameters) -> Option<Need> {
        self.needs.iter().copied().find(|need| !need.is_met(parameters))
    }

    /// Whether points cannot have it.
    pub fn is_of_meshes_alone(&self) -> bool {
        self.needs(Need::Mesh) && !self.is_of_points
    }

    /// Whether it is made of the mesh or the points, which are gone when the job has ended.
    pub fn is_made_of_input(&self) -> bool {
        self.needs(Need::Mesh) || self.needs(Need::Image)
    }

    /// Whether it is made of a hierarchy or a cut of one, without the mesh: shapes are fitted to that.
    pub fn is_made_of_hierarchy(&self) -> bool {
        !self.is_made_of_input() && !self.needs(Need::Shapes)
    }

    /// Whether it is made of something.
    pub fn needs(&self, need: Need) -> bool {
        self.needs.contains(&need)
    }

    /// The form with this file extension.
    pub fn form(&self, extension: &str) -> Option<&'static Form> {
        self.forms.iter().find(|form| form.extension().eq_ignore_ascii_case(extension))
    }
}

impl Form {
    /// File name without its extension.
    fn stem(&self) -> &'static str {
        self.file.split_once('.').map_or(self.file, |(stem, _)| stem)
    }

    /// File extension, without the first dot: also `stl.zip`.
    pub fn extension(&self) -> &'static str {
        self.file.split_once('.').map_or("", |(_, extension)| extension)
    }
}

impl Flag {
    /// Its name without dashes.
    pub fn long(&self) -> &'static str {
        self.name.trim_start_matches('-')
    }

    /// The forms of its output that the flag writes.
    pub fn forms(&self, artifact: &'static Artifact) -> impl Iterator<Item = &'static Form> {
        artifact.forms.iter().filter(|form| artifact.flags.len() == 1 || form.stem() == self.long())
    }
}

/// What jobs with these parameters yield, in the order in which it is written.
pub fn made(parameters: &Parameters) -> impl Iterator<Item = &'static Artifact> {
    ALL.into_iter().filter(|artifact| artifact.is_made(parameters))
}

/// The forms of it that the service stores.
pub fn stored(parameters: &Parameters) -> impl Iterator<Item = &'static Form> {
    made(parameters).flat_map(|artifact| artifact.forms).filter(|form| form.is_stored)
}

/// What outputs are written from: as much of a job as there is.
#[derive(Debug, Clone, Copy, Default)]
pub struct Content<'a> {
    /// The labels.
    pub labels: Option<Labels<'a>>,
    /// The cluster table of points, in place of a mesh.
    pub points: Option<&'a PointTable>,
    /// Of an image: what the colours of its cluster table are divided by.
    pub compactness: Option<f64>,
    /// The shape of points, whose labels have it: that of their grid, or their number.
    pub shape: Option<&'a [usize]>,
    /// The labels of iterations.
    pub snapshots: Option<&'a Record>,
    /// The hierarchy.
    pub hierarchy: Option<&'a Stored>,
    /// Which part of the hierarchy is written as JSON.
    pub limits: Limits,
    /// The report.
    pub report: Option<&'a Report>,
    /// Whether the report is indented.
    pub is_indented: bool,
    /// The mesh, where an output needs it: positions and faces count, parts may be missing.
    pub mesh: Option<&'a PolygonMesh>,
    /// Where its faces come from, if those that were read were divided.
    pub origin: Option<&'a Origin>,
    /// What the request chose.
    pub choices: Choices,
    /// Keeps the remesh between outputs that are made of it.
    pub remesh: Option<&'a OnceLock<Remesh>>,
}

/// A part of a content that an encoder needs.
fn given<T>(part: Option<T>) -> Result<T> {
    part.ok_or_else(|| Error::internal("an output was to be written without what it is made of"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::{Sample, generate};

    /// An output of an open mesh in five clusters.
    pub(super) fn written(artifact: &Artifact, form: usize) -> Vec<u8> {
        let mesh = generate(Sample::Terrain, 300).expect("a sample");
        let labels: Vec<u32> = (0..mesh.faces.len()).map(|face| (face * 5 / mesh.faces.len()) as u32).collect();
        let content = Content { labels: Some(Labels::new(5, &labels)), mesh: Some(&mesh), ..Content::default() };
        let mut out = Vec::new();
        (artifact.forms[form].encode)(&content).expect("a mesh")(&mut out).expect("a vector takes everything");
        out
    }
}
