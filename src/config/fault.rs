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
    /// `table.key`; empty in syntax errors.
    pub key: String,
    /// What is wrong.
    pub problem: Problem,
}

/// What is wrong with a key.
#[derive(Clone, Debug, PartialEq)]
pub enum Problem {
    /// A value that cannot be used.
    Unusable {
        found: String,
        /// What would be right: a range with its unit, a type, or the choices.
        right: String,
    },
    /// Anything else, as a sentence.
    Other(String),
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, fault) in self.faults.iter().enumerate() {
            if index > 0 {
                f.write_str("\n")?;
            }
            f.write_str(&self.name)?;
            if let Some(line) = fault.line {
                write!(f, ":{line}")?;
            }
            if let Some(column) = fault.column {
                write!(f, ":{column}")?;
            }
            write!(f, ": {fault}")?;
        }
        Ok(())
    }
}

impl fmt::Display for ConfigFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.problem {
            Problem::Unusable { found, right } => {
                write!(f, "{} is {found}, but must be {right}", self.key)
            }
            Problem::Other(sentence) if self.key.is_empty() => f.write_str(sentence),
            Problem::Other(sentence) => write!(f, "{}: {sentence}", self.key),
        }
    }
}
