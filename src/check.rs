//! Checking settings: every fault is collected, with its key, what was found and what would be right.

use std::fmt;
use std::ops::RangeInclusive;

/// One setting that cannot be used.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// The key as written in the configuration, without its table: `angle_deg`.
    pub key: String,
    /// What was found.
    pub found: String,
    /// What would be right: a range with its unit, or a sentence.
    pub right: String,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} is {}, but must be {}",
            self.key, self.found, self.right
        )
    }
}

/// Settings that can say what is wrong with themselves.
pub trait Check {
    /// Every fault at once; empty when all is well.
    fn check(&self) -> Vec<Fault>;
}

/// Collects a fault unless `value` lies in `range`. NaN never does.
pub fn within<T>(faults: &mut Vec<Fault>, key: &str, value: T, range: RangeInclusive<T>, unit: &str)
where
    T: PartialOrd + fmt::Display,
{
    if !range.contains(&value) {
        let unit = if unit.is_empty() {
            String::new()
        } else {
            format!(" {unit}")
        };
        faults.push(Fault {
            key: key.to_owned(),
            found: value.to_string(),
            right: format!("from {} to {}{unit}", range.start(), range.end()),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_outside_its_range_is_named_with_key_range_and_unit() {
        let mut faults = Vec::new();
        within(&mut faults, "angle_deg", 345.0, 180.0..=720.0, "degrees");
        assert!(faults.is_empty());
        within(&mut faults, "angle_deg", f64::NAN, 180.0..=720.0, "degrees");
        assert_eq!(
            faults[0].to_string(),
            "angle_deg is NaN, but must be from 180 to 720 degrees"
        );
    }
}
