//! Reads the code and enforces the table of modules in ARCHITECTURE.md, and those of its invariants that text shows.

use proc_macro2::{TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Module, and what it may use; those may use what they name, in turn.
const TABLE: [(&str, &[&str]); 19] = [
    ("units", &[]),
    ("storage", &["units"]),
    ("geodesy", &["units"]),
    ("forest", &["geodesy"]),
    ("camera", &["geodesy"]),
    ("content", &["geodesy", "forest"]),
    ("store", &["content", "forest"]),
    ("prepare", &["store"]),
    ("cells", &["content", "forest"]),
    ("select", &["camera", "cells", "forest"]),
    ("paging", &["select", "store", "forest"]),
    ("render", &["camera", "content", "select"]),
    ("layout", &["select", "store", "storage"]),
    ("engine", &["paging", "render", "layout", "storage"]),
    ("simulate", &["paging", "layout", "storage"]),
    ("record", &["engine", "camera"]),
    ("window", &["record", "engine", "camera"]),
    ("chart", &["record", "simulate"]),
    ("lib", &[]),
];

/// Crates that only the named modules may use.
const CRATES: [(&[&str], &[&str]); 7] = [
    (&["proj", "tiff", "zip", "geojson", "flatgeobuf", "geozero", "osmpbf", "tiny_skia", "exmex"], &["prepare"]),
    (&["wgpu"], &["render"]),
    (&["memmap2"], &["store"]),
    (&["object_store", "tokio", "url"], &["store"]),
    (&["winit", "egui_winit", "directories"], &["window"]),
    (&["egui"], &["render", "window"]),
    (&["plotters", "nv_flip", "image_compare"], &["chart"]),
];

/// What the pure middle must not name.
const IMPURE: [&str; 8] = ["fs", "thread", "net", "Instant", "SystemTime", "wgpu", "rayon", "File"];

fn allowed(module: &str) -> BTreeSet<&'static str> {
    let table: BTreeMap<_, _> = TABLE.into_iter().collect();
    let mut seen = BTreeSet::new();
    let mut open = table.get(module).map(|uses| uses.to_vec()).unwrap_or_default();
    while let Some(next) = open.pop() {
        if seen.insert(next) {
            open.extend(table[next]);
        }
    }
    seen
}

/// All tokens in a row: a path is `crate`, `:`, `:`, `name` wherever it stands, macros included.
fn words(stream: TokenStream, out: &mut Vec<String>) {
    for tree in stream {
        match tree {
            TokenTree::Group(group) => {
                out.push(format!("<{:?}>", group.delimiter()));
                words(group.stream(), out);
                out.push("</>".into());
            }
            TokenTree::Ident(ident) => out.push(ident.to_string()),
            TokenTree::Punct(punct) => out.push(punct.as_char().to_string()),
            TokenTree::Literal(_) => out.push("literal".into()),
        }
    }
}

fn words_of(source: &str) -> Vec<String> {
    // `syn` refuses what is no Rust before its tokens are looked at.
    syn::parse_file(source).expect("the file parses");
    let mut out = Vec::new();
    words(TokenStream::from_str(source).expect("the file has tokens"), &mut out);
    out
}

/// First segments of paths that start at `crate`, groups `crate::{a, b::c}` included.
fn modules_used(words: &[String]) -> BTreeSet<String> {
    let mut used = BTreeSet::new();
    for at in 0..words.len().saturating_sub(3) {
        if words[at] != "crate" || words[at + 1] != ":" || words[at + 2] != ":" {
            continue;
        }
        if words[at + 3] != "<Brace>" {
            used.insert(words[at + 3].clone());
            continue;
        }
        let (mut depth, mut starts) = (1, true);
        for word in &words[at + 4..] {
            match word.as_str() {
                "<Brace>" => depth += 1,
                "</>" => depth -= 1,
                name if depth == 1 && starts => {
                    used.insert(name.to_owned());
                }
                _ => {}
            }
            starts = depth == 1 && word == ",";
            if depth == 0 {
                break;
            }
        }
    }
    used
}

/// Crates named at the start of a path: `name ::` not preceded by `::`.
fn crates_used(words: &[String]) -> BTreeSet<String> {
    let starts = |at: usize| at < 2 || words[at - 1] != ":" || words[at - 2] != ":";
    (0..words.len().saturating_sub(2))
        .filter(|&at| words[at + 1] == ":" && words[at + 2] == ":" && starts(at))
        .map(|at| words[at].clone())
        .collect()
}

/// The faults of one source file that belongs to `module`.
fn faults(module: &str, path: &str, source: &str) -> Vec<String> {
    let words = words_of(source);
    let allowed = allowed(module);
    let known: BTreeSet<_> = TABLE.iter().map(|(name, _)| *name).collect();
    let mut faults = Vec::new();
    for used in modules_used(&words) {
        if used != module && known.contains(used.as_str()) && !allowed.contains(used.as_str()) {
            faults.push(format!("{path}: `{module}` may not use `{used}`"));
        }
    }
    let crates = crates_used(&words);
    for (names, users) in CRATES {
        for name in names.iter().filter(|name| crates.contains(**name)) {
            if !users.contains(&module) {
                faults.push(format!("{path}: only {users:?} may use the crate `{name}`"));
            }
        }
    }
    if module == "select"
        || path.contains("paging/manager")
        || path.contains("paging/policy")
        || path.ends_with("paging/order.rs")
    {
        for word in IMPURE.iter().filter(|word| words.iter().any(|w| w == **word)) {
            faults.push(format!("{path}: the pure middle names `{word}`"));
        }
    }
    if words.iter().any(|word| word == "unsafe") && !path.ends_with("store/map.rs") {
        faults.push(format!("{path}: `unsafe` belongs to store/map.rs alone"));
    }
    if words.windows(2).any(|pair| ["todo", "unimplemented"].contains(&&*pair[0]) && pair[1] == "!") {
        faults.push(format!("{path}: a stub"));
    }
    faults
}

fn sources(dir: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(dir).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|ext| ext == "rs") {
            out.push(path);
        }
    }
}

#[test]
fn the_code_keeps_the_table() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let (mut found, mut modules) = (Vec::new(), BTreeSet::new());
    for file in &files {
        let relative = file.strip_prefix(&root).expect("below src");
        let first = relative.components().next().expect("a name").as_os_str().to_string_lossy();
        let module = first.trim_end_matches(".rs").to_owned();
        if module == "bin" {
            continue;
        }
        assert!(TABLE.iter().any(|(name, _)| *name == module), "{module} is not in the table");
        let source = std::fs::read_to_string(file).expect("readable");
        found.extend(faults(&module, &relative.to_string_lossy(), &source));
        modules.insert(module);
    }
    assert!(modules.len() >= 12, "the walk found only {modules:?}");
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn the_architecture_prints_the_table_that_is_enforced() {
    let text =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("ARCHITECTURE.md")).expect("readable");
    let rows: BTreeMap<String, String> = text
        .lines()
        .filter_map(|line| {
            let cells: Vec<_> = line.trim_matches('|').split('|').map(str::trim).collect();
            let [module, _, uses] = cells[..] else { return None };
            Some((module.strip_prefix('`')?.strip_suffix('`')?.to_owned(), uses.to_owned()))
        })
        .collect();
    for (module, uses) in TABLE {
        let expected = match (module, uses) {
            ("layout" | "lib", _) => continue,
            ("engine", _) => "all above but prepare".to_owned(),
            (_, []) => "–".to_owned(),
            _ => uses.join(", "),
        };
        assert_eq!(rows.get(module), Some(&expected), "{module}");
    }
}

#[test]
fn the_table_has_no_circle() {
    for (module, _) in TABLE {
        assert!(!allowed(module).contains(module), "{module} uses itself");
    }
}

#[test]
fn each_rule_finds_what_breaks_it() {
    let cases = [
        ("select", "select/mod.rs", "use crate::{camera::View, render::{Renderer, draw}};", "`render`"),
        ("render", "render/mod.rs", "fn f() { let _ = crate::paging::x(); }", "`paging`"),
        ("geodesy", "geodesy/a.rs", "fn f() { m!(crate::forest::CellId) }", "`forest`"),
        ("engine", "engine/a.rs", "use crate::prepare::Recipe;", "`prepare`"),
        ("store", "store/a.rs", "use tiff::decoder::Decoder;", "`tiff`"),
        ("paging", "paging/manager.rs", "fn f() { std::time::Instant::now(); }", "`Instant`"),
        ("paging", "paging/manager.rs", "use std::fs;", "`fs`"),
        ("paging", "paging/manager/progress.rs", "use std::thread;", "`thread`"),
        ("content", "content/a.rs", "fn f() { unsafe { g() } }", "`unsafe`"),
        ("cells", "cells/a.rs", "fn f() { todo!() }", "a stub"),
    ];
    for (module, path, source, part) in cases {
        let found = faults(module, path, source);
        assert!(found.len() == 1 && found[0].contains(part), "{source}: {found:?}");
    }
    let fine = "use crate::forest::{CellId, index::Place}; use crate::units; fn render() { forest::x() }";
    assert_eq!(faults("store", "store/a.rs", fine), Vec::<String>::new());
}
