use std::cell::Cell;

use serde::Deserialize;

use super::*;

thread_local! {
    /// How often defaults were made: each look at a key makes some.
    static MADE: Cell<u32> = const { Cell::new(0) };
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct CountedSettings {
    count: u32,
}

impl Default for CountedSettings {
    fn default() -> Self {
        MADE.set(MADE.get() + 1);
        Self { count: 0 }
    }
}

impl Check for CountedSettings {
    const KEYS: &[&str] = &["count"];

    fn check(&self) -> Vec<Fault> {
        Vec::new()
    }
}

#[test]
fn many_unknown_keys_are_little_work() {
    let keys: String = (0..50_000).map(|i| format!("k{i} = 1\n")).collect();
    for (table, least) in [("counted", 50_000), ("counted.count", 1)] {
        let text = format!("[{table}]\n{keys}");
        MADE.set(0);
        let mut reader = TableReader::new(&text).unwrap();
        reader.table::<CountedSettings>("counted");
        let faults = reader.into_faults();
        assert!(faults.len() >= least, "{table}: {}", faults.len());
        assert!(MADE.get() < 1000, "{table}: {}", MADE.get());
    }
}
