//! Every shader is valid, the structs in it have the sizes and offsets of Rust's, and it uses what its first lines
//! name. Needs no GPU.

use std::collections::BTreeSet;
use std::path::Path;

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, Module, StorageAccess, TypeInner};
use tesserae_mesh::device::ShapeWords;
use tesserae_mesh::device::gpu::Tuning;
use tesserae_mesh::device::gpu::kernels::{Binding, KERNELS, Kernel, PIECES, names};
use tesserae_mesh::device::gpu::layout::{self, Iteration};
use tesserae_mesh::device::gpu::pages::{Bindings, MOST_PAGES};
use tesserae_mesh::device::gpu::shapes;
use tesserae_mesh::energy::shared::{Layout, Struct};

/// Numbers of coordinates of points.
const AXES: [usize; 2] = [3, 8];

fn parse(kernel: &Kernel, source: &str) -> (Module, ModuleInfo) {
    parse_text(kernel.name, source)
}

fn parse_text(name: &str, source: &str) -> (Module, ModuleInfo) {
    let module =
        naga::front::wgsl::parse_str(source).unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(source)));
    let pages =
        Capabilities::STORAGE_BUFFER_BINDING_ARRAY | Capabilities::STORAGE_BUFFER_BINDING_ARRAY_NON_UNIFORM_INDEXING;
    let info = Validator::new(ValidationFlags::all(), Capabilities::SHADER_INT64 | pages)
        .validate(&module)
        .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(source)));
    (module, info)
}

/// A binding: group and index, name, whether it is written (none for a uniform), bytes of an element.
type Declared = ((u32, u32), String, Option<bool>, u32);

/// The bindings that the entry point uses.
fn used(module: &Module, info: &ModuleInfo) -> Vec<Declared> {
    let mut found = Vec::new();
    for (handle, variable) in module.global_variables.iter() {
        let uses = info.get_entry_point(0)[handle];
        let is_written = match variable.space {
            AddressSpace::Uniform => None,
            AddressSpace::Storage { access } => Some(access.contains(StorageAccess::STORE)),
            _ => continue,
        };
        let stride = match module.types[variable.ty].inner {
            // an array of a known length is one value, an array of unknown length has elements
            TypeInner::Array { size: naga::ArraySize::Dynamic, stride, .. } => stride,
            ref inner => inner.size(module.to_ctx()),
        };
        // entry points of one thread may do without the uniform
        if is_written.is_none() || !uses.is_empty() {
            let place = variable.binding.as_ref().expect("a binding");
            found.push(((place.group, place.binding), variable.name.clone().expect("a name"), is_written, stride));
        }
    }
    found.sort_by_key(|found| found.0);
    found
}

/// Compares what a module for so many axes uses with the buffers that are bound.
fn check_bindings((module, info): &(Module, ModuleInfo), bound: &[Binding], axes: usize) -> Result<(), String> {
    let uniform = ((0, 0), "iteration".to_owned(), None, size_of::<Iteration>() as u32);
    let storage = (0..).zip(bound).map(|(at, binding)| {
        let spec = binding.buffer.spec();
        ((1, at), spec.name.to_owned(), Some(binding.is_written), spec.bytes_of(1, axes) as u32)
    });
    let expected: Vec<Declared> = std::iter::once(uniform).chain(storage).collect();
    let found = used(module, info);
    if found == expected { Ok(()) } else { Err(format!("WGSL uses {found:#?}, bound is {expected:#?}")) }
}

/// Compares a struct of a module for so many axes with what Rust knows of it.
fn check_struct(module: &Module, expected: &Struct, axes: usize) -> Result<(), String> {
    let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(expected.name));
    let Some((_, naga::Type { inner: TypeInner::Struct { members, span }, .. })) = found else {
        return Err(format!("{} is no struct", expected.name));
    };
    let offsets: Vec<_> = members.iter().map(|member| member.offset as usize).collect();
    let (bytes, in_rust) = match expected.layout {
        Layout::Twin(bytes, offsets) => (bytes, offsets),
        Layout::Words(words) => (4 * words(axes), offsets.as_slice()),
    };
    if (*span as usize, offsets.as_slice()) == (bytes, in_rust) {
        return Ok(());
    }
    Err(format!("{}: WGSL has {span} bytes, {offsets:?}; Rust has {bytes}, {in_rust:?}", expected.name))
}

#[test]
fn every_shader_is_valid_and_uses_the_buffers_and_the_constant_that_it_names() {
    let mut all = BTreeSet::new();
    for kernel in KERNELS {
        let bound = kernel.bindings();
        for axes in AXES {
            let parsed = parse(kernel, &kernel.source(&Tuning::default(), axes, None));
            check_bindings(&parsed, &bound, axes).unwrap_or_else(|error| panic!("{}: {error}", kernel.name));
            let constants: Vec<_> =
                parsed.0.overrides.iter().filter_map(|(_, constant)| constant.name.as_deref()).collect();
            assert_eq!(constants, Vec::from_iter(kernel.constant.map(|(name, _)| name)), "{}", kernel.name);
        }
        for (part, key) in kernel.parts.iter().flat_map(|part| ["reads", "writes"].map(|key| (part, key))) {
            let unknown =
                names(part.wgsl, key).find(|name| !bound.iter().any(|bound| bound.buffer.spec().name == *name));
            assert_eq!(unknown, None, "{}.wgsl names a buffer that is not in the table", part.path);
        }
        let most = if kernel.is_chain() { 11 } else { 8 };
        assert!(bound.len() <= most, "{}: portable devices bind 8 storage buffers", kernel.name);
        assert!(all.insert(kernel.name), "{} twice", kernel.name);
    }
}

#[test]
fn every_shader_is_valid_for_buffers_in_pages_and_writes_no_atomic_twice() {
    let pages = Bindings { bytes: (1 << 31) - 1, pages: MOST_PAGES as u64 };
    for (kernel, axes) in KERNELS.iter().flat_map(|kernel| AXES.map(|axes| (kernel, axes))) {
        let [whole, paged] = [None, Some(&pages)].map(|pages| kernel.source(&Tuning::default(), axes, pages));
        let names = |source| {
            let (module, info) = parse(kernel, source);
            used(&module, &info).into_iter().map(|(place, name, is_written, _)| (place, name, is_written))
        };
        assert!(names(&paged).eq(names(&whole)), "{}", kernel.name);
        // an index is written twice, so it must have no effects
        let atomics = |source: &str| source.matches("atomic").count();
        assert_eq!(atomics(&paged), atomics(&whole), "{}", kernel.name);
    }
}

#[test]
fn structs_have_the_same_layout_on_both_sides() {
    for axes in AXES {
        let (module, _) = parse(KERNELS[0], &KERNELS[0].source(&Tuning::default(), axes, None));
        for expected in layout::structs() {
            assert_eq!(check_struct(&module, expected, axes), Ok(()), "{axes} axes");
        }
    }
}

#[test]
fn the_kernel_of_shapes_is_valid_and_sees_the_words_of_a_shape() {
    let (module, info) = parse_text("shape_propose", shapes::WGSL);
    let found = used(&module, &info);
    assert!(found.len() <= 8, "portable devices bind 8 storage buffers");
    let strides: Vec<(&str, u32)> = found.iter().map(|(_, name, _, bytes)| (name.as_str(), *bytes)).collect();
    let words = size_of::<ShapeWords>() as u32;
    let expected =
        [("neighbours", 4), ("samples", 4), ("labels", 4), ("shapes", words), ("listed", 4), ("proposals", 4)];
    assert_eq!(strides, expected);
    assert!(found.iter().all(|(_, name, is_written, _)| *is_written == Some(name == "proposals")));
}

#[test]
fn the_tables_list_every_shader_file_and_every_shared_piece_is_used() {
    let shaders = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let list = |folder: &Path| -> Vec<String> {
        let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry"));
        entries.map(|entry| entry.file_name().into_string().expect("UTF-8")).collect()
    };
    let mut files = BTreeSet::new();
    for folder in list(&shaders) {
        let path = |file: String| format!("{folder}/{}", file.strip_suffix(".wgsl").expect("a shader"));
        files.extend(list(&shaders.join(&folder)).into_iter().map(path));
    }
    let kernels = KERNELS.iter().flat_map(|kernel| kernel.parts).map(|part| (part.path, part.wgsl));
    let alone = [("shapes/shape_propose", shapes::WGSL)];
    let texts: Vec<(&str, &str)> = kernels.chain(PIECES.iter().copied()).chain(alone).collect();
    let path = |name: &str| match name {
        "energy" => "energy/cvd".to_owned(),
        name if name.contains('/') => name.to_owned(),
        name => format!("shared/{name}"),
    };
    assert_eq!(files, texts.iter().map(|(name, _)| path(name)).collect());
    let used: BTreeSet<&str> = texts.iter().flat_map(|(_, text)| names(text, "uses")).collect();
    assert_eq!(used, PIECES.iter().map(|(name, _)| *name).collect());
}

#[test]
fn the_rust_twin_that_a_kernel_names_exists() {
    let device = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/device");
    let folders = [device.clone(), device.join("plain")].into_iter().filter(|folder| folder.is_dir());
    let files =
        folders.flat_map(|folder| std::fs::read_dir(folder).expect("a folder").map(|file| file.expect("an entry")));
    let text: String = files.filter_map(|file| std::fs::read_to_string(file.path()).ok()).collect();
    let mut twins = 0;
    for part in KERNELS.iter().flat_map(|kernel| kernel.parts) {
        let Some((_, twin)) = part.wgsl.split_once("Rust: device::") else { continue };
        let name = twin.split_once(".\n").map_or("", |(path, _)| path.rsplit("::").next().unwrap_or(path));
        let is_there = ['(', '<'].into_iter().any(|next| text.contains(&format!("fn {name}{next}")));
        assert!(is_there, "{}.wgsl names {name}", part.path);
        twins += 1;
    }
    assert!(twins > 20, "{twins}");
}

#[test]
fn the_comparison_notices_differences() {
    let source = |kernel: &Kernel| kernel.source(&Tuning::default(), 3, None);
    let mut swaps = 0;
    for kernel in KERNELS {
        let parsed = parse(kernel, &source(kernel));
        let bound = kernel.bindings();
        for (b, a) in (0..bound.len()).flat_map(|b| (0..b).map(move |a| (b, a))) {
            let mut swapped = bound.clone();
            swapped.swap(a, b);
            assert!(check_bindings(&parsed, &swapped, 3).is_err(), "{}: bindings {a} and {b}", kernel.name);
            swaps += 1;
        }
    }
    assert!(swaps > 200, "{swaps}");
    let kernel = KERNELS.iter().find(|kernel| kernel.name == "BOUNDARY_APPLY").expect("boundary_apply");
    let changed = |from: &str, to: &str| {
        let changed = source(kernel).replace(from, to);
        assert_ne!(changed, source(kernel), "{from}");
        parse(kernel, &changed)
    };
    let unused = changed("wanted_clusters[face]", "0u");
    assert!(check_bindings(&unused, &kernel.bindings(), 3).is_err());
    let mut only_read = kernel.bindings();
    only_read.iter_mut().for_each(|binding| binding.is_written = false);
    assert!(check_bindings(&parse(kernel, &source(kernel)), &only_read, 3).is_err());
    let (grown, _) = changed("moves: atomic<u32>,", "moves: atomic<u32>, more: u32,");
    let differs = |module: &Module| layout::structs().any(|expected| check_struct(module, expected, 3).is_err());
    assert!(differs(&grown));
    let (moved, _) = changed("point: Point,\n    weight: u32,", "weight: u32,\n    point: Point,");
    assert!(differs(&moved));
}
