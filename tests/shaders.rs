//! The shaders are valid, and what stands in them and in Rust alike is laid out alike.

#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{Module, Type, TypeInner};
use std::collections::HashMap;
use std::path::Path;
use stoop::geodesy::{SEMI_MAJOR_M, SEMI_MINOR_M};
use stoop::render::{Mirror, mirrored_structs, shader_sources};

fn parse(name: &str, source: &str) -> Module {
    naga::front::wgsl::parse_str(source).unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(source)))
}

fn modules() -> HashMap<&'static str, Module> {
    shader_sources().into_iter().map(|(name, source)| (name, parse(name, source))).collect()
}

#[test]
fn every_shader_is_valid() {
    for (name, source) in shader_sources() {
        let module = parse(name, source);
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        validator.validate(&module).unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(source)));
        assert!(module.entry_points.iter().any(|entry| entry.name == "vs_main"), "{name} has no vs_main");
        assert!(module.entry_points.iter().any(|entry| entry.name == "fs_color"), "{name} has no fs_color");
    }
}

#[test]
fn every_shader_file_is_part_of_a_pass() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let mut files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(shader_sources().iter().any(|(_, source)| source.contains(&text)), "{} is unused", path.display());
        files += 1;
    }
    assert!(files >= 5);
}

fn named<'m>(module: &'m Module, name: &str) -> &'m Type {
    let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name));
    found.map(|(_, ty)| ty).unwrap_or_else(|| panic!("no struct {name}"))
}

fn check_buffer(module: &Module, mirror: &Mirror) {
    let TypeInner::Struct { members, span } = &named(module, mirror.name).inner else { panic!("{}", mirror.name) };
    assert_eq!(*span as usize, mirror.size, "size of {}", mirror.name);
    let wgsl: Vec<_> = members
        .iter()
        .map(|member| {
            let size = module.types[member.ty].inner.size(module.to_ctx());
            (member.name.as_deref().unwrap_or(""), member.offset as usize, size as usize)
        })
        .collect();
    let rust: Vec<_> = mirror.fields.iter().map(|field| (field.name, field.offset, field.size)).collect();
    assert_eq!(wgsl, rust, "fields of {}", mirror.name);
}

/// A vertex is fed by attributes: names in the order of their locations, and fields side by side without a gap.
fn check_vertex(module: &Module, mirror: &Mirror) {
    let TypeInner::Struct { members, .. } = &named(module, mirror.name).inner else { panic!("{}", mirror.name) };
    assert_eq!(members.len(), mirror.fields.len(), "{}", mirror.name);
    let mut end = 0;
    for (at, (member, field)) in members.iter().zip(&mirror.fields).enumerate() {
        assert_eq!(member.name.as_deref(), Some(field.name));
        let bound =
            matches!(&member.binding, Some(naga::Binding::Location { location, .. }) if *location as usize == at);
        assert!(bound, "{}.{} is not at location {at}", mirror.name, field.name);
        assert_eq!(field.offset, end, "{}.{}", mirror.name, field.name);
        end += field.size;
    }
    assert_eq!(end, mirror.size, "{}", mirror.name);
}

#[test]
fn mirrored_structs_agree() {
    let modules = modules();
    for mirror in mirrored_structs() {
        let module = &modules[mirror.pass];
        let check = if mirror.is_vertex { check_vertex } else { check_buffer };
        check(module, &mirror);
    }
}

#[test]
fn every_buffer_of_the_shaders_is_mirrored() {
    let mirrors = mirrored_structs();
    for (name, module) in modules() {
        for (_, variable) in module.global_variables.iter().filter(|(_, variable)| variable.binding.is_some()) {
            let mut ty = &module.types[variable.ty];
            if let TypeInner::Array { base, .. } = ty.inner {
                ty = &module.types[base];
            }
            if let (TypeInner::Struct { .. }, Some(struct_name)) = (&ty.inner, &ty.name) {
                assert!(mirrors.iter().any(|mirror| mirror.name == struct_name), "{name}: {struct_name} has no mirror");
            }
        }
    }
}

fn constant(module: &Module, name: &str) -> f32 {
    let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name)).expect(name);
    match module.global_expressions[constant.init] {
        naga::Expression::Literal(naga::Literal::F32(value)) => value,
        ref other => panic!("{name} is {other:?}"),
    }
}

#[test]
fn shared_constants_agree() {
    // A copy of a picture and panels know nothing of the Earth.
    for (_, module) in modules().iter().filter(|(name, _)| !["present", "overlay"].contains(name)) {
        assert_eq!(constant(module, "SEMI_MAJOR_M"), SEMI_MAJOR_M as f32);
        assert_eq!(constant(module, "STRETCH"), (SEMI_MAJOR_M / SEMI_MINOR_M) as f32);
    }
}
