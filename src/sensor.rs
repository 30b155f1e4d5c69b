//! Sources of readings, and the events that all of them send.

pub mod board;
pub(crate) mod bus;
pub(crate) mod chip;
pub mod clock;
pub(crate) mod i2c;
pub mod replay;
pub mod serial;
pub mod simulator;

use std::time::Instant;

use crate::condition::SourceFault;
use crate::reading::Reading;

pub use chip::drivers;

/// What a source sends.
#[derive(Clone, Debug, PartialEq)]
pub enum SourceEvent {
    /// A reading, and the moment at which it was taken.
    Reading(Reading, Instant),
    /// The times of the readings that follow have nothing to do with those before.
    NewStretch,
    /// The source has a fault and keeps trying; `None` when it works again.
    Fault(Option<SourceFault>),
    /// There are no more readings; if there were none, or most could not be used, why.
    End(Option<String>),
    /// The source has failed for good.
    Broken(SourceFault),
}
