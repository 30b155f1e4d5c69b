//! Reads the tables of a TOML document into settings and collects every fault on the way.

use std::ops::Range;

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue, ValueDeserializer};

use super::Table;
use super::fault::ConfigFault;
use super::retired;
use super::syntax;
use super::syntax::{LineIndex, column};
use super::words::{choices, explain, suggest};
use crate::check::{Check, Fault};

/// What a table of the configuration is read into.
pub trait Settings: Default + Serialize + DeserializeOwned + Check {}

impl<T: Default + Serialize + DeserializeOwned + Check> Settings for T {}

/// In a table within a table so many keys are looked at, one by one.
const MOST_NESTED: usize = 100;

type Key<'i> = Spanned<DeString<'i>>;
type Value<'i> = Spanned<DeValue<'i>>;

/// The settings that a table is read into, without their type: the search for wrong keys is then compiled once, and not
/// for each of 20 tables.
struct Target<'i> {
    table: Table,
    /// Reads the settings from a table that has only the value, under the nested keys; the deserialiser's message if
    /// it cannot.
    attempt: fn(&[Key<'i>], &Value<'i>) -> Result<(), String>,
}

impl Target<'_> {
    /// The default of a key whose value is a row of numbers.
    fn default_numbers(&self, path: &[Key<'_>]) -> Option<&Vec<toml::Value>> {
        let (first, rest) = path.split_first()?;
        let mut value = self.table.defaults.get(first.get_ref().as_ref())?;
        for key in rest {
            value = value.get(key.get_ref().as_ref())?;
        }
        value.as_array()
    }
}

pub(super) struct TableReader<'i> {
    text: &'i str,
    places: LineIndex,
    root: DeTable<'i>,
    faults: Vec<ConfigFault>,
    /// Keys that no longer exist: their offset, and a sentence.
    retired: Vec<(usize, String)>,
}

impl<'i> TableReader<'i> {
    /// Reads the TOML. With a syntax error in it nothing else can be said for certain, so then
    /// the syntax errors are all.
    pub(super) fn new(text: &'i str) -> Result<Self, Vec<ConfigFault>> {
        let (root, errors) = DeTable::parse_recoverable(text);
        if errors.is_empty() {
            return Ok(Self {
                text,
                places: LineIndex::of(text),
                root: root.into_inner(),
                faults: Vec::new(),
                retired: Vec::new(),
            });
        }
        let places = LineIndex::of(text);
        let mut faults: Vec<ConfigFault> = errors
            .iter()
            .map(|error| {
                let span = error.span().filter(|span| text.get(span.clone()).is_some());
                let at = span.as_ref().map(|span| span.start);
                let sentence = match span {
                    Some(span) => syntax::explain(error.message(), text, span),
                    None => error.message().to_owned(),
                };
                ConfigFault {
                    line: at.map(|at| places.line(at)),
                    column: at.map(|at| column(text, at)),
                    sentence,
                }
            })
            .collect();
        faults.sort_by_key(|fault| (fault.line, fault.column));
        Err(faults)
    }

    /// Collects a fault for every top-level key that is not one of `names`; `table_of` returns the table of a key.
    pub(super) fn refuse_other_tables(
        &mut self,
        names: &[&str],
        table_of: fn(&str) -> Option<&'static str>,
    ) {
        let known: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        for (key, value) in &self.root {
            let name: &str = key.get_ref();
            if names.contains(&name) {
                continue;
            }
            let sentence = if value.get_ref().is_table() {
                format!("unknown table; {}", suggest(name, &known))
            } else {
                let help = match table_of(name) {
                    Some(table) => format!("move it below [{table}]"),
                    None => suggest(name, &known),
                };
                format!("this key is outside any table: {help}")
            };
            let fault = self.fault(Some(key.span().start), format!("{name}: {sentence}"));
            self.faults.push(fault);
        }
    }

    /// The settings in table `name`; the defaults if there is no such table or it cannot be used.
    pub(super) fn table<T: Settings>(&mut self, name: &'static str) -> T {
        let target = Target {
            table: super::table::<T>(name),
            attempt: |path, value| match deserialize::<T>(path, value) {
                Ok(_) => Ok(()),
                Err(error) => Err(error.message().to_owned()),
            },
        };
        let Some(usable) = self.usable(&target) else {
            return T::default();
        };
        match deserialize::<T>(&[], &usable) {
            Ok(settings) => {
                self.collect(&format!("{name}."), settings.check());
                settings
            }
            Err(error) => {
                let sentence = format!("{name}: {}", error.message());
                let fault = self.fault(Some(usable.span().start), sentence);
                self.faults.push(fault);
                T::default()
            }
        }
    }

    /// What can be used of a table, with the faults of the rest collected: nothing where the document does not have it.
    /// `None` where it is no table.
    fn usable(&mut self, target: &Target<'i>) -> Option<Value<'i>> {
        let name = target.table.name;
        let Some((key, value)) = find(&self.root, name) else {
            return Some(Spanned::new(0..0, DeValue::Table(DeTable::new())));
        };
        let span = key.span();
        let DeValue::Table(table) = value.get_ref() else {
            let found = self.snippet(&value.span());
            let fault = Fault::new(name, found, format!("a table, [{name}]"));
            let fault = self.fault(Some(span.start), fault.to_string());
            self.faults.push(fault);
            return None;
        };
        let (usable, faults, gone) = self.usable_keys(table, target);
        self.faults.extend(faults);
        self.retired.extend(gone);
        Some(Spanned::new(span, DeValue::Table(usable)))
    }

    /// The keys of a table that can be used, the faults of the others, and the keys that no longer exist, with their
    /// offsets. Key by key, since a deserialiser stops at its first error.
    fn usable_keys(
        &self,
        table: &DeTable<'i>,
        target: &Target<'i>,
    ) -> (DeTable<'i>, Vec<ConfigFault>, Vec<(usize, String)>) {
        let name = target.table.name;
        let mut usable = DeTable::new();
        let mut faults = Vec::new();
        let mut gone = Vec::new();
        for (key, value) in table {
            if let Some(instead) = retired::instead(name, key.get_ref()) {
                let at = key.span().start;
                let sentence = format!(
                    "line {}: {name}.{} no longer exists and has no effect: {instead}",
                    self.places.line(at),
                    key.get_ref()
                );
                gone.push((at, sentence));
                continue;
            }
            let known = &target.table.keys;
            if !known.is_empty() && !known.iter().any(|known| known == key.get_ref()) {
                faults.push(self.unknown(name, key, known));
                continue;
            }
            let wrong = self.probe(target, std::slice::from_ref(key), value);
            if wrong.is_empty() {
                usable.insert(key.clone(), value.clone());
            }
            faults.extend(wrong);
        }
        (usable, faults, gone)
    }

    /// The keys that no longer exist, as sentences in the order of the lines.
    pub(super) fn take_retired(&mut self) -> Vec<String> {
        self.retired.sort();
        let retired = std::mem::take(&mut self.retired);
        retired.into_iter().map(|(_, sentence)| sentence).collect()
    }

    /// Collects faults that settings found in themselves; with `below` before them their keys are `table.key`.
    pub(super) fn collect(&mut self, below: &str, faults: Vec<Fault>) {
        for fault in faults {
            let key = format!("{below}{}", fault.key);
            let at = position(&self.root, &key);
            self.faults
                .push(self.fault(at, Fault { key, ..fault }.to_string()));
        }
    }

    /// Whether all was well so far.
    pub(super) fn is_good(&self) -> bool {
        self.faults.is_empty()
    }

    /// Every fault, in the order of the lines.
    pub(super) fn into_faults(mut self) -> Vec<ConfigFault> {
        self.faults
            .sort_by_key(|fault| fault.line.unwrap_or(usize::MAX));
        self.faults
    }

    /// A fault at this place of the text.
    fn fault(&self, at: Option<usize>, sentence: String) -> ConfigFault {
        ConfigFault {
            line: at.map(|at| self.places.line(at)),
            column: None,
            sentence,
        }
    }

    fn unknown(&self, table: &str, key: &Key<'i>, known: &[String]) -> ConfigFault {
        let name: &str = key.get_ref();
        let sentence = format!("{table}.{name}: unknown key; {}", suggest(name, known));
        self.fault(Some(key.span().start), sentence)
    }

    /// The faults of one key alone, all others at their defaults. `path` leads from the table to the key.
    fn probe(&self, target: &Target<'i>, path: &[Key<'i>], value: &Value<'i>) -> Vec<ConfigFault> {
        let numbers = target.default_numbers(path);
        // The deserialiser ignores surplus numbers.
        let too_many = match (value.get_ref(), &numbers) {
            (DeValue::Array(found), Some(numbers)) => found.len() > numbers.len(),
            _ => false,
        };
        let mut message = match (target.attempt)(path, value) {
            Ok(()) if too_many => String::new(),
            Ok(()) => return Vec::new(),
            Err(message) => message,
        };
        // In a table within the table the same holds: look for every wrong key.
        if let DeValue::Table(inner) = value.get_ref() {
            let faults: Vec<ConfigFault> = inner
                .iter()
                .take(MOST_NESTED)
                .flat_map(|(key, value)| {
                    let path: Vec<Key<'i>> = path.iter().chain([key]).cloned().collect();
                    self.probe(target, &path, value)
                })
                .collect();
            if !faults.is_empty() {
                return faults;
            }
        }
        // The parser refuses a choice that is no string before it looks at the choices.
        if message == WANTED_CHOICE
            && let Err(refused) = (target.attempt)(path, &text_value(value.span()))
        {
            message = refused;
        }
        let names: Vec<&str> = path.iter().map(|key| key.get_ref().as_ref()).collect();
        let at = match path.last() {
            Some(key) => key.span().start,
            None => value.span().start,
        };
        let key = format!("{}.{}", target.table.name, names.join("."));
        let found = self.snippet(&value.span());
        let sentence = match numbers {
            Some(numbers) => {
                let default = toml::Value::Array(numbers.clone());
                let right = format!("{} numbers, as the default is: {default}", numbers.len());
                Fault::new(&key, found, right).to_string()
            }
            None => explain(&key, found, &message),
        };
        vec![self.fault(Some(at), sentence)]
    }

    /// A value as written in the file, cut to a part of one line.
    fn snippet(&self, span: &Range<usize>) -> String {
        const LONGEST: usize = 60;
        let whole = self.text.get(span.clone()).unwrap_or_default().trim();
        let first = whole.lines().next().unwrap_or_default();
        let cut: String = first.chars().take(LONGEST).collect();
        if cut.len() < whole.len() {
            format!("{cut}…")
        } else {
            cut
        }
    }
}

/// The keys that a table may have, as its settings' deserialiser names them.
pub(super) fn keys<T: Settings>() -> Vec<String> {
    // No key can have this name, so it is refused, and the refusal lists those that can.
    let stranger = Spanned::new(0..0, DeString::from("\0"));
    match deserialize::<T>(&[stranger], &text_value(0..0)) {
        Ok(_) => Vec::new(),
        Err(error) => choices(error.message()),
    }
}

/// Reads settings from a table that has only `value`, under the nested keys `path`.
fn deserialize<T: DeserializeOwned>(
    path: &[Key<'_>],
    value: &Value<'_>,
) -> Result<T, toml::de::Error> {
    T::deserialize(ValueDeserializer::from(nested(path, value)))
}

/// A table that has only `value`, under the nested keys `path`.
fn nested<'i>(path: &[Key<'i>], value: &Value<'i>) -> Value<'i> {
    let mut value = value.clone();
    for key in path.iter().rev() {
        let span = value.span();
        let mut table = DeTable::new();
        table.insert(key.clone(), value);
        value = Spanned::new(span, DeValue::Table(table));
    }
    value
}

const WANTED_CHOICE: &str = "wanted string or table";

fn text_value<'i>(span: Range<usize>) -> Value<'i> {
    Spanned::new(span, DeValue::String(DeString::from("")))
}

fn find<'t, 'i>(table: &'t DeTable<'i>, name: &str) -> Option<(&'t Key<'i>, &'t Value<'i>)> {
    table.iter().find(|(key, _)| key.get_ref() == name)
}

/// The place of the key in the text; of a dotted key, as much of it as is there.
fn position(table: &DeTable<'_>, dotted: &str) -> Option<usize> {
    let (first, rest) = dotted.split_once('.').unwrap_or((dotted, ""));
    let (key, value) = find(table, first)?;
    let deeper = match value.get_ref() {
        DeValue::Table(inner) => position(inner, rest),
        _ => None,
    };
    Some(deeper.unwrap_or(key.span().start))
}

#[cfg(test)]
mod tests;
