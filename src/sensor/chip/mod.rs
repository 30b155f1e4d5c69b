//! The chips that headingd knows, one folder each: registers and what is done with them.

pub mod adxl345;
pub mod hmc5843;
pub mod itg3200;
pub mod mpu6050;

use nalgebra::Vector3;

use super::bus::{Bus, BusError, Cause, read_byte};
use super::clock::Clock;

/// Standard gravity, m/s².
pub(crate) const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// Why a chip cannot be used, or not now.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ChipError {
    /// A transfer failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// Something answers, but it is another chip.
    #[error(
        "the chip at 0x{address:02x} is no {chip}: its register 0x{register:02x} says {found:02x?}, and should say \
         {right}; check the address, and which chip the board has"
    )]
    Identity {
        /// What was looked for.
        chip: &'static str,
        /// 7-bit address.
        address: u8,
        /// The identification register.
        register: u8,
        /// What it says.
        found: Vec<u8>,
        /// What it should say.
        right: &'static str,
    },
    /// A register does not hold what was written to it.
    #[error(
        "the {chip} has lost its configuration (register 0x{register:02x} holds 0x{found:02x}, not \
         0x{right:02x}), as after a dip of its supply; it is set up again; if it goes on, check power and wiring"
    )]
    ConfigurationLost {
        /// The chip.
        chip: &'static str,
        /// The register.
        register: u8,
        /// What it holds.
        found: u8,
        /// What was written.
        right: u8,
    },
    /// A measurement did not end in time.
    #[error(
        "the {chip} has no measurement ready after {waited_s:.3} s; it is set up again; if it goes on, check power \
         and wiring"
    )]
    NotReady {
        /// The chip.
        chip: &'static str,
        /// How long it was waited for, seconds.
        waited_s: f64,
    },
    /// The same raw numbers again and again, where noise must show.
    #[error(
        "the {chip} has said exactly the same {count} times, and even a board at rest shows noise: its registers \
         are frozen; it is set up again; if it goes on, switch it off and on"
    )]
    Frozen {
        /// The chip.
        chip: &'static str,
        /// How many readings were the same.
        count: u32,
    },
    /// A clone that cannot do the HMC5843's work has been found in its place.
    #[error(
        "no HMC5843 or kin answers at 0x1e, but something at 0x{address:02x}: that is a {name}, often sold as an \
         HMC5883L; it is another chip, which headingd does not know; get a board with a real one"
    )]
    Clone {
        /// Where it answers.
        address: u8,
        /// What it is.
        name: &'static str,
    },
    /// The clock was told to stop.
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
            Self::Stopped => "stopped",
        }
    }

    /// Whether the next transfer may do, with the chip as it is.
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Bus(error) if error.cause.is_passing())
    }

    /// Whether the chip did not answer at all.
    pub fn is_no_answer(&self) -> bool {
        matches!(self, Self::Bus(error) if error.cause == Cause::NoAnswer)
    }
}

/// A gyro, an accelerometer, or both in one.
pub trait Companion {
    /// The chip's name.
    fn name(&self) -> &'static str;

    /// Whether it is an accelerometer, or one as well.
    fn measures_force(&self) -> bool;

    /// Tells whether this chip answers, and sets it up.
    fn start(&mut self, bus: &mut dyn Bus, clock: &mut dyn Clock) -> Result<(), ChipError>;

    /// Reads what it measures.
    fn read(&mut self, bus: &mut dyn Bus) -> Result<Motion, ChipError>;

    /// Looks whether the chip still is as it was set up.
    fn verify(&mut self, bus: &mut dyn Bus) -> Result<(), ChipError>;
}

/// What a companion measured, chip axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// The numbers of the chip, to see whether they change; 0 where it has none.
    pub raw: [i16; 6],
    /// Angular rate, rad/s.
    pub rate_rad_s: Option<Vector3<f64>>,
    /// Specific force, m/s².
    pub specific_force_m_s2: Option<Vector3<f64>>,
}

/// Counts how often a chip has said exactly the same.
///
/// The quietest of these parts at their coarsest range have a noise of about half a count an axis (an HMC5883L's
/// 2 mG at 230 counts a gauss). Then two readings of one axis are the same with a probability of 0.56 at most,
/// all three with 0.18, and 20 in a row with 5e-15: at 100 Hz, a false alarm in tens of thousands of years. A chip
/// that is read twice as fast as it measures still leaves 10: 2e-7 at that range, 1e-16 at any usual one.
#[derive(Clone, Debug)]
pub struct FrozenWatch<T> {
    last: Option<T>,
    same: u32,
}

impl<T> Default for FrozenWatch<T> {
    fn default() -> Self {
        Self {
            last: None,
            same: 0,
        }
    }
}

/// So many times the same are a frozen chip.
pub const FROZEN_AFTER: u32 = 20;

impl<T: PartialEq> FrozenWatch<T> {
    /// Takes a raw reading; an error when it is one too many of the same, and as long as there is no other: a chip
    /// that is set up anew and still says the same is still frozen.
    pub fn take(&mut self, chip: &'static str, raw: T) -> Result<(), ChipError> {
        if self.last.as_ref() == Some(&raw) {
            self.same += 1;
        } else {
            self.same = 1;
            self.last = Some(raw);
        }
        if self.same < FROZEN_AFTER {
            return Ok(());
        }
        let count = self.same;
        Err(ChipError::Frozen { chip, count })
    }
}

/// Waits this long from now.
fn pause(clock: &mut dyn Clock, s: f64) -> Result<(), ChipError> {
    let until_s = clock.now_s() + s;
    clock
        .wait_until(until_s)
        .then_some(())
        .ok_or(ChipError::Stopped)
}

/// Writes registers, in this order.
fn write_all(bus: &mut dyn Bus, address: u8, settings: &[(u8, u8)]) -> Result<(), ChipError> {
    for &(register, value) in settings {
        bus.write(address, register, value)?;
    }
    Ok(())
}

/// Asks the register at `place`, which is an address and a number, whether this is the `chip`; `right` tells people
/// what it should say.
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
fn compare<const N: usize>(
    bus: &mut dyn Bus,
    chip: &'static str,
    address: u8,
    right: [(u8, u8); N],
) -> Result<(), ChipError> {
    let mut found = [0; N];
    bus.read(address, right[0].0, &mut found)?;
    for ((register, right), found) in right.into_iter().zip(found) {
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

/// Three numbers of 16 bits, high byte first.
fn big_endian(bytes: &[u8; 6]) -> [i16; 3] {
    [0, 2, 4].map(|at| i16::from_be_bytes([bytes[at], bytes[at + 1]]))
}

fn scaled(counts: [i16; 3], unit: f64) -> Vector3<f64> {
    Vector3::from(counts.map(f64::from)) * unit
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

    #[test]
    fn twenty_times_the_same_are_frozen_and_a_change_begins_anew() {
        let mut watch = FrozenWatch::default();
        for raw in [1; 19].into_iter().chain([2; 19]) {
            watch.take("chip", raw).unwrap();
        }
        for _ in 0..2 {
            let error = watch.take("chip", 2).unwrap_err();
            assert_eq!(error.code(), "frozen");
        }
        watch.take("chip", 3).unwrap();
    }
}
