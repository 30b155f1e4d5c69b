//! No two files import each other, and a type's name means one thing.

use std::collections::{BTreeMap, BTreeSet};

use crate::source::{Token, paths, tokens};
use crate::{assert_none, program};

/// Each room has settings, and each command arguments.
const IN_EVERY_ROOM: &[&str] = &["Settings", "Args"];

/// A file as a module: `src/a/b.rs` is `a::b`.
fn module(file: &str) -> Vec<String> {
    let path = file.strip_prefix("src/").unwrap_or(file);
    let path = path.strip_suffix(".rs").unwrap_or(path);
    match path {
        "lib" | "main" => Vec::new(),
        path => path.split('/').map(str::to_owned).collect(),
    }
}

/// Which modules each module imports. Those above it are left out: that a file of a folder uses what the folder's own file
/// defines is how Rust is written.
fn imports(files: &[(String, String)]) -> BTreeMap<String, BTreeSet<String>> {
    let modules: BTreeSet<Vec<String>> = files.iter().map(|(file, _)| module(file)).collect();
    let mut found: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (file, text) in files {
        let own = module(file);
        for (_, path) in paths(&tokens(text)) {
            let supers = path.iter().take_while(|part| *part == "super").count();
            let mut target = match path[0].as_str() {
                "crate" | "headingd" => Vec::new(),
                "super" => own[..own.len().saturating_sub(supers)].to_vec(),
                _ => own.clone(),
            };
            let named = ["crate", "headingd", "self"].contains(&path[0].as_str());
            for part in &path[supers.max(usize::from(named))..] {
                target.push(part.clone());
                if !modules.contains(&target) {
                    target.pop();
                    break;
                }
            }
            if !own.starts_with(&target) {
                let imported = found.entry(own.join("::")).or_default();
                imported.insert(target.join("::"));
            }
        }
    }
    found
}

/// The shortest way from one module to another, if there is one.
fn way(imports: &BTreeMap<String, BTreeSet<String>>, from: &str, to: &str) -> Option<Vec<String>> {
    let mut ways = vec![vec![from.to_owned()]];
    let mut seen = BTreeSet::new();
    let mut next = 0;
    while next < ways.len() {
        let way = ways[next].clone();
        next += 1;
        for target in imports.get(&way[way.len() - 1]).into_iter().flatten() {
            let mut longer = way.clone();
            longer.push(target.clone());
            if target == to {
                return Some(longer);
            }
            if seen.insert(target.clone()) {
                ways.push(longer);
            }
        }
    }
    None
}

#[test]
fn no_two_files_import_each_other() {
    let files: Vec<_> = program().collect();
    let imports = imports(&files);
    let mut breaches = Vec::new();
    for from in imports.keys() {
        if let Some(way) = way(&imports, from, from) {
            breaches.push(format!("a circle: {}", way.join(" imports ")));
        }
    }
    assert_none(&breaches);
}

/// The names of the types that a text defines.
fn types(tokens: &[Token]) -> Vec<&str> {
    let mut depth = 0;
    let mut found = Vec::new();
    for pair in tokens.windows(2) {
        let [(_, word), (_, name)] = pair else {
            continue;
        };
        match word.as_str() {
            "{" => depth += 1,
            "}" => depth -= 1,
            "struct" | "enum" | "trait" | "union" => found.push(name.as_str()),
            // Within braces it belongs to a trait.
            "type" if depth == 0 => found.push(name.as_str()),
            _ => {}
        }
    }
    found
}

#[test]
fn a_types_name_means_one_thing() {
    let mut files: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (file, text) in program() {
        for name in types(&tokens(&text)) {
            files
                .entry(name.to_owned())
                .or_default()
                .insert(file.clone());
        }
    }
    let mut breaches = Vec::new();
    for (name, files) in &files {
        let known = IN_EVERY_ROOM.contains(&name.as_str());
        if files.len() > 1 && !known {
            let files: Vec<&str> = files.iter().map(String::as_str).collect();
            breaches.push(format!("{name} is defined in {}", files.join(" and ")));
        }
    }
    assert_none(&breaches);
}

#[test]
fn circles_and_names_are_found() {
    let files = |list: &[(&str, &str)]| -> Vec<(String, String)> {
        let owned = |(file, text): &(&str, &str)| ((*file).to_owned(), (*text).to_owned());
        list.iter().map(owned).collect()
    };
    let circle = imports(&files(&[
        ("src/a.rs", "mod b; mod c; use b::B; pub struct A;"),
        ("src/a/b.rs", "use super::A; use super::c::{self, C};"),
        ("src/a/c.rs", "fn f() { crate::d::g() }"),
        (
            "src/d.rs",
            "use crate::a; fn g() { a::h() } #[cfg(test)] use crate::e;",
        ),
        ("src/e.rs", "use crate::{a::b::B, d};"),
    ]));
    let list = |name: &str| -> Vec<&str> {
        let imported = circle.get(name).into_iter().flatten();
        imported.map(String::as_str).collect()
    };
    assert_eq!(list("a"), ["a::b"]);
    assert_eq!(list("a::b"), ["a::c"]);
    assert_eq!(list("a::c"), ["d"]);
    assert_eq!(list("d"), ["a"]);
    assert_eq!(list("e"), ["a::b", "d"]);
    let found = way(&circle, "d", "d").unwrap();
    assert_eq!(found, ["d", "a", "a::b", "a::c", "d"]);
    assert_eq!(way(&circle, "e", "e"), None);

    let text = "struct A; impl T for A { type Item = B; } type C = A; #[cfg(test)] mod tests { enum D {} }";
    assert_eq!(types(&tokens(text)), ["A", "C"]);
}
