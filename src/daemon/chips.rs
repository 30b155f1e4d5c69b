//! Real chips as a source: what they say becomes messages, with the moment at which it was read.

use std::time::Instant;

use tokio::sync::mpsc;

use super::source::Message;
use crate::reading::Reading;
use crate::sensor::bus::LinuxBus;
use crate::sensor::clock::SystemClock;
use crate::sensor::i2c::{Chips, Said, Settings};

/// The gyro's readings wait this long for one of the magnetometer, seconds. A heading goes out with that one alone,
/// so nothing is later for it, and the daemon is woken half as often or less.
const WAITING_S: f64 = 0.03;

/// Reads the chips until the clock says stop, or nobody listens any more.
pub(super) fn read(settings: &Settings, out: &mpsc::Sender<Message>, mut clock: SystemClock) {
    let mut bus = LinuxBus::new(settings.bus);
    let taken = clock.clone();
    let mut waiting: Vec<(Reading, Instant)> = Vec::new();
    let mut say = |said| {
        let trouble = match said {
            Said::Reading(reading) => {
                waiting.push((reading, taken.instant(reading.t_s)));
                let since_s = reading.t_s - waiting[0].0.t_s;
                if reading.field_mgauss.is_none() && since_s < WAITING_S {
                    return true;
                }
                None
            }
            Said::Trouble(trouble) => Some(Message::Trouble(trouble)),
        };
        // As one message: each that is sent wakes the daemon.
        let readings =
            (!waiting.is_empty()).then(|| Message::Readings(std::mem::take(&mut waiting)));
        [readings, trouble]
            .into_iter()
            .flatten()
            .all(|message| out.blocking_send(message).is_ok())
    };
    Chips::new(settings).run(&mut bus, &mut clock, &mut say);
}
