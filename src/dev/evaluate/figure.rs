//! Figure 6: energy against the number of clusters, for every algorithm.

use super::Flat;
use super::printed::FIGURE_6;
use super::runs::{MeshFile, Runner};
use crate::dev::plot;
use crate::error::Result;
use crate::parameters::{Algorithm, Parameters};

/// Numbers of clusters at which flat clusterings are measured and all curves compared.
pub(super) const NUMBERS: [u64; 6] = [2000, 1800, 1600, 1400, 1200, 1000];

/// Runs whose energies a point of a flat curve with random seeds is the mean of.
pub(super) const SEED_NUMBERS: u64 = 3;

/// A curve: name, and (clusters, energy) from many clusters to few.
pub(super) struct Curve {
    pub name: String,
    points: Vec<(u64, f64)>,
}

/// All curves, on one mesh.
pub(super) struct Figure {
    pub mesh: String,
    pub curves: Vec<Curve>,
}

impl Curve {
    /// The energy at a number of clusters: that of a run, or between two of them, straight on logarithmic axes.
    pub fn at(&self, clusters: u64) -> Option<f64> {
        let after = self.points.iter().position(|&(k, _)| k <= clusters)?;
        let (k1, e1) = self.points[after];
        if k1 == clusters {
            return Some(e1);
        }
        let (k0, e0) = *self.points.get(after.checked_sub(1)?)?;
        let part = (clusters as f64 / k0 as f64).ln() / (k1 as f64 / k0 as f64).ln();
        Some((e0.ln() + part * (e1.ln() - e0.ln())).exp())
    }

    /// Whether a run ended at that number of clusters.
    pub fn is_measured(&self, clusters: u64) -> bool {
        self.points.iter().any(|&(k, _)| k == clusters)
    }

    /// What is drawn: the runs within the figure, and its borders.
    fn drawn(&self) -> Vec<(u64, f64)> {
        let (fewest, most, _) = FIGURE_6;
        let mut points: Vec<(u64, f64)> =
            self.points.iter().copied().filter(|(k, _)| (fewest..=most).contains(k)).collect();
        for border in [fewest, most] {
            if let Some(energy) = self.at(border).filter(|_| !self.is_measured(border)) {
                points.push((border, energy));
            }
        }
        points.sort_by_key(|&(k, _)| std::cmp::Reverse(k));
        points
    }
}

impl Figure {
    /// Runs everything that the figure shows, on the cpu.
    pub fn measure(runner: &mut Runner<'_>, mesh: &MeshFile) -> Result<Self> {
        let (_, _, switch) = FIGURE_6;
        let mut curves = Vec::new();
        for (name, algorithm, switch_to_ml_at) in [
            ("HR", Algorithm::Hr, None),
            ("ML", Algorithm::Ml, None),
            ("PML", Algorithm::Pml, None),
            ("PML/1633 ML", Algorithm::Pml, Some(switch)),
        ] {
            let parameters = Parameters { algorithm, switch_to_ml_at, ..Parameters::default() };
            let levels = runner.run(mesh, &parameters, 0, 1)?.report.levels;
            let points = levels.iter().filter_map(|level| Some((level.clusters, level.energy?))).collect();
            curves.push(Curve { name: name.to_owned(), points });
        }
        for flat in Flat::ALL {
            let seeds = if flat == Flat::Default { 1 } else { SEED_NUMBERS };
            let mut points = Vec::new();
            for clusters in NUMBERS {
                let mut sum = 0.0;
                for seed in 0..seeds {
                    let report = runner.run(mesh, &flat.parameters(clusters, seed), 0, 1)?.report;
                    sum += report.energy.final_.unwrap_or(f64::NAN);
                }
                points.push((clusters, sum / seeds as f64));
            }
            curves.push(Curve { name: flat.name().to_owned(), points });
        }
        Ok(Self { mesh: mesh.name(), curves })
    }

    /// The curve of that name.
    pub fn curve(&self, name: &str) -> Option<&Curve> {
        self.curves.iter().find(|curve| curve.name == name)
    }

    /// As SVG: the energies, and below, all but the highest as parts of ACVD's, which tells them apart.
    pub fn draw(&self) -> Result<String> {
        let lines: Vec<plot::Line> = self.curves.iter().map(|curve| (curve.name.clone(), curve.drawn())).collect();
        let acvd = self.curve(Flat::Acvd.name());
        let parts = |curve: &Curve| {
            let part = |clusters: u64| Some((clusters, curve.at(clusters)? / acvd?.at(clusters)?));
            // a line without points keeps its colour
            let numbers = NUMBERS.into_iter().filter(|_| curve.name != "HR");
            (curve.name.clone(), numbers.filter_map(part).collect())
        };
        let parts: Vec<plot::Line> = self.curves.iter().map(parts).collect();
        plot::draw_against_clusters(&lines, "energy / ACVD's", &parts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_two_runs_a_curve_is_straight_on_logarithmic_axes() {
        let curve = Curve { name: String::new(), points: vec![(4000, 1.0), (1600, 2.5), (900, 4.0)] };
        assert_eq!(curve.at(1600), Some(2.5));
        let between = curve.at(2000).expect("between two runs");
        assert!((between - 2.0).abs() < 1e-12, "energy ~ 1/k: {between}");
        assert_eq!((curve.at(5000), curve.at(800)), (None, None));
        let drawn: Vec<u64> = curve.drawn().into_iter().map(|(k, _)| k).collect();
        assert_eq!(drawn, [2000, 1600, 1000]);
    }
}
