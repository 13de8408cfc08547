//! The stages before the clustering, each by itself: parsing OBJ (beside `tobj`), parsing GLB, topology.
//!
//! On meshes made from nothing, and on the real ones in the folder that `TESSERAE_TEST_MESHES` names, where there is
//! one. `make bench` runs it; `make bench FILTER=topology` runs a part. Throughput is in bytes for parsers and in faces
//! for the topology.

use std::hint::black_box;
use std::path::Path;

use criterion::{BenchmarkId, Criterion, Throughput};
use tesserae::dev::sample::{self, Sample};
use tesserae::mesh::{self, Format, Limits, NoResources, PolygonMesh};
use tesserae::surface::Surface;

/// A mesh by name, and the files that hold it.
struct Subject {
    name: String,
    mesh: PolygonMesh,
    files: Vec<(Format, Vec<u8>)>,
}

impl Subject {
    fn sample(sample: Sample, faces: u64) -> Self {
        let mesh = sample::generate(sample, faces).expect("a number of faces that the sample has");
        let (mut obj, mut glb) = (Vec::new(), Vec::new());
        sample::write_obj(&mut obj, &mesh).expect("a vector takes everything");
        sample::write_glb(&mut glb, &mesh).expect("a vector takes everything");
        let files = vec![(Format::Obj, obj), (Format::Glb, glb)];
        Self { name: format!("{}-{}", sample.name(), mesh.faces.len()), mesh, files }
    }

    /// A file, where it is there.
    fn file(folder: &Path, name: &str) -> Option<Self> {
        let bytes = std::fs::read(folder.join(name)).ok()?;
        let format = Format::recognise(Some(name), &bytes, Some(bytes.len() as u64)).expect("a mesh");
        let mesh = read(&bytes, format);
        Some(Self { name: name.to_owned(), mesh, files: vec![(format, bytes)] })
    }
}

fn read(bytes: &[u8], format: Format) -> PolygonMesh {
    mesh::read(bytes, format, &NoResources, &Limits::default()).expect("a mesh")
}

fn main() {
    let mut subjects = vec![
        Subject::sample(Sample::Knot, 100_000),
        Subject::sample(Sample::Quads, 50_000),
        Subject::sample(Sample::Sphere, 1_000_000),
    ];
    if let Some(folder) = std::env::var_os("TESSERAE_TEST_MESHES") {
        let names = ["stanford-bunny.obj", "stanford-bunny.glb", "igea.glb"];
        subjects.extend(names.into_iter().filter_map(|name| Subject::file(Path::new(&folder), name)));
    }
    let mut criterion = Criterion::default().sample_size(20).configure_from_args();
    parse(&mut criterion, &subjects);
    topology(&mut criterion, &subjects);
    criterion.final_summary();
}

fn parse(criterion: &mut Criterion, subjects: &[Subject]) {
    for format in [Format::Obj, Format::Glb] {
        let mut group = criterion.benchmark_group(format!("parse {}", format.name()));
        for Subject { name, files, .. } in subjects {
            let Some((_, bytes)) = files.iter().find(|file| file.0 == format) else { continue };
            group.throughput(Throughput::Bytes(bytes.len() as u64));
            group.bench_function(BenchmarkId::new("tesserae", name), |bench| {
                bench.iter(|| read(black_box(bytes), format))
            });
            if format == Format::Obj {
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
