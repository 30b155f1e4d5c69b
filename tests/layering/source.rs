//! The source as words and paths, without comments, texts and what only tests use.
//!
//! No Rust parser, but enough of one: comments nest, texts may be raw, braces in a path are multiplied out.

use std::fs;
use std::path::{Path, PathBuf};

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
        let name = path
            .strip_prefix(root)
            .unwrap()
            .to_str()
            .unwrap()
            .to_owned();
        (name, fs::read_to_string(&path).unwrap())
    };
    files.into_iter().map(named).collect()
}

/// The words and signs of a text, without what stands under `#[cfg(test)]`.
pub fn tokens(text: &str) -> Vec<Token> {
    let c: Vec<char> = text.chars().collect();
    let at = |i: usize| c.get(i).copied().unwrap_or('\0');
    let (mut i, mut line, mut found) = (0, 1, Vec::new());
    while i < c.len() {
        let start = i;
        if at(i) == '/' && at(i + 1) == '/' {
            while i < c.len() && at(i) != '\n' {
                i += 1;
            }
        } else if at(i) == '/' && at(i + 1) == '*' {
            let mut depth = 0;
            while i < c.len() {
                match (at(i), at(i + 1)) {
                    ('/', '*') => (depth, i) = (depth + 1, i + 2),
                    ('*', '/') => (depth, i) = (depth - 1, i + 2),
                    _ => i += 1,
                }
                if depth == 0 {
                    break;
                }
            }
        } else if at(i) == '"' {
            i += 1;
            while i < c.len() && at(i) != '"' {
                i += if at(i) == '\\' { 2 } else { 1 };
            }
            i += 1;
        } else if at(i) == '\'' && (at(i + 1) == '\\' || at(i + 2) == '\'') {
            // A character; anything else after `'` is a lifetime.
            i += if at(i + 1) == '\\' { 3 } else { 2 };
            while i < c.len() && at(i) != '\'' {
                i += 1;
            }
            i += 1;
        } else if at(i).is_alphanumeric() || at(i) == '_' {
            while at(i).is_alphanumeric() || at(i) == '_' {
                i += 1;
            }
            let word: String = c[start..i].iter().collect();
            let hashes = c[i..].iter().take_while(|sign| **sign == '#').count();
            if (word == "r" || word == "br") && at(i + hashes) == '"' {
                i += hashes + 1;
                let ends = |i: usize| at(i) == '"' && (1..=hashes).all(|k| at(i + k) == '#');
                while i < c.len() && !ends(i) {
                    i += 1;
                }
                i += hashes + 1;
            } else {
                found.push((line, word));
            }
        } else {
            i += 1;
            if !at(start).is_whitespace() {
                found.push((line, at(start).to_string()));
            }
        }
        i = i.min(c.len());
        line += c[start..i].iter().filter(|sign| **sign == '\n').count();
    }
    without_tests(&found)
}

/// Leaves out each item under `#[cfg(test)]`: up to its `;`, or the end of its braces.
fn without_tests(tokens: &[Token]) -> Vec<Token> {
    const MARK: [&str; 7] = ["#", "[", "cfg", "(", "test", ")", "]"];
    let (mut i, mut kept) = (0, Vec::new());
    while i < tokens.len() {
        let rest = &tokens[i..];
        if rest.len() < MARK.len() || rest.iter().zip(MARK).any(|(token, word)| token.1 != word) {
            kept.push(tokens[i].clone());
            i += 1;
            continue;
        }
        i += MARK.len();
        let mut depth = 0;
        while i < tokens.len() {
            let word = tokens[i].1.as_str();
            i += 1;
            match word {
                "{" | "(" | "[" => depth += 1,
                "}" | ")" | "]" => depth -= 1,
                _ => {}
            }
            if depth == 0 && (word == "}" || word == ";") {
                break;
            }
        }
    }
    kept
}

/// Every path of two parts and more, with its line: braces are multiplied out.
pub fn paths(tokens: &[Token]) -> Vec<(usize, Vec<String>)> {
    let (mut i, mut found) = (0, Vec::new());
    while i < tokens.len() {
        let mut branch = Vec::new();
        i = tree(tokens, i, &[], &mut branch).max(i + 1);
        found.extend(branch.into_iter().filter(|(_, path)| path.len() > 1));
    }
    found
}

/// Reads `a::b`, `a::{b, c::d}` or `{…}` from `i` on, and gives where it ends.
fn tree(
    tokens: &[Token],
    mut i: usize,
    before: &[String],
    found: &mut Vec<(usize, Vec<String>)>,
) -> usize {
    let word = |i: usize| tokens.get(i).map_or("", |token| token.1.as_str());
    let is_name =
        |word: &str| word == "*" || word.starts_with(|c: char| c.is_alphabetic() || c == '_');
    let mut path = before.to_vec();
    loop {
        if word(i) == "{" && !path.is_empty() {
            i += 1;
            while i < tokens.len() && word(i) != "}" {
                i = tree(tokens, i, &path, found).max(i + 1);
            }
            return i + 1;
        }
        if !is_name(word(i)) {
            break;
        }
        let line = tokens[i].0;
        if word(i) != "self" || path.is_empty() {
            path.push(word(i).to_owned());
        }
        i += 1;
        if word(i) != ":" || word(i + 1) != ":" {
            found.push((line, path));
            return i;
        }
        i += 2;
    }
    if path.len() > before.len() {
        let line = tokens[i.min(tokens.len()) - 1].0;
        found.push((line, path));
    }
    i
}
