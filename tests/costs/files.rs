//! Meshes are read and prepared, and other files read, in time in proportion to their bytes.

use std::hint::black_box;
use std::time::Duration;

use tesserae_mesh::hierarchy::stored::{self, Stored};
use tesserae_mesh::job::{self, Request};
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};
use tesserae_mesh::parameters::Parameters;

use crate::inputs::{FILES, Kind, MESHES};
use crate::measure::{BOUND, Bound, Cost, SIZES, check, of_thread, with_others};

/// Processor time of work that uses rayon, all of it on one thread.
fn on_one_thread(work: impl FnOnce() + Send) -> Duration {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    pool.install(|| of_thread(work))
}

fn parameters() -> Parameters {
    Parameters { clusters: Some(1), bridge_components: true, ..Parameters::default() }
}

fn prepare(bytes: &[u8], format: Format, seeds: Option<&[u8]>, weights: Option<&[u8]>) {
    let parameters = parameters();
    let limits = Limits { max_faces: 1 << 17, ..Limits::default() };
    let request = Request { seeds, weights, limits, ..Request::new(bytes, format, &parameters) };
    _ = black_box(job::prepare(&request));
}

#[test]
fn meshes_are_read_in_proportion_to_their_bytes() {
    let _others = with_others();
    let costs = MESHES.iter().map(|&(name, format, make)| {
        let read =
            |bytes: &[u8]| on_one_thread(|| _ = black_box(mesh::read(bytes, format, &NoResources, &Limits::default())));
        (format!("{}: {name}", format.name()), Cost::of(SIZES, BOUND, make, read))
    });
    check(costs, BOUND);
}

#[test]
fn meshes_are_prepared_in_proportion_to_their_bytes() {
    let _others = with_others();
    // a strip has a face a byte, and a face takes 1 µs
    let (sizes, bound) = (SIZES.map(|bytes| bytes / 8), Bound { for_each_mib: Duration::from_millis(2400) });
    let costs = MESHES.iter().map(|&(name, format, make)| {
        let cost = Cost::of(sizes, bound, make, |bytes| on_one_thread(|| prepare(bytes, format, None, None)));
        (format!("{}: {name}", format.name()), cost)
    });
    check(costs, bound);
}

#[test]
fn other_files_are_read_in_proportion_to_their_bytes() {
    let _others = with_others();
    let triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let costs = FILES.iter().map(|&(name, kind, make)| {
        let read = |bytes: &[u8]| {
            on_one_thread(|| match kind {
                Kind::Hierarchy => {
                    let length = bytes.len() as u64;
                    assert!(black_box(Stored::read(bytes, length, u64::MAX)).is_ok(), "{name}");
                    assert!(black_box(stored::cut(bytes, length, u64::MAX, 1)).is_ok(), "{name}");
                }
                Kind::Labels => _ = black_box(job::parse_labels(bytes, bytes.len() / 4)),
                Kind::Seeds => prepare(triangle, Format::Obj, Some(bytes), None),
                Kind::Weights => prepare(triangle, Format::Obj, None, Some(bytes)),
            })
        };
        (format!("{kind:?}: {name}"), Cost::of(SIZES, BOUND, make, read))
    });
    check(costs, BOUND);
}
