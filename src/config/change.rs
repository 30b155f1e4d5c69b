//! From one configuration to another while the daemon runs.

use std::collections::BTreeSet;

use toml::{Table, Value};

use super::Config;

/// Tables and keys that are fixed when the daemon starts: clients know the socket and the device.
const AT_START: &[&str] = &[
    "socket",
    "control",
    "nmea",
    "udp",
    "tcp",
    "pty",
    "source.kind",
    "source.log",
    "i2c.bus",
    "serial.port",
    "heading.stale_s",
];

/// What is different in a new configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// The new configuration, but for what is fixed.
    pub config: Config,
    /// The keys that change now, as `table.key`.
    pub now: Vec<String>,
    /// The keys that change with a restart only.
    pub at_start: Vec<String>,
}

impl Config {
    /// What changes when a daemon that runs with this configuration is given another. An error: with what is
    /// fixed, the new configuration makes no sense.
    ///
    /// # Errors
    ///
    /// Every fault of the new configuration.
    pub fn change(&self, wanted: &Self) -> Result<Change, String> {
        let (old, mut new) = (tables(self), tables(wanted));
        let (mut now, mut at_start) = (Vec::new(), Vec::new());
        for table in Self::TABLES {
            let (Value::Table(old), Value::Table(new)) = (&old[*table], &mut new[*table]) else {
                unreachable!("settings are written as a table");
            };
            // A key that has no default may be in one of them only.
            let keys: BTreeSet<String> = old.keys().chain(new.keys()).cloned().collect();
            for key in keys {
                let name = format!("{table}.{key}");
                if old.get(&key) == new.get(&key) {
                    continue;
                }
                if !AT_START.contains(table) && !AT_START.contains(&name.as_str()) {
                    now.push(name);
                    continue;
                }
                at_start.push(name);
                match old.get(&key) {
                    Some(value) => new.insert(key, value.clone()),
                    None => new.remove(&key),
                };
            }
        }
        let text = toml::to_string(&new).expect("settings are made of what TOML can write");
        Ok(Change {
            config: Self::parse(
                "the configuration with what is fixed until a restart",
                &text,
            )?,
            now,
            at_start,
        })
    }
}

fn tables(config: &Config) -> Table {
    Table::try_from(config).expect("settings are made of what TOML can write")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(text: &str) -> Config {
        Config::parse("a.toml", text).unwrap()
    }

    #[test]
    fn what_is_fixed_stays_and_the_rest_changes() {
        let old = config("[i2c]\ngain = 2\n[socket]\nbacklog = 9");
        let new = config(
            "[source]\nkind = \"i2c\"\nspeed = 2\n[i2c]\nbus = 3\n[verdict]\noutlier_share = 0.2",
        );
        let change = old.change(&new).unwrap();
        assert_eq!(
            change.now,
            ["source.speed", "i2c.gain", "verdict.outlier_share"]
        );
        assert_eq!(
            change.at_start,
            ["source.kind", "i2c.bus", "socket.backlog"]
        );
        let right =
            config("[source]\nspeed = 2\n[verdict]\noutlier_share = 0.2\n[socket]\nbacklog = 9");
        assert_eq!(change.config, right);
    }

    #[test]
    fn every_fixed_key_is_one() {
        for name in AT_START {
            let (table, key) = name.split_once('.').unwrap_or((name, ""));
            let tables = Config::tables();
            let table = tables.iter().find(|known| known.name == table).unwrap();
            assert!(key.is_empty() || table.keys.contains(&key), "{name}");
        }
    }
}
