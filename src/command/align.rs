//! `headingd align`: how the chips of a board lie, from a recorded motion.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::read_log::{read_log_on, tell_skips};
use super::{Failure, print, print_json, tell};
use crate::alignment::{AccelerometerReads, Alignment, ChipAlignment, align};
use crate::frame::{Mounting, rounded};
use crate::sensor::replay::Replay;

/// So many readings are used, from the beginning: an hour at 100 a second, and more motion tells nothing new.
const MOST_READINGS: usize = 400_000;
/// A rotation beside the axes is certain from so many standard deviations on.
const CERTAIN: f64 = 3.0;

/// Find how the chips of a board are mounted, from a log of it in motion
///
/// Prints the table `[mounting]` for the configuration: for each chip, which of its axes point along the board's, and the
/// small rotation that is left. Turn the board by 90 degrees and back about each of its three axes, for half a minute.
/// The accelerometer tells where down was when the log began. No motion tells which way is ahead: set board_axes, which
/// turns all chips alike. The axes that the log names are not used.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = "Example: headingd record --out motion.csv --duration 30 && headingd align motion.csv"
)]
pub struct Args {
    /// The log. "-" is standard input
    pub log: PathBuf,
    /// The log is from south of the magnetic equator, where the field points out of the ground
    #[arg(long)]
    pub south: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let mut readings = Vec::new();
    let mut count = 0;
    let mut replay = Replay::open(&args.log)?;
    read_log_on(&mut replay, |entry, _| {
        count += 1;
        if count <= MOST_READINGS {
            readings.push(entry.reading);
        }
        Ok(())
    })?;
    if count > MOST_READINGS {
        tell(format_args!(
            "the log is long: its first {MOST_READINGS} readings are used"
        ));
    }
    tell_skips(&replay)?;
    let found = align(&readings, !args.south)
        .map_err(|refusal| Failure::new(Failure::REFUSED, refusal.to_string()))?;
    if args.json {
        print_json(&as_json(&found))
    } else {
        print(&as_text(&found))
    }
}

fn as_text(found: &Alignment) -> String {
    let mut text = "[mounting]\n".to_owned();
    let mut add = |name: &str, chip: Option<&ChipAlignment>| {
        let Some(chip) = chip else { return };
        text += &format!("{name} = \"{}\"\n", chip.axes);
        let [x, y, z] = chip.turn_deg;
        let [sx, sy, sz] = chip.turn_sd_deg;
        let certain = (0..3).any(|i| chip.turn_deg[i].abs() > CERTAIN * chip.turn_sd_deg[i]);
        let turn = format!("{x:.1} ± {sx:.1}, {y:.1} ± {sy:.1}, {z:.1} ± {sz:.1}");
        text += &format!("# beside that, turned against the gyro about X, Y, Z by {turn} degrees");
        text += &if certain {
            format!(", as in\n#{name} = \"{}\"\n", readable(&chip.exact))
        } else {
            "\n".to_owned()
        };
    };
    add("mag_axes", found.mag.as_ref());
    add("accel_axes", found.accel.as_ref());
    text += &format!("gyro_axes = \"{}\"\n", found.gyro);
    text += match (found.accel, found.accel_reads) {
        (None, _) => {
            "# Without an accelerometer, down is not known: the gyro's Z is taken for it.\n"
        }
        (_, AccelerometerReads::Force) => "",
        (_, AccelerometerReads::Gravity) => {
            "# The accelerometer reads gravity, where others read force; or the log is from south of the magnetic equator (--south), or one\n\
             # axis of the magnetometer is mirrored: such logs look the same. To check these lines, hold the board level, face up: roll\n\
             # must be near 0, and the heading must grow as the board turns to the right.\n"
        }
        (_, AccelerometerReads::Unknown) if found.mag.is_none() => {
            "# The log has no magnetometer: whether the accelerometer reads force or gravity is not known, and force is assumed.\n"
        }
        (_, AccelerometerReads::Unknown) => {
            "# The field is too level to tell whether the accelerometer reads force or gravity: force is assumed.\n"
        }
    };
    text += "# No motion shows which way is ahead: if headings are off by 90 or 180 degrees, set heading_offset_deg.\n";
    text
}

fn as_json(found: &Alignment) -> Value {
    let hundredths = |degrees: [f64; 3]| degrees.map(|one| rounded(one, 2));
    let mut all = json!({ "gyro": { "axes": found.gyro } });
    for (name, chip) in [("mag", &found.mag), ("accel", &found.accel)] {
        if let Some(chip) = chip {
            all[name] = json!({
                "axes": chip.axes,
                "exact": readable(&chip.exact),
                "turn_deg": hundredths(chip.turn_deg),
                "turn_sd_deg": hundredths(chip.turn_sd_deg),
            });
        }
    }
    if found.accel_reads != AccelerometerReads::Unknown {
        all["reads_gravity"] = (found.accel_reads == AccelerometerReads::Gravity).into();
    }
    all
}

/// With as many digits as mean something.
fn readable(mounting: &Mounting) -> Mounting {
    let digits = mounting.rotation().map(|n| rounded(n, 5));
    Mounting::from_matrix(digits).unwrap_or(*mounting)
}
