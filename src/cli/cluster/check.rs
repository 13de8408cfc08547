//! What needs no mesh to be refused.

use tesserae_mesh::artifacts::{Choices, LINKAGE_NPY, Need};
use tesserae_mesh::parameters::{Neighbours, Seeds, Subdivide};

use super::Arguments;
use super::files::{Files, check_patterns};
use crate::Failure;
use crate::files::{Source, Target};
use crate::results::{OutputFile, check_places};

/// Refuses what contradicts itself, outputs that cannot be written, and outputs that would replace another or an input.
pub fn check(arguments: &Arguments) -> Result<Choices, Failure> {
    let usage = |message: String| Failure::Usage("cluster", message);
    check_numbers(arguments).map_err(usage)?;
    check_device(arguments).map_err(usage)?;
    arguments.outputs.check("cluster")?;
    let choices = arguments.choices.choices("cluster", arguments.outputs.files())?;
    check_outputs(arguments).map_err(usage)?;
    let meshes = arguments.meshes.files();
    check_patterns(arguments, meshes.len()).map_err(usage)?;
    let files: Vec<Files> = meshes.iter().map(|mesh| Files::new(arguments, mesh)).collect();
    let places: Vec<_> = files.iter().flat_map(|files| files.all().map(OutputFile::place)).collect();
    check_places("cluster", &inputs(arguments), &places)?;
    Ok(choices)
}

/// Where everything comes from, after what it is.
pub fn inputs(arguments: &Arguments) -> Vec<(&'static str, Source)> {
    let mut inputs: Vec<_> = arguments.meshes.files().into_iter().map(|mesh| ("the mesh", mesh.source)).collect();
    if let Seeds::File(path) = &arguments.parameters.seeds {
        inputs.push(("the list of seeds", Source::from(path.clone())));
    }
    if let Some(path) = &arguments.weights {
        inputs.push(("the weights", Source::from(path.clone())));
    }
    if let Some(Neighbours::File(path)) = &arguments.parameters.graph {
        inputs.push(("the graph", Source::from(path.clone())));
    }
    inputs
}

/// Checks the parameters with each number of clusters.
fn check_numbers(arguments: &Arguments) -> Result<(), String> {
    let numbers = &arguments.clusters;
    let listed = matches!(arguments.parameters.seeds, Seeds::File(_));
    for clusters in numbers {
        let parameters = arguments.of_clusters(Some(*clusters));
        parameters.check_values().map_err(|error| error.message)?;
    }
    arguments.first().check(listed).map_err(|error| error.message)?;
    if numbers.len() < 2 {
        return Ok(());
    }
    if let Some((_, twice)) = numbers.iter().enumerate().find(|(at, number)| numbers[..*at].contains(number)) {
        return Err(format!("--clusters has a number twice: {twice}"));
    }
    if listed {
        return Err("a list of seeds has one number of clusters: leave --clusters out".to_owned());
    }
    if arguments.parameters.subdivide == Some(Subdivide::Auto) {
        return Err("--subdivide auto goes with one number of clusters: give a number, as --subdivide 1".to_owned());
    }
    Ok(())
}

fn check_device(arguments: &Arguments) -> Result<(), String> {
    if let Some(message) = arguments.device.contradiction() {
        return Err(message);
    }
    let algorithm = arguments.parameters.algorithm;
    match algorithm.is_reference() && arguments.device.choice().wants_gpu() {
        true => Err(format!(
            "the algorithm {} is a sequential reference that no gpu runs: take --device cpu or auto",
            algorithm.name()
        )),
        false => Ok(()),
    }
}

/// Refuses outputs of what the job does not make.
fn check_outputs(arguments: &Arguments) -> Result<(), String> {
    let (outputs, parameters) = (&arguments.outputs, arguments.first());
    let lacking =
        |need| outputs.files().iter().find(|file| file.artifact.lacks(&parameters).is_some_and(|lacks| lacks == need));
    if let Some(file) = lacking(Need::Hierarchy) {
        let (output, name) = (file.named(), parameters.algorithm.name());
        return Err(format!("{output} goes with hierarchies (pml, ml, hr), not with the algorithm {name}"));
    }
    if let Some(file) = lacking(Need::Shapes) {
        return Err(format!("{} goes with --energy planes or shapes", file.named()));
    }
    let is_file = |file: &OutputFile| file.is_labels() && file.target != Target::Stdout;
    let has_labels = outputs.files().iter().any(is_file) || !outputs.folders().is_empty();
    if parameters.snapshots.is_some() && !has_labels {
        return Err("--snapshots needs --labels OUT, a file, beside which the labels of iterations are written, as \
                    OUT.iteration-6.npy"
            .to_owned());
    }
    if lacking(Need::Labels).is_some() {
        return Err("a whole hierarchy has labels at every number of clusters: give --clusters as well, or write the \
                    hierarchy with --hierarchy OUT.tsr and take labels from it with `tesserae cut`"
            .to_owned());
    }
    if let Some(file) = lacking(Need::Faces) {
        return Err(format!(
            "{} is about the faces of the mesh, which --subdivide divides: leave one of them out",
            file.named()
        ));
    }
    if outputs.includes(&LINKAGE_NPY) {
        if parameters.optimizes() {
            return Err("--linkage needs a nested tree, in which no face moves: add --optimize none".to_owned());
        }
        if parameters.clusters.is_some_and(|clusters| clusters > 1) {
            return Err("--linkage needs a whole tree: leave --clusters out".to_owned());
        }
    }
    Ok(())
}
