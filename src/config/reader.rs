//! Reads the tables of a TOML document into settings and collects every fault on the way.

use std::ops::Range;

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue, ValueDeserializer};

use super::retired;
use super::words::{beyond, explain, quoted, suggest};
use super::{Config, Table};
use crate::check::{Check, Fault};

type Key<'i> = Spanned<DeString<'i>>;
type Value<'i> = Spanned<DeValue<'i>>;

/// Reads and checks the settings of a table, without their type: the search for wrong keys is then compiled once, and not for
/// each of 20 tables. An error is the deserialiser's message.
type Attempt = fn(DeTable<'_>) -> Result<Vec<Fault>, String>;

/// A file with more syntax errors than this is likely no TOML at all.
const MOST_SYNTAX_FAULTS: usize = 10;
/// No message quotes more characters of a line.
const LONGEST_SNIPPET: usize = 60;

pub(super) struct TableReader<'i> {
    text: &'i str,
    root: DeTable<'i>,
    /// Each a sentence, with its offset in the text if it has a place there.
    faults: Vec<(Option<usize>, String)>,
    /// Keys that no longer exist: their offset, and a sentence.
    retired: Vec<(usize, String)>,
}

impl<'i> TableReader<'i> {
    /// Reads the TOML. After a syntax error, which is a fault, nothing else can be said for certain.
    pub(super) fn new(text: &'i str) -> Self {
        let (root, errors) = DeTable::parse_recoverable(text);
        let told = errors.iter().map(|error| {
            let at = error.span().map(|span| span.start.min(text.len()));
            let mut sentence = error.message().to_owned();
            // The parser takes `i2c` for a misspelt `inf`, and `fast` for `false`.
            if sentence.starts_with("invalid float") || sentence.starts_with("invalid boolean") {
                sentence += ", or a text in quotes";
            }
            let before = at.and_then(|at| text.get(..at)).unwrap_or_default();
            let begin = before.rfind('\n').map_or(0, |end| end + 1);
            let line = text[begin..].lines().next().unwrap_or_default();
            if !line.is_empty() {
                // Escaped: no control character of a file reaches the terminal.
                sentence += &format!(": {:?}", first_line(line));
            }
            (at, sentence)
        });
        let mut faults: Vec<_> = told.collect();
        faults.sort();
        let more = faults.len().saturating_sub(MOST_SYNTAX_FAULTS);
        if more > 0 {
            faults.truncate(MOST_SYNTAX_FAULTS);
            faults.push((None, format!("and {more} more: is this a configuration?")));
        }
        Self {
            text,
            root: root.into_inner(),
            faults,
            retired: Vec::new(),
        }
    }

    /// Collects a fault for every top-level key that is no table of the configuration.
    pub(super) fn refuse_other_tables(&mut self) {
        let names = Config::TABLES;
        let tables = Config::tables();
        for (key, value) in &self.root {
            let name: &str = key.get_ref();
            if names.contains(&name) {
                continue;
            }
            let with_key = tables.iter().filter(|table| table.keys.contains(&name));
            let with_key: Vec<String> = with_key.map(|table| format!("[{}]", table.name)).collect();
            let sentence = if value.get_ref().is_table() {
                format!("unknown table; {}", suggest(name, names))
            } else if with_key.is_empty() {
                format!("this key is outside any table: {}", suggest(name, names))
            } else {
                let with_key = with_key.join(" or ");
                format!("this key is outside any table: move it below {with_key}")
            };
            let sentence = format!("{}: {sentence}", quoted(name));
            self.faults.push((Some(key.span().start), sentence));
        }
    }

    /// The settings in table `name`, with the defaults of what is not there or cannot be used.
    pub(super) fn table<T: Check>(&mut self, name: &'static str) -> T {
        let attempt: Attempt = |table| {
            let settings: T = read(table)?;
            // Keys are compared even if one is wrong by itself: the range that a message names may come from another key.
            let mut faults = settings.check_keys();
            settings.compare_keys(&mut faults);
            Ok(faults)
        };
        let count = self.faults.len();
        let usable = self.usable(&super::table::<T>(name), attempt);
        let settings: T = read(usable.clone()).expect("each of these keys was read by itself");
        // A key that cannot be used has its default here; comparing that with other keys would report faults that are not in the
        // file.
        let faults = if self.faults.len() == count {
            settings.check()
        } else {
            settings.check_keys()
        };
        for fault in faults {
            let other = cause(&usable, &fault, attempt).map(|other| format!("{name}.{other}"));
            let key = format!("{name}.{}", fault.key);
            self.collect(&Fault { key, ..fault }, other.as_deref());
        }
        settings
    }

    /// What can be used of a table, with the faults of the rest collected. Key by key, since a deserialiser stops at its
    /// first error.
    fn usable(&mut self, target: &Table, attempt: Attempt) -> DeTable<'i> {
        let name = target.name;
        let mut usable = DeTable::new();
        let Some((key, value)) = self.root.get_key_value(name) else {
            return usable;
        };
        let DeValue::Table(table) = value.get_ref() else {
            let found = self.snippet(&value.span());
            let fault = Fault::new(name, found, format!("a table, [{name}]"));
            self.faults
                .push((Some(key.span().start), fault.to_string()));
            return usable;
        };
        let mut wrong = Vec::new();
        for (key, value) in table {
            let at = key.span().start;
            if let Some(instead) = retired::instead(name, key.get_ref()) {
                let line = 1 + self.text[..at].matches('\n').count();
                let key = key.get_ref();
                let sentence = format!(
                    "line {line}: {name}.{key} no longer exists and has no effect: {instead}"
                );
                self.retired.push((at, sentence));
            } else if self.probe(target, attempt, &usable, key, value).is_ok() {
                usable.insert(key.clone(), value.clone());
            } else {
                wrong.push((key, value));
            }
        }
        // The range of a wrong key may depend on a good one: `gain` on `magnetometer`.
        for (key, value) in wrong {
            if let Err(sentence) = self.probe(target, attempt, &usable, key, value) {
                self.faults.push((Some(key.span().start), sentence));
            }
        }
        usable
    }

    /// The keys that no longer exist, as sentences in the order of the lines.
    pub(super) fn take_retired(&mut self) -> Vec<String> {
        self.retired.sort();
        let retired = std::mem::take(&mut self.retired);
        retired.into_iter().map(|(_, sentence)| sentence).collect()
    }

    /// Collects a fault that settings found in themselves, of the key `table.key`. If its key is not in the file, it is reported at
    /// `other`, the key with which it conflicts.
    pub(super) fn collect(&mut self, fault: &Fault, other: Option<&str>) {
        let at = key_position(&self.root, &fault.key)
            .or_else(|| key_position(&self.root, other?))
            .or_else(|| table_position(&self.root, &fault.key));
        self.faults.push((at, fault.to_string()));
    }

    /// Whether all was well so far.
    pub(super) fn is_good(&self) -> bool {
        self.faults.is_empty()
    }

    /// Every fault on a line of its own, in the order of the text; those without a place come last. `name` is the text's.
    pub(super) fn into_message(mut self, name: &str) -> String {
        self.faults.sort_by_key(|(at, _)| at.unwrap_or(usize::MAX));
        // Counted on from fault to fault: there may be as many as lines.
        let (mut line, mut from) = (1, 0);
        let told = self.faults.iter().map(|(at, sentence)| {
            let Some(at) = *at else {
                return format!("{name}: {sentence}");
            };
            let between = &self.text.as_bytes()[from..at];
            line += between.iter().filter(|byte| **byte == b'\n').count();
            from = at;
            format!("{name}:{line}: {sentence}")
        });
        told.collect::<Vec<_>>().join("\n")
    }

    /// What is wrong with one key alone; `good` are others of its table.
    fn probe(
        &self,
        target: &Table,
        attempt: Attempt,
        good: &DeTable<'i>,
        key: &Key<'i>,
        value: &Value<'i>,
    ) -> Result<(), String> {
        let Table {
            name: table,
            keys,
            defaults,
        } = target;
        let name: &str = key.get_ref();
        let dotted = format!("{table}.{name}");
        if !keys.contains(&name) {
            let key = quoted(name);
            return Err(format!(
                "{table}.{key}: unknown key; {}",
                suggest(name, keys)
            ));
        }
        let numbers = defaults.get(name).and_then(toml::Value::as_array);
        // The deserialiser ignores surplus numbers.
        let too_many = match (value.get_ref(), numbers) {
            (DeValue::Array(found), Some(numbers)) => found.len() > numbers.len(),
            _ => false,
        };
        let with = |mut table: DeTable<'i>, value: Value<'i>| {
            table.insert(key.clone(), value);
            attempt(table)
        };
        let mut message = match with(DeTable::new(), value.clone()) {
            Ok(_) if too_many => String::new(),
            Ok(_) => return Ok(()),
            Err(message) => message,
        };
        // The parser refuses a choice that is no string before it looks at the choices.
        if message == "wanted string or table" {
            let text = DeValue::String(DeString::from(""));
            if let Err(refused) = with(DeTable::new(), Spanned::new(value.span(), text)) {
                message = refused;
            }
        }
        let found = match value.get_ref() {
            // Its place in the file may be that of a header or of a dotted key.
            DeValue::Table(_) => "a table".to_owned(),
            _ => self.snippet(&value.span()),
        };
        if let Some(numbers) = numbers {
            let default = toml::Value::Array(numbers.clone());
            let right = format!("{} numbers, as the default is: {default}", numbers.len());
            return Err(Fault::new(&dotted, found, right).to_string());
        }
        // Checks the number as if it had the right type: the fault then names the range.
        let number = beyond(&message).and_then(|number| DeValue::parse(number).ok());
        let checked = number.and_then(|number| with(good.clone(), number).ok());
        let mut faults = checked.into_iter().flatten();
        Err(match faults.find(|fault| fault.key == name) {
            Some(fault) => {
                let right = format!("a whole number, {}", fault.right);
                Fault::new(&dotted, found, right).to_string()
            }
            None => explain(&dotted, found, &message),
        })
    }

    /// A value as written in the file, cut to a part of one line.
    fn snippet(&self, span: &Range<usize>) -> String {
        first_line(self.text.get(span.clone()).unwrap_or_default())
    }
}

/// The first line of a text, cut if it is long.
fn first_line(text: &str) -> String {
    let whole = text.trim();
    let first = whole.lines().next().unwrap_or_default();
    let cut: String = first.chars().take(LONGEST_SNIPPET).collect();
    if cut.len() < whole.len() {
        format!("{cut}…")
    } else {
        cut
    }
}

fn read<T: DeserializeOwned>(table: DeTable<'_>) -> Result<T, String> {
    let table = Spanned::new(0..0, DeValue::Table(table));
    T::deserialize(ValueDeserializer::from(table)).map_err(|error| error.message().to_owned())
}

/// The key of this table without which its settings would not have this fault.
fn cause(table: &DeTable<'_>, fault: &Fault, attempt: Attempt) -> Option<String> {
    let is_cause = |key: &&Key<'_>| {
        let mut without = table.clone();
        without.remove(key.get_ref().as_ref());
        let faults = attempt(without).unwrap_or_default();
        !faults.iter().any(|found| found.key == fault.key)
    };
    let key = table.keys().find(is_cause)?;
    Some(key.get_ref().to_string())
}

/// The place of `table.key` in the text.
fn key_position(root: &DeTable<'_>, dotted: &str) -> Option<usize> {
    let (table, name) = dotted.split_once('.')?;
    let table = root.get(table)?.get_ref().as_table()?;
    let (key, _) = table.get_key_value(name)?;
    Some(key.span().start)
}

/// The place of the table of `table.key`.
fn table_position(root: &DeTable<'_>, dotted: &str) -> Option<usize> {
    let table = dotted.split('.').next()?;
    Some(root.get_key_value(table)?.0.span().start)
}
