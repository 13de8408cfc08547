//! The jobs that are measured.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::cluster::quality::Quality;
use crate::dev::sample::{Sample, generate, write_glb};
use crate::error::{Error, Result};
use crate::job::{self, Prepared, Request};
use crate::mesh::{Beside, Format, Limits};
use crate::parameters::{Algorithm, Optimize, Parameters};

/// A mesh to be clustered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mesh {
    /// A knot of about so many faces.
    Knot(u64),
    /// A file.
    File(PathBuf),
}

impl fmt::Display for Mesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Mesh::Knot(_) => f.write_str(Sample::Knot.name()),
            Mesh::File(path) => f.write_str(&path.file_name().unwrap_or_default().to_string_lossy()),
        }
    }
}

/// A job.
#[derive(Debug, Clone, PartialEq)]
pub struct Work {
    /// What is clustered.
    pub mesh: Mesh,
    /// What to do; of flat algorithms, `clusters` is filled in.
    pub parameters: Parameters,
    /// Faces a cluster where `parameters` names no number of clusters and the algorithm is flat.
    pub faces_a_cluster: u64,
}

impl Work {
    /// A flat clustering with default settings.
    pub fn flat(mesh: Mesh, clusters: Option<u64>, faces_a_cluster: u64) -> Self {
        Self { mesh, parameters: Parameters { clusters, ..Parameters::default() }, faces_a_cluster }
    }

    /// A whole hierarchy.
    pub fn hierarchy(mesh: Mesh, optimize: Optimize) -> Self {
        let parameters = Parameters { algorithm: Algorithm::Pml, optimize, ..Parameters::default() };
        Self { mesh, parameters, faces_a_cluster: 1 }
    }

    /// The algorithm, and what else tells jobs apart.
    pub(super) fn name(&self) -> String {
        let Parameters { algorithm, optimize, quality, clusters, .. } = &self.parameters;
        let mut name = algorithm.name().to_owned();
        name += match quality {
            Quality::Fast => ", fast",
            Quality::Default => "",
            Quality::Best => ", best",
        };
        match (algorithm.is_hierarchical(), clusters) {
            (true, _) if *optimize == Optimize::None => name += ", not optimised",
            (false, None) => name += &format!(", {} faces a cluster", self.faces_a_cluster),
            (true, _) | (false, Some(_)) => {}
        }
        name
    }

    /// Whether the mesh has more faces, as far as that is known.
    pub(super) fn is_larger(&self, faces: u64) -> bool {
        matches!(self.mesh, Mesh::Knot(wanted) if wanted > faces)
    }

    /// Number of clusters, for a mesh of so many faces; none for a whole hierarchy.
    pub(super) fn clusters(&self, faces: u64) -> Option<u64> {
        match self.parameters.algorithm.is_hierarchical() {
            true => self.parameters.clusters,
            false => Some(self.parameters.clusters.unwrap_or((faces / self.faces_a_cluster).max(1))),
        }
    }

    /// Makes or reads the mesh, and prepares it.
    pub(super) fn prepare(&self) -> Result<(u64, Prepared)> {
        let (bytes, format, faces) = match &self.mesh {
            Mesh::Knot(faces) => {
                let mesh = generate(Sample::Knot, *faces)?;
                let mut bytes = Vec::new();
                write_glb(&mut bytes, &mesh).map_err(|error| Error::io("the sample cannot be written", error))?;
                (bytes, Format::Glb, Some(mesh.faces.len() as u64))
            }
            Mesh::File(path) => {
                let bytes =
                    std::fs::read(path).map_err(|error| Error::io(format_args!("cannot read {path:?}"), error))?;
                let format = Format::recognise(Some(&path.to_string_lossy()), &bytes, Some(bytes.len() as u64))?;
                (bytes, format, None)
            }
        };
        let folder = match &self.mesh {
            Mesh::File(path) => path.parent().unwrap_or(Path::new(".")).to_owned(),
            Mesh::Knot(_) => PathBuf::from("."),
        };
        let mut parameters = self.parameters.clone();
        parameters.clusters = faces.map_or(parameters.clusters, |faces| self.clusters(faces));
        let prepared = job::prepare(&Request {
            resources: &Beside { folder },
            limits: Limits { max_bytes: u64::MAX, ..Limits::default() },
            ..Request::new(&bytes, format, &parameters)
        });
        let prepared =
            prepared.map_err(|error| Error::new(error.kind, format_args!("{}: {}", self.mesh, error.message)))?;
        Ok((prepared.input.items(), prepared))
    }
}
