//! Tracks the faults of a chip; reinitialises it with exponential back-off.

use crate::condition::SourceFault;
use crate::sensor::chip::ChipError;

/// The chip is reinitialised after so many failures in a row.
const IN_A_ROW: u32 = 3;
/// The first back-off, and the longest, seconds.
const FIRST_WAIT_S: f64 = 0.1;
const LONGEST_WAIT_S: f64 = 5.0;
/// A series of faults is over after this long without one, seconds.
const QUIET_S: f64 = 2.0;

pub(super) struct Health {
    what: &'static str,
    /// A fault of this chip becomes the daemon's state, and the state is logged: so it is not logged here.
    vital: bool,
    /// When the chip must be set up; `None` while it works.
    pub(super) set_up_at_s: Option<f64>,
    wait_s: f64,
    in_a_row: u32,
    faults: Option<Faults>,
}

struct Faults {
    since_s: f64,
    last_s: f64,
    count: u64,
    /// Codes that were logged here, or that the state reports.
    told: Vec<&'static str>,
    newest: SourceFault,
}

impl Health {
    /// A chip that is not set up yet; `what` is its role: "gyro".
    pub(super) fn new(what: &'static str, vital: bool) -> Self {
        Self {
            what,
            vital,
            set_up_at_s: Some(0.0),
            wait_s: FIRST_WAIT_S,
            in_a_row: 0,
            faults: None,
        }
    }

    pub(super) fn set_up(&mut self) {
        self.set_up_at_s = None;
        self.in_a_row = 0;
    }

    /// Takes a fault; true if the chip must be reinitialised.
    pub(super) fn failed(&mut self, now_s: f64, error: &ChipError) -> bool {
        let newest = SourceFault {
            code: error.code(),
            message: format!("{}: {error}", self.what),
        };
        let faults = self.faults.get_or_insert_with(|| Faults {
            since_s: now_s,
            last_s: now_s,
            count: 0,
            told: Vec::new(),
            newest: newest.clone(),
        });
        faults.count += 1;
        faults.last_s = now_s;
        faults.newest = newest;
        self.in_a_row += 1;
        let working = self.set_up_at_s.is_none();
        let again = !working || !error.is_passing() || self.in_a_row >= IN_A_ROW;
        if again {
            // The state also reports a fault of the whole bus, so that is not logged per chip.
            let is_state = self.vital || ["no_bus", "permission"].contains(&faults.newest.code);
            faults.tell(is_state);
            self.set_up_at_s = Some(now_s + self.wait_s);
            self.wait_s = (2.0 * self.wait_s).min(LONGEST_WAIT_S);
        }
        again
    }

    pub(super) fn worked(&mut self, now_s: f64) {
        self.in_a_row = 0;
        let Some(faults) = &mut self.faults else {
            return;
        };
        // If the chip recovered without a reset, no state reported that, so log it.
        faults.tell(false);
        if now_s - faults.last_s > QUIET_S {
            tracing::info!(
                faults = faults.count,
                "{} works again, after {:.1} s",
                self.what,
                now_s - faults.since_s
            );
            self.faults = None;
            self.wait_s = FIRST_WAIT_S;
        }
    }

    /// The newest fault, while there are some.
    pub(super) fn trouble(&self) -> Option<&SourceFault> {
        self.faults.as_ref().map(|faults| &faults.newest)
    }
}

impl Faults {
    /// Logs the newest, unless one with its code has been, or is logged as the state.
    fn tell(&mut self, is_state: bool) {
        let SourceFault { code, message } = &self.newest;
        if !self.told.contains(code) {
            self.told.push(code);
            if !is_state {
                tracing::warn!(code, "{message}");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::bus::{Cause, fake};

    fn error(cause: Cause) -> ChipError {
        fake::error("read", 0x68, cause).into()
    }

    #[test]
    fn a_passing_fault_is_forgiven_twice_and_others_are_not() {
        let mut health = Health::new("gyro", false);
        health.set_up();
        assert!(!health.failed(0.0, &error(Cause::Timeout)));
        assert!(!health.failed(0.1, &error(Cause::NoAnswer)));
        health.worked(0.2);
        assert!(!health.failed(0.3, &error(Cause::Timeout)));
        assert!(!health.failed(0.4, &error(Cause::ArbitrationLost)));
        assert!(health.failed(0.5, &error(Cause::ArbitrationLost)));
        health.set_up();
        assert!(health.failed(0.6, &error(Cause::Permission)));
    }

    #[test]
    fn the_wait_doubles_to_five_seconds_and_is_short_again_after_a_quiet_time() {
        let mut health = Health::new("gyro", false);
        let mut now_s = 0.0;
        let mut waits = Vec::new();
        for _ in 0..8 {
            health.failed(now_s, &error(Cause::NoAnswer));
            let at_s = health.set_up_at_s.unwrap();
            waits.push(((at_s - now_s) * 10.0).round() / 10.0);
            now_s = at_s;
        }
        assert_eq!(waits, [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0]);
        health.failed(now_s, &error(Cause::NoAnswer));
        health.set_up();
        health.worked(now_s + 1.0);
        assert_eq!(health.trouble().unwrap().code, "no_answer");
        health.worked(now_s + 2.1);
        assert!(health.trouble().is_none());
        health.failed(now_s + 3.0, &error(Cause::NoBus));
        assert!((health.set_up_at_s.unwrap() - now_s - 3.1).abs() < 1e-9);
    }
}
