//! A bus with chips on it: reading and writing registers, and the errors.

#[cfg(test)]
pub(crate) mod fake;
mod linux;

pub use linux::LinuxBus;

/// The longest block that one transfer reads: the limit of an SMBus I2C block read.
pub const LONGEST_BLOCK: usize = 32;

/// Reads and writes the registers of the chips on one bus.
pub trait Bus {
    /// Reads registers from `register` on, as many as `into` is long (1 to [`LONGEST_BLOCK`]), in one transfer.
    fn read(&mut self, address: u8, register: u8, into: &mut [u8]) -> Result<(), BusError>;

    fn write(&mut self, address: u8, register: u8, value: u8) -> Result<(), BusError>;
}

pub fn read_byte(bus: &mut dyn Bus, address: u8, register: u8) -> Result<u8, BusError> {
    let mut byte = [0];
    bus.read(address, register, &mut byte)?;
    Ok(byte[0])
}

/// What was attempted on a bus, and what came of it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot {attempt} the chip at 0x{address:02x} on {bus}: {cause}")]
pub struct BusError {
    pub bus: String,
    /// In words: "read register 0x09 of".
    pub attempt: String,
    pub address: u8,
    pub cause: Cause,
}

/// Why a transfer failed, after Linux's `fault-codes.rst`, and what helps.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Cause {
    #[error(
        "there is no such bus; enable it in the board's settings, load the module (modprobe i2c-dev), and look which \
         buses there are (ls /dev/i2c-*)"
    )]
    NoBus,
    #[error(
        "permission denied; let the user join the group i2c (usermod -aG i2c USER) and log in anew"
    )]
    Permission,
    /// A driver of the kernel is bound to the chip, which the kernel names like `1-001e`.
    #[error(
        "the kernel's driver {driver} has claimed the chip; free it with: echo {device} | sudo tee \
         /sys/bus/i2c/drivers/{driver}/unbind"
    )]
    Claimed { driver: String, device: String },
    #[error(
        "the address is busy, but no driver of the kernel has claimed it; is the bus stuck? Switch the chips off and on"
    )]
    Busy,
    #[error(
        "no chip answers; check wiring, power and address (a magnetometer behind an MPU-6050 answers only when that \
         has its bypass on)"
    )]
    NoAnswer,
    #[error(
        "the transfer timed out; check the pull-up resistors and for a line held low, or choose a slower bus clock"
    )]
    Timeout,
    #[error("arbitration lost; another master, or noise, is on the bus")]
    ArbitrationLost,
    #[error("only {found} bytes came; check wiring and bus clock")]
    ShortRead { found: u8 },
    #[error("the adapter does not support SMBus I2C block reads; use another adapter")]
    Unsupported,
    #[error("{0}; check wiring, power and bus clock")]
    Other(String),
}

impl Cause {
    /// As a code that a program can read.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NoBus => "no_bus",
            Self::Permission => "permission",
            Self::Claimed { .. } | Self::Busy => "claimed",
            Self::NoAnswer => "no_answer",
            Self::Timeout => "timeout",
            Self::ArbitrationLost => "arbitration_lost",
            Self::ShortRead { .. } => "short_read",
            Self::Unsupported => "unsupported",
            Self::Other(_) => "bus_error",
        }
    }

    /// Whether the next attempt may succeed: a disturbance on the wires. The others need a person.
    pub fn is_passing(&self) -> bool {
        !matches!(
            self,
            Self::NoBus | Self::Permission | Self::Claimed { .. } | Self::Busy | Self::Unsupported
        )
    }
}
