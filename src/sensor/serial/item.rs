//! The items that a codec decodes from a device's bytes.

use crate::reading::Reading;

/// One item from a device.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// The sensors at the device's next tick. The device sends no time: `t_s` is 0.
    Frame(Reading),
    /// The sensors at a time of the device's own clock.
    Timed(Reading),
    /// The answer to a request for synchronisation, with the two bytes that were asked for.
    Synch([u8; 2]),
    /// The device sends, but in this mode, which is of no use here.
    OtherMode(&'static str),
    /// A remark, or a part of a header: nothing is wrong.
    Remark,
    /// Bytes that cannot be used, and why.
    Bad(String),
    /// A line that does not end.
    TooLong,
}
