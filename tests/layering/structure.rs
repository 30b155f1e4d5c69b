//! No two files import each other, and a type's name means one thing.

use std::collections::{BTreeMap, BTreeSet};

use crate::source::{Token, imports, module, tokens};
use crate::{assert_none, program};

/// Each room has settings, and each command arguments.
const IN_EVERY_ROOM: &[&str] = &["Settings", "Args"];

/// What imports what.
pub type Imports = BTreeMap<String, BTreeSet<String>>;

/// Which modules each module imports. Those above it are left out: that a file of a folder uses what the folder's own file
/// defines is how Rust is written.
fn between(files: &[(String, String)]) -> Imports {
    let modules: BTreeSet<Vec<String>> = files.iter().map(|(file, _)| module(file)).collect();
    let mut found = Imports::new();
    for (file, text) in files {
        let own = module(file);
        for (_, mut path) in imports(file, text) {
            while !path.is_empty() && !modules.contains(&path) {
                path.pop();
            }
            if !own.starts_with(&path) {
                let imported = found.entry(own.join("::")).or_default();
                imported.insert(path.join("::"));
            }
        }
    }
    found
}

/// What is left without whatever imports nothing of the rest or is imported by nothing of it: circles, and what lies between two.
pub fn circles(mut imports: Imports) -> Imports {
    loop {
        let before = imports.clone();
        let imported: BTreeSet<&String> = before.values().flatten().collect();
        for targets in imports.values_mut() {
            targets.retain(|target| before.contains_key(target));
        }
        imports.retain(|name, targets| !targets.is_empty() && imported.contains(name));
        if imports == before {
            return imports;
        }
    }
}

#[test]
fn no_two_files_import_each_other() {
    let files: Vec<_> = program().collect();
    let told = |(name, targets)| format!("in a circle: {name} imports {targets:?}");
    assert_none(circles(between(&files)).into_iter().map(told));
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
    let mut defined: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (file, text) in program() {
        for name in types(&tokens(&text)) {
            let files = defined.entry(name.to_owned()).or_default();
            files.insert(file.clone());
        }
    }
    defined.retain(|name, files| files.len() > 1 && !IN_EVERY_ROOM.contains(&name.as_str()));
    let told = |(name, files)| format!("{name} is defined in each of {files:?}");
    assert_none(defined.into_iter().map(told));
}

#[test]
fn circles_and_names_are_found() {
    let files = [
        ("src/a.rs", "mod b; mod c; use b::B; pub struct A;"),
        ("src/a/b.rs", "use super::A; use super::c::{self, C};"),
        ("src/a/c.rs", "fn f() { crate::d::g() }"),
        (
            "src/d.rs",
            "use crate::a; fn g() { a::h() } #[cfg(test)] use crate::e;",
        ),
        ("src/e.rs", "use crate::{a::b::B, d, f};"),
        ("src/f.rs", ""),
    ];
    let files = files.map(|(file, text)| (file.to_owned(), text.to_owned()));
    let all = |pairs: &[(&str, &str)]| {
        let mut all = Imports::new();
        for (name, imported) in pairs {
            let imported = imported.split(' ').map(str::to_owned).collect();
            all.insert((*name).to_owned(), imported);
        }
        all
    };
    let circle = [("a", "a::b"), ("a::b", "a::c"), ("a::c", "d"), ("d", "a")];
    let with_e = [&circle[..], &[("e", "a::b d f")]].concat();
    assert_eq!(between(&files), all(&with_e));
    assert_eq!(circles(all(&with_e)), all(&circle));

    let text = "struct A; impl T for A { type Item = B; } type C = A; #[cfg(test)] mod tests { enum D {} }";
    assert_eq!(types(&tokens(text)), ["A", "C"]);
}
