//! The codec that a device asks for, or all of them until one understands it.

use super::Item;
use super::log_rows::LogRows;
use super::razor_binary::RazorBinary;
use super::razor_text::RazorText;
use super::settings::{Protocol, Settings};
use crate::frame::Mountings;

#[derive(Debug)]
pub(super) enum Decoder {
    /// Boxed since only one of the two will stay.
    Listening(Box<(RazorText, LogRows)>),
    RazorText(RazorText),
    RazorBinary(RazorBinary),
    LogRows(Box<LogRows>),
}

impl Decoder {
    pub(super) fn new(settings: &Settings, board: Mountings) -> Self {
        let gain = settings.chip.counts_per_gauss();
        match settings.protocol {
            Protocol::Auto => {
                Self::Listening(Box::new((RazorText::new(gain), LogRows::new(board))))
            }
            Protocol::Razor => Self::RazorText(RazorText::new(gain)),
            Protocol::RazorBinary => Self::RazorBinary(RazorBinary::new(gain)),
            Protocol::LogRows => Self::LogRows(Box::new(LogRows::new(board))),
        }
    }

    /// The device's protocol; [`Protocol::Auto`] while that is not known.
    pub(super) fn protocol(&self) -> Protocol {
        match self {
            Self::Listening(_) => Protocol::Auto,
            Self::RazorText(_) => Protocol::Razor,
            Self::RazorBinary(_) => Protocol::RazorBinary,
            Self::LogRows(_) => Protocol::LogRows,
        }
    }

    /// Hands over what `bytes` complete, in order.
    pub(super) fn feed(&mut self, bytes: &[u8], mut found: impl FnMut(Item)) {
        let both = match self {
            Self::RazorText(codec) => return codec.feed(bytes, found),
            Self::RazorBinary(codec) => return codec.feed(bytes, found),
            Self::LogRows(codec) => return codec.feed(bytes, found),
            Self::Listening(both) => both,
        };
        let (mut razor, mut rows) = (false, false);
        both.0.feed(bytes, |item| {
            if matches!(item, Item::Frame(_) | Item::OtherMode(_) | Item::Synch(_)) {
                razor = true;
                found(item);
            }
        });
        // A line that the one understands is a remark or a fault to the other.
        both.1.feed(bytes, |item| {
            rows |= matches!(item, Item::Timed(_));
            if !razor {
                found(item);
            }
        });
        let (text, log_rows) = (both.0.clone(), rows && !razor);
        if razor {
            *self = Self::RazorText(text);
        } else if log_rows && let Self::Listening(both) = self {
            let board = LogRows::new(Mountings::default());
            *self = Self::LogRows(Box::new(std::mem::replace(&mut both.1, board)));
        }
    }

    /// Whether it has lost its place, and only the device can help.
    pub(super) fn is_lost(&self) -> bool {
        matches!(self, Self::RazorBinary(codec) if !codec.is_aligned())
    }
}
