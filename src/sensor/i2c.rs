//! Chips on a bus of Linux: the gyro and the accelerometer at their rate or faster, the magnetometer at its own, each
//! reading with the time at which it was read.
//!
//! It runs until the clock says stop. A failing chip is reinitialised with exponential back-off; the others go on.

mod auto_range;
mod companion;
pub(crate) mod examine;
mod health;
mod magnetometer;
mod settings;
#[cfg(test)]
mod tests;
mod timetable;

use std::time::Instant;

use super::SourceEvent;
use super::board::Companions;
use super::bus::Bus;
use super::chip::{ChipError, drivers};
use super::clock::Clock;
use crate::condition::SourceFault;
use crate::reading::Reading;
use companion::CompanionPoller;
use health::Health;
use magnetometer::MagnetometerPoller;

pub use settings::Settings;

/// How often a chip's configuration is read back, seconds.
const VERIFY_S: f64 = 1.0;

/// Gyro and magnetometer are read together if they are due within this share of the gyro's period.
const TOGETHER: f64 = 0.4;

pub struct Chips {
    magnetometer: MagnetometerPoller,
    /// The code of the fault reported last; `None` once readings resume.
    said: Option<&'static str>,
    gyro: Option<CompanionPoller>,
    accel: Option<CompanionPoller>,
    period_s: f64,
    tick_s: f64,
}

impl Chips {
    /// The chips of these settings. Nothing is read yet.
    pub fn new(settings: &Settings) -> Self {
        let companions = match settings.companions {
            Companions::Auto => settings.board.companions(),
            named => named,
        };
        let (gyros, accels) =
            drivers::companions(companions, settings.gyro_address, settings.accel_address);
        let poller =
            |what, chips: Vec<_>| (!chips.is_empty()).then(|| CompanionPoller::new(what, chips));
        Self {
            magnetometer: MagnetometerPoller::new(settings),
            said: None,
            gyro: poller("gyro", gyros),
            accel: poller("accelerometer", accels),
            period_s: 1.0 / settings.gyro_rate_hz,
            tick_s: 0.0,
        }
    }

    /// Reads until the clock says stop, or `out` does by giving false.
    pub fn run(
        &mut self,
        bus: &mut dyn Bus,
        clock: &mut dyn Clock,
        out: &mut dyn FnMut(SourceEvent) -> bool,
    ) {
        self.tick_s = clock.now_s();
        while clock.wait_until(self.due_s()) {
            // The companions first: a magnetometer behind an MPU-6050 answers once that is set up.
            let done = self
                .read_companions(bus, clock, out)
                .and_then(|()| self.read_magnetometer(bus, clock, out));
            if done.is_err() {
                return;
            }
        }
    }

    /// The newest fault of each chip that has some.
    pub fn troubles(&self) -> impl Iterator<Item = &SourceFault> {
        let companions = [&self.gyro, &self.accel].into_iter().flatten();
        let healths = companions.map(|companion| &companion.health);
        [&self.magnetometer.health]
            .into_iter()
            .chain(healths)
            .filter_map(Health::trouble)
    }

    /// Time of the next action. A tick shortly before the magnetometer is due waits for it, which saves a wake-up.
    fn due_s(&self) -> f64 {
        let magnetometer = self.magnetometer.due_s();
        let companions = [&self.gyro, &self.accel].into_iter().flatten();
        let companions =
            companions.map(|companion| companion.health.set_up_at_s.unwrap_or(self.tick_s));
        let tick_s = companions.fold(f64::INFINITY, f64::min);
        if (tick_s..tick_s + TOGETHER * self.period_s).contains(&magnetometer) {
            magnetometer
        } else {
            tick_s.min(magnetometer)
        }
    }

    /// Sets up and reads gyro and accelerometer, as far as that is due.
    fn read_companions(
        &mut self,
        bus: &mut dyn Bus,
        clock: &mut dyn Clock,
        out: &mut dyn FnMut(SourceEvent) -> bool,
    ) -> Result<(), ChipError> {
        if let Some(gyro) = &mut self.gyro {
            gyro.start(bus, clock)?;
            if gyro.measures_force() {
                self.accel = None;
            }
        }
        if let Some(accel) = &mut self.accel {
            accel.start(bus, clock)?;
        }
        let (now_s, taken) = (clock.now_s(), Instant::now());
        // A tick shortly after the magnetometer's time is taken along with it: one wake-up less.
        if now_s < self.tick_s - TOGETHER * self.period_s {
            return Ok(());
        }
        // Each tick is scheduled from the one before, so delays do not accumulate; missed ticks are skipped, and an early one
        // moves the next.
        let late_s = now_s - self.tick_s;
        self.tick_s += self.period_s;
        if !(0.0..self.period_s).contains(&late_s) {
            self.tick_s = now_s + self.period_s;
        }
        let gyro = self.gyro.as_mut().and_then(|gyro| gyro.read(bus, now_s));
        let gyro = gyro.unwrap_or_default();
        let accel = self.accel.as_mut().and_then(|accel| accel.read(bus, now_s));
        let force = accel.and_then(|motion| motion.specific_force_m_s2);
        let reading = Reading {
            t_s: now_s,
            field_mgauss: None,
            rate_rad_s: gyro.rate_rad_s,
            specific_force_m_s2: gyro.specific_force_m_s2.or(force),
        };
        if reading.rate_rad_s.is_none() && reading.specific_force_m_s2.is_none() {
            return Ok(());
        }
        tell(out, SourceEvent::Reading(reading, taken))
    }

    /// Sets up and reads the magnetometer, as far as that is due.
    fn read_magnetometer(
        &mut self,
        bus: &mut dyn Bus,
        clock: &mut dyn Clock,
        out: &mut dyn FnMut(SourceEvent) -> bool,
    ) -> Result<(), ChipError> {
        // `poll` either sets the chip up or reads it; so a measurement that it returns was read now.
        let taken = Instant::now();
        match self.magnetometer.poll(bus, clock) {
            Ok(None) => Ok(()),
            Ok(Some((t_s, sample))) => {
                if self.said.take().is_some() {
                    tell(out, SourceEvent::Fault(None))?;
                }
                let reading = Reading {
                    t_s,
                    field_mgauss: Some(sample.field_mgauss),
                    ..Reading::default()
                };
                tell(out, SourceEvent::Reading(reading, taken))
            }
            Err(ChipError::Stopped) => Err(ChipError::Stopped),
            Err(error) => {
                let down = self.magnetometer.health.failed(clock.now_s(), &error);
                if !down || self.said == Some(error.code()) {
                    return Ok(());
                }
                self.said = Some(error.code());
                let trouble = self.magnetometer.health.trouble().cloned();
                tell(out, SourceEvent::Fault(trouble))
            }
        }
    }
}

fn tell(out: &mut dyn FnMut(SourceEvent) -> bool, event: SourceEvent) -> Result<(), ChipError> {
    if out(event) {
        Ok(())
    } else {
        Err(ChipError::Stopped)
    }
}
