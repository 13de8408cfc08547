//! The report of an evaluation, in Markdown.

use std::fmt::Write;

use super::figure::{Figure, NUMBERS, SEED_NUMBERS};
use super::printed::MODELS;
use super::runs::{MeshFile, Runner, Timed};
use super::statements::Statement;
use super::{FlatRow, TreeRow};
use crate::dev::markdown::{line, processor, table_head};
use crate::parameters::Algorithm;
use crate::report::DeviceInfo;

/// A face count that differs by more than this part from the paper's makes another mesh of it.
const ANOTHER_MESH: f64 = 0.02;

/// Clusters at which the energies of hierarchies are told.
const TREE_CLUSTERS: u64 = 1000;

/// Writes everything.
pub(super) fn report(
    files: &[Option<MeshFile>],
    runner: &Runner<'_>,
    flat: &[FlatRow<'_>],
    trees: &[TreeRow<'_>],
    figure: &Figure,
    statements: &[Statement],
) -> String {
    let devices = runner.devices.infos();
    let mut out = "# The paper's evaluation\n\n".to_owned();
    introduction(&mut out, files, &devices, runner.repeats, flat);
    table_1(&mut out, &devices, flat);
    table_2(&mut out, &devices, trees);
    figure_6(&mut out, figure);
    out.push_str("\n## What was said\n\n| statement | here | |\n|---|---|---|\n");
    for Statement { text, kept, numbers } in statements {
        let kept = match kept {
            Some(true) => "kept",
            Some(false) => "**not kept**",
            None => "not checked",
        };
        line(&mut out, &[text, kept, numbers]);
    }
    out
}

fn introduction(
    out: &mut String,
    files: &[Option<MeshFile>],
    devices: &[DeviceInfo],
    repeats: u32,
    flat: &[FlatRow<'_>],
) {
    let build = if cfg!(debug_assertions) { " (**a debug build: its times say nothing**)" } else { "" };
    let _ = writeln!(
        out,
        "Tables 1 and 2 and Figure 6 of \"Parallel Mesh Clustering\", by tesserae {}{build}. Times are of clustering \
         alone, without reading and transfers, in Table 1 the least of {repeats}. The paper's figures, printed beside \
         them, are of a 3 GHz Core 2 Duo and a GeForce GTX 280. Energies are sums of area × squared distance in the \
         units of the files, in parentheses over that of a flat tiling by hexagons. ACVD, VC and BB start from the \
         same random seeds; the default settings from their own.\n",
        env!("CARGO_PKG_VERSION")
    );
    let _ = writeln!(out, "- machine: {}, {}, {}", processor(), std::env::consts::ARCH, std::env::consts::OS);
    for device in devices {
        let _ = writeln!(out, "- {}: {}, {}, {}", device.kind.name(), device.name, device.backend, device.driver);
    }
    if devices.len() == 1 {
        out.push_str("- no gpu took part: there is none here but software\n");
    }
    for (file, model) in files.iter().zip(MODELS) {
        let Some(file) = file else {
            let _ = writeln!(out, "- {}: not found", model.name);
            continue;
        };
        let runs = flat.iter().find(|row| row.printed.model == model.name).and_then(|row| row.runs.as_ref());
        let faces = runs.and_then(|runs| runs.first()).map_or(0, |(_, _, timed)| timed.report.input.items());
        let printed = (1000 * model.thousand_faces) as f64;
        let other = match (faces as f64 / printed - 1.0).abs() > ANOTHER_MESH {
            true => {
                format!(" (**the paper's has {}k: times and energies are not of that mesh**)", model.thousand_faces)
            }
            false => String::new(),
        };
        let _ = writeln!(out, "- {}: {}, {faces} faces{other}", model.name, file.name());
    }
}

/// Which columns a table has: name and device of each run of the first row that has any.
fn columns<'a, K: Copy + 'a>(mut rows: impl Iterator<Item = &'a Vec<(K, usize, Timed)>>) -> Vec<(K, usize)> {
    rows.next().map(|runs| runs.iter().map(|&(what, device, _)| (what, device)).collect()).unwrap_or_default()
}

fn table_1(out: &mut String, devices: &[DeviceInfo], rows: &[FlatRow<'_>]) {
    let columns = columns(rows.iter().filter_map(|row| row.runs.as_ref()));
    for (title, is_time) in [("## Table 1: times, in ms", true), ("### Its energies", false)] {
        let _ = writeln!(out, "\n{title}\n");
        let mut head = vec!["mesh, clusters".to_owned()];
        if is_time {
            head.extend(["paper: ACVD, cpu", "paper: BB, gpu"].map(str::to_owned));
        }
        head.extend(columns.iter().map(|&(flat, device)| format!("{}, {}", flat.name(), devices[device].kind.name())));
        table_head(out, &head);
        for FlatRow { printed, runs } in rows {
            let mut cells = vec![format!("{}, {}", printed.model, printed.clusters)];
            if is_time {
                cells.extend([format!("{:.0}", 1000.0 * printed.cpu_acvd_s), format!("{:.0}", printed.gpu_bb_ms)]);
            }
            match runs {
                None => cells.extend(columns.iter().map(|_| "no mesh".to_owned())),
                Some(runs) if is_time => cells.extend(runs.iter().map(|(_, _, timed)| format!("{:.1}", timed.ms))),
                Some(runs) => cells.extend(runs.iter().map(|(_, _, timed)| energy(timed))),
            }
            line(out, &cells);
        }
    }
}

fn table_2(out: &mut String, devices: &[DeviceInfo], rows: &[TreeRow<'_>]) {
    let columns = columns(rows.iter().filter_map(|row| row.runs.as_ref()));
    for (title, is_time) in [("## Table 2: whole hierarchies, in seconds", true), ("### Their energies", false)] {
        let _ = writeln!(out, "\n{title}\n");
        if !is_time {
            let _ = writeln!(
                out,
                "After the last round with {TREE_CLUSTERS} clusters or more, whose number is in parentheses.\n"
            );
        }
        let mut head = vec!["mesh".to_owned()];
        if is_time {
            head.extend(["paper: ML, cpu", "paper: ML, gpu", "paper: PML, gpu"].map(str::to_owned));
        }
        let name = |algorithm: Algorithm| algorithm.name().to_uppercase();
        head.extend(
            columns.iter().map(|&(algorithm, device)| format!("{}, {}", name(algorithm), devices[device].kind.name())),
        );
        table_head(out, &head);
        for TreeRow { printed, runs } in rows {
            let mut cells = vec![printed.model.to_owned()];
            if is_time {
                cells.extend([printed.cpu_ml_s, printed.gpu_ml_s, printed.gpu_pml_s].map(|s| format!("{s:.0}")));
            }
            match runs {
                None => cells.extend(columns.iter().map(|_| "no mesh".to_owned())),
                Some(runs) if is_time => {
                    cells.extend(runs.iter().map(|(_, _, timed)| format!("{:.2}", timed.ms / 1000.0)));
                }
                Some(runs) => cells.extend(runs.iter().map(|(_, _, timed)| level_energy(timed))),
            }
            line(out, &cells);
        }
    }
}

fn figure_6(out: &mut String, figure: &Figure) {
    let _ = writeln!(
        out,
        "\n## Figure 6: energy against the number of clusters\n\n\
         ![Energy against the number of clusters](figure-6.svg)\n\n\
         {}, on the cpu. Energies of ACVD, VC and BB are means over {SEED_NUMBERS} seed numbers. `~`: between two \
         rounds, straight on logarithmic axes.\n",
        figure.mesh
    );
    let mut head = vec!["clusters".to_owned()];
    head.extend(figure.curves.iter().map(|curve| curve.name.clone()));
    table_head(out, &head);
    for clusters in NUMBERS {
        let mut cells = vec![clusters.to_string()];
        cells.extend(figure.curves.iter().map(|curve| match curve.at(clusters) {
            Some(energy) => format!("{}{energy:.5e}", if curve.is_measured(clusters) { "" } else { "~" }),
            None => "none".to_owned(),
        }));
        line(out, &cells);
    }
}

fn energy(timed: &Timed) -> String {
    let energy = timed.report.energy.final_.map_or_else(|| "none".to_owned(), |energy| format!("{energy:.5e}"));
    let ratio = timed.report.energy.hexagon_ratio.map_or_else(String::new, |ratio| format!(" ({ratio:.4})"));
    energy + &ratio
}

fn level_energy(timed: &Timed) -> String {
    let level = timed.report.levels.iter().rev().find(|level| level.clusters >= TREE_CLUSTERS);
    let found = level.and_then(|level| Some((level.clusters, level.energy?)));
    found.map_or_else(|| "none".to_owned(), |(clusters, energy)| format!("{energy:.5e} ({clusters})"))
}
