//! headingd.toml(5) held against the code: each key with its unit, its range and its default.

#[path = "../../packaging/keys.rs"]
mod keys;

use self::keys::{Key, Table};
use headingd::config::Config;
use toml::Value;

const FILE: &str = include_str!("../../config/headingd.toml");

/// What the code says shortly, the manual says in words.
const SAME: [(&str, &str); 3] = [
    ("mG", "milligauss"),
    ("Hz", "a second"),
    ("per second", "a second"),
];

fn tables() -> Vec<Table> {
    keys::read(FILE).unwrap()
}

#[test]
fn it_has_every_table_and_key_of_the_code_and_no_other() {
    let of_code = Config::tables();
    let of_file = tables();
    let names = |tables: &[Table]| -> Vec<String> {
        tables.iter().map(|table| table.name.clone()).collect()
    };
    let code_names: Vec<String> = of_code.iter().map(|table| table.name.to_owned()).collect();
    assert_eq!(names(&of_file), code_names);
    for (code, file) in of_code.iter().zip(&of_file) {
        let mut found: Vec<&str> = file.keys.iter().map(|key| key.name.as_str()).collect();
        let mut known = code.keys.to_vec();
        found.sort_unstable();
        known.sort_unstable();
        assert_eq!(found, known, "[{}]", code.name);
        assert!(file.about.len() > 10, "[{}] is not explained", code.name);
        for key in &file.keys {
            assert!(!key.about.is_empty(), "{} is not explained", key.name);
            let default = key.default.as_ref().map(|text| {
                let text = format!("key = {text}");
                text.parse::<toml::Table>().unwrap()["key"].clone()
            });
            assert_eq!(
                default.as_ref(),
                code.defaults.get(&key.name),
                "{}",
                key.name
            );
        }
    }
}

/// What the code says is right for a number, when it is given one that is not; `None` if any will do.
fn right(table: &str, key: &Key, found: &str) -> Option<String> {
    let text = format!("[{table}]\n{} = {found}\n", key.name);
    let error = Config::parse("file", &text).err()?;
    let line = error.lines().find(|line| line.contains(&key.name))?;
    Some(line.split_once("must be from ")?.1.to_owned())
}

#[test]
fn every_range_and_unit_is_that_of_the_code() {
    let mut checked = 0;
    let mut wrong = Vec::new();
    for table in tables() {
        for key in &table.keys {
            let value = key
                .default
                .as_ref()
                .map(|text| format!("key = {text}").parse::<toml::Table>().unwrap()["key"].clone());
            // A key without a default is a number, unless the code says otherwise.
            let found = match value {
                None => ["1e12", "4000000000"].map(str::to_owned).to_vec(),
                Some(Value::Float(_)) => vec!["1e12".to_owned()],
                Some(Value::Integer(_)) => vec!["4000000000".to_owned(), "100000".to_owned()],
                Some(Value::Array(list)) if list[0].is_float() => {
                    vec![format!("[{}]", vec!["1e12"; list.len()].join(", "))]
                }
                _ => continue,
            };
            let Some(mut right) = found
                .iter()
                .find_map(|found| right(&table.name, key, found))
            else {
                continue;
            };
            for (short, long) in SAME {
                right = right.replace(short, long);
            }
            // "from 0.1 to 1000 times real time" stands there as "0.1 to 1000 …" and "times real time".
            let mut words = right.splitn(4, ' ');
            let range = [words.next(), words.next(), words.next()].map(Option::unwrap_or_default);
            let unit = words.next().unwrap_or_default();
            let about = key.about.to_lowercase();
            checked += 1;
            if !about.contains(&range.join(" ")) || !about.contains(&unit.to_lowercase()) {
                wrong.push(format!(
                    "[{}] {}: {right:?} is not in: {}",
                    table.name, key.name, key.about
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(checked > 40, "{checked}");
}
