//! Reads the tables of a TOML document into settings and collects every fault on the way.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue, ValueDeserializer};

use super::retired;
use super::syntax::{self, LineIndex, column};
use super::words::{as_integer, beyond, explain, quoted, suggest};
use super::{Config, ConfigFault, Table};
use crate::check::{Check, Fault};

type Key<'i> = Spanned<DeString<'i>>;
type Value<'i> = Spanned<DeValue<'i>>;

/// The settings that a table is read into, without their type: the search for wrong keys is then compiled once, and not
/// for each of 20 tables.
struct Target {
    table: Table,
    /// Reads and checks the settings; the deserialiser's message if it cannot read them.
    attempt: fn(DeTable<'_>) -> Result<Vec<Fault>, String>,
}

impl Target {
    /// Reads and checks a table with one more key.
    fn with<'v>(
        &self,
        mut table: DeTable<'v>,
        key: &Key<'v>,
        value: Value<'v>,
    ) -> Result<Vec<Fault>, String> {
        table.insert(key.clone(), value);
        (self.attempt)(table)
    }

    /// The key of this table without which it would not have this fault.
    fn cause(&self, table: &DeTable<'_>, fault: &Fault) -> Option<String> {
        let is_cause = |key: &&Key<'_>| {
            let mut without = table.clone();
            without.remove(key.get_ref().as_ref());
            let faults = (self.attempt)(without).unwrap_or_default();
            !faults.iter().any(|found| found.key == fault.key)
        };
        let key = table.keys().find(is_cause)?;
        Some(key.get_ref().to_string())
    }
}

/// A file with more syntax errors than this is likely no TOML at all.
const MOST_SYNTAX_FAULTS: usize = 10;

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
        let places = LineIndex::of(text);
        if errors.is_empty() {
            return Ok(Self {
                text,
                places,
                root: root.into_inner(),
                faults: Vec::new(),
                retired: Vec::new(),
            });
        }
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
        // The parser has two messages about one colon.
        faults.dedup_by(|next, fault| (next.line, &next.sentence) == (fault.line, &fault.sentence));
        if let Some(more) = faults
            .len()
            .checked_sub(MOST_SYNTAX_FAULTS)
            .filter(|n| *n > 0)
        {
            faults.truncate(MOST_SYNTAX_FAULTS);
            faults.push(ConfigFault {
                line: None,
                column: None,
                sentence: format!("and {more} more: is this a configuration?"),
            });
        }
        Err(faults)
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
            let at = Some(key.span().start);
            self.faults.push(fault(
                &self.places,
                at,
                format!("{}: {sentence}", quoted(name)),
            ));
        }
    }

    /// The settings in table `name`, with the defaults of what is not there or cannot be used.
    pub(super) fn table<T: Check>(&mut self, name: &'static str) -> T {
        let target = Target {
            table: super::table::<T>(name),
            attempt: |table| {
                let table = Spanned::new(0..0, DeValue::Table(table));
                match T::deserialize(ValueDeserializer::from(table)) {
                    Ok(settings) => Ok(settings.check()),
                    Err(error) => Err(error.message().to_owned()),
                }
            },
        };
        let count = self.faults.len();
        let usable = self.usable(&target);
        let table = Spanned::new(0..0, DeValue::Table(usable.clone()));
        let settings = T::deserialize(ValueDeserializer::from(table))
            .expect("each of these keys was read by itself");
        // A key that cannot be used has its default here; comparing that with other keys would report faults that are not in the
        // file.
        let faults = if self.faults.len() == count {
            settings.check()
        } else {
            settings.check_keys()
        };
        for found in faults {
            let other = target.cause(&usable, &found);
            let dotted = |key: &str| format!("{name}.{key}");
            let fault = Fault {
                key: dotted(&found.key),
                ..found
            };
            self.collect(fault, other.map(|other| dotted(&other)).as_deref());
        }
        settings
    }

    /// What can be used of a table, with the faults of the rest collected. Key by key, since a deserialiser stops at its
    /// first error.
    fn usable(&mut self, target: &Target) -> DeTable<'i> {
        let name = target.table.name;
        let mut usable = DeTable::new();
        let Some((key, value)) = find(&self.root, name) else {
            return usable;
        };
        let DeValue::Table(table) = value.get_ref() else {
            let found = self.snippet(&value.span());
            let sentence = Fault::new(name, found, format!("a table, [{name}]")).to_string();
            let at = Some(key.span().start);
            self.faults.push(fault(&self.places, at, sentence));
            return usable;
        };
        let mut wrong = Vec::new();
        for (key, value) in table {
            let at = key.span().start;
            if let Some(instead) = retired::instead(name, key.get_ref()) {
                let sentence = format!(
                    "line {}: {name}.{} no longer exists and has no effect: {instead}",
                    self.places.line(at),
                    key.get_ref()
                );
                self.retired.push((at, sentence));
            } else if self.probe(target, &usable, key, value).is_ok() {
                usable.insert(key.clone(), value.clone());
            } else {
                wrong.push((key, value));
            }
        }
        // The range of a wrong key may depend on a good one: `gain` on `magnetometer`.
        for (key, value) in wrong {
            if let Err(sentence) = self.probe(target, &usable, key, value) {
                let at = Some(key.span().start);
                self.faults.push(fault(&self.places, at, sentence));
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

    /// Collects a fault that settings found in themselves, of the key `table.key`. One that has its default is reported at the
    /// `other` key, which contradicts it.
    pub(super) fn collect(&mut self, found: Fault, other: Option<&str>) {
        let at = key_position(&self.root, &found.key)
            .or_else(|| key_position(&self.root, other?))
            .or_else(|| table_position(&self.root, &found.key));
        self.faults.push(fault(&self.places, at, found.to_string()));
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

    /// What is wrong with one key alone; `good` are others of its table.
    fn probe(
        &self,
        target: &Target,
        good: &DeTable<'i>,
        key: &Key<'i>,
        value: &Value<'i>,
    ) -> Result<(), String> {
        let Table {
            name: table,
            keys,
            defaults,
        } = &target.table;
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
        let attempt = |table: DeTable<'i>, value: Value<'i>| target.with(table, key, value);
        let mut message = match attempt(DeTable::new(), value.clone()) {
            Ok(_) if too_many => String::new(),
            Ok(_) => return Ok(()),
            Err(message) => message,
        };
        // The parser refuses a choice that is no string before it looks at the choices.
        if message == WANTED_CHOICE {
            let text = DeValue::String(DeString::from(""));
            if let Err(refused) = attempt(DeTable::new(), Spanned::new(value.span(), text)) {
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
        if let (Some(_), Some(written)) = (beyond(&message), as_integer(value.get_ref()))
            && let Ok(integer) = DeValue::parse(&written)
            && let Ok(faults) = target.with(good.clone(), key, integer)
            && !faults.iter().any(|fault| fault.key == name)
        {
            let right = format!("an integer, without a point or an exponent: {written}");
            return Err(Fault::new(&dotted, found, right).to_string());
        }
        // Checks the number as if it had the right type: the fault then names the range.
        let number = beyond(&message).and_then(|number| DeValue::parse(number).ok());
        let checked = number.and_then(|number| attempt(good.clone(), number).ok());
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

const WANTED_CHOICE: &str = "wanted string or table";

fn find<'t, 'i>(table: &'t DeTable<'i>, name: &str) -> Option<(&'t Key<'i>, &'t Value<'i>)> {
    table.iter().find(|(key, _)| key.get_ref() == name)
}

/// A fault at this place of the text.
fn fault(places: &LineIndex, at: Option<usize>, sentence: String) -> ConfigFault {
    ConfigFault {
        line: at.map(|at| places.line(at)),
        column: None,
        sentence,
    }
}

/// The place of `table.key` in the text.
fn key_position(root: &DeTable<'_>, dotted: &str) -> Option<usize> {
    let (table, name) = dotted.split_once('.')?;
    let (_, value) = find(root, table)?;
    let (key, _) = find(value.get_ref().as_table()?, name)?;
    Some(key.span().start)
}

/// The place of the table of `table.key`.
fn table_position(root: &DeTable<'_>, dotted: &str) -> Option<usize> {
    let table = dotted.split('.').next()?;
    Some(find(root, table)?.0.span().start)
}

#[cfg(test)]
mod tests;
