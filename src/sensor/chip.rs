//! What the drivers of all chips share. Each chip has a file or folder here, with its registers and its identity, and a
//! line in the table of [`drivers`].

pub mod adxl345;
pub mod companion;
pub mod drivers;
pub mod hmc5843;
pub mod itg3200;
pub mod magnetometer;
pub mod mpu6050;
pub mod qmc5883l;

use super::bus::{Bus, BusError, Cause, LONGEST_BLOCK, read_byte};
use super::clock::Clock;

/// Why a chip cannot be used, or not now.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ChipError {
    #[error(transparent)]
    Bus(#[from] BusError),
    #[error(
        "the chip at 0x{address:02x} does not identify itself as {chip}: register 0x{register:02x} holds {found:02x?}, not \
         {right}; check the address, and which chip the board has"
    )]
    Identity {
        chip: &'static str,
        address: u8,
        register: u8,
        found: Vec<u8>,
        right: &'static str,
    },
    #[error(
        "the {chip} has lost its configuration (register 0x{register:02x} holds 0x{found:02x}, not \
         0x{right:02x}), as after a dip of its supply; it is set up again; if it goes on, check power and wiring"
    )]
    ConfigurationLost {
        chip: &'static str,
        register: u8,
        found: u8,
        right: u8,
    },
    #[error(
        "the {chip} has no measurement ready after {waited_s:.3} s; it is set up again; if it goes on, check power \
         and wiring"
    )]
    NotReady { chip: &'static str, waited_s: f64 },
    #[error(
        "the {chip} has repeated the same reading {count} times, although even a board at rest shows noise: its \
         registers are frozen; it is set up again; if it goes on, switch it off and on"
    )]
    Frozen { chip: &'static str, count: u32 },
    #[error(
        "no {wanted} answers, but the chip at 0x{address:02x} is another one, {found}: boards often carry another chip \
         than they are sold with; {help}"
    )]
    Clone {
        wanted: &'static str,
        address: u8,
        found: &'static str,
        help: &'static str,
    },
    #[error(
        "the chip at 0x1e identifies itself as an HMC5883L (\"H43\"), but has never delivered a new measurement: it is \
         most likely a QMC5883L of revision A (marked DA 5883), which cannot be used; get a board with a QMC5883L of \
         revision B (it answers at 0x0d) or with a real HMC5883L; if this is a real one, switch it off and on, and check \
         its power"
    )]
    FakeHmc5883l,
    #[error("told to stop")]
    Stopped,
}

impl ChipError {
    /// As a code that a program can read.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Bus(error) => error.cause.code(),
            Self::Identity { .. } => "wrong_identity",
            Self::ConfigurationLost { .. } => "configuration_lost",
            Self::NotReady { .. } => "not_ready",
            Self::Frozen { .. } => "frozen",
            Self::Clone { .. } => "clone",
            Self::FakeHmc5883l => "fake_hmc5883l",
            Self::Stopped => "stopped",
        }
    }

    /// Whether the next transfer may succeed without setting the chip up again.
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Bus(error) if error.cause.is_passing())
    }

    /// Whether the chip did not answer at all.
    pub fn is_no_answer(&self) -> bool {
        matches!(self, Self::Bus(error) if error.cause == Cause::NoAnswer)
    }
}

/// Counts how often a chip has repeated a reading.
///
/// The quietest of these parts at their coarsest range have a noise of about half a count an axis (an HMC5883L's
/// 2 mG at 230 counts a gauss). Then two readings of one axis are the same with a probability of 0.56 at most,
/// all three with 0.18, and 20 in a row with 5e-15: at 100 Hz, a false alarm in tens of thousands of years. Where a
/// chip is read twice per measurement, 20 equal readings are only 10 equal measurements: 2e-7 at that range, 1e-16 at any usual one.
#[derive(Clone, Debug, Default)]
pub struct RepeatWatch<T> {
    last: Option<T>,
    same: u32,
}

/// A chip is frozen after so many identical readings.
pub const FROZEN_AFTER: u32 = 20;

impl<T: PartialEq> RepeatWatch<T> {
    /// Takes a raw reading. Errors if its chip is frozen.
    pub fn take(&mut self, chip: &'static str, raw: T) -> Result<(), ChipError> {
        if self.is_frozen(raw) {
            let count = self.same;
            return Err(ChipError::Frozen { chip, count });
        }
        Ok(())
    }

    /// Takes a raw reading. True after 20 identical readings, until one differs: a chip that is set up again and repeats
    /// its last reading is still frozen.
    pub fn is_frozen(&mut self, raw: T) -> bool {
        if self.last.as_ref() == Some(&raw) {
            self.same = self.same.saturating_add(1);
        } else {
            self.same = 1;
            self.last = Some(raw);
        }
        self.same >= FROZEN_AFTER
    }
}

fn pause(clock: &mut dyn Clock, s: f64) -> Result<(), ChipError> {
    let until_s = clock.now_s() + s;
    clock
        .wait_until(until_s)
        .then_some(())
        .ok_or(ChipError::Stopped)
}

fn write_all(bus: &mut dyn Bus, address: u8, settings: &[(u8, u8)]) -> Result<(), ChipError> {
    for &(register, value) in settings {
        bus.write(address, register, value)?;
    }
    Ok(())
}

/// Identifies a `chip` by the register at `place`, an address and a number; `right` is its right value, for people.
fn must_be(
    bus: &mut dyn Bus,
    chip: &'static str,
    place: (u8, u8),
    right: &'static str,
    is_right: impl Fn(u8) -> bool,
) -> Result<(), ChipError> {
    let (address, register) = place;
    let found = read_byte(bus, address, register)?;
    if is_right(found) {
        return Ok(());
    }
    Err(ChipError::Identity {
        chip,
        address,
        register,
        found: vec![found],
        right,
    })
}

/// Compares a block of registers, from the first of `right` on, with what was written to them.
fn compare(
    bus: &mut dyn Bus,
    chip: &'static str,
    address: u8,
    right: &[(u8, u8)],
) -> Result<(), ChipError> {
    let mut found = [0; LONGEST_BLOCK];
    let found = &mut found[..right.len()];
    bus.read(address, right[0].0, found)?;
    for (&(register, right), &mut found) in right.iter().zip(found) {
        if found != right {
            return Err(ChipError::ConfigurationLost {
                chip,
                register,
                found,
                right,
            });
        }
    }
    Ok(())
}

/// The first three numbers of 16 bits, high byte first.
fn big_endian(bytes: &[u8]) -> [i16; 3] {
    [0, 2, 4].map(|at| i16::from_be_bytes([bytes[at], bytes[at + 1]]))
}

/// The first three numbers of 16 bits, low byte first.
fn little_endian(bytes: &[u8]) -> [i16; 3] {
    [0, 2, 4].map(|at| i16::from_le_bytes([bytes[at], bytes[at + 1]]))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A clock that jumps to whatever is waited for.
    #[derive(Default)]
    pub(crate) struct JumpingClock {
        pub(crate) now_s: f64,
    }

    impl Clock for JumpingClock {
        fn now_s(&self) -> f64 {
            self.now_s
        }

        fn wait_until(&mut self, t_s: f64) -> bool {
            self.now_s = self.now_s.max(t_s);
            true
        }
    }
}
