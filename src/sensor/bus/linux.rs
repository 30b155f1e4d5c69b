//! A Linux bus, `/dev/i2c-N`, by SMBus transfers only: they also work where the adapter refuses plain I2C ones
//! (I2C_RDWR), and the kernel refuses to open a chip for them (I2C_SLAVE) while a driver is bound to it. This refusal is
//! never overridden.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io;
use std::path::{Path, PathBuf};

use i2cdev::core::I2CDevice;
use i2cdev::linux::{LinuxI2CDevice, LinuxI2CError};
use libc::{EACCES, EAGAIN, EBUSY, ENODEV, ENOENT, ENXIO, EOPNOTSUPP, EPERM, EREMOTEIO, ETIMEDOUT};

use super::{Bus, BusError, Cause};

/// Where the kernel shows which driver has which chip.
const DEVICES: &str = "/sys/bus/i2c/devices";

/// A bus of Linux. Chips are opened when they are first talked to.
pub struct LinuxBus {
    number: u8,
    /// One open file per chip, since the address is set per file. An error closes the file, so that the next transfer
    /// opens a bus that came back, or a chip that a driver released.
    devices: BTreeMap<u8, LinuxI2CDevice>,
}

impl LinuxBus {
    /// The bus `/dev/i2c-N`. Nothing is opened yet.
    pub fn new(number: u8) -> Self {
        Self {
            number,
            devices: BTreeMap::new(),
        }
    }

    pub fn path(number: u8) -> PathBuf {
        format!("/dev/i2c-{number}").into()
    }

    fn device(&mut self, address: u8) -> Result<&mut LinuxI2CDevice, BusError> {
        let number = self.number;
        match self.devices.entry(address) {
            Entry::Occupied(open) => Ok(open.into_mut()),
            Entry::Vacant(place) => LinuxI2CDevice::new(Self::path(number), address.into())
                .map(|device| place.insert(device))
                .map_err(|error| {
                    let cause = opening(error, number, address);
                    failed(number, address, "talk to", cause)
                }),
        }
    }
}

fn failed(bus: u8, address: u8, attempt: impl Into<String>, cause: Cause) -> BusError {
    BusError {
        bus: LinuxBus::path(bus).display().to_string(),
        attempt: attempt.into(),
        address,
        cause,
    }
}

impl Bus for LinuxBus {
    fn read(&mut self, address: u8, register: u8, into: &mut [u8]) -> Result<(), BusError> {
        let count = into.len() as u8;
        let read = self
            .device(address)?
            .smbus_read_i2c_block_data(register, count);
        let cause = match read {
            Ok(bytes) if bytes.len() == into.len() => {
                into.copy_from_slice(&bytes);
                return Ok(());
            }
            Ok(bytes) => Cause::ShortRead {
                found: bytes.len() as u8,
            },
            Err(error) => transfer(error),
        };
        let attempt = match count {
            1 => format!("read register 0x{register:02x} of"),
            _ => format!("read {count} registers from 0x{register:02x} of"),
        };
        self.devices.remove(&address);
        Err(failed(self.number, address, attempt, cause))
    }

    fn write(&mut self, address: u8, register: u8, value: u8) -> Result<(), BusError> {
        self.device(address)?
            .smbus_write_byte_data(register, value)
            .map_err(|error| {
                let attempt = format!("write register 0x{register:02x} of");
                self.devices.remove(&address);
                failed(self.number, address, attempt, transfer(error))
            })
    }
}

/// What a refusal to open means: of the file, or of the address.
fn opening(error: LinuxI2CError, number: u8, address: u8) -> Cause {
    let error = io::Error::from(error);
    match error.raw_os_error() {
        Some(ENOENT | ENODEV | ENXIO) => Cause::NoBus,
        Some(EACCES | EPERM) => Cause::Permission,
        Some(EBUSY) => claimed(Path::new(DEVICES), number, address).unwrap_or(Cause::Busy),
        _ => Cause::Other(error.to_string()),
    }
}

/// What a failed transfer means, as `Documentation/i2c/fault-codes.rst` of the kernel has it.
fn transfer(error: LinuxI2CError) -> Cause {
    let error = io::Error::from(error);
    match error.raw_os_error() {
        // No acknowledge is ENXIO; BCM2835 returns EREMOTEIO, some adapters ENODEV.
        Some(ENXIO | EREMOTEIO | ENODEV) => Cause::NoAnswer,
        Some(ETIMEDOUT) => Cause::Timeout,
        Some(EAGAIN) => Cause::ArbitrationLost,
        Some(EOPNOTSUPP) => Cause::Unsupported,
        Some(EBUSY) => Cause::Busy,
        Some(EACCES | EPERM) => Cause::Permission,
        _ => Cause::Other(error.to_string()),
    }
}

/// Which driver has claimed a chip, if one has.
fn claimed(devices: &Path, number: u8, address: u8) -> Option<Cause> {
    let device = format!("{number}-{address:04x}");
    let driver = devices.join(&device).join("driver").canonicalize().ok()?;
    Some(Cause::Claimed {
        driver: driver.file_name()?.to_str()?.to_owned(),
        device,
    })
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn an_errno_becomes_a_cause() {
        let of = |errno| transfer(LinuxI2CError::Errno(errno));
        for (errno, code) in [
            (ENXIO, "no_answer"),
            (EREMOTEIO, "no_answer"),
            (ENODEV, "no_answer"),
            (ETIMEDOUT, "timeout"),
            (EAGAIN, "arbitration_lost"),
            (EOPNOTSUPP, "unsupported"),
            (5, "bus_error"),
        ] {
            assert_eq!(of(errno).code(), code);
        }
        assert!(of(5).to_string().contains("Input/output error"));
        let open = |errno| {
            let error = LinuxI2CError::Io(io::Error::from_raw_os_error(errno));
            opening(error, 250, 0x1e).code()
        };
        assert_eq!(
            [open(ENOENT), open(EACCES), open(EBUSY), open(5)],
            ["no_bus", "permission", "claimed", "bus_error"]
        );
    }

    #[test]
    fn the_driver_that_has_the_chip_is_named_with_the_line_that_frees_it() {
        let folder = tempfile::tempdir().unwrap();
        let driver = folder.path().join("drivers/hmc5843");
        let device = folder.path().join("devices/1-001e");
        fs::create_dir_all(&driver).unwrap();
        fs::create_dir_all(&device).unwrap();
        symlink(&driver, device.join("driver")).unwrap();
        let devices = folder.path().join("devices");
        let said = claimed(&devices, 1, 0x1e).unwrap().to_string();
        assert!(
            said.contains("echo 1-001e | sudo tee /sys/bus/i2c/drivers/hmc5843/unbind"),
            "{said}"
        );
        assert_eq!(claimed(&devices, 1, 0x68), None);
    }
}
