//! The stages around the clustering, each by itself: parsing every format (OBJ beside `tobj`, all beside a copy of the
//! file), topology, and encoders of everything that is made of a mesh and labels.
//!
//! On meshes made from nothing, and on the real ones in the folder that `TESSERAE_TEST_MESHES` names, where there is
//! one. `make bench` runs it; `make bench FILTER=topology` runs a part. Throughput is in bytes for parsers and in faces
//! for the rest.

use std::hint::black_box;
use std::path::Path;

use criterion::{BenchmarkId, Criterion, Throughput};
use tesserae_mesh::artifacts::{ALL, Content, Labels, Need};
use tesserae_mesh::dev::sample::{self, Sample};
use tesserae_mesh::mesh::{self, Format, Limits, NoResources, PolygonMesh};
use tesserae_mesh::surface::Surface;

/// A mesh by name, and the files that hold it.
struct Subject {
    name: String,
    mesh: PolygonMesh,
    files: Vec<File>,
}

/// A file: what it is, its format, its bytes.
type File = (&'static str, Format, Vec<u8>);

impl Subject {
    fn sample(sample: Sample, faces: u64) -> Self {
        let mesh = sample::generate(sample, faces).expect("a number of faces that the sample has");
        let (mut obj, mut glb) = (Vec::new(), Vec::new());
        sample::write_obj(&mut obj, &mesh).expect("a vector takes everything");
        sample::write_glb(&mut glb, &mesh).expect("a vector takes everything");
        let (ply, stl) = (ply(&mesh), stl(&mesh));
        let files = vec![
            ("obj", Format::Obj, obj),
            ("glb", Format::Glb, glb),
            ("ply text", Format::Ply, ply.0),
            ("ply binary", Format::Ply, ply.1),
            ("stl text", Format::Stl, stl.0),
            ("stl binary", Format::Stl, stl.1),
        ];
        Self { name: format!("{}-{}", sample.name(), mesh.faces.len()), mesh, files }
    }

    /// A file, where it is there.
    fn file(folder: &Path, name: &str) -> Option<Self> {
        let bytes = std::fs::read(folder.join(name)).ok()?;
        let format = Format::recognise(Some(name), &bytes, Some(bytes.len() as u64)).expect("a mesh");
        let mesh = read(&bytes, format);
        Some(Self { name: name.to_owned(), mesh, files: vec![(format.name(), format, bytes)] })
    }
}

fn read(bytes: &[u8], format: Format) -> PolygonMesh {
    mesh::read(bytes, format, &NoResources, &Limits::default()).expect("a mesh")
}

/// A mesh as PLY, text and binary.
fn ply(mesh: &PolygonMesh) -> (Vec<u8>, Vec<u8>) {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            mesh.positions.len(),
            mesh.faces.len()
        )
    };
    let (mut text, mut binary) = (header("ascii"), header("binary_little_endian").into_bytes());
    for [x, y, z] in &mesh.positions {
        text += &format!("{x} {y} {z}\n");
        binary.extend([x, y, z].iter().flat_map(|&&c| (c as f32).to_le_bytes()));
    }
    for face in 0..mesh.faces.len() {
        let corners = mesh.faces.corners(face);
        text += &format!("{}", corners.len());
        binary.push(corners.len() as u8);
        for corner in corners {
            text += &format!(" {corner}");
            binary.extend(corner.to_le_bytes());
        }
        text += "\n";
    }
    (text.into_bytes(), binary)
}

/// The triangles that begin the polygons of a mesh as STL, text and binary.
fn stl(mesh: &PolygonMesh) -> (Vec<u8>, Vec<u8>) {
    let (mut text, mut binary) = ("solid bench\n".to_owned(), vec![0; 80]);
    binary.extend((mesh.faces.len() as u32).to_le_bytes());
    for face in 0..mesh.faces.len() {
        text += "facet normal 0 0 0\n  outer loop\n";
        binary.extend([0; 12]);
        for &corner in &mesh.faces.corners(face)[..3] {
            let [x, y, z] = mesh.positions[corner as usize];
            text += &format!("    vertex {x} {y} {z}\n");
            binary.extend([x, y, z].iter().flat_map(|&c| (c as f32).to_le_bytes()));
        }
        text += "  endloop\nendfacet\n";
        binary.extend([0; 2]);
    }
    text += "endsolid bench\n";
    (text.into_bytes(), binary)
}

fn main() {
    let mut subjects = vec![
        Subject::sample(Sample::Knot, 100_000),
        Subject::sample(Sample::Quads, 50_000),
        Subject::sample(Sample::Sphere, 1_000_000),
    ];
    if let Some(folder) = std::env::var_os("TESSERAE_TEST_MESHES") {
        let names = [
            "stanford-bunny.obj",
            "stanford-bunny.glb",
            "igea.glb",
            "stanford-bunny.ply",
            "horse.ply",
            "featuretype.stl",
        ];
        subjects.extend(names.into_iter().filter_map(|name| Subject::file(Path::new(&folder), name)));
    }
    let mut criterion = Criterion::default().sample_size(20).configure_from_args();
    parse(&mut criterion, &subjects);
    topology(&mut criterion, &subjects);
    encode(&mut criterion, &subjects);
    criterion.final_summary();
}

fn parse(criterion: &mut Criterion, subjects: &[Subject]) {
    for Subject { name, files, .. } in subjects {
        for (kind, format, bytes) in files {
            let mut group = criterion.benchmark_group(format!("parse {kind}"));
            group.throughput(Throughput::Bytes(bytes.len() as u64));
            group.bench_function(BenchmarkId::new("tesserae", name), |bench| {
                bench.iter(|| read(black_box(bytes), *format))
            });
            group.bench_function(BenchmarkId::new("copy", name), |bench| bench.iter(|| black_box(&bytes[..]).to_vec()));
            if *format == Format::Obj {
                group.bench_function(BenchmarkId::new("tobj", name), |bench| {
                    bench.iter(|| {
                        // polygons stay polygons there too, and materials are not looked at
                        let options = tobj::LoadOptions::default();
                        tobj::load_obj_buf(&mut black_box(&bytes[..]), &options, |_| Ok(Default::default()))
                    });
                });
            }
        }
    }
}

fn topology(criterion: &mut Criterion, subjects: &[Subject]) {
    let mut group = criterion.benchmark_group("topology");
    for Subject { name, mesh, .. } in subjects {
        group.throughput(Throughput::Elements(mesh.faces.len() as u64));
        group.bench_function(name, |bench| bench.iter(|| Surface::build(black_box(mesh)).expect("a surface")));
    }
}

/// Every form of every output that a mesh and labels are enough for. Clusters are faces in a row, 100 each.
fn encode(criterion: &mut Criterion, subjects: &[Subject]) {
    for Subject { name, mesh, .. } in subjects {
        let labels: Vec<u32> = (0..mesh.faces.len() as u32).map(|face| face / 100).collect();
        let clusters = labels.last().map_or(0, |&last| u64::from(last) + 1);
        let content = Content { labels: Some(Labels::new(clusters, &labels)), mesh: Some(mesh), ..Content::default() };
        let is_enough = |need: &Need| matches!(need, Need::Labels | Need::Faces | Need::Mesh);
        for form in ALL.iter().filter(|output| output.needs.iter().all(is_enough)).flat_map(|output| output.forms) {
            let mut bytes = Vec::new();
            let mut encode = || {
                bytes.clear();
                (form.encode)(black_box(&content)).is_ok_and(|write| write(&mut bytes).is_ok())
            };
            // a format that refuses this many clusters
            if !encode() {
                continue;
            }
            let mut group = criterion.benchmark_group(format!("encode {}", form.file));
            group.throughput(Throughput::Elements(mesh.faces.len() as u64));
            group.bench_function(name, |bench| bench.iter(&mut encode));
        }
    }
}
