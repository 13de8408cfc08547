//! Every shader parses and is valid, and declares what its row says: bindings by name, workgroup sizes, and the sizes
//! and offsets of shared structs. Needs no GPU.

use std::collections::BTreeSet;
use std::path::Path;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{AddressSpace, Module, StorageAccess, TypeInner};
use tesserae::device::gpu::kernels::{Binding, KERNELS, Kernel, PIECES, uses};
use tesserae::device::gpu::layout::{
    Iteration, RUN, STRUCTS, Struct, TIES_BY_HASH, TIES_BY_LARGEST_ID, UNLISTED, WORKGROUP,
};

fn parse(kernel: &Kernel) -> Module {
    naga::front::wgsl::parse_str(&kernel.source())
        .unwrap_or_else(|error| panic!("{}.wgsl: {}", kernel.path, error.emit_to_string(&kernel.source())))
}

/// A binding: index, name, whether it is written (none for a uniform), bytes of an element.
type Declared = (u32, String, Option<bool>, u32);

/// The bindings that a module declares.
fn declared(module: &Module) -> Vec<Declared> {
    let mut found = Vec::new();
    for (_, variable) in module.global_variables.iter() {
        let is_written = match variable.space {
            AddressSpace::Uniform => None,
            AddressSpace::Storage { access } => Some(access.contains(StorageAccess::STORE)),
            AddressSpace::WorkGroup | AddressSpace::Private => continue,
            ref other => panic!("unexpected address space {other:?}"),
        };
        let place = variable.binding.as_ref().expect("a binding");
        assert_eq!(place.group, 0);
        let stride = match module.types[variable.ty].inner {
            // an array of a known length is one value, an array of unknown length has elements
            TypeInner::Array { size: naga::ArraySize::Dynamic, stride, .. } => stride,
            ref inner => inner.size(module.to_ctx()),
        };
        found.push((place.binding, variable.name.clone().expect("a name"), is_written, stride));
    }
    found.sort_by_key(|found| found.0);
    found
}

/// Compares what a module declares with the bindings of a row.
fn check_bindings(module: &Module, row: &[Binding]) -> Result<(), String> {
    let uniform = (0, "iteration".to_owned(), None, size_of::<Iteration>() as u32);
    let storage = (1..).zip(row).map(|(at, binding)| {
        (at, binding.name().to_owned(), Some(binding.is_written), binding.buffer.spec().stride as u32)
    });
    let expected: Vec<Declared> = std::iter::once(uniform).chain(storage).collect();
    let found = declared(module);
    if found == expected { Ok(()) } else { Err(format!("WGSL has {found:#?}, the row has {expected:#?}")) }
}

/// Whether the module declares the struct, and an error when it declares it differently.
fn check_struct(module: &Module, expected: &Struct) -> Result<bool, String> {
    for (_, ty) in module.types.iter() {
        if ty.name.as_deref() != Some(expected.name) {
            continue;
        }
        let TypeInner::Struct { members, span } = &ty.inner else {
            return Err(format!("{} is no struct", expected.name));
        };
        let found: Vec<_> =
            members.iter().map(|member| (member.name.as_deref().unwrap_or(""), member.offset as usize)).collect();
        if *span as usize != expected.size || found != expected.members {
            return Err(format!("WGSL has {span} bytes, {found:?}; Rust has {expected:?}"));
        }
        return Ok(true);
    }
    Ok(false)
}

#[test]
fn every_shader_is_valid() {
    for kernel in KERNELS {
        Validator::new(ValidationFlags::all(), Capabilities::SHADER_INT64)
            .validate(&parse(kernel))
            .unwrap_or_else(|error| panic!("{}.wgsl: {}", kernel.path, error.emit_to_string(&kernel.source())));
    }
}

#[test]
fn every_shader_declares_the_bindings_of_its_row() {
    for kernel in KERNELS {
        check_bindings(&parse(kernel), kernel.bindings).unwrap_or_else(|error| panic!("{}.wgsl: {error}", kernel.path));
        assert!(kernel.bindings.len() <= 8, "{}: portable devices bind 8 storage buffers", kernel.name);
    }
}

#[test]
fn two_buffers_of_a_row_that_are_swapped_fail_the_check() {
    let mut swaps = 0;
    for kernel in KERNELS {
        let module = parse(kernel);
        for (b, a) in (0..kernel.bindings.len()).flat_map(|b| (0..b).map(move |a| (b, a))) {
            let mut row = kernel.bindings.to_vec();
            row.swap(a, b);
            assert!(check_bindings(&module, &row).is_err(), "{}: bindings {a} and {b}", kernel.name);
            swaps += 1;
        }
    }
    assert!(swaps > 200, "{swaps}");
}

#[test]
fn every_shader_has_one_entry_point_of_its_workgroup_size_and_the_constant_of_its_row() {
    let mut names = BTreeSet::new();
    for kernel in KERNELS {
        let module = parse(kernel);
        let [entry] = &module.entry_points[..] else {
            panic!("{}.wgsl: not one entry point", kernel.path);
        };
        assert_eq!(entry.name, kernel.entry_point());
        assert_eq!(entry.workgroup_size, [kernel.workgroup_size, 1, 1], "{}", kernel.name);
        let constants: Vec<_> = module.overrides.iter().filter_map(|(_, constant)| constant.name.as_deref()).collect();
        assert_eq!(constants, Vec::from_iter(kernel.constant.map(|(name, _)| name)), "{}", kernel.name);
        assert!(names.insert(kernel.name), "{} twice", kernel.name);
    }
}

#[test]
fn shared_structs_and_constants_are_the_same_on_both_sides() {
    let mut seen = BTreeSet::new();
    let mut constants = BTreeSet::new();
    for kernel in KERNELS {
        let module = parse(kernel);
        for expected in STRUCTS {
            if check_struct(&module, expected).unwrap_or_else(|error| panic!("{}.wgsl: {error}", kernel.path)) {
                seen.insert(expected.name);
            }
        }
        for (_, constant) in module.constants.iter() {
            let (name, expected) = match constant.name.as_deref() {
                Some("WORKGROUP") => ("WORKGROUP", WORKGROUP),
                Some("RUN") => ("RUN", RUN),
                Some("TIES_BY_HASH") => ("TIES_BY_HASH", TIES_BY_HASH),
                Some("TIES_BY_LARGEST_ID") => ("TIES_BY_LARGEST_ID", TIES_BY_LARGEST_ID),
                Some("UNLISTED") => ("UNLISTED", UNLISTED),
                Some("FREE") => ("FREE", tesserae::device::FREE),
                _ => continue,
            };
            let naga::Expression::Literal(naga::Literal::U32(value)) = module.global_expressions[constant.init] else {
                panic!("{}.wgsl: {name} is no u32", kernel.path);
            };
            assert_eq!(value, expected, "{}.wgsl: {name}", kernel.path);
            constants.insert(name);
        }
    }
    assert_eq!(constants.len(), 6, "only {constants:?} are used");
    assert_eq!(seen.len(), STRUCTS.len(), "only {seen:?} are used");
}

#[test]
fn the_tables_list_every_shader_file_and_every_shared_piece_is_used() {
    let shaders = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let names = |folder: &Path| -> Vec<String> {
        let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry"));
        entries.map(|entry| entry.file_name().into_string().expect("UTF-8")).collect()
    };
    let mut files = BTreeSet::new();
    for folder in names(&shaders) {
        let path = |file: String| format!("{folder}/{}", file.strip_suffix(".wgsl").expect("a shader"));
        files.extend(names(&shaders.join(&folder)).into_iter().map(path));
    }
    let kernels = KERNELS.iter().map(|kernel| (kernel.path, kernel.wgsl));
    let texts: Vec<(&str, &str)> = kernels.chain(PIECES.iter().copied()).collect();
    let table: BTreeSet<String> = texts.iter().map(|(path, _)| (*path).to_owned()).collect();
    assert_eq!(files, table);
    let used: BTreeSet<&str> = texts.iter().flat_map(|(_, text)| uses(text)).collect();
    let pieces: BTreeSet<&str> =
        PIECES.iter().map(|(path, _)| path.strip_prefix("shared/").unwrap_or("energy")).collect();
    assert_eq!(used, pieces);
}

#[test]
fn the_comparison_notices_differences() {
    let kernel = KERNELS.iter().find(|kernel| kernel.path == "boundary/boundary_apply").expect("boundary_apply");
    let module_with = |source: &str| naga::front::wgsl::parse_str(source).expect("WGSL");
    let changed = |from: &str, to: &str| {
        let source = kernel.source().replace(from, to);
        assert_ne!(source, kernel.source(), "{from}");
        module_with(&source)
    };
    assert!(check_bindings(&changed("@binding(2)", "@binding(9)"), kernel.bindings).is_err());
    let written = changed("var<storage, read> neighbours", "var<storage, read_write> neighbours");
    assert!(check_bindings(&written, kernel.bindings).is_err());
    let grown = changed("moves: atomic<u32>,", "moves: atomic<u32>, more: u32,");
    assert!(STRUCTS.iter().any(|expected| check_struct(&grown, expected).is_err()));
}
