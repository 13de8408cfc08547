//! Which files are written of each mesh and each number of clusters.

use std::path::Path;

use tesserae_mesh::artifacts::{
    Artifact, Form, HIERARCHY, HIERARCHY_TSR, LABELS, LABELS_NPY, Need, REPORT, REPORT_JSON,
};

use super::Arguments;
use crate::by_extension::FLAG;
use crate::files::Target;
use crate::inputs::MeshFile;
use crate::patterns::{CLUSTERS, NAME};
use crate::results::OutputFile;
use crate::summary::SummaryRow;

/// The files of a mesh.
pub struct Files {
    /// Of the run, where one hierarchy is cut at several numbers of clusters: its report and itself.
    pub of_run: Vec<OutputFile>,
    /// Of each number of clusters, or of a run without one.
    pub of_clusters: Vec<(Option<u64>, Vec<OutputFile>)>,
}

impl Files {
    /// Those of this mesh.
    pub fn new(arguments: &Arguments, mesh: &MeshFile) -> Self {
        let fill = |files: Vec<OutputFile>, clusters| -> Vec<OutputFile> {
            files.iter().map(|file| file.filled(mesh.stem(), clusters)).collect()
        };
        let (of_run, of_each) = split(arguments);
        let clusters: Vec<Option<u64>> = match &arguments.clusters[..] {
            [] => vec![None],
            clusters => clusters.iter().copied().map(Some).collect(),
        };
        let of_clusters = clusters.into_iter().map(|clusters| (clusters, fill(of_each.clone(), clusters))).collect();
        Self { of_run: fill(of_run, None), of_clusters }
    }

    /// All of them.
    pub fn all(&self) -> impl Iterator<Item = &OutputFile> {
        self.of_run.iter().chain(self.of_clusters.iter().flat_map(|(_, files)| files))
    }
}

/// The outputs of a run that is cut, and those of each number of clusters. Their names have patterns still.
fn split(arguments: &Arguments) -> (Vec<OutputFile>, Vec<OutputFile>) {
    let is_of_run = |file: &OutputFile| arguments.is_cut() && (file.needs(Need::Report) || file.needs(Need::Hierarchy));
    let parameters = arguments.first();
    let in_folders = arguments.outputs.folders().iter().flat_map(|folder| {
        const STORED: [(&Artifact, &Form); 3] =
            [(&LABELS, &LABELS_NPY), (&HIERARCHY, &HIERARCHY_TSR), (&REPORT, &REPORT_JSON)];
        let made = STORED.into_iter().filter(|(artifact, _)| artifact.is_made(&parameters));
        made.map(|(artifact, form)| in_folder(arguments, folder, artifact, form, &is_of_run))
    });
    arguments.outputs.files().iter().cloned().chain(in_folders).partition(is_of_run)
}

/// A file that `-o DIR/` means.
fn in_folder(
    arguments: &Arguments,
    folder: &Path,
    artifact: &'static Artifact,
    form: &'static Form,
    is_of_run: &dyn Fn(&OutputFile) -> bool,
) -> OutputFile {
    let file = |stem: &str| OutputFile {
        flag: FLAG,
        artifact,
        form,
        target: Target::File(folder.join(format!("{stem}.{}", form.extension()))),
    };
    let plain = file(NAME);
    match arguments.clusters.is_empty() || is_of_run(&plain) {
        true => plain,
        false => file(&format!("{NAME}-{CLUSTERS}")),
    }
}

/// What is wrong with the patterns in names of outputs: each file must be of one mesh and one number of clusters.
pub fn check_patterns(arguments: &Arguments, meshes: usize) -> Result<(), String> {
    let (of_run, of_each) = split(arguments);
    if let Some(file) = of_run.iter().find(|file| file.has_pattern(CLUSTERS)) {
        let name = file.named();
        return Err(format!("one hierarchy is cut at all numbers of clusters: leave {CLUSTERS} out of {name}"));
    }
    if let Some(file) = of_each.iter().find(|file| file.has_pattern(CLUSTERS) && arguments.clusters.is_empty()) {
        return Err(format!("{} has {CLUSTERS} in its name: give --clusters, or leave {CLUSTERS} out", file.named()));
    }
    let lacks_name = of_run.iter().chain(&of_each).filter(|_| meshes > 1).find(|file| !file.has_pattern(NAME));
    let several = arguments.clusters.len() > 1;
    let lacks_clusters = of_each.iter().filter(|_| several).find(|file| !file.has_pattern(CLUSTERS));
    let (file, pattern, what) = match (lacks_name, lacks_clusters) {
        (Some(file), _) => (file, NAME, "mesh"),
        (None, Some(file)) => (file, CLUSTERS, "number of clusters"),
        (None, None) => return Ok(()),
    };
    let example = match (meshes > 1, several && !of_run.iter().any(|of_run| of_run.target == file.target)) {
        (true, true) => format!("{NAME}-{CLUSTERS}"),
        (true, false) => NAME.to_owned(),
        (false, _) => CLUSTERS.to_owned(),
    };
    Err(format!(
        "{} would be written once for each {what}: put {pattern} into its name, as {example}.{}",
        file.named(),
        file.form.extension()
    ))
}

/// How to write something, where nothing was.
pub fn advice(arguments: &Arguments, rows: &[SummaryRow]) -> String {
    let meshes = arguments.meshes.files();
    let name = match &meshes[..] {
        [mesh] => mesh.stem().to_string_lossy().into_owned(),
        _ => NAME.to_owned(),
    };
    let name = if arguments.clusters.len() > 1 { format!("{name}-{CLUSTERS}") } else { name };
    let first = arguments.first();
    let examples = match LABELS.lacks(&first) {
        Some(Need::Labels) => format!("-o {name}.tsr (the hierarchy)"),
        Some(_) => format!("--remesh {name}.ply"),
        None if rows.iter().any(|row| row.are_items) => match rows.iter().all(|row| row.are_pixels) {
            true => format!("-o {name}-labels.png (labels) or --means {name}-means.png (to look at)"),
            false => format!("-o {name}.npy (labels)"),
        },
        None => format!("-o {name}.npy (labels) or -o {name}.glb (to look at)"),
    };
    format!("nothing was written: add {examples}")
}
