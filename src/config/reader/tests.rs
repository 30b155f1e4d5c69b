use std::cell::Cell;

use serde::Deserialize;

use super::*;
use crate::check::{Fault, within};

#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Outer {
    inner: Inner,
    seed: Option<u32>,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Inner {
    count: u32,
    share: f64,
}

impl Check for Outer {
    fn check(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        within(&mut faults, "inner.share", self.inner.share, 0.0..=1.0, "");
        faults
    }
}

#[test]
fn a_table_within_a_table_is_read_key_by_key_too() {
    let text = "[outer]\nseed = -1\n[outer.inner]\nshare = 2\n";
    let mut reader = TableReader::new(text).unwrap();
    reader.table::<Outer>("outer");
    let text = "[outer.inner]\ncount = 1.5\nshare = \"a\"\nshape = 1\n";
    let mut nested = TableReader::new(text).unwrap();
    nested.table::<Outer>("outer");
    let said: Vec<String> = reader
        .into_faults()
        .into_iter()
        .chain(nested.into_faults())
        .map(|fault| format!("{}: {fault}", fault.line.unwrap()))
        .collect();
    assert_eq!(
        said,
        [
            "2: outer.seed is -1, but must be a whole number from 0 to 4294967295",
            "4: outer.inner.share is 2, but must be from 0 to 1",
            "2: outer.inner.count is 1.5, but must be a whole number from 0 to 4294967295",
            "3: outer.inner.share is \"a\", but must be a number",
            "4: outer.inner.shape: unknown key; did you mean share?",
        ]
    );
}

thread_local! {
    /// How often defaults were made: each look at a key makes some.
    static MADE: Cell<u32> = const { Cell::new(0) };
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct CountedSettings {
    count: u32,
    inner: Inner,
}

impl Default for CountedSettings {
    fn default() -> Self {
        MADE.set(MADE.get() + 1);
        Self {
            count: 0,
            inner: Inner::default(),
        }
    }
}

impl Check for CountedSettings {
    fn check(&self) -> Vec<Fault> {
        Vec::new()
    }
}

#[test]
fn many_unknown_keys_are_little_work() {
    let keys: String = (0..50_000).map(|i| format!("k{i} = 1\n")).collect();
    for (table, least) in [
        ("counted", 50_000),
        ("counted.inner", MOST_NESTED),
        ("counted.count", 1),
    ] {
        let text = format!("[{table}]\n{keys}");
        MADE.set(0);
        let mut reader = TableReader::new(&text).unwrap();
        reader.table::<CountedSettings>("counted");
        let faults = reader.into_faults();
        assert!(faults.len() >= least, "{table}: {}", faults.len());
        assert!(MADE.get() < 1000, "{table}: {}", MADE.get());
    }
}

#[test]
fn a_table_names_its_keys() {
    assert_eq!(keys::<Outer>(), ["inner", "seed"]);
}
