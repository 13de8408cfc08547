//! Flat clusterings as jobs.

use std::time::{Duration, Instant};

use super::iterations::Iterations;
use super::watched::Watched;
use super::{Clustered, Coarse, CoarseSpec, Method, Prepared, Viewer, finite};
use crate::cluster::coarse::Start;
use crate::cluster::fast;
use crate::cluster::flat::{self, Clustering, Options};
use crate::cluster::hierarchy::hierarchical;
use crate::cluster::numbers;
use crate::cluster::quality::Quality;
use crate::cluster::record::Record;
use crate::cluster::reference::acvd::acvd;
use crate::cluster::reference::variational::variational;
use crate::cluster::relocation::{self, Relocation};
use crate::cluster::run::{self, Phase};
use crate::cluster::seeds::{self, SeedFaces};
use crate::device::cpu::CpuDevice;
use crate::device::{Cancel, Device, Ending, Steps};
use crate::energy::{Functional, LatticeEnergy};
use crate::error::{Error, Result};
use crate::parameters::{Name, Seeds};
use crate::report::{DeviceKind, Iteration, Row};
use crate::surface::{Items, Moves};

/// A job, and its items.
#[derive(Clone, Copy)]
pub(super) struct Job<'a, E: Functional> {
    /// The job.
    pub prepared: &'a Prepared,
    /// The items of its subject.
    pub items: &'a Items<E>,
}

/// Runs boundary-based clustering from many clusters that merge.
pub(super) fn run_coarse<E: Functional>(
    job: Job<'_, E>,
    coarse: &Coarse<E>,
    device: &mut dyn Device<E>,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
) -> Result<Clustered> {
    let items = job.items;
    let started = Instant::now();
    let start = coarse.start(items, device, cancel)?;
    let mut run = Run::new(job, started, &start, on_row);
    let mut clustering = run.phases(device, |steps, keep, record| {
        flat::boundary_based(items, &start.labels, coarse.spec.options(items.moves), steps, cancel, keep, record)
    })?;
    if let Some(quality) = coarse.relocation_after(items, clustering.ending) {
        let labels = std::mem::take(&mut clustering.labels);
        let cheaper = labels_of_cheaper(items, coarse.spec, job.prepared.viewer.as_deref(), cancel);
        let relocation = Relocation { graph: items, quality, pairs: coarse.spec.pairs(), cancel };
        let fast = || coarse.fast_labels(items, cancel);
        let (labels, ending) =
            relocation.labels(labels, device, fast, cheaper, &mut |phase, energy, moves, labels| {
                run.add_row(phase, energy, moves, labels);
            })?;
        clustering.labels = run.record.numbered_like_last(labels);
        if ending == Ending::WorkLimit {
            clustering.ending = ending;
        }
    }
    if start.is_bounded && clustering.ending == Ending::Converged {
        clustering.ending = Ending::WorkLimit;
    }
    Ok(run.ended(device, clustering))
}

impl<E: Functional> Coarse<E> {
    /// Which moves of whole clusters follow the phases, if any: none where the caller's limit ended them, and where
    /// moves are connected, no swaps alone: there they pay on any image, and take five times as long as the rest.
    fn relocation_after(&self, items: &Items<E>, ending: Ending) -> Option<Quality> {
        let is_cut_short = ending == Ending::IterationLimit && self.spec.max_iterations.is_some();
        let has_more = || items.moves == Moves::Free || cheaper_than(items, self.spec).next().is_some();
        let is_worth_it = |quality: &Quality| !is_cut_short && (*quality != Quality::Fast || has_more());
        self.spec.relocation(items.faces()).filter(is_worth_it)
    }

    /// The labels of the phases of quality `fast`.
    fn fast_labels(&self, items: &Items<E>, cancel: &Cancel) -> Result<Vec<u32>> {
        fast::labels(items, self.spec.clusters, self.spec.seed, cancel)
    }

    /// The labels of a run without a report.
    fn labels(&self, items: &Items<E>, viewer: Option<&dyn Viewer>, cancel: &Cancel) -> Result<Vec<u32>> {
        let (cpu, record) = (&mut CpuDevice::new(), &mut Record::new(None));
        let device = &mut Watched::new(cpu, items, viewer, false);
        let start = self.start(items, device, cancel)?;
        let mut steps = device.open(items, &start.component_of_cluster)?;
        let options = self.spec.options(items.moves);
        let run = flat::boundary_based(items, &start.labels, options, steps.as_mut(), cancel, &mut |_| {}, record)?;
        drop(steps);
        match self.relocation_after(items, run.ending) {
            Some(quality) => {
                let relocation = Relocation { graph: items, quality, pairs: self.spec.pairs(), cancel };
                let cheaper = labels_of_cheaper(items, self.spec, viewer, cancel);
                let fast = || self.fast_labels(items, cancel);
                let on_change = &mut |_, _, _, labels: &[u32]| show(items, viewer, labels);
                Ok(relocation.labels(run.labels, device, fast, cheaper, on_change)?.0)
            }
            None => Ok(run.labels),
        }
    }
}

/// A job whose result another one mixes in.
#[derive(Debug, Clone, Copy)]
enum Cheaper {
    Default,
    Parallel,
    Sequential,
    Acvd,
}

/// Up to this number of items, points are also merged one pair after the other.
const FEW_ITEMS: usize = 10_000;

/// Squares of numbers of neighbours, summed up: with more, points are not merged one by one, because every merge looks
/// at all neighbours.
const FEW_PAIRS: usize = 1 << 24;

/// With more than this, and more than [`PAIRS_AN_ITEM`], there are hubs: each move of one by `acvd` looks at all
/// neighbours.
const PAIRS_AT_HUBS: usize = 1 << 22;

/// The same for each item.
const PAIRS_AN_ITEM: usize = 64;

/// Passes of `acvd` by normals in the default quality: it converges slowly, and its clusters settle afterwards.
const PASSES_BY_NORMALS: u32 = 16;

/// The jobs whose results a job of this quality mixes in. Clusters of few items are as good as their start, so that
/// small sets of points have all of them, unless they start from merges. By normals, `acvd` to its end takes 5 to 12
/// times as long as all else on large meshes, and ends no lower on average.
fn cheaper_than<E: Functional>(items: &Items<E>, spec: CoarseSpec) -> impl Iterator<Item = Cheaper> {
    let (is_default, is_best) = (spec.quality == Quality::Default, spec.quality == Quality::Best);
    let square = |item| items.neighbours_of(item).len().pow(2);
    let pairs = if is_default || is_best { (0..items.faces() as u32).map(square).sum() } else { usize::MAX };
    let has_hubs = items.moves == Moves::Free && pairs > PAIRS_AT_HUBS.max(PAIRS_AN_ITEM * items.faces());
    let may_be_few = items.moves == Moves::Connected && !spec.is_merged;
    let are_few = may_be_few && items.faces() <= FEW_ITEMS && pairs <= FEW_PAIRS;
    let is_large = spec.energy.is_of_normals() && items.faces() > relocation::SMALL;
    let has_few_clusters = spec.clusters <= relocation::FEW_CLUSTERS as u64 && !is_large;
    let jobs = [
        (Cheaper::Default, is_best),
        (Cheaper::Parallel, are_few || is_best),
        (Cheaper::Acvd, are_few || (is_best || is_default && has_few_clusters) && !has_hubs),
        (Cheaper::Sequential, are_few),
    ];
    jobs.into_iter().filter_map(|(job, is_wanted)| is_wanted.then_some(job))
}

/// What the cheaper jobs end with. They show their labels as the job does that mixes them in.
fn labels_of_cheaper<E: Functional>(
    items: &Items<E>,
    spec: CoarseSpec,
    viewer: Option<&dyn Viewer>,
    cancel: &Cancel,
) -> impl Iterator<Item = Result<Vec<u32>>> {
    cheaper_than(items, spec).map(move |job| labels_of(job, items, spec, viewer, cancel))
}

/// What a job ends with. It runs on the cpu, whatever the device: labels are the same.
fn labels_of<E: Functional>(
    job: Cheaper,
    items: &Items<E>,
    spec: CoarseSpec,
    viewer: Option<&dyn Viewer>,
    cancel: &Cancel,
) -> Result<Vec<u32>> {
    let mut cpu = CpuDevice::new();
    let is_hierarchy = matches!(job, Cheaper::Parallel | Cheaper::Sequential);
    let mut device = Watched::new(&mut cpu, items, viewer, is_hierarchy);
    Ok(match job {
        Cheaper::Default => {
            let spec = CoarseSpec { quality: Quality::Default, ..spec };
            Coarse::new(items, spec)?.labels(items, viewer, cancel)?
        }
        Cheaper::Parallel => {
            let options = spec.as_hierarchy();
            hierarchical(items, &options, &mut device, cancel, &mut |_| {}, &mut |_| {})?.labels
        }
        Cheaper::Sequential => {
            let options = spec.as_sequential_hierarchy();
            hierarchical(items, &options, &mut device, cancel, &mut |_| {}, &mut |_| {})?.labels
        }
        Cheaper::Acvd => {
            let seeds = seeds::choose(items, spec.clusters, &Seeds::Morton, spec.seed, None)?;
            let mut options = Options { refine: false, ..spec.options(items.moves) };
            if spec.energy.is_of_normals() && spec.quality == Quality::Default {
                let most = options.max_iterations.unwrap_or(PASSES_BY_NORMALS);
                options.max_iterations = Some(most.min(PASSES_BY_NORMALS));
            }
            let mut steps = device.open(items, &seeds.component_of_cluster)?;
            let record = &mut Record::new(None);
            acvd(items, &seeds, options, steps.as_mut(), cancel, &mut |_| {}, record)?.labels
        }
    })
}

/// Shows labels, if that is due.
fn show<E: Functional>(items: &Items<E>, viewer: Option<&dyn Viewer>, labels: &[u32]) {
    if let Some(viewer) = viewer.filter(|viewer| viewer.is_due()) {
        viewer.show(items.in_upload_order(labels));
    }
}

/// Runs a flat algorithm from seeds.
pub(super) fn run_seeded<E: Functional>(
    job: Job<'_, E>,
    method: Method,
    seeds: &SeedFaces,
    options: Options,
    device: &mut dyn Device<E>,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
) -> Result<Clustered> {
    if method != Method::BoundaryBased && device.info().kind == DeviceKind::Gpu {
        return Err(Error::unsuitable(format_args!(
            "the device must be cpu or auto for this algorithm, a sequential reference that no gpu runs: {}",
            job.prepared.spec.reported().algorithm.name()
        )));
    }
    let items = job.items;
    let started = Instant::now();
    let (labels, component_of_cluster) = (seeds.labels(items.faces()), seeds.component_of_cluster.clone());
    let start = Start { labels, component_of_cluster, is_bounded: false };
    let mut run = Run::new(job, started, &start, on_row);
    let clustering = run.phases(device, |steps, keep, record| match method {
        Method::BoundaryBased => flat::boundary_based(items, &start.labels, options, steps, cancel, keep, record),
        Method::Acvd => acvd(items, seeds, options, steps, cancel, keep, record),
        Method::Variational => variational(items, seeds, options, cancel, keep, record),
    })?;
    Ok(run.ended(device, clustering))
}

/// A run, and what it reports.
struct Run<'a, E: Functional> {
    job: Job<'a, E>,
    started: Instant,
    start: &'a Start,
    on_row: &'a mut dyn FnMut(Row),
    iterations: Iterations,
    record: Record,
    upload: Duration,
}

impl<'a, E: Functional> Run<'a, E> {
    fn new(job: Job<'a, E>, started: Instant, start: &'a Start, on_row: &'a mut dyn FnMut(Row)) -> Self {
        let record = Record::new(job.prepared.spec.snapshots.clone());
        Self { job, started, start, on_row, iterations: Iterations::default(), record, upload: Duration::ZERO }
    }

    /// Runs `cluster` on a device that is opened with the clusters of the start.
    fn phases(
        &mut self,
        device: &mut dyn Device<E>,
        cluster: impl FnOnce(&mut dyn Steps, &mut dyn FnMut(run::Row), &mut Record) -> Result<Clustering>,
    ) -> Result<Clustering> {
        let opened = Instant::now();
        let mut steps = device.open(self.job.items, &self.start.component_of_cluster)?;
        self.upload = opened.elapsed();
        let Self { job, started, on_row, iterations, record, .. } = self;
        let mut keep = |row: run::Row| {
            let row = iteration(row, finite(job.items.energy(row.energy)), *started);
            on_row(Row::Iteration(row.clone()));
            iterations.add(row);
        };
        cluster(steps.as_mut(), &mut keep, record)
    }

    /// Adds a row after the phases, and keeps the labels if they are wanted.
    fn add_row(&mut self, phase: Phase, energy: LatticeEnergy, moves: u64, labels: &[u32]) {
        let number = self.iterations.rows.last().map_or(0, |row| row.iteration + 1);
        let row = run::Row { iteration: number, round: None, phase, energy, moves };
        let row = iteration(row, finite(self.job.items.energy(energy)), self.started);
        (self.on_row)(Row::Iteration(row.clone()));
        self.iterations.add(row);
        show(self.job.items, self.job.prepared.viewer.as_deref(), labels);
        if self.record.wants(number) {
            // clusters that move as a whole leave gaps between the numbers
            let labels = self.record.numbered_like_last(numbers::compact(labels));
            self.record.keep(number, labels);
        }
    }

    fn ended(self, device: &dyn Device<E>, clustering: Clustering) -> Clustered {
        let cluster = self.started.elapsed() - self.upload;
        Clustered {
            device: device.info().clone(),
            clusters: self.start.component_of_cluster.len(),
            tree: None,
            iterations: self.iterations.rows,
            levels: Vec::new(),
            shapes: None,
            warnings: warnings(self.job.prepared.spec.reported().max_iterations, clustering.ending, &self.record),
            snapshots: self.record,
            upload: self.upload,
            cluster,
            initial: Some(clustering.initial),
            labels: clustering.labels,
        }
    }
}

/// A row of a run as a row of the report; `energy` in source units.
pub(super) fn iteration(row: run::Row, energy: Option<f64>, started: Instant) -> Iteration {
    Iteration {
        iteration: row.iteration,
        phase: row.phase,
        round: row.round,
        energy,
        moves: row.moves,
        elapsed_us: started.elapsed().as_micros() as u64,
    }
}

/// What is unusual about the run.
pub(super) fn warnings(max_iterations: Option<u32>, ending: Ending, record: &Record) -> Vec<String> {
    let mut warnings = match (ending, max_iterations) {
        (Ending::IterationLimit, Some(limit)) => {
            vec![format!("stopped by {}, maybe before it had converged: {limit}", Name::MAX_ITERATIONS)]
        }
        (Ending::WorkLimit, _) => vec![
            "stopped by the bound on work, maybe before it had converged: clusters hang \
            together by long ways, as around holes, slivers or damaged positions, or faces have very many neighbours"
                .to_owned(),
        ],
        (Ending::IterationLimit, None) | (Ending::Converged, _) => Vec::new(),
    };
    if let Some(first) = record.beyond().first() {
        warnings
            .push(format!("the run ended before iterations whose labels were to be kept, the first of them {first}"));
    }
    if record.left_out > 0 {
        warnings.push(format!(
            "there was no room for the labels of all iterations that were asked for, ask for fewer; left out: {}",
            record.left_out
        ));
    }
    warnings
}
