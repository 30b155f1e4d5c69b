//! The source as words and paths, without comments, texts and what only tests use.

use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{Delimiter, Spacing, TokenStream, TokenTree};

/// A word or a sign, with its line.
pub type Token = (usize, String);

/// Every file of Rust in a folder of the project and below: its name, with `/`, and its text.
pub fn sources(of: &str) -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders = vec![root.join(of)];
    let mut files: Vec<PathBuf> = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "rs") {
                files.push(path);
            }
        }
    }
    assert!(files.len() > 20, "{of}/ was not found");
    files.sort();
    let named = |path: PathBuf| {
        let name = path.strip_prefix(root).unwrap().to_str().unwrap();
        (name.to_owned(), fs::read_to_string(&path).unwrap())
    };
    files.into_iter().map(named).collect()
}

/// The words and signs of a text, without what stands under `#[cfg(test)]`.
pub fn tokens(text: &str) -> Vec<Token> {
    let mut found = Vec::new();
    flatten(text.parse().expect("it is Rust"), &mut found);
    found
}

fn flatten(stream: TokenStream, found: &mut Vec<Token>) {
    let mut trees = stream.into_iter().peekable();
    while let Some(tree) = trees.next() {
        let mut push = |word: &str| found.push((tree.span().start().line, word.to_owned()));
        match &tree {
            TokenTree::Ident(name) => push(&name.to_string()),
            TokenTree::Punct(sign) => {
                let next = trees.peek().map(|next| next.to_string().replace(' ', ""));
                match (sign.as_char(), sign.spacing(), next.as_deref()) {
                    ('#', _, Some("[cfg(test)]")) => drop(trees.find(ends_item)),
                    (':', Spacing::Joint, Some(":")) => {
                        trees.next();
                        push("::");
                    }
                    (sign, ..) => push(&sign.to_string()),
                }
            }
            TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => {
                push("{");
                flatten(group.stream(), found);
                found.push((group.span_close().start().line, "}".to_owned()));
            }
            TokenTree::Group(group) => {
                push("(");
                flatten(group.stream(), found);
            }
            TokenTree::Literal(_) => {}
        }
    }
}

fn ends_item(tree: &TokenTree) -> bool {
    match tree {
        TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
        TokenTree::Punct(sign) => sign.as_char() == ';',
        _ => false,
    }
}

/// Every path of two parts and more, with its line: braces are multiplied out.
pub fn paths(tokens: &[Token]) -> Vec<(usize, Vec<String>)> {
    let mut found = Vec::new();
    // What stands before each brace that is open.
    let mut before: Vec<Vec<String>> = vec![Vec::new()];
    let mut path: Vec<String> = Vec::new();
    let mut goes_on = false;
    let mut last = 0;
    for (line, word) in tokens {
        let is_name =
            word.starts_with(|c: char| c.is_alphabetic() || c == '_') || (goes_on && word == "*");
        if word != "::" && !(goes_on && (is_name || word == "{")) {
            found.push((last, std::mem::take(&mut path)));
        }
        match word.as_str() {
            "{" => before.push(std::mem::take(&mut path)),
            "}" => drop(before.pop()),
            name if is_name => {
                if !goes_on {
                    path.clone_from(&before[before.len() - 1]);
                }
                if name != "self" || path.is_empty() {
                    path.push(name.to_owned());
                }
                last = *line;
            }
            _ => {}
        }
        goes_on = word == "::";
    }
    found.retain(|(_, path)| path.len() > 1);
    found
}

/// A file as a module: `src/a/b.rs` is `a::b`.
pub fn module(file: &str) -> Vec<String> {
    let path = file.strip_prefix("src/").unwrap_or(file);
    let path = path.strip_suffix(".rs").unwrap_or(path);
    path.split('/').map(str::to_owned).collect()
}

/// The paths of a file, from the top of the crate; one of another crate seems to be a part of the file.
pub fn imports(file: &str, text: &str) -> Vec<(usize, Vec<String>)> {
    let own = module(file);
    let whole = |(line, path): (usize, Vec<String>)| {
        let supers = path.iter().take_while(|part| *part == "super").count();
        let (from, skipped) = match path[0].as_str() {
            "crate" | "headingd" => (0, 1),
            "self" => (own.len(), 1),
            _ => (own.len().saturating_sub(supers), supers),
        };
        (line, [&own[..from], &path[skipped..]].concat())
    };
    paths(&tokens(text)).into_iter().map(whole).collect()
}
