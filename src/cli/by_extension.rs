//! The output that `-o FILE` names by its extension alone.

use std::path::PathBuf;

use tesserae_mesh::artifacts::{ALL, Artifact, Form, LABELS, MESH, REPORT};

use super::files::{Extension, Target};

/// The flag.
pub const FLAG: &str = "-o";

/// Outputs that an extension means where several have it, the first of these that does: the report as JSON, the mesh
/// with its clusters as a geometry, else the labels.
static USUAL: [&Artifact; 3] = [&REPORT, &MESH, &LABELS];

/// A value of `-o`.
#[derive(Debug, Clone)]
pub enum Named {
    /// An output.
    File(&'static Artifact, &'static Form, Target),
    /// A folder for labels, report and hierarchy.
    Folder(PathBuf),
}

/// Takes the name of a file or, if `takes_folders`, of a folder. `writes` says which outputs the command has.
pub fn parse(path: PathBuf, writes: fn(&Artifact) -> bool, takes_folders: bool) -> Result<Named, String> {
    let is_folder = path.to_string_lossy().ends_with(std::path::is_separator) || path.is_dir();
    match is_folder {
        true if takes_folders => Ok(Named::Folder(path)),
        true => Err("it is a folder: give the name of a file in it".to_owned()),
        false => {
            let target = Target::from(path);
            file(&target, writes).map(|(artifact, form)| Named::File(artifact, form, target))
        }
    }
}

/// The output and the form of a file of this name.
fn file(target: &Target, writes: fn(&Artifact) -> bool) -> Result<(&'static Artifact, &'static Form), String> {
    let extension = match target.extension() {
        Extension::Is(extension) => extension.to_string_lossy().to_ascii_lowercase(),
        Extension::None | Extension::Missing => {
            return Err(format!("the extension says what is written, {}", known(writes)));
        }
    };
    let fits = |form: &Form| target.ends_in(form.extension());
    meant(&extension, &fits, writes).map_err(|several| match several.is_empty() {
        true => format!("no output has the extension .{extension}; there are {}", known(writes)),
        false => format!("say which output it is: {}", flags(&several, &extension)),
    })
}

/// The output and the form of a file whose name has this last extension, and what `fits` of further ones; or else the
/// outputs that it may be.
fn meant(
    extension: &str,
    fits: &dyn Fn(&Form) -> bool,
    writes: fn(&Artifact) -> bool,
) -> Result<(&'static Artifact, &'static Form), Vec<&'static Artifact>> {
    let may_be = |artifact: &&Artifact| {
        writes(artifact) && !artifact.flags.is_empty() && artifact.forms.iter().any(|form| has(form, extension))
    };
    let able: Vec<&'static Artifact> = ALL.into_iter().filter(may_be).collect();
    let is_able = |usual: &&Artifact| able.iter().any(|artifact| artifact.name == usual.name);
    let usual = USUAL.into_iter().find(|usual| is_able(usual) && usual.form(extension).is_some());
    let Some(artifact) = usual.or(if able.len() == 1 { able.first().copied() } else { None }) else { return Err(able) };
    let form = artifact.forms.iter().filter(|form| fits(form)).max_by_key(|form| form.extension().len());
    form.map(|form| (artifact, form)).ok_or(able)
}

/// Whether a form has this extension, as a whole or as a part of it: `stl` of `stl.zip`.
fn has(form: &Form, extension: &str) -> bool {
    form.extension().split('.').any(|part| part == extension)
}

/// The flags that write files of this extension, with the names that they take.
fn flags(artifacts: &[&'static Artifact], extension: &str) -> String {
    let of = |artifact: &'static Artifact| {
        artifact.flags.iter().flat_map(move |flag| flag.forms(artifact).map(move |form| (flag, form)))
    };
    let having = artifacts.iter().flat_map(|artifact| of(artifact)).filter(|(_, form)| has(form, extension));
    having.map(|(flag, form)| format!("{} OUT.{}", flag.name, form.extension())).collect::<Vec<_>>().join(" or ")
}

/// The extensions that mean one output.
fn known(writes: fn(&Artifact) -> bool) -> String {
    let mut known: Vec<&str> = Vec::new();
    for extension in ALL.into_iter().flat_map(|artifact| artifact.forms).map(Form::extension) {
        let last = extension.rsplit('.').next().unwrap_or(extension);
        let is_meant = meant(last, &|form| form.extension() == extension, writes).is_ok();
        if is_meant && !known.contains(&extension) {
            known.push(extension);
        }
    }
    known.iter().map(|extension| format!(".{extension}")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use tesserae_mesh::artifacts::Need;

    fn of_job(name: &str) -> Result<(&'static str, &'static str), String> {
        file(&Target::from(PathBuf::from(name)), |_| true).map(|(artifact, form)| (artifact.name, form.file))
    }

    #[test]
    fn an_extension_means_what_most_people_expect() {
        for (name, artifact, form) in [
            ("x.npy", "labels", "labels.npy"),
            ("x.TXT", "labels", "labels.txt"),
            ("x.csv", "labels", "labels.csv"),
            ("x.bin", "labels", "labels.bin"),
            ("x.png", "labels", "labels.png"),
            ("x.json", "report", "report.json"),
            ("x.glb", "mesh", "mesh.glb"),
            ("x.ply", "mesh", "mesh.ply"),
            ("x.obj", "mesh", "mesh.obj"),
            ("x.vtp", "mesh", "mesh.vtp"),
            ("x.tsr", "hierarchy", "hierarchy.tsr"),
            ("x.graphml", "graph", "graph.graphml"),
            ("x.zip", "submeshes", "submeshes.zip"),
            ("x.stl.zip", "submeshes", "submeshes.stl.zip"),
        ] {
            assert_eq!(of_job(name), Ok((artifact, form)), "{name}");
        }
    }

    #[test]
    fn an_extension_that_may_mean_several_outputs_is_refused_with_their_flags() {
        for (name, words) in [
            ("x.stl", vec!["--submeshes OUT.stl.zip", "--remesh OUT.stl"]),
            ("x.npz", vec!["--submeshes OUT.npz", "--clusters-graph OUT.npz", "--remesh-source OUT.npz"]),
            ("x.gif", vec![".gif", ".npy, ", ".glb", ".stl.zip"]),
            ("x", vec!["the extension says", ".npy"]),
            ("-", vec!["the extension says", ".npy"]),
        ] {
            let error = of_job(name).expect_err(name);
            assert!(words.iter().all(|word| error.contains(word)), "{name}: {error}");
        }
        let of_mesh = |name: &str| file(&Target::from(PathBuf::from(name)), |artifact| artifact.needs(Need::Mesh));
        let error = of_mesh("x.json").expect_err("several");
        assert!(error.contains("--clusters-graph OUT.json or --boundaries OUT.json"), "{error}");
        assert!(of_mesh("x.npy").expect_err("none").contains("no output has the extension .npy"));
        assert_eq!(of_mesh("x.csv").map(|(artifact, _)| artifact.name), Ok("clusters"));
    }
}
