//! The codec that a device asks for, or all of them until one understands it.

use super::Item;
use super::log_rows::LogRows;
use super::razor_binary::RazorBinary;
use super::razor_text::RazorText;
use super::settings::{Protocol, Settings};

#[derive(Debug)]
pub(super) struct Decoder {
    protocol: Protocol,
    razor_text: RazorText,
    razor_binary: RazorBinary,
    log_rows: LogRows,
}

impl Decoder {
    /// With what is known of the device's log rows.
    pub(super) fn new(settings: &Settings, log_rows: LogRows) -> Self {
        let gain = settings.chip.counts_per_gauss();
        Self {
            protocol: settings.protocol,
            razor_text: RazorText::new(gain),
            razor_binary: RazorBinary::new(gain),
            log_rows,
        }
    }

    /// The device's protocol; [`Protocol::Auto`] while that is not known.
    pub(super) fn protocol(&self) -> Protocol {
        self.protocol
    }

    /// Hands over what `bytes` complete, in order.
    pub(super) fn feed(&mut self, bytes: &[u8], found: impl FnMut(Item)) {
        match self.protocol {
            Protocol::Razor => self.razor_text.feed(bytes, found),
            Protocol::RazorBinary => self.razor_binary.feed(bytes, found),
            Protocol::LogRows => self.log_rows.feed(bytes, found),
            Protocol::Auto => self.listen(bytes, found),
        }
    }

    fn listen(&mut self, bytes: &[u8], mut found: impl FnMut(Item)) {
        self.razor_text.feed(bytes, |item| {
            if matches!(item, Item::Frame(_) | Item::OtherMode(_) | Item::Synch(_)) {
                self.protocol = Protocol::Razor;
                found(item);
            }
        });
        if self.protocol == Protocol::Razor {
            return;
        }
        // A line that the one understands is a remark or a fault to the other.
        self.log_rows.feed(bytes, |item| {
            if matches!(item, Item::Timed(_) | Item::Early) {
                self.protocol = Protocol::LogRows;
            }
            found(item);
        });
    }

    /// What is known of the device's log rows.
    pub(super) fn into_log_rows(self) -> LogRows {
        self.log_rows
    }

    /// Whether it has lost its place, and only the device can help.
    pub(super) fn is_lost(&self) -> bool {
        self.protocol == Protocol::RazorBinary && !self.razor_binary.is_aligned()
    }
}
