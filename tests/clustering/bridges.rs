//! `bridge_components`: one tree over separate parts, and fewer clusters than parts.

use tesserae_mesh::dev::sample::{Sample, generate, write_obj};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::job::{self, Outcome, Request};
use tesserae_mesh::mesh::Format;
use tesserae_mesh::parameters::{Algorithm, Parameters};

fn run(parameters: &Parameters) -> tesserae_mesh::Result<Outcome> {
    let mut bytes = Vec::new();
    write_obj(&mut bytes, &generate(Sample::Parts, 2000)?).expect("a vector takes everything");
    let prepared = job::prepare(&Request::new(&bytes, Format::Obj, parameters))?;
    job::run(&prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| {})
}

#[test]
fn flat_clusters_may_be_fewer_than_parts() {
    let parameters = Parameters { clusters: Some(3), ..Parameters::default() };
    let refused = run(&parameters).expect_err("there are twelve parts");
    assert!(refused.message.contains("bridge_components"), "{refused}");
    let Outcome { labels, report, .. } =
        run(&Parameters { bridge_components: true, ..parameters }).expect("bridges join the parts");
    assert_eq!((report.clusters, report.disconnected_clusters, report.input.components()), (3, 0, 12));
    let mut used = labels.expect("a flat clustering has labels");
    used.sort_unstable();
    used.dedup();
    assert_eq!(used, [0, 1, 2]);
}

#[test]
fn a_forest_becomes_one_tree() {
    let parameters = Parameters { algorithm: Algorithm::Pml, ..Parameters::default() };
    let roots = |parameters: &Parameters| {
        run(parameters).expect("it can be clustered").hierarchy.expect("there is a hierarchy").tree.roots()
    };
    assert_eq!(roots(&parameters), 12);
    assert_eq!(roots(&Parameters { bridge_components: true, ..parameters }), 1);
}
