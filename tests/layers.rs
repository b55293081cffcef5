//! The house keeps its layers: an arrow between folders of `src/` points down the list in ARCHITECTURE.md, and no file imports in a circle.
//!
//! What a folder's files take from the folder's own `mod.rs` is its own matter, as are tests.

// Tests read folders that nobody makes fail.
#![allow(clippy::disallowed_methods)]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Modules that only tests are built with, beside files and folders called `tests`.
const OF_TESTS: [&str; 5] = ["tests", "testing", "panics", "properties", "twin"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The files below a folder, each with the path of its module.
fn files(folder: &Path, module: &[String], out: &mut BTreeMap<Vec<String>, PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if OF_TESTS.contains(&&*name) || module.is_empty() && (name == "lib" || name == "main") {
            continue;
        }
        let inner: Vec<String> = module.iter().cloned().chain([name.clone()]).collect();
        if path.is_dir() {
            files(&path, &inner, out);
        } else {
            out.insert(if name == "mod" { module.to_vec() } else { inner }, path);
        }
    }
}

/// The paths of modules and what lies in them that a module's text names, without comments and its module of tests; trees of names are taken apart.
fn paths(text: &str, module: &[String]) -> BTreeSet<Vec<String>> {
    let text: String = text.lines().map(|line| line.split("//").next().unwrap_or("").to_owned() + "\n").collect();
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
    let mut out = BTreeSet::new();
    // A name that stands at a path's beginning.
    let begins = |name: &str| {
        let begins = |at: &usize| !text[..*at].ends_with(|c: char| c.is_alphanumeric() || "_:$".contains(c));
        text.match_indices(&format!("{name}::")).map(|(at, _)| at).filter(begins).collect::<Vec<_>>()
    };
    for first in ["crate", "super", "self"] {
        for at in begins(first) {
            let mut found = BTreeSet::new();
            expand(&mut text[at..].chars().peekable(), &[], &mut found);
            out.extend(found.into_iter().map(|path| absolute(&path, module)));
        }
    }
    // What is named by way of a module that is imported.
    let imported: Vec<Vec<String>> = out.iter().filter(|path| path.len() > 1).cloned().collect();
    for path in imported {
        let last = &path[path.len() - 1];
        if last.starts_with(char::is_lowercase) {
            for at in begins(last) {
                let mut found = BTreeSet::new();
                expand(&mut text[at..].chars().peekable(), &[], &mut found);
                out.extend(
                    found.into_iter().map(|rest| path.iter().cloned().chain(rest.into_iter().skip(1)).collect()),
                );
            }
        }
    }
    out
}

/// A path from the crate's root on.
fn absolute(path: &[String], module: &[String]) -> Vec<String> {
    let mut out = module.to_vec();
    for name in path {
        match &**name {
            "crate" => out.clear(),
            "self" => (),
            "super" => drop(out.pop()),
            _ => out.push(name.clone()),
        }
    }
    out
}

/// Reads a path, or the branches of a tree of paths behind `before`.
fn expand(text: &mut std::iter::Peekable<std::str::Chars<'_>>, before: &[String], out: &mut BTreeSet<Vec<String>>) {
    let mut path = before.to_vec();
    let mut name = String::new();
    while let Some(&c) = text.peek() {
        if c.is_alphanumeric() || c == '_' {
            name.push(c);
        } else if c == ':' {
            if !name.is_empty() {
                path.push(std::mem::take(&mut name));
            }
        } else if c == '{' && name.is_empty() {
            loop {
                text.next();
                expand(text, &path, out);
                while text.next_if(|c| c.is_whitespace()).is_some() {}
                if text.peek() != Some(&',') {
                    text.next();
                    return;
                }
            }
        } else if !(c.is_whitespace() && name.is_empty() && path.len() == before.len()) {
            break;
        }
        text.next();
    }
    if !name.is_empty() {
        path.push(name);
    }
    // A name that is given another one.
    while text.peek().is_some_and(|c| c.is_alphanumeric() || c.is_whitespace()) && !before.is_empty() {
        text.next();
    }
    out.insert(path);
}

/// Which modules each module's file imports from.
fn imports() -> BTreeMap<Vec<String>, BTreeSet<Vec<String>>> {
    let mut modules = BTreeMap::new();
    files(&root().join("src"), &[], &mut modules);
    let of = |(module, file): (&Vec<String>, &PathBuf)| {
        let text = std::fs::read_to_string(file).unwrap();
        let from = |path: Vec<String>| {
            (1..=path.len()).rev().map(|len| path[..len].to_vec()).find(|path| modules.contains_key(path))
        };
        let found = paths(&text, module).into_iter().filter_map(from).filter(|other| other != module).collect();
        (module.clone(), found)
    };
    modules.iter().map(of).collect()
}

/// The folders of `src/` in the order of ARCHITECTURE.md.
fn order() -> Vec<String> {
    let text = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let rows = text.lines().skip_while(|line| *line != "## The map").take_while(|line| !line.starts_with("Rules"));
    let cells = rows.filter(|line| line.starts_with("| `")).filter_map(|line| line.split('|').nth(1));
    cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).map(str::to_owned).collect()
}

#[test]
fn arrows_between_folders_point_down_the_list() {
    let (order, imports) = (order(), imports());
    let place = |module: &[String]| order.iter().position(|name| *name == module[0]);
    let (mut wrong, mut arrows) = (Vec::new(), 0);
    for (module, others) in &imports {
        let own = place(module).unwrap_or_else(|| panic!("ARCHITECTURE.md does not list `{}`", module[0]));
        for other in others.iter().filter(|other| other[0] != module[0]) {
            arrows += 1;
            if place(other).is_none_or(|other| other > own) {
                wrong.push(format!("{} imports from {}", module.join("::"), other.join("::")));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(arrows > 500, "only {arrows} imports between folders were understood");
}

#[test]
fn no_file_imports_in_a_circle() {
    let mut imports = imports();
    for (module, others) in &mut imports {
        others.retain(|other| !module.starts_with(other));
    }
    // What imports nothing that is left is in no circle, nor is what nothing imports that is left.
    loop {
        let left: BTreeSet<Vec<String>> = imports.keys().cloned().collect();
        let imported: BTreeSet<Vec<String>> = imports.values().flatten().cloned().collect();
        imports.retain(|module, others| imported.contains(module) && others.iter().any(|other| left.contains(other)));
        if imports.len() == left.len() {
            break;
        }
    }
    let in_circles: Vec<String> = imports.keys().map(|module| module.join("::")).collect();
    assert!(in_circles.is_empty(), "in circles, or between two: {in_circles:?}");
}

#[test]
fn trees_of_names_are_taken_apart() {
    let text = "use crate::a::{self, b::{C, d as e},\n    f};\nlet x = crate::g::h(); // crate::not\nf::i(); super::J;\n#[cfg(test)]\nmod tests { use crate::not; }";
    let module = ["k".to_owned(), "l".to_owned()];
    let found: Vec<String> = paths(text, &module).into_iter().map(|path| path.join("::")).collect();
    assert_eq!(found, ["a", "a::b::C", "a::b::d", "a::f", "a::f::i", "g::h", "k::J"]);
}
