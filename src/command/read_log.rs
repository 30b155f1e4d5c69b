//! A log read to its end, and what of it could not be used.

use super::{Failure, progress, tell};
use crate::pipeline::Dropped;
use crate::recording::Entry;
use crate::sensor::replay::Replay;

/// How many rows of a log are read between two looks at how far that is.
const ROWS_A_LOOK: u64 = 8192;

/// Reads a log to its end, beside a bar on a terminal. Hands over each entry, and whether a new stretch begins with it.
pub fn read_log(
    log: &mut Replay,
    mut take: impl FnMut(Entry, bool) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let bar = progress::bar("{wide_bar} {percent} % {eta} left");
    let mut rows = 0_u64;
    while let Some(entry) = log.next() {
        take(entry?, log.begins_stretch())?;
        rows += 1;
        if rows.is_multiple_of(ROWS_A_LOOK) {
            progress::set(&bar, log.share_read());
        }
    }
    Ok(())
}

/// Where a log's time jumps, what follows is taken as so much later: longer than any gyro's gap, seconds.
const STRETCHES_APART_S: f64 = 10.0;

/// Like `read_log`, with times that go on where those of the log jump.
pub fn read_log_on(
    log: &mut Replay,
    mut take: impl FnMut(Entry, bool) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let (mut last_s, mut later_s) = (0.0, 0.0);
    read_log(log, |mut entry, begins_stretch| {
        if begins_stretch {
            later_s = last_s + STRETCHES_APART_S - entry.reading.t_s;
        }
        entry.reading.t_s += later_s;
        last_s = entry.reading.t_s;
        take(entry, begins_stretch)
    })
}

/// Says on standard error that rows of a log were skipped, if some were; that it is of no use is a failure.
pub fn tell_skips(log: &Replay) -> Result<(), Failure> {
    if let Some(why) = log.unusable() {
        return Err(Failure::new(Failure::DATA, why));
    }
    if let Some(summary) = log.skips().summary() {
        tell(summary);
    }
    Ok(())
}

/// Says on standard error how many values of a log were dropped that no sensor can have taken, if some were.
pub fn tell_dropped(dropped: &Dropped) {
    let Dropped {
        rates,
        forces,
        fields,
    } = *dropped;
    let sensors = [
        ("gyro", rates),
        ("accelerometer", forces),
        ("magnetometer", fields),
    ];
    for (sensor, count) in sensors.into_iter().filter(|(_, count)| *count > 0) {
        let values = if count == 1 { "value" } else { "values" };
        tell(format_args!(
            "{count} {values} of the {sensor} dropped that no sensor can have taken"
        ));
    }
}
