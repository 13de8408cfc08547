//! `tesserae cut`: labels at any number of clusters, from a hierarchy that was made before.

use std::path::PathBuf;

use serde_json::json;

use super::files::{Source, Target, path_parser};
use super::results::{LabelFile, TreeFiles, check_places};
use super::{Failure, print_line, say, signals};
use crate::artifacts::write_cut;
use crate::hierarchy::Cut;
use crate::hierarchy::stored::{self, Header, Stored};
use crate::job::labels_sha256;
use crate::mesh::Limits;

/// Arguments of `tesserae cut`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A number of clusters that a round of the run ended with gives the labels that the run had there, as does every number
that was asked for with --levels. Any other takes the last round before it and applies the next round's cheapest merges.
Which of the two it was, and the energy, is said in one line.

Examples:
  tesserae cut horse.tsr --clusters 750 --labels horse-750.npy
  tesserae cut horse.tsr --hierarchy horse-top.json --max-clusters 100")]
pub struct Arguments {
    /// The hierarchy, as `tesserae cluster --hierarchy OUT.tsr` wrote it, or - for standard input
    #[arg(value_name = "HIERARCHY.tsr")]
    input: PathBuf,

    /// Number of clusters
    #[arg(long, short = 'k', value_name = "K")]
    clusters: Option<u64>,

    /// Where to write the labels: OUT.npy, OUT.json, OUT.bin (u32, little-endian), or - for JSON on standard output
    #[arg(long, value_name = "OUT", value_parser = path_parser(LabelFile::parse))]
    labels: Option<LabelFile>,

    /// Where to write what is known of the cut (JSON): a file, or - for standard output
    #[arg(long, value_name = "OUT.json")]
    report: Option<PathBuf>,

    #[command(flatten)]
    trees: TreeFiles,

    /// Largest number of faces that is accepted
    #[arg(long, env = "TESSERAE_MAX_FACES", value_name = "N", default_value_t = Limits::default().max_faces)]
    max_faces: u64,
}

/// Reads, cuts, writes, and says in one line what came out.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let report = arguments.report.clone().map(Target::from);
    let targets = check(arguments, report.as_ref())?;
    let input = Source::from(arguments.input.clone());
    let (file, length) = input.open()?;
    signals::cancel_when_asked();
    let about_input = || Failure::about(&input);
    let mut line = None;
    if arguments.trees.first().is_some() {
        let stored = Stored::read(file, length, arguments.max_faces).map_err(about_input())?;
        if let Some(clusters) = arguments.clusters {
            let cut = stored.tree.labels_at(clusters).map_err(about_input())?;
            line = Some(write(arguments, report.as_ref(), &stored.header, &cut)?);
        }
        arguments.trees.write(&stored, &input)?;
    } else if let Some(clusters) = arguments.clusters {
        let (header, cut) = stored::cut(file, length, arguments.max_faces, clusters).map_err(about_input())?;
        line = Some(write(arguments, report.as_ref(), &header, &cut)?);
    }
    let Some(line) = line else {
        return Ok(());
    };
    if targets.contains(&&Target::Stdout) {
        say(&line);
        Ok(())
    } else {
        print_line(&line)
    }
}

/// Writes labels and report of a cut; gives what came out, in one line.
fn write(arguments: &Arguments, report: Option<&Target>, header: &Header, cut: &Cut) -> Result<String, Failure> {
    if let Some(labels) = &arguments.labels {
        labels.target.write(|out| write_cut(out, labels.format, cut))?;
    }
    if let Some(target) = report {
        target.write(|out| write_report(out, header, cut))?;
    }
    Ok(summary(cut))
}

/// Refuses what needs no hierarchy to be refused; gives everything that is written.
fn check<'a>(arguments: &'a Arguments, report: Option<&'a Target>) -> Result<Vec<&'a Target>, Failure> {
    let usage = |message: &str| Err(Failure::Usage("cut", message.to_owned()));
    let labels = arguments.labels.as_ref().map(|labels| ("--labels", &labels.target));
    let report = report.map(|target| ("--report", target));
    match arguments.clusters {
        None if labels.is_some() || report.is_some() => {
            return usage("--clusters is missing: say how many clusters you want");
        }
        None if arguments.trees.first().is_none() => {
            return usage("nothing is asked for: give --clusters and --labels, --hierarchy or --linkage");
        }
        _ => {}
    }
    arguments.trees.check("cut")?;
    let targets: Vec<_> = labels.into_iter().chain(report).chain(arguments.trees.targets()).collect();
    let input = ("the hierarchy", Source::from(arguments.input.clone()));
    check_places("cut", &[input], &targets)?;
    Ok(targets.into_iter().map(|(_, target)| target).collect())
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
fn summary(cut: &Cut) -> String {
    let state = match (cut.rounds, cut.extra_merges) {
        (0, 0) => "every face a cluster".to_owned(),
        (round, 0) => format!("the state after round {round}"),
        (0, more) => format!("the {more} cheapest merges of round 1"),
        (round, more) => format!("the state after round {round} and the {more} cheapest merges of the next"),
    };
    format!(
        "{} faces, {} clusters, energy {:.9e}, {}: {state}",
        cut.labels.len(),
        cut.clusters(),
        cut.energy,
        cut.kind()
    )
}
