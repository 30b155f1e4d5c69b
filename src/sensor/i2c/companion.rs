//! Sets up, reads and watches a chip beside the magnetometer.

use super::VERIFY_S;
use super::health::Health;
use crate::sensor::bus::Bus;
use crate::sensor::chip::companion::{Companion, InertialSample};
use crate::sensor::chip::{ChipError, RepeatWatch};
use crate::sensor::clock::Clock;

pub(super) struct CompanionPoller {
    pub(super) health: Health,
    /// The chips that may be there, and the one that was found.
    choices: Vec<Companion>,
    found: Option<Companion>,
    frozen: RepeatWatch<[i16; 6]>,
    verify_s: f64,
}

impl CompanionPoller {
    pub(super) fn new(what: &'static str, choices: Vec<Companion>) -> Self {
        Self {
            health: Health::new(what, false),
            choices,
            found: None,
            frozen: RepeatWatch::default(),
            verify_s: 0.0,
        }
    }

    /// Sets the chip up, if that is due.
    pub(super) fn start(
        &mut self,
        bus: &mut dyn Bus,
        clock: &mut dyn Clock,
    ) -> Result<(), ChipError> {
        let now_s = clock.now_s();
        if self.health.set_up_at_s.is_none_or(|at_s| at_s > now_s) {
            return Ok(());
        }
        let mut failed = None;
        for chip in &self.choices {
            match chip.start(bus, clock) {
                Ok(()) => {
                    self.verify_s = clock.now_s() + VERIFY_S;
                    self.health.set_up();
                    let before = self.found.replace(*chip);
                    if before.is_none_or(|before| before.name() != chip.name()) {
                        tracing::info!("found an {}", chip.name());
                    }
                    return Ok(());
                }
                Err(ChipError::Stopped) => return Err(ChipError::Stopped),
                // Report the first: a chip with another identity is most likely a variant of that one.
                Err(error @ ChipError::Identity { .. }) => failed = failed.or(Some(error)),
                // It may still be this one, and must not be set up as another.
                Err(error) => {
                    failed = Some(error);
                    break;
                }
            }
        }
        if let Some(error) = failed {
            self.health.failed(clock.now_s(), &error);
        }
        Ok(())
    }

    /// Whether the chip that was found is an accelerometer.
    pub(super) fn measures_force(&self) -> bool {
        self.found.is_some_and(|chip| chip.measures_force())
    }

    /// Reads the chip, if it works.
    pub(super) fn read(&mut self, bus: &mut dyn Bus, now_s: f64) -> Option<InertialSample> {
        let works = self.health.set_up_at_s.is_none();
        let chip = self.found.filter(|_| works)?;
        match self.try_read(&chip, bus, now_s) {
            Ok(motion) => {
                self.health.worked(now_s);
                Some(motion)
            }
            Err(error) => {
                self.health.failed(now_s, &error);
                None
            }
        }
    }

    fn try_read(
        &mut self,
        chip: &Companion,
        bus: &mut dyn Bus,
        now_s: f64,
    ) -> Result<InertialSample, ChipError> {
        if now_s >= self.verify_s {
            chip.verify(bus)?;
            self.verify_s = now_s + VERIFY_S;
        }
        let motion = chip.read(bus)?;
        self.frozen.take(chip.name(), motion.raw)?;
        Ok(motion)
    }
}
