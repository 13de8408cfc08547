//! `tesserae cut`: labels at any number of clusters, from a hierarchy that was made before.

use std::path::PathBuf;

use serde_json::json;
use tesserae_mesh::artifacts::{Content, Labels, Need};
use tesserae_mesh::device::FREE;
use tesserae_mesh::hierarchy::Cut;
use tesserae_mesh::hierarchy::stored::{self, Header, Stored};
use tesserae_mesh::job::labels_sha256;
use tesserae_mesh::mesh::Limits;

use super::files::Source;
use super::results::{OfHierarchy, Outputs, check_places};
use super::summary::{Balance, clusters_of, count, number};
use super::{Failure, Quiet, print_line, say, signals};

/// Arguments of `tesserae cut`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A number of clusters that a round of the run ended with gives the labels that the run had there, as does every \
number of --levels. Any other takes the last round before it and applies the next round's cheapest merges. One line \
says which of the two it was, and the energy; --report writes the same as JSON, with where the hierarchy comes from. \
`tesserae export` makes meshes of the clusters.

Examples:
  tesserae cut horse.tsr -k 750 -o horse-750.npy
  tesserae cut horse.tsr --hierarchy horse-top.json --max-clusters 100
  tesserae export horse.obj --hierarchy horse.tsr -k 750 -o horse-750.glb")]
pub struct Arguments {
    /// The hierarchy, as `tesserae cluster --hierarchy OUT.tsr` wrote it, or - for standard input
    #[arg(value_name = "HIERARCHY.tsr")]
    input: PathBuf,

    /// Number of clusters
    #[arg(long, short = 'k', value_name = "K")]
    clusters: Option<u64>,

    #[command(flatten)]
    outputs: Outputs<OfHierarchy>,

    /// Largest number of faces that is accepted
    #[arg(long, env = "TESSERAE_MAX_FACES", value_name = "N", default_value_t = Limits::default().max_faces)]
    max_faces: u64,

    #[command(flatten)]
    quiet: Quiet,
}

/// Reads, cuts, writes, and says in one line what came out.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    check(arguments)?;
    let outputs = &arguments.outputs;
    let input = Source::from(arguments.input.clone());
    let (file, length) = input.open()?;
    signals::cancel_when_asked();
    let about_input = || Failure::about(&input);
    let (stored, cut) = match arguments.clusters {
        Some(clusters) if outputs.that_needs(Need::Hierarchy).is_none() => {
            let cut = stored::cut(file, length, arguments.max_faces, clusters).map_err(about_input())?;
            (None, Some(cut))
        }
        clusters => {
            let stored = Stored::read(file, length, arguments.max_faces).map_err(about_input())?;
            let cut = clusters.map(|clusters| stored.labels_at(clusters)).transpose().map_err(about_input())?;
            let cut = cut.map(|cut| (stored.header.clone(), cut));
            (Some(stored), cut)
        }
    };
    let shape = cut.as_ref().and_then(|(header, cut)| header.shape_of(cut.labels.len()));
    let content = Content {
        labels: cut.as_ref().map(|(_, cut)| Labels::from(cut)),
        shape: shape.as_deref(),
        hierarchy: stored.as_ref(),
        limits: outputs.limits(),
        ..Content::default()
    };
    for file in outputs.files() {
        match &cut {
            Some((header, cut)) if file.needs(Need::Report) => {
                file.target.write(|out| write_report(out, header, cut))?;
            }
            _ => file.write(&content, &input)?,
        }
    }
    match cut.filter(|_| !arguments.quiet.quiet).map(|(_, cut)| summary(&cut, shape.is_some())) {
        Some(line) if outputs.use_stdout() => {
            say(&line);
            Ok(())
        }
        Some(line) => print_line(&line),
        None => Ok(()),
    }
}

/// Refuses what needs no hierarchy to be refused.
fn check(arguments: &Arguments) -> Result<(), Failure> {
    let usage = |message: &str| Err(Failure::Usage("cut", message.to_owned()));
    let outputs = &arguments.outputs;
    let of_cut = outputs.that_needs(Need::Labels).or(outputs.that_needs(Need::Report));
    match arguments.clusters {
        None if of_cut.is_some() => return usage("--clusters is missing: say how many clusters you want"),
        None if outputs.files().is_empty() => {
            return usage("no output is named: give --clusters and -o OUT.npy, or --hierarchy or --linkage");
        }
        _ => {}
    }
    outputs.check("cut")?;
    check_places("cut", &[("the hierarchy", Source::from(arguments.input.clone()))], &outputs.places())
}

/// What is known of a cut.
fn write_report(out: &mut dyn std::io::Write, header: &Header, cut: &Cut) -> std::io::Result<()> {
    let report = json!({
        "clusters": cut.clusters(),
        "cut": cut.kind(),
        "round": cut.rounds,
        "merges_on_top": cut.extra_merges,
        "energy": cut.energy,
        "labels_sha256": labels_sha256(&cut.labels),
        "hierarchy": header,
    });
    serde_json::to_writer_pretty(&mut *out, &report)?;
    out.write_all(b"\n")
}

/// What came out, in one line.
fn summary(cut: &Cut, are_items: bool) -> String {
    let state = match (cut.rounds, cut.extra_merges) {
        (0, 0) => format!("every {} a cluster", if are_items { "item" } else { "face" }),
        (round, 0) => format!("the state after round {round}"),
        (0, more) => format!("the {more} cheapest merges of round 1"),
        (round, more) => format!("the state after round {round} and the {more} cheapest merges of the next"),
    };
    let of = count(cut.labels.iter().filter(|&&label| label != FREE).count() as u64);
    let of = format!("{of} {}", if are_items { "items" } else { "faces" });
    let balance = Balance::of(&cut.labels, cut.clusters()).map(|balance| format!("{balance}, ")).unwrap_or_default();
    format!("{}, {balance}energy {}, {}: {state}", clusters_of(cut.clusters(), &of), number(cut.energy), cut.kind())
}
