use super::*;
use crate::artifacts::{HIERARCHY, LABELS};
use crate::device::cpu::CpuDevice;

#[test]
fn a_mesh_is_kept_for_an_output_that_needs_it_and_for_no_other() {
    let made_of_mesh = Artifact {
        name: "mesh",
        about: "",
        needs: &[Need::Mesh],
        forms: &[],
        choices: &[],
        flags: &[],
        is_of_points: false,
        is_served: false,
    };
    let parameters = Parameters { clusters: Some(1), ..Parameters::default() };
    for (outputs, positions) in [(vec![&LABELS, &made_of_mesh], Some(4)), (vec![&LABELS], None)] {
        let request = Request {
            outputs: &outputs,
            ..Request::new(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n", Format::Obj, &parameters)
        };
        let prepared = prepare(&request).expect("a mesh");
        let outcome = run(&prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| {}).expect("a result");
        drop(prepared);
        assert_eq!(outcome.content().mesh.map(|mesh| mesh.positions.len()), positions);
    }
}

#[test]
fn faces_that_visit_a_vertex_twice_are_warned_about_once() {
    let obj = |faces: &str| format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n{faces}");
    let parameters = Parameters { clusters: Some(1), ..Parameters::default() };
    for (faces, degenerate) in
        [("f 1 2 3\nf 2 4 3\n", None), ("f 1 2 3 2\nf 1 2 3 1 2 4\nf 2 4 3\n", Some("at one position: 2"))]
    {
        let bytes = obj(faces);
        let request = Request::new(bytes.as_bytes(), Format::Obj, &parameters);
        let warnings = prepare(&request).expect("a mesh").warnings;
        assert_eq!(warnings.len(), usize::from(degenerate.is_some()), "{warnings:?}");
        assert!(degenerate.is_none_or(|words| warnings[0].ends_with(words)), "{warnings:?}");
    }
}

#[test]
fn the_outputs_that_parameters_promise_are_what_the_plan_makes() {
    use crate::parameters::Algorithm;
    for algorithm in [Algorithm::Bb, Algorithm::Acvd, Algorithm::Vc, Algorithm::Pml, Algorithm::Ml, Algorithm::Hr] {
        for clusters in [None, Some(1)] {
            let parameters = Parameters { algorithm, clusters, ..Parameters::default() };
            let request = Request {
                seeds: if algorithm.is_hierarchical() { None } else { Some(b"[1]") },
                ..Request::new(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n", Format::Obj, &parameters)
            };
            let prepared = prepare(&request).expect("a mesh");
            // of the parameters as they were sent, and as the report repeats them
            for parameters in [&parameters, prepared.spec.reported()] {
                let has_labels = LABELS.is_made(parameters);
                assert_eq!(has_labels, prepared.spec.clustering.has_labels(), "{parameters:?}");
                let is_hierarchical = prepared.spec.clustering.is_hierarchical();
                assert_eq!(HIERARCHY.is_made(parameters), is_hierarchical, "{parameters:?}");
            }
        }
    }
}

#[test]
fn a_viewer_sees_labels_of_the_upload_after_moves_of_whole_clusters_and_changes_nothing() {
    use crate::cluster::quality::Quality;
    use crate::dev::sample::{Sample, generate, write_glb};

    #[derive(Debug, Default)]
    struct All(std::sync::Mutex<Vec<Vec<u32>>>);
    impl Viewer for All {
        fn watches(&self) -> bool {
            true
        }
        fn is_due(&self) -> bool {
            true
        }
        fn show(&self, labels: Vec<u32>) {
            self.0.lock().expect("no panic").push(labels);
        }
    }

    let mut glb = Vec::new();
    write_glb(&mut glb, &generate(Sample::Terrain, 3000).expect("a mesh")).expect("written");
    let parameters = Parameters { clusters: Some(300), ..Parameters::default() };
    let mut prepared = prepare(&Request::new(&glb, Format::Glb, &parameters)).expect("a mesh");
    let labels = |prepared: &Prepared| {
        let outcome = run(prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| {}).expect("a result");
        (outcome.labels.expect("labels"), outcome.report.iterations)
    };
    let (plain, rows) = labels(&prepared);
    let all = Arc::<All>::default();
    prepared.viewer = Some(all.clone());
    assert_eq!(labels(&prepared).0, plain);
    let shown = std::mem::take(&mut *all.0.lock().expect("no panic"));
    assert!(!shown.is_empty() && shown.len() < rows.len(), "{} of {} rows", shown.len(), rows.len());
    // the same clusters with other numbers
    let last = shown.last().expect("labels");
    let mut number = vec![None; last.len()];
    let renumbered: Vec<u32> =
        last.iter().zip(&plain).map(|(&label, &own)| *number[label as usize].get_or_insert(own)).collect();
    assert_eq!(renumbered, plain);

    // with quality best, so are those of the jobs that it mixes in
    let parameters = Parameters { quality: Quality::Best, ..parameters };
    let mut prepared = prepare(&Request::new(&glb, Format::Glb, &parameters)).expect("a mesh");
    let (plain, _) = labels(&prepared);
    prepared.viewer = Some(all.clone());
    let (watched, rows) = labels(&prepared);
    assert_eq!(watched, plain);
    let shown = all.0.lock().expect("no panic").len();
    assert!(shown > rows.len(), "{shown} of {} rows", rows.len());
}

/// A polygon of so many corners, a face at each edge, and a second polygon on the other side of these if `is_closed`.
fn around_polygon(faces: usize, is_closed: bool) -> String {
    use std::fmt::Write;
    let mut obj = String::new();
    let ring = |obj: &mut String, radius: f64, height: f64| {
        for corner in 0..faces {
            let angle = std::f64::consts::TAU * corner as f64 / faces as f64;
            writeln!(obj, "v {} {} {height}", radius * angle.cos(), radius * angle.sin()).expect("room");
        }
    };
    ring(&mut obj, 1.0, 0.0);
    ring(&mut obj, if is_closed { 1.0 } else { 1.3 }, 0.2);
    let polygon = |first: usize| (first..first + faces).map(|corner| format!(" {corner}")).collect::<String>();
    writeln!(obj, "f{}", polygon(1)).expect("room");
    if is_closed {
        writeln!(obj, "f{}", polygon(1 + faces)).expect("room");
    }
    for corner in 0..faces {
        let (one, next) = (1 + corner, 1 + (corner + 1) % faces);
        match is_closed {
            true => writeln!(obj, "f {one} {next} {} {}", next + faces, one + faces).expect("room"),
            false => writeln!(obj, "f {one} {} {next}", one + faces).expect("room"),
        }
    }
    obj
}

#[test]
fn work_is_in_proportion_to_the_faces_where_one_has_them_all_as_neighbours() {
    use crate::cluster::quality::Quality;
    use crate::surface::LOOKS;

    const FACES: usize = 4_000;
    let looks_a_face = |is_closed: bool, clusters: usize, quality: Quality| {
        let obj = around_polygon(FACES, is_closed);
        let parameters = Parameters { clusters: Some(clusters as u64), quality, ..Parameters::default() };
        let prepared = prepare(&Request::new(obj.as_bytes(), Format::Obj, &parameters)).expect("a mesh");
        // the thread counts
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        pool.install(|| {
            let before = LOOKS.get();
            run(&prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| {}).expect("a result");
            (LOOKS.get() - before) / FACES as u64
        })
    };
    for is_closed in [false, true] {
        for clusters in [FACES / 2, FACES / 100] {
            for (quality, most) in
                [(Quality::Fast, 1_000), (Quality::Default, 11 * 1_000), (Quality::Best, 12 * 11 * 1_000)]
            {
                let looks = looks_a_face(is_closed, clusters, quality);
                assert!(looks <= most, "{is_closed} {clusters} {quality:?}: {looks} looks a face");
            }
        }
    }
}
