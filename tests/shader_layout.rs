//! Every shader parses and is valid, and declares what the Rust side believes it does: bindings, workgroup sizes, and the
//! sizes and offsets of shared structs. Needs no GPU.

use std::collections::BTreeSet;
use std::path::Path;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{AddressSpace, Module, StorageAccess, TypeInner};
use tesserae::device::gpu::kernels::{Access, Binding, KERNELS, Kernel};
use tesserae::device::gpu::layout::{
    GATHER_RUN, STRUCTS, Struct, TIES_BY_HASH, TIES_BY_LARGEST_ID, UNLISTED, WORKGROUP,
};

fn module(kernel: &Kernel) -> Module {
    naga::front::wgsl::parse_str(&kernel.source())
        .unwrap_or_else(|error| panic!("{}.wgsl: {}", kernel.name, error.emit_to_string(&kernel.source())))
}

/// The bindings that a module declares, or what is wrong with them.
fn bindings(module: &Module) -> Vec<(u32, String, Access, u32)> {
    let mut found = Vec::new();
    for (_, variable) in module.global_variables.iter() {
        let access = match variable.space {
            AddressSpace::Uniform => Access::Turn,
            AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => Access::Write,
            AddressSpace::Storage { .. } => Access::Read,
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
        let name = variable.name.clone().expect("a name");
        found.push((place.binding, name, access, stride));
    }
    found.sort_by_key(|found| found.0);
    found
}

fn check_bindings(module: &Module, expected: &[Binding]) -> Result<(), String> {
    let expected: Vec<_> = expected
        .iter()
        .zip(0..)
        .map(|(binding, at)| (at, binding.name.to_owned(), binding.access, binding.stride as u32))
        .collect();
    let found = bindings(module);
    if found == expected { Ok(()) } else { Err(format!("WGSL has {found:#?}, Rust has {expected:#?}")) }
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
        let module = module(kernel);
        Validator::new(ValidationFlags::all(), Capabilities::SHADER_INT64)
            .validate(&module)
            .unwrap_or_else(|error| panic!("{}.wgsl: {}", kernel.name, error.emit_to_string(&kernel.source())));
    }
}

#[test]
fn every_shader_declares_the_bindings_of_the_table() {
    for kernel in KERNELS {
        check_bindings(&module(kernel), kernel.bindings)
            .unwrap_or_else(|error| panic!("{}.wgsl: {error}", kernel.name));
        let storage = kernel.bindings.iter().filter(|binding| binding.access != Access::Turn).count();
        assert!(storage <= 8, "{}: portable devices bind 8 storage buffers", kernel.name);
    }
}

#[test]
fn every_shader_has_one_entry_point_of_its_name_and_workgroup_size() {
    for kernel in KERNELS {
        let module = module(kernel);
        let [entry] = &module.entry_points[..] else {
            panic!("{}.wgsl: not one entry point", kernel.name);
        };
        assert_eq!(entry.name, kernel.name);
        assert_eq!(entry.workgroup_size, [kernel.workgroup_size, 1, 1], "{}", kernel.name);
    }
}

#[test]
fn shared_structs_and_constants_are_the_same_on_both_sides() {
    let mut seen = BTreeSet::new();
    let mut constants = BTreeSet::new();
    for kernel in KERNELS {
        let module = module(kernel);
        for expected in STRUCTS {
            if check_struct(&module, expected).unwrap_or_else(|error| panic!("{}.wgsl: {error}", kernel.name)) {
                seen.insert(expected.name);
            }
        }
        for (_, constant) in module.constants.iter() {
            let (name, expected) = match constant.name.as_deref() {
                Some("WORKGROUP") => ("WORKGROUP", WORKGROUP),
                Some("RUN") => ("RUN", GATHER_RUN),
                Some("TIES_BY_HASH") => ("TIES_BY_HASH", TIES_BY_HASH),
                Some("TIES_BY_LARGEST_ID") => ("TIES_BY_LARGEST_ID", TIES_BY_LARGEST_ID),
                Some("UNLISTED") => ("UNLISTED", UNLISTED),
                Some("FREE") => ("FREE", tesserae::device::FREE),
                _ => continue,
            };
            let naga::Expression::Literal(naga::Literal::U32(value)) = module.global_expressions[constant.init] else {
                panic!("{}.wgsl: {name} is no u32", kernel.name);
            };
            assert_eq!(value, expected, "{}.wgsl: {name}", kernel.name);
            constants.insert(name);
        }
    }
    assert_eq!(constants.len(), 6, "only {constants:?} are used");
    assert_eq!(seen.len(), STRUCTS.len(), "only {seen:?} are used");
}

#[test]
fn the_table_lists_every_shader_file() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let names = |folder: &Path| -> Vec<(bool, String)> {
        let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry"));
        entries.map(|entry| (entry.path().is_dir(), entry.file_name().into_string().expect("UTF-8"))).collect()
    };
    let mut files = BTreeSet::new();
    for (is_folder, phase) in names(&folder) {
        assert!(is_folder, "{phase} belongs in a folder");
        if phase != "shared" {
            files.extend(names(&folder.join(phase)).into_iter().map(|(_, file)| file.replace(".wgsl", "")));
        }
    }
    let table: BTreeSet<String> = KERNELS.iter().map(|kernel| kernel.name.to_owned()).collect();
    assert_eq!(files, table);
}

#[test]
fn the_comparison_notices_differences() {
    let kernel = KERNELS.iter().find(|kernel| kernel.name == "boundary_apply").expect("boundary_apply");
    let swapped = kernel.source().replace("@binding(2)", "@binding(7)");
    let module_with = |source: &str| naga::front::wgsl::parse_str(source).expect("WGSL");
    assert!(check_bindings(&module_with(&swapped), kernel.bindings).is_err());
    let read_only =
        kernel.source().replace("var<storage, read> wishes: array<u32>", "var<storage, read_write> wishes: array<u32>");
    assert!(check_bindings(&module_with(&read_only), kernel.bindings).is_err());
    let grown = kernel.source().replace("moves: atomic<u32>,", "moves: atomic<u32>, more: u32,");
    assert_ne!(grown, kernel.source());
    assert!(STRUCTS.iter().any(|expected| check_struct(&module_with(&grown), expected).is_err()));
}
