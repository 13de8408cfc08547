//! Reports as a picture (SVG): energy against the number of clusters for hierarchies (the paper's Figure 6), energy per
//! iteration for flat clusterings. Reports of both kinds give two panels, with the flat ones as points in the first.
//!
//! The viewer of the picture sets its text: no font is needed here.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::prelude::*;
use serde::Deserialize;

use crate::error::{Error, Kind, Result};

/// Width and height of a panel, in pixels.
const PANEL: (u32, u32) = (960, 560);

/// What is drawn of a report.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Curve {
    /// What it is called in the picture.
    #[serde(skip)]
    name: String,
    algorithm: String,
    clusters: u64,
    energy: Final,
    #[serde(default)]
    iterations: Vec<Iteration>,
    #[serde(default)]
    levels: Vec<Level>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Final {
    #[serde(rename = "final")]
    final_: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Iteration {
    iteration: u32,
    energy: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Level {
    clusters: u64,
    energy: Option<f64>,
}

/// Points of a panel: (iteration, or logarithm of the number of clusters; logarithm of the energy), to base 10.
type Points = Vec<(f64, f64)>;

impl Curve {
    /// Reads a report; `name` is what it is called in the picture. Errors do not name it.
    pub fn read(name: &str, json: &[u8]) -> Result<Self> {
        let curve: Self = serde_json::from_slice(json)
            .map_err(|error| Error::new(Kind::BadRequest, format_args!("this is no report: {error}")))?;
        let name = format!("{name} ({})", curve.algorithm);
        Ok(Self { name, ..curve })
    }

    fn is_hierarchy(&self) -> bool {
        !self.levels.is_empty()
    }

    fn levels(&self) -> Points {
        drawable(self.levels.iter().map(|level| (logarithm(level.clusters), level.energy)))
    }

    fn iterations(&self) -> Points {
        drawable(self.iterations.iter().map(|row| (f64::from(row.iteration), row.energy)))
    }

    /// The end of a flat clustering among hierarchies.
    fn end(&self) -> Points {
        drawable([(logarithm(self.clusters), self.energy.final_)].into_iter())
    }
}

fn logarithm(clusters: u64) -> f64 {
    (clusters.max(1) as f64).log10()
}

/// Points whose energy has a logarithm.
fn drawable(points: impl Iterator<Item = (f64, Option<f64>)>) -> Points {
    points.filter_map(|(x, energy)| Some((x, energy.filter(|energy| *energy > 0.0)?.log10()))).collect()
}

/// Draws reports as SVG. Fails when none of them has an energy to show.
pub fn draw(curves: &[Curve]) -> Result<String> {
    let (hierarchies, flats): (Vec<&Curve>, Vec<&Curve>) = curves.iter().partition(|curve| curve.is_hierarchy());
    let of_clusters: Vec<(String, Points)> = match hierarchies.is_empty() {
        true => Vec::new(),
        false => curves
            .iter()
            .map(|curve| (curve.name.clone(), if curve.is_hierarchy() { curve.levels() } else { curve.end() }))
            .collect(),
    };
    let of_iterations: Vec<(String, Points)> =
        flats.iter().map(|curve| (curve.name.clone(), curve.iterations())).collect();
    draw_panels(&[
        Panel { x: "clusters", y: "energy", lines: of_clusters },
        Panel { x: "iteration", y: "energy", lines: of_iterations },
    ])
}

/// A line of (clusters, energy) with its name.
pub type Line = (String, Vec<(u64, f64)>);

/// Draws lines as SVG, and below them others as fractions of the energy of `part_of`. Fails when there is nothing
/// to show.
pub fn draw_against_clusters(lines: &[Line], part_of: &str, parts: &[Line]) -> Result<String> {
    let points = |(name, points): &Line| {
        (name.clone(), drawable(points.iter().map(|&(clusters, energy)| (logarithm(clusters), Some(energy)))))
    };
    draw_panels(&[
        Panel { x: "clusters", y: "energy", lines: lines.iter().map(points).collect() },
        Panel { x: "clusters", y: part_of, lines: parts.iter().map(points).collect() },
    ])
}

/// Axes and lines.
struct Panel<'a> {
    /// What x counts: `clusters`, whose logarithms are drawn, or `iteration`.
    x: &'a str,
    /// What y tells: `energy`, or parts of one.
    y: &'a str,
    /// Lines with their names.
    lines: Vec<(String, Points)>,
}

/// Colours of lines, far apart also for those who see few.
const COLORS: [RGBColor; 9] = [
    RGBColor(0x99, 0x99, 0x99),
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0x56, 0xb4, 0xe9),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0x00, 0x00, 0x00),
    RGBColor(0xf0, 0xe4, 0x42),
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0xd5, 0x5e, 0x00),
];

/// Draws panels, one below the other, those without points left out.
fn draw_panels(panels: &[Panel<'_>]) -> Result<String> {
    let panels: Vec<_> =
        panels.iter().filter(|panel| panel.lines.iter().any(|(_, points)| !points.is_empty())).collect();
    if panels.is_empty() {
        return Err(Error::new(Kind::BadRequest, "the reports have no energies above 0 to draw"));
    }
    let mut svg = String::new();
    let drawn = (|| {
        let root = SVGBackend::with_string(&mut svg, (PANEL.0, PANEL.1 * panels.len() as u32)).into_drawing_area();
        root.fill(&WHITE).map_err(defect)?;
        let areas = root.split_evenly((panels.len(), 1));
        for (area, panel) in areas.iter().zip(panels) {
            draw_panel(area, panel)?;
        }
        root.present().map_err(defect)
    })();
    drawn.map(|()| svg)
}

/// The least and the largest of a coordinate, and some room.
fn extent(lines: &[(String, Points)], coordinate: impl Fn(&(f64, f64)) -> f64) -> Range<f64> {
    let all = lines.iter().flat_map(|(_, points)| points).map(coordinate);
    let (least, most) =
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), value| (least.min(value), most.max(value)));
    let room = (0.03 * (most - least)).max(0.01);
    least - room..most + room
}

/// One panel with its axes, lines and legend.
fn draw_panel(area: &DrawingArea<SVGBackend<'_>, Shift>, panel: &Panel<'_>) -> Result<()> {
    let (x, y) = (extent(&panel.lines, |point| point.0), extent(&panel.lines, |point| point.1));
    let mut chart = ChartBuilder::on(area)
        .margin(16)
        .x_label_area_size(44)
        .y_label_area_size(92)
        .build_cartesian_2d(x, y)
        .map_err(defect)?;
    let (is_clusters, is_energy) = (panel.x == "clusters", panel.y == "energy");
    chart
        .configure_mesh()
        .x_desc(panel.x)
        .y_desc(panel.y)
        .x_label_formatter(&|&x| format!("{:.0}", if is_clusters { 10f64.powf(x) } else { x }))
        .y_label_formatter(&|&y| {
            let value = 10f64.powf(y);
            if is_energy { format!("{value:.2e}") } else { format!("{value:.3}") }
        })
        .light_line_style(WHITE.mix(0.0))
        .draw()
        .map_err(defect)?;
    for (nth, (name, points)) in panel.lines.iter().enumerate() {
        let color = COLORS[nth % COLORS.len()];
        let series =
            chart.draw_series(LineSeries::new(points.iter().copied(), color.stroke_width(2))).map_err(defect)?;
        series.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
        if let [point] = points.as_slice() {
            chart.draw_series([Circle::new(*point, 4, color.filled())]).map_err(defect)?;
        }
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .border_style(BLACK.mix(0.4))
        .background_style(WHITE.mix(0.9))
        .draw()
        .map_err(defect)
}

/// Drawing into a string does not fail.
fn defect(error: impl std::fmt::Display) -> Error {
    Error::internal(format_args!("the picture cannot be drawn: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLAT: &str = r#"{"algorithm": "bb", "clusters": 9, "energy": {"final": 1.5}, "levels": [],
        "iterations": [{"iteration": 0, "energy": 3.0}, {"iteration": 1, "energy": 2.0},
                       {"iteration": 2, "energy": 1.5}]}"#;
    const TREE: &str = r#"{"algorithm": "pml", "clusters": 1, "energy": {"final": 8.0}, "iterations": [],
        "levels": [{"clusters": 40, "energy": 0.0}, {"clusters": 10, "energy": 1.0}, {"clusters": 1, "energy": 8.0}]}"#;

    fn curve(name: &str, json: &str) -> Curve {
        Curve::read(name, json.as_bytes()).expect("a report")
    }

    #[test]
    fn every_report_has_a_line_and_a_name() {
        let flat = draw(&[curve("a.json", FLAT), curve("b & <c>.json", FLAT)]).expect("drawn");
        assert!(flat.starts_with("<svg") && flat.trim_end().ends_with("</svg>"));
        for words in ["a.json (bb)", "b &amp; &lt;c&gt;.json (bb)", "iteration", "energy"] {
            assert!(flat.contains(words), "{words}");
        }
        assert!(!flat.contains("clusters"));
        let both = draw(&[curve("a.json", FLAT), curve("t.json", TREE)]).expect("drawn");
        for words in ["a.json (bb)", "t.json (pml)", "iteration", "clusters", "<circle"] {
            assert!(both.contains(words), "{words}");
        }
    }

    #[test]
    fn a_single_point_and_equal_energies_can_be_drawn() {
        let one = r#"{"algorithm": "hr", "clusters": 1, "energy": {"final": 8.0},
            "levels": [{"clusters": 1, "energy": 8.0}]}"#;
        assert!(draw(&[curve("one", one)]).is_ok());
        let same = FLAT.replace("2.0", "3.0").replace("1.5", "3.0");
        assert!(draw(&[curve("same", &same)]).is_ok());
        let extreme = FLAT.replace("2.0", "1e-300").replace("3.0", "1e300");
        assert!(draw(&[curve("extreme", &extreme)]).is_ok());
    }

    #[test]
    fn what_is_no_report_or_shows_nothing_is_refused() {
        for json in ["", "[]", "{}", r#"{"algorithm": 3}"#] {
            let error = Curve::read("x.json", json.as_bytes()).expect_err(json);
            assert!(error.message.starts_with("this is no report: "), "{error}");
        }
        let empty = r#"{"algorithm": "bb", "clusters": 3, "energy": {"final": null}, "iterations": []}"#;
        assert!(draw(&[curve("empty", empty)]).is_err());
    }
}
