//! The faults of a configuration, as values and as sentences.

use std::fmt;

/// Everything that is wrong with a configuration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub struct ConfigError {
    /// The configuration's name, as a rule its file's path.
    pub name: String,
    /// Every fault, in the order of the lines; those without a line come last.
    pub faults: Vec<ConfigFault>,
}

/// One fault of a configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct ConfigFault {
    /// Line, counted from 1, where it can be found: a default that does not suit has none.
    pub line: Option<usize>,
    /// Column, counted from 1 in characters; of syntax errors only.
    pub column: Option<usize>,
    /// What is wrong, and with which key, as `table.key`.
    pub sentence: String,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, fault) in self.faults.iter().enumerate() {
            if index > 0 {
                f.write_str("\n")?;
            }
            f.write_str(&self.name)?;
            for number in fault.line.iter().chain(&fault.column) {
                write!(f, ":{number}")?;
            }
            write!(f, ": {}", fault.sentence)?;
        }
        Ok(())
    }
}
