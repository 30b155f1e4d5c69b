//! A heading on its way to clients.

use std::sync::OnceLock;
use std::time::Instant;

use super::{gpsd, nmea, signalk};
use crate::heading::Heading;

/// A heading, put into each format once, and only into those that somebody watches for.
#[derive(Debug)]
pub(super) struct Outgoing {
    heading: Heading,
    taken: Instant,
    time: Option<String>,
    /// Without its age, which is added when it is written to a client.
    att: OnceLock<String>,
    nmea: OnceLock<String>,
    signalk: OnceLock<String>,
}

impl Outgoing {
    /// `taken` is when the magnetometer was read, and `time` the same moment by the time of day.
    pub(super) fn new(heading: Heading, taken: Instant, time: Option<String>) -> Self {
        Self {
            heading,
            taken,
            time,
            att: OnceLock::new(),
            nmea: OnceLock::new(),
            signalk: OnceLock::new(),
        }
    }

    pub(super) fn heading(&self) -> &Heading {
        &self.heading
    }

    pub(super) fn taken(&self) -> Instant {
        self.taken
    }

    pub(super) fn time(&self) -> Option<&str> {
        self.time.as_deref()
    }

    /// Appends it as an `ATT` object of the device, of which there is one.
    pub(super) fn put_att(&self, out: &mut String, device: &str) {
        out.push_str(self.att.get_or_init(|| {
            let mut begun = String::with_capacity(512);
            gpsd::att_begin(&mut begun, device, &self.heading, self.time());
            begun
        }));
        let age_ms = self.taken.elapsed().as_millis();
        gpsd::att_end(out, u64::try_from(age_ms).unwrap_or(u64::MAX));
    }

    /// Appends it as NMEA 0183 of the talker, of which there is one.
    pub(super) fn put_nmea(&self, out: &mut String, talker: &str) {
        out.push_str(
            self.nmea
                .get_or_init(|| nmea::sentences(talker, &self.heading)),
        );
    }

    /// Appends it as a Signal K delta.
    pub(super) fn put_signalk(&self, out: &mut String) {
        out.push_str(
            self.signalk
                .get_or_init(|| signalk::delta(&self.heading, self.time())),
        );
    }
}
