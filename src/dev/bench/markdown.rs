//! Measurements as Markdown.

use std::fmt::Write;

use super::{BenchRow, Measurements};
use crate::dev::markdown::{line, table_head};
use crate::device::{KernelWork, StageTime};
use crate::report::DeviceKind;

/// Writes everything.
pub(super) fn report(measurements: &Measurements) -> String {
    let Measurements { tesserae, processor, threads, device, copy_bytes_a_second, rows } = measurements;
    let mut out = "# What a device takes\n\n".to_owned();
    let (arch, os) = (std::env::consts::ARCH, std::env::consts::OS);
    let _ = writeln!(out, "- tesserae {tesserae}");
    let _ = writeln!(out, "- machine: {processor}, {threads} threads, {arch}, {os}");
    let _ = writeln!(out, "- device: {}, {}, {}", device.name, device.backend, device.driver);
    match copy_bytes_a_second {
        Some(copy) => {
            let _ = writeln!(out, "- copies within its memory: {:.1} GB/s, read and written", copy / 1e9);
        }
        None if device.kind == DeviceKind::Gpu => out.push_str("- it has no timestamps: all times are the host's\n"),
        None => {}
    }
    out.push_str(
        "\nTimes in ms; `device` is clustering as the device's own timestamps have it, `cluster` as the host does.\n\n",
    );
    let is_gpu = device.kind == DeviceKind::Gpu;
    let mut cells = vec!["mesh", "faces", "clusters", "algorithm", "parse", "topology", "upload", "cluster"];
    if is_gpu {
        cells.extend(["device", "on the cpu", "same labels"]);
    }
    cells.extend(["labels back", "iterations", "energy", "hexagonal"]);
    if is_gpu {
        cells.extend(["sweep", "of copy"]);
    }
    table_head(&mut out, &cells);
    for row in rows.iter().filter(|row| row.refused.is_none()) {
        line(&mut out, &figures(row, is_gpu));
    }
    for row in rows {
        if let Some(why) = &row.refused {
            let _ = writeln!(out, "\nNot run: {}, {} faces, {}: {why}", row.mesh, row.faces, row.algorithm);
        }
    }
    if rows.iter().any(|row| !row.profile.stages.is_empty()) {
        stages(&mut out, rows);
    }
    out
}

fn figures(row: &BenchRow, is_gpu: bool) -> Vec<String> {
    let or = |number: Option<f64>, text: fn(f64) -> String| number.map_or_else(|| "–".to_owned(), text);
    let ms = |number: f64| format!("{number:.1}");
    let mesh = format!("{}{}", row.mesh, if row.is_for_cpu { ", on the cpu" } else { "" });
    let mut cells = vec![mesh, row.faces.to_string(), row.clusters.to_string(), row.algorithm.clone()];
    cells.extend([row.parse, row.topology, row.upload, row.cluster].map(ms));
    if is_gpu {
        let same = row.same_as_cpu.map_or("–", |same| if same { "yes" } else { "**no**" });
        cells.extend([or(row.device, ms), or(row.cluster_on_cpu, ms), same.to_owned()]);
    }
    cells.extend([ms(row.download), row.iterations.to_string()]);
    cells.extend([or(row.energy, |x| format!("{x:.5e}")), or(row.hexagon_ratio, |x| format!("{x:.4}"))]);
    if is_gpu {
        cells.push(or(row.sweep.map(|sweep| sweep.milliseconds), |x| format!("{x:.3}")));
        cells.push(or(row.sweep.map(|sweep| sweep.share_of_copy), |x| format!("{:.0} %", 100.0 * x)));
    }
    cells
}

/// Where the device's time went, how often it was waited for, and what its kernels read and wrote.
fn stages(out: &mut String, rows: &[BenchRow]) {
    out.push_str("\n## On the device\n\n");
    out.push_str(
        "Milliseconds and passes of each stage; submissions; waits of the host; dispatches of all kernels, also ",
    );
    out.push_str("those without work; megabytes that they read and write, by the table of kernels.\n\n");
    table_head(out, &["mesh, faces, algorithm", "stages", "submits", "waits", "dispatches", "MB"]);
    for BenchRow { mesh, faces, algorithm, profile, .. } in rows.iter().filter(|row| !row.profile.stages.is_empty()) {
        let stage = |stage: &StageTime| format!("{} {:.2} ({})", stage.stage, stage.milliseconds, stage.passes);
        let stages: Vec<String> = profile.stages.iter().map(stage).collect();
        let untimed = match profile.untimed_passes {
            0 => String::new(),
            passes => format!(" and {passes} passes that were not timed"),
        };
        let megabytes = |bytes: u64| format!("{:.1}", bytes as f64 / 1e6);
        let of_each = |number: fn(&KernelWork) -> u64, text: &dyn Fn(u64) -> String| {
            let numbers = profile.kernels.iter().map(|(kernel, work)| (kernel, number(work)));
            let each: Vec<String> =
                numbers.filter(|&(_, of)| of > 0).map(|(kernel, of)| format!("{kernel} {}", text(of))).collect();
            format!("{}: {}", text(number(&profile.total())), each.join(", "))
        };
        let cells = [
            format!("{mesh}, {faces}, {algorithm}"),
            stages.join(", ") + &untimed,
            profile.submits.to_string(),
            profile.waits.to_string(),
            of_each(|work| work.dispatches, &|dispatches| dispatches.to_string()),
            of_each(|work| work.bytes, &megabytes),
        ];
        line(out, &cells);
    }
}
