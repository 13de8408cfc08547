//! What several tests share: a zoo of meshes, and clusterings that flood.
#![allow(dead_code, reason = "every test binary uses its own part")]

pub mod gpu;
pub mod zoo;

use std::path::{Path, PathBuf};

use tesserae_mesh::cluster::hierarchy::Options;
use tesserae_mesh::cluster::merging::Pairs;
use tesserae_mesh::cluster::quality::Quality;
use tesserae_mesh::cluster::seeds::{self, SeedFaces};
use tesserae_mesh::dev::sample::hard::{cone, stacked_boxes};
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::dual_edge::Ties;
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::surface::Surface;

/// The folder of the repository, which is that of a test's package or outside of it.
pub fn root() -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.ancestors().find(|folder| folder.join("Cargo.lock").is_file()).expect("a repository").to_owned()
}

/// Clusterings whose boundary phase floods: borders have hundreds of faces to go.
pub fn floods() -> Vec<(&'static str, Surface, SeedFaces)> {
    // one cluster is the first face of a strip, the other begins beside it and has all others
    let strip = Surface::build(&generate(Sample::Strip, 1200).expect("a sample")).expect("a surface");
    let faces = strip.internal_faces();
    let ends = SeedFaces { face_of_cluster: vec![faces[0], faces[1]], component_of_cluster: vec![0, 0] };
    let boxes = Surface::build(&stacked_boxes(160)).expect("a surface");
    let among_boxes = seeds::choose(&boxes, 6, &Seeds::Random, 1, None).expect("the number is possible");
    let cone = Surface::build(&cone(1500)).expect("a surface");
    let around = seeds::choose(&cone, 3, &Seeds::Random, 1, None).expect("the number is possible");
    vec![("strip", strip, ends), ("stacked boxes", boxes, among_boxes), ("cone", cone, around)]
}

/// Parallel rounds with optimisation, to the top.
pub fn pml() -> Options {
    Options {
        sequential_at: 0,
        collapse_fraction: None,
        optimise: true,
        refine: true,
        iterations_a_round: [4, u32::MAX],
        optimised_from: 1,
        ties: Ties::Hash,
        pairs: Pairs::CheaperHalf,
        clusters: None,
        levels: Vec::new(),
        allow_disconnected: false,
        relocation: Some(Quality::Default),
    }
}
