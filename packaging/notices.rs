//! Writes the licences of everything that is linked into the program: of each crate the name, the version, the
//! licence, where its source is, and the texts that came with it. The MPL asks for the place of the source.
//!
//!     cargo run --example notices -- target/THIRD-PARTY-NOTICES

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;
use std::{env, fs};

use serde_json::Value;

/// How the files begin in which crates keep licences.
const LICENCES: [&str; 5] = ["LICEN", "COPY", "NOTICE", "UNLICEN", "AUTHORS"];

fn main() -> Result<(), Box<dyn Error>> {
    let out = env::args_os()
        .nth(1)
        .ok_or("say where to: notices target/THIRD-PARTY-NOTICES")?;
    let metadata = metadata()?;
    let mut text = String::from(
        "headingd is linked with the following crates. Of each: its licence, where its source is, and the licence \
         texts that came with it.\n",
    );
    // Most texts are the same in many crates.
    let mut texts: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for package in linked(&metadata)? {
        let name = format!(
            "{} {}",
            string(package, "name")?,
            string(package, "version")?
        );
        let licence = string(package, "license")?;
        let source = package["repository"].as_str().unwrap_or("its registry");
        writeln!(
            text,
            "\n{name}\n    licence: {licence}\n    source:  {source}"
        )?;
        let found = licences(package).map_err(|error| format!("{name}: {error}"))?;
        if found.is_empty() {
            return Err(format!("{name} ({licence}) came without a licence text").into());
        }
        for licence in found {
            texts.entry(licence).or_default().insert(name.clone());
        }
    }
    for (licence, names) in texts {
        let names: Vec<String> = names.into_iter().collect();
        writeln!(
            text,
            "\n{}\n{}\n\n{licence}",
            "-".repeat(80),
            names.join(", ")
        )?;
    }
    fs::write(out, text)?;
    Ok(())
}

/// What cargo knows of the crates.
fn metadata() -> Result<Value, Box<dyn Error>> {
    let rustc = Command::new("rustc").arg("-vV").output()?;
    let about = String::from_utf8(rustc.stdout)?;
    let host = about.lines().find_map(|line| line.strip_prefix("host: "));
    let host = host.ok_or("rustc does not say what it compiles for")?;
    let target = env::var("CARGO_BUILD_TARGET").unwrap_or_else(|_| host.to_owned());
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let arguments = ["metadata", "--locked", "--format-version", "1"];
    let output = Command::new(cargo)
        .args(arguments)
        .args(["--filter-platform", &target])
        .output()?;
    if !output.status.success() {
        return Err(format!(
            "cargo {} failed: {}",
            arguments.join(" "),
            String::from_utf8_lossy(&output.stderr)
        )
        .into());
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}

/// The packages that the program needs to run, those that only tests or builds need left out.
fn linked(metadata: &Value) -> Result<Vec<&Value>, Box<dyn Error>> {
    let list = |value: &'_ Value| value.as_array().cloned().unwrap_or_default();
    let nodes: BTreeMap<String, Vec<Value>> = list(&metadata["resolve"]["nodes"])
        .into_iter()
        .map(|node| Ok((string(&node, "id")?.to_owned(), list(&node["deps"]))))
        .collect::<Result<_, String>>()?;
    let root = string(&metadata["resolve"], "root")?;
    let mut needed = BTreeSet::new();
    let mut open = vec![root.to_owned()];
    while let Some(id) = open.pop() {
        for dependency in nodes.get(&id).into_iter().flatten() {
            let kinds = list(&dependency["dep_kinds"]);
            let package = string(dependency, "pkg")?;
            if kinds.iter().any(|kind| kind["kind"].is_null()) && !needed.contains(package) {
                needed.insert(package.to_owned());
                open.push(package.to_owned());
            }
        }
    }
    let packages = metadata["packages"].as_array().ok_or("no packages")?;
    let mut linked: Vec<&Value> = packages
        .iter()
        .filter(|package| package["id"].as_str().is_some_and(|id| needed.contains(id)))
        .collect();
    linked.sort_by_key(|package| package["name"].as_str());
    Ok(linked)
}

/// The licence texts in a package's folder.
fn licences(package: &Value) -> Result<Vec<String>, Box<dyn Error>> {
    let folder = Path::new(string(package, "manifest_path")?)
        .parent()
        .ok_or("its manifest is in no folder")?;
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().to_uppercase();
        if LICENCES.iter().any(|start| name.starts_with(start)) && entry.file_type()?.is_file() {
            files.push(entry.path());
        }
    }
    files.sort();
    let read = |file| {
        Ok(fs::read_to_string(file)?
            .replace("\r\n", "\n")
            .trim_end()
            .to_owned())
    };
    files.into_iter().map(read).collect()
}

fn string<'v>(value: &'v Value, key: &str) -> Result<&'v str, String> {
    value[key].as_str().ok_or_else(|| format!("no {key}"))
}
