//! Equal results for any number of threads.

use tesserae_mesh::complex::{Boundaries, Graph};
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::remesh::{Placement, remesh};

use super::labels::{Kind, Recipe};

#[test]
fn threads_change_nothing() {
    for sample in [Sample::Knot, Sample::Terrain, Sample::Parts] {
        let mesh = generate(sample, 6000).expect("a sample");
        let recipe = Recipe { kind: Kind::Nearest, clusters: 59, noise: 1, seed: 8 };
        let (labels, clusters) = recipe.labels(&mesh);
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| {
                let remeshed = remesh(&mesh, &labels, clusters, Placement::Fit).expect("labels fit");
                let graph = Graph::new(&mesh, &labels, clusters).expect("labels fit");
                (remeshed, graph, Boundaries::new(&mesh, &labels, clusters).expect("labels fit"))
            })
        };
        let one = with(1);
        for threads in [2, 3, 7] {
            assert_eq!(with(threads), one);
        }
    }
}
