//! What a job keeps of its mesh or points, which are otherwise gone when the job ends: named outputs, which are made
//! while these are in memory, and the mesh or the image itself, of which every output can be made later.

use serde::{Deserialize, Serialize};
use tesserae_mesh::artifacts::{ALL, Artifact, Form, MESH, Need};
use tesserae_mesh::error::{Error, Quoted, Result};
use tesserae_mesh::job::InputFormat;
use tesserae_mesh::parameters::{Name, Parameters};

#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Kept {
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub outputs: Vec<String>,
    /// Whether the mesh or the image is kept.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub mesh: bool,
}

impl Kept {
    /// What needs a file of this format while it is in memory.
    pub fn artifacts(&self, format: InputFormat) -> impl Iterator<Item = &'static Artifact> {
        made_of_input().filter(move |artifact| self.gives(artifact, format))
    }

    pub fn forms(&self) -> impl Iterator<Item = &'static Form> {
        forms().filter(|form| self.has(form))
    }

    pub fn has(&self, form: &Form) -> bool {
        self.outputs.iter().any(|name| name == form.file)
    }

    /// Whether some form of an output can be had of a file of this format.
    pub fn gives(&self, artifact: &Artifact, format: InputFormat) -> bool {
        self.mesh && format.lacks(artifact).is_none() || artifact.forms.iter().any(|form| self.has(form))
    }

    /// Refuses what jobs on files of this format do not have.
    pub fn check_format(&self, format: InputFormat) -> Result<()> {
        if self.mesh && !can_be_kept(format) {
            return Err(Error::parameter(
                "keep_mesh goes with meshes and images, not with arrays: name what is to be made of them with outputs",
            ));
        }
        for artifact in made_of_input() {
            let named = artifact.forms.iter().find(|form| self.has(form));
            if let (Some(form), Some(what)) = (named, format.lacks(artifact)) {
                return Err(Error::parameter(format_args!("{} is made of {what}: leave it out of outputs", form.file)));
            }
        }
        Ok(())
    }

    /// Refuses outputs that jobs with these parameters, on files of this format, do not have.
    pub fn check(&self, parameters: &Parameters, format: InputFormat) -> Result<()> {
        if self.mesh && parameters.subdivide.is_some() {
            return Err(Error::parameter(format_args!(
                "keep_mesh does not go with {}, by which another mesh is clustered: name what is to be made of that \
                 with outputs",
                Name::SUBDIVIDE
            )));
        }
        match self.outputs.first().filter(|_| MESH.lacks(parameters) == Some(Need::Labels)) {
            Some(name) => Err(Error::parameter(format_args!(
                "a whole hierarchy has labels at every number of clusters: give clusters{}, {name}",
                if can_be_kept(format) { ", or keep_mesh=true instead of outputs" } else { "" }
            ))),
            None => Ok(()),
        }
    }
}

fn can_be_kept(format: InputFormat) -> bool {
    !format.is_of_points() || format.is_image()
}

/// The outputs that are made of the mesh or the points.
pub(crate) fn made_of_input() -> impl Iterator<Item = &'static Artifact> {
    ALL.into_iter().filter(|artifact| artifact.is_served && artifact.is_made_of_input())
}

fn forms() -> impl Iterator<Item = &'static Form> {
    made_of_input().flat_map(|artifact| artifact.forms)
}

/// The files that a list of names means: `mesh.ply` that file, `mesh` the first form of that output.
pub(crate) fn files<'a>(names: impl Iterator<Item = &'a str>) -> Result<Vec<String>> {
    let mut files = Vec::new();
    for name in names.map(str::trim) {
        let by_name =
            made_of_input().find(|artifact| artifact.name == name).and_then(|artifact| artifact.forms.first());
        let form = by_name.or_else(|| forms().find(|form| form.file == name)).ok_or_else(|| {
            let known: Vec<&str> = forms().map(|form| form.file).collect();
            Error::parameter(format_args!("outputs must be of {}, not {}", known.join(", "), Quoted(name)))
        })?;
        if !files.iter().any(|file| file == form.file) {
            files.push(form.file.to_owned());
        }
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tesserae_mesh::parameters::{Algorithm, Subdivide};

    #[test]
    fn outputs_are_named_by_file_or_by_name() {
        let named = |text: &str| files(text.split(','));
        assert_eq!(named("mesh, mesh.ply,mesh.glb"), Ok(vec!["mesh.glb".to_owned(), "mesh.ply".to_owned()]));
        for text in ["labels.npy", "report", "mesh.stl", "", "mesh,,"] {
            let error = named(text).expect_err(text);
            assert!(error.message.contains("mesh.glb"), "{error}");
        }
    }

    #[test]
    fn a_whole_hierarchy_has_no_named_outputs_but_may_keep_its_mesh() {
        let [ply, png, npy] = ["ply", "png", "npy"].map(|name| InputFormat::from_name(name).expect("a format"));
        let whole = Parameters { algorithm: Algorithm::Pml, ..Parameters::default() };
        let cut = Parameters { clusters: Some(3), ..whole.clone() };
        let named = Kept { outputs: vec!["mesh.glb".to_owned()], mesh: false };
        let mesh = Kept { outputs: Vec::new(), mesh: true };
        assert!(named.check(&cut, ply).is_ok() && mesh.check(&whole, ply).is_ok());
        for (format, can_be_kept) in [(ply, true), (png, true), (npy, false)] {
            let error = named.check(&whole, format).expect_err("labels at every number");
            assert_eq!(error.message.contains("keep_mesh"), can_be_kept, "{}", error.message);
        }
        let divided = Parameters { clusters: Some(3), subdivide: Some(Subdivide::Auto), ..Parameters::default() };
        assert!(named.check(&divided, ply).is_ok());
        assert!(mesh.check(&divided, ply).expect_err("another mesh").message.contains("outputs"));
        assert_eq!(named.forms().count(), 1);
        for artifact in made_of_input() {
            assert_eq!(mesh.gives(artifact, ply), artifact.needs(Need::Mesh));
            assert_eq!(named.gives(artifact, ply), artifact.name == "mesh");
            assert_eq!(mesh.gives(artifact, png), ["graph", "clusters", "means"].contains(&artifact.name));
        }
    }

    #[test]
    fn nothing_leaves_no_trace_in_what_is_stored() {
        assert_eq!(serde_json::to_string(&Kept::default()).expect("JSON"), "{}");
        assert_eq!(serde_json::from_str::<Kept>("{}").expect("JSON"), Kept::default());
    }
}
