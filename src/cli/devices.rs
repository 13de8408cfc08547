//! `tesserae devices`: what there is to cluster on.

use serde::Serialize;
use tesserae_mesh::device::Device;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::select::{self, AdapterReport, FACES_FOR_GPU};
use tesserae_mesh::report::DeviceInfo;

use super::{Failure, print};

/// Arguments of `tesserae devices`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Devices<'a> {
    /// The processor of this machine.
    cpu: &'a DeviceInfo,
    /// Every graphics adapter.
    adapters: &'a [AdapterReport],
    /// What `--device auto` takes.
    auto: Auto,
}

/// What `--device auto` takes.
#[derive(Debug, Serialize)]
struct Auto {
    /// Number of the adapter for large meshes and for the service; null for the cpu.
    adapter: Option<usize>,
    /// The smallest mesh, in faces, for which `tesserae cluster` takes that adapter.
    faces_for_gpu: u64,
}

/// Prints every device, and which one `--device auto` takes.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let cpu: &dyn Device = &CpuDevice::new();
    let adapters = select::tested_adapters();
    let auto =
        Auto { adapter: select::auto_adapter(&adapters).map(|report| report.index), faces_for_gpu: FACES_FOR_GPU };
    let devices = Devices { cpu: cpu.info(), adapters: &adapters, auto };
    let text = if arguments.json {
        serde_json::to_string_pretty(&devices).map_err(|error| Failure::stdout(error.into()))? + "\n"
    } else {
        table(&devices)
    };
    print(|out| out.write_all(text.as_bytes()))
}

/// The devices in columns, then what auto takes.
fn table(devices: &Devices<'_>) -> String {
    let row = |cells: [&str; 8]| cells.map(str::to_owned);
    let cpu = devices.cpu;
    let mut rows = vec![
        row(["adapter", "kind", "name", "backend", "driver", "faces", "of hierarchies", "usable"]),
        row(["", "cpu", &cpu.name, &cpu.backend, &cpu.driver, "", "", "yes"]),
    ];
    for report in devices.adapters {
        let index = report.index.to_string();
        let kind = report.kind.to_string();
        let usable = match &report.reason {
            Some(reason) => format!("no: {reason}"),
            None => "yes".to_owned(),
        };
        let [flat, hierarchy] = [report.largest.flat, report.largest.hierarchy].map(|faces| faces.to_string());
        let (name, backend, driver) = (&report.name, &report.backend, &report.driver);
        rows.push(row([&index, &kind, name, backend, driver, &flat, &hierarchy, &usable]));
    }
    let widths: [usize; 8] =
        std::array::from_fn(|column| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0));
    let mut text = String::new();
    for row in rows {
        let cells = row.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}"));
        text += cells.collect::<Vec<_>>().join("  ").trim_end();
        text += "\n";
    }
    text += "\n";
    text += &match devices.auto.adapter {
        Some(index) => format!(
            "--device auto takes adapter {index}; for a single mesh of fewer than {} faces, the cpu\n",
            devices.auto.faces_for_gpu
        ),
        None => "--device auto takes the cpu\n".to_owned(),
    };
    text
}
