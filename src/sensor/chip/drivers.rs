//! The table of all drivers, and which chip answers: a new chip gets its line here.

use super::adxl345::ADXL345;
use super::companion::Companion;
use super::itg3200::ITG3200;
use super::magnetometer::{Driver, Identified, Magnetometer};
use super::mpu6050::MPU6050;
use super::{ChipError, hmc5843, qmc5883l};
use crate::sensor::board::Companions;
use crate::sensor::bus::{Bus, read_byte};
use crate::sensor::clock::Clock;

/// The magnetometers, in the order in which they are looked for.
pub static MAGNETOMETERS: &[&Driver] = &[&hmc5843::DRIVER, &qmc5883l::DRIVER];

/// The addresses of gyros and of accelerometers.
pub const GYRO_ADDRESSES: [u8; 2] = [0x68, 0x69];
/// See [`GYRO_ADDRESSES`].
pub const ACCEL_ADDRESSES: [u8; 2] = [0x53, 0x1D];

/// Magnetometers that headingd cannot read: address, content of register 0, name.
const UNSUPPORTED: &[(u8, u8, &str)] = &[(0x2C, 0x80, "QMC5883P")];

/// The gyros and the accelerometers that a board may have at these addresses.
pub fn companions(which: Companions, gyro: u8, accel: u8) -> (Vec<Companion>, Vec<Companion>) {
    let (mpu, itg, adxl) = (MPU6050.at(gyro), ITG3200.at(gyro), ADXL345.at(accel));
    match which {
        // An MPU-6050 is an accelerometer as well, and has a bus behind it. Their identities tell the gyros apart.
        Companions::Auto => (vec![mpu, itg], vec![adxl]),
        Companions::None => (vec![], vec![]),
        Companions::Itg3200 => (vec![itg], vec![]),
        Companions::Itg3200Adxl345 => (vec![itg], vec![adxl]),
        Companions::Mpu6050 => (vec![mpu], vec![]),
    }
}

/// The magnetometer with this word.
pub fn magnetometer(word: &str) -> Option<&'static dyn Magnetometer> {
    MAGNETOMETERS.iter().find_map(|driver| driver.chip(word))
}

/// Identifies the magnetometer on a bus: the one that the configuration names, or else the first that answers.
///
/// # Errors
///
/// When none can be used; the error is of the first chip that answered, or else of the first.
pub fn identify(
    bus: &mut dyn Bus,
    clock: &mut dyn Clock,
    named: Option<&'static dyn Magnetometer>,
) -> Result<Identified, ChipError> {
    let mut errors = Vec::new();
    for driver in MAGNETOMETERS {
        if named.is_some_and(|chip| driver.chip(chip.sheet().name).is_none()) {
            continue;
        }
        match (driver.identify)(bus, clock, named) {
            Err(ChipError::Stopped) => return Err(ChipError::Stopped),
            Err(error) => errors.push(error),
            found => return found,
        }
    }
    let nearest = errors.into_iter().min_by_key(ChipError::is_no_answer);
    let error = nearest.expect("every chip has a driver");
    if !error.is_no_answer() {
        return Err(error);
    }
    let wanted = named.map_or("supported magnetometer", |chip| chip.sheet().name);
    Err(other(bus, clock, wanted).unwrap_or(error))
}

/// The magnetometer that answers in place of the wanted one, if one does.
fn other(bus: &mut dyn Bus, clock: &mut dyn Clock, wanted: &'static str) -> Option<ChipError> {
    const SUPPORTED: &str = "set i2c.magnetometer = \"auto\"";
    const NOT_SUPPORTED: &str =
        "headingd does not support it: get a board with an HMC5883L or a QMC5883L";
    let drivers = MAGNETOMETERS.iter();
    let supported = drivers.map(|driver| (driver.address(), SUPPORTED));
    let others = UNSUPPORTED.iter().map(|chip| (chip.0, NOT_SUPPORTED));
    supported.chain(others).find_map(|(address, help)| {
        let found = magnetometer_at(bus, clock, address)?;
        Some(ChipError::Clone {
            wanted,
            address,
            found,
            help,
        })
    })
}

/// The magnetometer that answers at an address, also one that headingd cannot read. Only its identity is read.
fn magnetometer_at(bus: &mut dyn Bus, clock: &mut dyn Clock, address: u8) -> Option<&'static str> {
    let mut drivers = MAGNETOMETERS.iter();
    if let Some(driver) = drivers.find(|driver| driver.address() == address) {
        let found = (driver.identify)(bus, clock, Some(driver.chips[0]));
        return found.is_ok().then_some(driver.name);
    }
    let (_, identity, name) = UNSUPPORTED.iter().find(|chip| chip.0 == address)?;
    (read_byte(bus, address, 0) == Ok(*identity)).then_some(*name)
}

/// The name of the chip that answers at an address, or "unknown".
pub fn name(bus: &mut dyn Bus, clock: &mut dyn Clock, address: u8) -> &'static str {
    if let Some(name) = magnetometer_at(bus, clock, address) {
        return name;
    }
    let (gyros, accels) = companions(Companions::Auto, address, address);
    let mut companions = gyros.into_iter().chain(accels);
    companions
        .find(|chip| chip.identify(bus).is_ok())
        .map_or("unknown", |chip| chip.name())
}

/// Every address at which chips are looked for.
pub fn addresses() -> impl Iterator<Item = u8> {
    let magnetometers = MAGNETOMETERS.iter().map(|driver| driver.address());
    let unsupported = UNSUPPORTED.iter().map(|chip| chip.0);
    magnetometers
        .chain(GYRO_ADDRESSES)
        .chain(ACCEL_ADDRESSES)
        .chain(unsupported)
}

#[cfg(test)]
mod tests {
    use super::super::magnetometer::{ChipSetup, MeasuringMode};
    use super::super::tests::JumpingClock;
    use super::*;
    use crate::sensor::bus::fake::FakeBus;

    fn code(bus: &FakeBus, named: &str) -> &'static str {
        let mut clock = JumpingClock::default();
        match identify(&mut bus.clone(), &mut clock, magnetometer(named)) {
            Ok(found) => found.chip.sheet().name,
            Err(error) => error.code(),
        }
    }

    #[test]
    fn another_chip_a_clone_and_silence_are_told_apart() {
        let bus = FakeBus::default();
        assert_eq!(code(&bus, "auto"), "no_answer");
        // A digital potentiometer may answer there.
        bus.set(0x2C, 0, &[0x40]);
        assert_eq!(code(&bus, "auto"), "no_answer");
        bus.set(0x2C, 0, &[0x80]);
        assert_eq!(code(&bus, "auto"), "clone");
        bus.set(0x0D, 0x0D, &[0]);
        assert_eq!(code(&bus, "auto"), "wrong_identity");
        bus.set(0x0D, 0x0D, &[0xFF]);
        assert_eq!(code(&bus, "auto"), "QMC5883L");
        assert_eq!(code(&bus, "qmc5883l"), "QMC5883L");
        assert_eq!(code(&bus, "hmc5883l"), "clone");
        bus.set(0x1E, 0x0A, b"abc");
        assert_eq!(code(&bus, "hmc5883l"), "wrong_identity");
        bus.set(0x1E, 0x0A, b"H43");
        assert_eq!(code(&bus, "hmc5883l"), "HMC5883L");
        // It never measures, and another one does.
        assert_eq!(code(&bus, "auto"), "QMC5883L");
    }

    #[test]
    fn an_address_alone_names_no_chip() {
        let bus = FakeBus::default();
        let mut clock = JumpingClock::default();
        let mut named = |address| name(&mut bus.clone(), &mut clock, address);
        bus.set(0x1E, 0x0A, b"abc");
        assert_eq!(named(0x1E), "unknown");
        bus.set(0x1E, 0x0A, b"H43");
        assert_eq!(named(0x1E), hmc5843::DRIVER.name);
    }

    /// The numbers that all drivers work by make sense together.
    #[test]
    fn every_data_sheet_is_consistent() {
        let chips = MAGNETOMETERS.iter().flat_map(|driver| driver.chips);
        for chip in chips {
            let sheet = chip.sheet();
            assert_eq!(magnetometer(sheet.name).unwrap().sheet(), sheet);
            assert!(sheet.rates_hz.is_sorted());
            assert!(sheet.gains.is_sorted_by(|a, b| a > b));
            let (finest, coarsest) = sheet.automatic_gains;
            assert!(finest < coarsest && usize::from(coarsest) < sheet.gains.len());
            let setup = |gain| ChipSetup {
                mode: MeasuringMode::Continuous(0),
                gain,
            };
            let mut registers = chip.registers(setup(finest));
            assert_ne!(registers, chip.registers(setup(coarsest)));
            registers.sort_unstable();
            assert!(registers.windows(2).all(|two| two[1].0 == two[0].0 + 1));
        }
    }
}
