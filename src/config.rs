//! TOML → checked settings.
//!
//! Each room owns its settings: defaults, ranges, units. This file only says which table belongs to which room. A
//! configuration is refused early and in full, with every fault at once.

mod across;
mod change;
pub(crate) mod log;
pub(crate) mod mounting;
mod reader;
pub(crate) mod record;
mod retired;
pub(crate) mod source;
mod words;

use serde::Serialize;

use crate::check::Check;
use crate::publish::outputs::{pty, tcp, udp};
use crate::publish::{control, nmea, server};
use crate::sensor::{i2c, serial, simulator};
use crate::{attitude, calibration, frame, pipeline, store, true_north, turn};
pub use change::Change;

/// A table of the configuration, as the code knows it.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Its name.
    pub name: &'static str,
    /// Its keys.
    pub keys: &'static [&'static str],
    /// Its defaults. A key that has none is missing here.
    pub defaults: toml::Table,
}

macro_rules! tables {
    ($($(#[$doc:meta])* $name:ident: $settings:ty,)*) => {
        /// All settings, checked.
        #[derive(Clone, Debug, Default, PartialEq, Serialize)]
        pub struct Config {
            $($(#[$doc])* pub $name: $settings,)*
            /// Keys of the file that no longer exist, each as a sentence with its line.
            #[serde(skip)]
            pub retired: Vec<String>,
        }

        impl Config {
            /// The names of all tables.
            pub const TABLES: &[&str] = &[$(stringify!($name)),*];

            /// All tables with their keys and defaults.
            pub fn tables() -> Vec<Table> {
                vec![$(table::<$settings>(stringify!($name))),*]
            }

            fn read(reader: &mut reader::TableReader<'_>) -> Self {
                Self {
                    $($name: reader.table(stringify!($name)),)*
                    retired: reader.take_retired(),
                }
            }
        }
    };
}

// One line a table. Its keys go into config/headingd.toml, which a test holds against this list.
tables! {
    /// Where readings come from.
    source: source::Settings,
    /// The simulated board.
    simulator: simulator::Settings,
    /// Chips on an I2C bus.
    i2c: i2c::Settings,
    /// A board behind a serial line.
    serial: serial::settings::Settings,
    /// How the chips are mounted on the board, and that on the body.
    mounting: mounting::Settings,
    /// Following the board's attitude.
    attitude: attitude::Settings,
    /// Finding full turns.
    turn: turn::Settings,
    /// Calibrating on them.
    calibration: calibration::settings::Settings,
    /// Judging a calibration.
    verdict: calibration::verdict::Limits,
    /// From readings to headings.
    heading: pipeline::Settings,
    /// From magnetic to true north.
    true_north: true_north::Settings,
    /// Publishing headings.
    socket: server::Settings,
    /// Headings as NMEA 0183.
    nmea: nmea::Settings,
    /// The same over UDP.
    udp: udp::Settings,
    /// The same over TCP.
    tcp: tcp::Settings,
    /// The same for programs that open serial ports.
    pty: pty::Settings,
    /// Looking after the calibration.
    control: control::Settings,
    /// Where the calibration is kept.
    store: store::Settings,
    /// Raw readings kept for later.
    record: record::Settings,
    /// What the daemon says about itself.
    log: log::Settings,
}

impl Config {
    /// Reads and checks a configuration. `name` goes into the messages: the path of its file.
    /// A table or key that is left out has its default.
    ///
    /// # Errors
    ///
    /// Every fault, each on a line of its own: the name, the fault's line in the text, and a sentence.
    pub fn parse(name: &str, text: &str) -> Result<Self, String> {
        let mut reader = reader::TableReader::new(text);
        if !reader.is_good() {
            return Err(reader.into_message(name));
        }
        reader.refuse_other_tables();
        let config = Self::read(&mut reader);
        // Between tables that are wrong in themselves there is nothing to compare.
        if reader.is_good() {
            for (fault, other) in config.check_across() {
                reader.collect(&fault, Some(other));
            }
        }
        for fault in config.check_gpsd() {
            reader.collect(&fault, None);
        }
        if reader.is_good() {
            Ok(config)
        } else {
            Err(reader.into_message(name))
        }
    }

    /// What a pipeline is set up with for these chips, on a board that is mounted so.
    pub fn setup(&self, chips: &frame::Mountings, board: &frame::Mounting) -> pipeline::Setup {
        pipeline::Setup {
            pipeline: self.heading,
            mountings: chips.on(board),
            attitude: self.attitude,
            turn: self.turn,
            calibration: self.calibration.clone(),
            verdict: self.verdict.clone(),
        }
    }
}

fn table<T: Check>(name: &'static str) -> Table {
    Table {
        name,
        keys: T::KEYS,
        defaults: toml::Table::try_from(T::default())
            .expect("settings are made of what TOML can write"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(text: &str) -> Vec<String> {
        let error = Config::parse("file.toml", text).unwrap_err();
        error.lines().map(str::to_owned).collect()
    }

    #[test]
    fn an_empty_configuration_is_the_default() {
        assert_eq!(Config::parse("file.toml", "").unwrap(), Config::default());
    }

    #[test]
    fn every_fault_is_reported_at_its_line() {
        let text = "speed = 1\n\n[source]\nkind = \"reply\"\nsped = 2\nspeed = 0\n\n\
                    [mounting]\nmag_axes = \"+x +y\"\ngyro_axes = 3\n\n[stroe]\n\n[i2s]\nbus = 1\n";
        let faults = faults(text);
        let right = [
            "file.toml:1: speed: this key is outside any table: move it below [source]",
            "file.toml:4: source.kind is \"reply\", but must be \"simulator\" or \"replay\" or \"i2c\" or \"serial\"",
            "file.toml:5: source.sped: unknown key; did you mean speed?",
            "file.toml:6: source.speed is 0, but must be from 0.1 to 1000 times real time",
            "file.toml:9: mounting.mag_axes: mounting \"+x +y\" is not understood: found 2 of the three or nine words",
            "file.toml:10: mounting.gyro_axes is 3, but must be a text in quotes",
            "file.toml:12: stroe: unknown table; did you mean store?",
            "file.toml:14: i2s: unknown table; did you mean i2c?",
        ];
        assert_eq!(faults.len(), right.len(), "{faults:#?}");
        for (fault, right) in faults.iter().zip(right) {
            assert!(fault.starts_with(right), "{fault}\n{right}");
        }
    }

    #[test]
    fn a_wrong_type_says_which_is_right() {
        #[rustfmt::skip]
        let cases = [
            ("[source]\nspeed = \"fast\"", "file.toml:2: source.speed is \"fast\", but must be a number"),
            ("[source]\nkind = 3",
             "file.toml:2: source.kind is 3, but must be \"simulator\" or \"replay\" or \"i2c\" or \"serial\""),
            ("[source]\nlog = true", "file.toml:2: source.log is true, but must be a text in quotes"),
            ("source.speed = [1]", "file.toml:1: source.speed is [1], but must be a number"),
            ("source = 1", "file.toml:1: source is 1, but must be a table, [source]"),
            ("[[source]]\nspeed = 1", "file.toml:1: source is [[source]], but must be a table, [source]"),
        ];
        for (text, right) in cases {
            assert_eq!(faults(text), [right]);
        }
    }

    #[test]
    fn no_float_slips_through_a_range() {
        for found in ["nan", "-nan", "inf", "-inf", "-1.0", "1e9"] {
            let faults = faults(&format!("[source]\nspeed = {found}"));
            assert!(faults[0].contains("must be from 0.1 to 1000"), "{faults:?}");
        }
    }

    #[test]
    fn of_a_file_that_is_no_toml_the_first_faults_are_told() {
        let text = "a,b\n".repeat(100);
        let error = Config::parse("a.csv", &text).unwrap_err();
        assert_eq!(error.lines().count(), 11, "{error}");
        assert!(
            error.ends_with("and 90 more: is this a configuration?"),
            "{error}"
        );
    }

    #[test]
    fn syntax_errors_are_told_at_their_lines() {
        for (text, right) in [
            ("[socket]\nmode = 0666\n", "2: unexpected leading zero"),
            ("[source]\nspeed = 1\nspeed = 2\n", "3: duplicate key"),
            ("[source]\n[i2c]\n[source]\n", "3: duplicate key"),
            (
                "[source]\nkind = i2c\n",
                "2: invalid float, expected `inf`, or a text in quotes: \"kind = i2c\"",
            ),
            (
                "[source]\nkind = serial\n",
                "2: string values must be quoted",
            ),
            ("[heading]\nstale_s = 0,5\n", "2: unexpected key or value"),
            (
                "[heading]\nstale_s = 5°\n",
                "2: string values must be quoted",
            ),
            ("[i2c]\nbus: 1\n", "2: invalid unquoted key"),
            (
                "[i2c]\nbus = \u{1b}[2J\n",
                "2: string values must be quoted, expected literal string: \"bus = \\u{1b}[2J\"",
            ),
            ("[log]\nfilter = \"°", "2: invalid basic string"),
        ] {
            let found = faults(text);
            assert!(
                found[0].starts_with(&format!("file.toml:{right}")),
                "{found:?}"
            );
            // No control character of a file reaches the terminal.
            assert!(!found.iter().any(|fault| fault.contains('\u{1b}')));
        }
    }

    #[test]
    fn a_key_that_cannot_be_used_is_compared_with_no_other() {
        let text = "[heading]\npublish_sd_deg = \"20\"\ngood_sd_deg = 12\n";
        let found = faults(text);
        assert!(
            found.len() == 1 && found[0].contains("publish_sd_deg"),
            "{found:?}"
        );
        let range = faults("[heading]\npublish_sd_deg = \"20\"\ngood_sd_deg = 0\n");
        assert_eq!(range.len(), 2, "{range:?}");
        let mode = faults("mode = \"0666\"\n");
        assert!(
            mode[0].contains("[calibration] or [socket] or [control]"),
            "{mode:?}"
        );
    }

    #[test]
    fn a_conflict_is_told_at_the_line_of_a_key_that_the_file_has_and_only_if_each_is_right() {
        #[rustfmt::skip]
        let cases = [
            ("[heading]\nstale_s = 1\npublish_sd_deg = 2\n",
             "file.toml:3: heading.good_sd_deg is 3, but must be at most publish_sd_deg, which is 2"),
            ("[heading]\npublish_sd_deg = 2\ngood_sd_deg = 4\n",
             "file.toml:3: heading.good_sd_deg is 4, but must be at most publish_sd_deg, which is 2"),
            ("[heading]\n\npublish_sd_deg = 0.1\n",
             "file.toml:3: heading.publish_sd_deg is 0.1, but must be from 1 to 45 degrees"),
        ];
        for (text, right) in cases {
            assert_eq!(faults(text), [right]);
        }
    }

    #[test]
    fn a_key_that_is_wrong_by_itself_is_named_whatever_else_is_wrong() {
        for (text, keys) in [
            (
                "[true_north]\ngpsd = \"localhost:2947\"\n[pty]\npath = \"nmea\"\n",
                ["true_north.gpsd", "pty.path"],
            ),
            (
                "[udp]\nto = \"localhost:10110\"\nformat = \"Signalk\"\n",
                ["udp.to", "udp.format"],
            ),
        ] {
            let found = faults(text);
            assert_eq!(found.len(), 2, "{found:?}");
            for (fault, key) in found.iter().zip(keys) {
                assert!(fault.contains(&format!(": {key} is ")), "{fault}");
            }
        }
    }

    #[test]
    fn a_board_is_not_mirrored() {
        let right = "file.toml:2: mounting.board_axes is \"-x +y +z\", which is mirrored, but must be a rotation: \
                     turn one sign round, or exchange two axes";
        assert_eq!(faults("[mounting]\nboard_axes = \"-x +y +z\""), [right]);
    }

    #[test]
    fn a_row_of_numbers_is_asked_for_whole() {
        for found in ["[1,2,\"x\"]", "[1, 2]", "[1, 2, 3, 4]", "3"] {
            let right = format!(
                "file.toml:2: simulator.scale is {found}, but must be 3 numbers, as the default is: \
                 [0.873, 0.998, 0.94]"
            );
            let text = format!("[simulator]\nscale = {found}");
            assert_eq!(faults(&text), [right]);
        }
    }

    #[test]
    fn what_is_no_whole_number_of_the_range_is_told_the_range_at_once() {
        for (before, key, found, range) in [
            ("", "i2c.gain", "-1", "from 0 to 7"),
            ("", "i2c.gain", "\"high\"", "from 0 to 7"),
            (
                "i2c.magnetometer = \"qmc5883l\"\n",
                "i2c.gain",
                "256",
                "from 0 to 1",
            ),
            ("", "i2c.gyro_address", "-1", "0x68 or 0x69"),
            ("", "i2c.bus", "300", "from 0 to 255"),
            ("", "serial.baud", "4294967296", "from 300 to 4000000 baud"),
            ("", "calibration.particles", "2.5", "from 2 to 1000"),
            ("", "calibration.seed", "-1", "0 or more"),
        ] {
            let line = before.lines().count() + 1;
            let right =
                format!("file.toml:{line}: {key} is {found}, but must be a whole number, {range}");
            assert_eq!(faults(&format!("{before}{key} = {found}")), [right]);
        }
    }

    #[test]
    fn a_table_is_no_number() {
        for (line, text) in [
            (2, "[simulator]\nnoise_mgauss = { a = 1 }"),
            (1, "[simulator.noise_mgauss]\na = 1"),
            (1, "simulator.noise_mgauss.a = 1"),
        ] {
            let right = format!(
                "file.toml:{line}: simulator.noise_mgauss is a table, but must be a number"
            );
            assert_eq!(faults(text), [right]);
        }
    }

    #[test]
    fn what_a_kind_needs_is_asked_for() {
        assert_eq!(
            faults("[source]\nkind = \"replay\""),
            ["file.toml:2: source.log is empty, but must be the path of the log to replay"]
        );
        let serial = faults("[source]\nkind = \"serial\"");
        assert!(
            serial[0].contains("serial.port is empty, but must be the path"),
            "{serial:?}"
        );
        let relative = faults("[serial]\nport = \"ttyUSB0\"\nbaud = 1");
        assert!(
            relative[0].contains("an absolute path") && relative.len() == 2,
            "{relative:?}"
        );
    }

    #[test]
    fn a_misspelt_level_is_no_filter() {
        assert!(faults("[log]\nfilter = \"inof\"")[0].contains("log.filter is \"inof\""));
        for good in ["debug", "WARN", "info,headingd::turn=debug", "off"] {
            Config::parse("file.toml", &format!("[log]\nfilter = {good:?}")).unwrap();
        }
    }
}
