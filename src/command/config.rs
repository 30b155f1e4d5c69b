//! `headingd config`: checks a configuration, or shows the settings that it comes to.

use std::path::PathBuf;

use clap::Subcommand;

use super::{Failure, load_config, print};
use crate::config::Config;

/// Check a configuration file or show the effective settings
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub action: Action,
}

/// What to do with a configuration.
#[derive(Clone, Debug, Subcommand)]
pub enum Action {
    /// Check a file and list every fault in it
    Check {
        /// The configuration file
        file: PathBuf,
    },
    /// Print all settings as TOML, with the defaults of those that the file leaves out
    Show {
        /// The configuration file; without it, the defaults are shown
        file: Option<PathBuf>,
    },
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    match &args.action {
        Action::Check { file } => {
            load_config(file)?;
            print(&format!("{}: good\n", file.display()))
        }
        Action::Show { file } => {
            let config = match file {
                Some(file) => load_config(file)?,
                None => Config::default(),
            };
            print(&shown(&config)?)
        }
    }
}

fn shown(config: &Config) -> Result<String, Failure> {
    toml::to_string(config).map_err(|error| {
        Failure::new(
            Failure::CONFIG,
            format!("cannot write the settings as TOML: {error}"),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(file: PathBuf) -> Result<(), Failure> {
        run(&Args {
            action: Action::Check { file },
        })
    }

    #[test]
    fn the_exit_status_tells_a_wrong_file_from_a_missing_one() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.toml");
        assert_eq!(check(file.clone()).unwrap_err().status, Failure::NO_INPUT);
        for wrong in [&b"[source]\nspeed = 0"[..], b"[source", b"# \xff"] {
            std::fs::write(&file, wrong).unwrap();
            let failure = check(file.clone()).unwrap_err();
            assert_eq!(failure.status, Failure::CONFIG);
            assert!(failure.message.contains("a.toml"));
        }
        std::fs::write(&file, "[source]\nspeed = 3").unwrap();
        check(file).unwrap();
    }

    #[test]
    fn what_is_shown_can_be_read_again() {
        let config =
            Config::parse("a.toml", "[source]\nspeed = 7\n[log]\nfilter = \"warn\"").unwrap();
        let text = shown(&config).unwrap();
        assert_eq!(Config::parse("b.toml", &text).unwrap(), config);
    }
}
