//! Sets up, reads and watches a chip beside the magnetometer.

use super::VERIFY_S;
use super::health::Health;
use crate::sensor::bus::Bus;
use crate::sensor::chip::companion::{Companion, InertialSample};
use crate::sensor::chip::{ChipError, RepeatWatch};
use crate::sensor::clock::Clock;

pub(super) struct CompanionPoller {
    pub(super) health: Health,
    /// The chips that may be there, and the one that is.
    choices: Vec<Companion>,
    chosen: usize,
    told: Option<usize>,
    frozen: RepeatWatch<[i16; 6]>,
    verify_s: f64,
}

impl CompanionPoller {
    pub(super) fn new(what: &'static str, choices: Vec<Companion>) -> Self {
        Self {
            health: Health::new(what),
            choices,
            chosen: 0,
            told: None,
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
        if self.health.set_up_at_s().is_none_or(|at_s| at_s > now_s) {
            return Ok(());
        }
        let mut failed = None;
        for (index, chip) in self.choices.iter().enumerate() {
            match chip.start(bus, clock) {
                Ok(()) => {
                    self.chosen = index;
                    self.verify_s = clock.now_s() + VERIFY_S;
                    self.health.set_up();
                    if self.told != Some(index) {
                        self.told = Some(index);
                        tracing::info!("found an {}", chip.name());
                    }
                    return Ok(());
                }
                Err(ChipError::Stopped) => return Err(ChipError::Stopped),
                Err(error) => failed = Some(error),
            }
        }
        if let Some(error) = failed {
            self.health.failed(clock.now_s(), &error);
        }
        Ok(())
    }

    /// Whether the chip that was found is an accelerometer.
    pub(super) fn measures_force(&self) -> bool {
        self.told.is_some() && self.choices[self.chosen].measures_force()
    }

    /// Reads the chip, if it works.
    pub(super) fn read(&mut self, bus: &mut dyn Bus, now_s: f64) -> Option<InertialSample> {
        if self.health.set_up_at_s().is_some() {
            return None;
        }
        match self.try_read(bus, now_s) {
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

    fn try_read(&mut self, bus: &mut dyn Bus, now_s: f64) -> Result<InertialSample, ChipError> {
        let chip = &self.choices[self.chosen];
        if now_s >= self.verify_s {
            chip.verify(bus)?;
            self.verify_s = now_s + VERIFY_S;
        }
        let motion = chip.read(bus)?;
        self.frozen.take(chip.name(), motion.raw)?;
        Ok(motion)
    }
}
