use std::cell::Cell;

use super::*;
use crate::check::settings;

thread_local! {
    /// How often defaults were made: each look at a key makes some.
    static MADE: Cell<u32> = const { Cell::new(0) };
}

fn counted() -> u32 {
    MADE.set(MADE.get() + 1);
    0
}

settings! {
    pub struct CountedSettings {
        count: u32 = counted(), 0..=9, "";
    }
}

#[test]
fn many_unknown_keys_are_little_work() {
    let keys: String = (0..50_000).map(|i| format!("k{i} = 1\n")).collect();
    for (table, least) in [("counted", 50_000), ("counted.count", 1)] {
        let text = format!("[{table}]\n{keys}");
        MADE.set(0);
        let mut reader = TableReader::new(&text);
        reader.table::<CountedSettings>("counted");
        let faults = reader.into_message("a").lines().count();
        assert!(faults >= least, "{table}: {faults}");
        assert!(MADE.get() < 1000, "{table}: {}", MADE.get());
    }
}
