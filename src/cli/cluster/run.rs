//! A mesh from its file to its outputs.

use std::collections::HashSet;
use std::path::Path;
use std::sync::OnceLock;
use std::time::Instant;

use tesserae_mesh::artifacts::{Artifact, Choices, Content, LABELS_PNG, LINKAGE_NPY, Labels, Need};
use tesserae_mesh::error::Error;
use tesserae_mesh::hierarchy::Cut;
use tesserae_mesh::hierarchy::linkage::no_single_root;
use tesserae_mesh::job::{
    self, Ahead, InputFile, InputFormat, OnDevice, Outcome, Points, PointsRequest, Prepared, Preparing, Refusal,
    Request, milliseconds,
};
use tesserae_mesh::parameters::{Neighbours, Seeds};
use tesserae_mesh::remesh::Remesh;

use super::Arguments;
use super::check::inputs;
use super::files::Files;
use crate::files::Source;
use crate::inputs::MeshFile;
use crate::places::Output;
use crate::progress::Progress;
use crate::results::{OutputFile, check_places};
use crate::summary::{Balance, SummaryRow};
use crate::{Failure, complain, signals};

/// Where the parts of the bar end: a mesh is read, prepared, then clustered and written for each number of clusters.
const READ: f64 = 0.1;
const PREPARED: f64 = 0.3;
/// The part of clustering in what follows.
const CLUSTERED: f64 = 0.85;

/// The runs of a command.
pub struct Run<'a> {
    pub arguments: &'a Arguments,
    pub choices: Choices,
    pub progress: Progress,
    /// What came out so far.
    pub rows: Vec<SummaryRow>,
}

impl Run<'_> {
    /// Reads a mesh and makes everything of it. Its name is shown if it is one of `several`.
    pub fn mesh(&mut self, mesh: &MeshFile, several: bool) -> Result<(), Failure> {
        let mut begin = Instant::now();
        let input = mesh.source.to_string();
        self.progress.mesh(if several { &input } else { "" });
        let files = Files::new(self.arguments, mesh);
        let (mut prepared, ahead) = self.prepare(mesh, &files)?;
        let cancel = signals::cancel_when_asked();
        cancel.check()?;
        self.check_target(mesh, &prepared)?;
        let mut device = OnDevice::open(self.arguments.device.choice(), ahead, &prepared)?;
        let mut said = HashSet::new();
        let runs = if self.arguments.is_cut() { 1 } else { files.of_clusters.len() };
        for nth in 0..runs {
            let (clusters, of_clusters) = &files.of_clusters[nth];
            if let (true, Some(clusters)) = (nth > 0, *clusters) {
                begin = Instant::now();
                prepared
                    .with_clusters(clusters)
                    .map_err(|refusal| FilesBeside::default().about(&mesh.source, refusal))?;
            }
            let share = (1.0 - PREPARED) / runs as f64;
            let from = PREPARED + share * nth as f64;
            self.progress.stage("clustering", from..from + CLUSTERED * share);
            if let Some(target) = prepared.subject.target() {
                self.progress.hierarchy(prepared.input.items(), target);
            }
            let mut outcome = device.run(&prepared, &cancel, &mut |row| self.progress.row(&row))?;
            self.progress.stage("writing", from + CLUSTERED * share..from + share);
            let of_run = if self.arguments.is_cut() { &files.of_run } else { of_clusters };
            self.write(mesh, &mut outcome, of_run, begin)?;
            let warnings: Vec<&String> =
                outcome.report.warnings.iter().filter(|warning| said.insert((*warning).clone())).collect();
            if !self.arguments.quiet.quiet {
                let say = |warning: &&String| complain(&format!("{input}: warning: {warning}"));
                self.progress.pause(|| warnings.iter().for_each(say));
            }
            if self.arguments.is_cut() {
                self.cuts(mesh, prepared.subject.points(), &outcome, &files, begin)?;
            } else {
                self.rows.push(SummaryRow::new(input.clone(), &outcome.report, outcome.labels.as_deref()));
            }
        }
        Ok(())
    }

    /// From the file to a mesh that is ready to be clustered, and a device that may have been opened meanwhile.
    fn prepare(&mut self, mesh: &MeshFile, files: &Files) -> Result<(Prepared, Ahead), Failure> {
        let Self { arguments, progress, .. } = self;
        let limits = arguments.limits();
        progress.stage("reading", 0.0..READ);
        let reading = Instant::now();
        let (bytes, format) = mesh.read(&limits, &mut |read, length| {
            progress.advance(if length > 0 { read as f64 / length as f64 } else { 0.0 });
        })?;
        let beside = FilesBeside::read(arguments, limits.max_bytes)?;
        let read = milliseconds(reading.elapsed());

        let places: Vec<Output<'_>> = files.all().map(OutputFile::place).collect();
        let resources = mesh.resources(&places);
        let parameters = arguments.first();
        // Until here there is nothing to end in order, and a read that waits for input could not be told to stop.
        signals::cancel_when_asked();
        let outputs: Vec<&Artifact> = files.all().map(|file| file.artifact).collect();
        let FilesBeside { seeds, weights, graph } = &beside;
        let [seeds, weights, graph] = [seeds, weights, graph].map(|file| file.as_ref().map(|file| &file.bytes[..]));
        progress.stage("reading the mesh", READ..PREPARED);
        let mut tell = |step: Preparing| {
            let (what, part) = match step {
                Preparing::Mesh => ("reading the mesh", 0.0),
                Preparing::Surface => ("finding neighbours", 0.4),
                Preparing::Start => ("finding where clusters start", 0.8),
            };
            progress.stage(what, READ + part * (PREPARED - READ)..PREPARED);
        };
        let mut prepare = || match format {
            InputFormat::Mesh(format) => {
                let parameters = &parameters;
                let (bytes, resources) = (&bytes[..], &*resources);
                let outputs = &outputs;
                let request = Request { bytes, format, resources, limits, parameters, seeds, weights, outputs };
                job::open(&request, |opened| opened.prepare_telling(&mut tell)).and_then(|prepared| prepared)
            }
            InputFormat::Points(format) => {
                if format.is_image() && !arguments.is_cut() && arguments.clusters.len() > 1 {
                    return Err(Refusal::from(Error::parameter(
                        "how much the place of a pixel counts depends on the number of clusters: give one for an image",
                    )));
                }
                let parameters = &parameters;
                tell(Preparing::Surface);
                let (bytes, outputs) = (&bytes[..], &outputs[..]);
                let request = PointsRequest { bytes, format, limits, parameters, graph, seeds, weights, outputs };
                job::prepare_points(&request)
            }
        };
        check_made_of(files, format).map_err(Failure::about(&mesh.source))?;
        // ends with its thread joined: a process must not end while a driver is being opened
        let (prepared, ahead) = std::thread::scope(|scope| {
            let ahead = scope.spawn(|| arguments.device.choice().open_ahead(bytes.len()));
            (prepare(), ahead.join().ok().flatten())
        });
        let mut prepared = prepared.map_err(|refusal| beside.about(&mesh.source, refusal))?;
        check_images(files, &prepared).map_err(Failure::about(&mesh.source))?;
        prepared.timings.read = read;
        Ok((prepared, ahead))
    }

    /// Refuses a linkage matrix of a hierarchy with several roots.
    fn check_target(&self, mesh: &MeshFile, prepared: &Prepared) -> Result<(), Failure> {
        match prepared.subject.target() {
            Some(target) if target > 1 && self.arguments.outputs.includes(&LINKAGE_NPY) => {
                let has_features = self.arguments.parameters.features.is_some();
                Err(Failure::about(&mesh.source)(Error::conflict(no_single_root(target, has_features))))
            }
            _ => Ok(()),
        }
    }

    /// Writes the outputs of a run that began at `begin`, the report last.
    fn write(
        &self,
        mesh: &MeshFile,
        outcome: &mut Outcome,
        files: &[OutputFile],
        begin: Instant,
    ) -> Result<(), Failure> {
        let writing = Instant::now();
        let remesh = OnceLock::new();
        let (with_report, others): (Vec<&OutputFile>, Vec<&OutputFile>) =
            files.iter().partition(|file| file.needs(Need::Report));
        self.write_files(mesh, &others, &outcome.content(), &remesh)?;
        self.write_iterations(mesh, outcome, files)?;
        outcome.report.remesh = remesh.get().map(|remesh| remesh.summary);
        outcome.report.timings_ms.write = milliseconds(writing.elapsed());
        outcome.report.timings_ms.total = milliseconds(begin.elapsed());
        self.write_files(mesh, &with_report, &outcome.content(), &remesh)
    }

    fn write_files(
        &self,
        mesh: &MeshFile,
        files: &[&OutputFile],
        content: &Content<'_>,
        remesh: &OnceLock<Remesh>,
    ) -> Result<(), Failure> {
        let (limits, choices) = (self.arguments.outputs.limits(), self.choices);
        let content = Content { limits, choices, is_indented: true, remesh: Some(remesh), ..*content };
        files.iter().enumerate().try_for_each(|(nth, file)| {
            self.progress.advance(nth as f64 / files.len() as f64);
            file.write(&content, &mesh.source)
        })
    }

    /// Writes the labels of iterations beside those of the end.
    fn write_iterations(&self, mesh: &MeshFile, outcome: &Outcome, files: &[OutputFile]) -> Result<(), Failure> {
        let Some(labels) = files.iter().find(|file| file.is_labels()) else { return Ok(()) };
        outcome.snapshots.replay(|iteration, labels_then| {
            let Some(file) = labels.of_iteration(iteration) else { return Ok(()) };
            let places: Vec<Output<'_>> = files.iter().map(OutputFile::place).chain([file.place()]).collect();
            check_places("cluster", &inputs(self.arguments), &places)?;
            let labels = Labels::new(outcome.report.clusters, labels_then);
            let shape = outcome.shape.as_deref();
            file.write(&Content { labels: Some(labels), shape, ..Content::default() }, &mesh.source)
        })
    }

    /// Cuts a hierarchy at each number of clusters and writes what is made of the labels.
    fn cuts(
        &mut self,
        mesh: &MeshFile,
        points: Option<&Points>,
        outcome: &Outcome,
        files: &Files,
        mut begin: Instant,
    ) -> Result<(), Failure> {
        let Some(stored) = &outcome.hierarchy else { return Ok(()) };
        for (clusters, files) in &files.of_clusters {
            let cut = stored.labels_at(clusters.unwrap_or(1)).map_err(Failure::about(&mesh.source))?;
            let row = of_cut(SummaryRow::new(mesh.source.to_string(), &outcome.report, None), &cut);
            let is_table = |file: &OutputFile| file.artifact.is_of_points && file.artifact.is_made_of_input();
            let points = points.filter(|_| files.iter().any(is_table));
            let table = points.map(|points| points.table(&cut.labels, cut.clusters()));
            let remesh = OnceLock::new();
            let content = Content {
                labels: Some(Labels { clusters: row.clusters.unwrap_or(0), ..Labels::from(&cut) }),
                points: table.as_ref(),
                ..outcome.content()
            };
            self.write_files(mesh, &files.iter().collect::<Vec<_>>(), &content, &remesh)?;
            let remesh = remesh.get().map(|remesh| remesh.summary);
            self.rows.push(SummaryRow { remesh, seconds: begin.elapsed().as_secs_f64(), ..row });
            begin = Instant::now();
        }
        Ok(())
    }
}

/// The row of a cut.
fn of_cut(row: SummaryRow, cut: &Cut) -> SummaryRow {
    let clusters = cut.clusters();
    let energy = Some(cut.energy).filter(|energy| energy.is_finite());
    SummaryRow { clusters: Some(clusters), balance: Balance::of(&cut.labels, clusters), energy, ..row }
}

/// Files besides the mesh or the points.
#[derive(Default)]
struct FilesBeside {
    seeds: Option<FileBeside>,
    weights: Option<FileBeside>,
    graph: Option<FileBeside>,
}

/// A file, and what it holds.
struct FileBeside {
    source: Source,
    bytes: Vec<u8>,
}

impl FilesBeside {
    fn read(arguments: &Arguments, max_bytes: u64) -> Result<Self, Failure> {
        let read = |path: &Path| {
            let source = Source::from(path.to_owned());
            let bytes = source.read(max_bytes)?;
            Ok::<_, Failure>(FileBeside { source, bytes })
        };
        let seeds = match &arguments.parameters.seeds {
            Seeds::File(path) => Some(path),
            Seeds::Coarse | Seeds::Merged | Seeds::Morton | Seeds::Random | Seeds::Listed => None,
        };
        let graph = match &arguments.parameters.graph {
            Some(Neighbours::File(path)) => Some(path),
            Some(Neighbours::Nearest(_) | Neighbours::Grid { .. }) | None => None,
        };
        Ok(Self {
            seeds: seeds.map(|path| read(path)).transpose()?,
            weights: arguments.weights.as_deref().map(read).transpose()?,
            graph: graph.map(|path| read(path)).transpose()?,
        })
    }

    /// The failure of a refusal, with the name of the file that it is about.
    fn about(&self, mesh: &Source, refusal: Refusal) -> Failure {
        let source = |file: &'_ Option<FileBeside>| file.as_ref().map(|file| file.source.clone());
        let file = match refusal.file {
            Some(InputFile::Mesh) => Some(mesh.clone()),
            Some(InputFile::Seeds) => source(&self.seeds),
            Some(InputFile::Weights) => source(&self.weights),
            Some(InputFile::Graph) => source(&self.graph),
            None => None,
        };
        match file {
            Some(file) => Failure::about(&file)(refusal.error),
            None => refusal.error.into(),
        }
    }
}

/// Refuses labels as an image where they have no rows and columns.
fn check_images(files: &Files, prepared: &Prepared) -> tesserae_mesh::error::Result<()> {
    let has_rows = prepared.subject.points().is_some_and(|points| points.set.shape.len() == 2);
    match files.all().find(|file| file.form.file == LABELS_PNG.file && !has_rows) {
        Some(file) => Err(Error::parameter(format_args!(
            "{} is of labels in rows and columns, of an image or a grid of two dimensions: take .npy",
            file.named()
        ))),
        None => Ok(()),
    }
}

/// Refuses outputs that are made of something else.
fn check_made_of(files: &Files, format: InputFormat) -> tesserae_mesh::error::Result<()> {
    for file in files.all() {
        if let Some(what) = format.lacks(file.artifact) {
            return Err(Error::parameter(format_args!("{} is made of {what}: leave it out", file.named())));
        }
    }
    Ok(())
}
