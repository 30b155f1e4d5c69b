//! Real chips as a source: what they say becomes messages, with the moment at which it was read.

use tokio::sync::mpsc;

use super::source::Message;
use crate::sensor::bus::LinuxBus;
use crate::sensor::clock::SystemClock;
use crate::sensor::i2c::{Chips, Said, Settings};

/// Reads the chips until the clock says stop, or nobody listens any more.
pub(super) fn read(settings: &Settings, out: &mpsc::Sender<Message>, mut clock: SystemClock) {
    let mut bus = LinuxBus::new(settings.bus);
    let taken = clock.clone();
    let mut say = |said| {
        let message = match said {
            Said::Reading(reading) => Message::Reading(reading, taken.instant(reading.t_s)),
            Said::Trouble(trouble) => Message::Trouble(trouble),
        };
        out.blocking_send(message).is_ok()
    };
    Chips::new(settings).run(&mut bus, &mut clock, &mut say);
}
