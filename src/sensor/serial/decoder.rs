//! The codec that the settings name; for `auto`, both text codecs until one fits.

use super::Item;
use super::log_rows::LogRows;
use super::razor_binary::RazorBinary;
use super::razor_text::RazorText;
use super::settings::{Protocol, Settings};

#[derive(Debug)]
pub(super) struct Decoder {
    /// The device's protocol; [`Protocol::Auto`] while that is not known.
    pub(super) protocol: Protocol,
    razor_text: RazorText,
    razor_binary: RazorBinary,
}

impl Decoder {
    pub(super) fn new(settings: &Settings) -> Self {
        let gain = settings.chip.counts_per_gauss();
        Self {
            protocol: settings.protocol,
            razor_text: RazorText::new(gain),
            razor_binary: RazorBinary::new(gain),
        }
    }

    /// Decodes `bytes`, and calls `found` with each completed item. The caller keeps `log_rows`, which outlives a port.
    pub(super) fn feed(&mut self, bytes: &[u8], log_rows: &mut LogRows, found: impl FnMut(Item)) {
        match self.protocol {
            Protocol::Razor => self.razor_text.feed(bytes, found),
            Protocol::RazorBinary => self.razor_binary.feed(bytes, found),
            Protocol::LogRows => log_rows.feed(bytes, found),
            Protocol::Auto => self.listen(bytes, log_rows, found),
        }
    }

    fn listen(&mut self, bytes: &[u8], log_rows: &mut LogRows, mut found: impl FnMut(Item)) {
        self.razor_text.feed(bytes, |item| {
            if matches!(item, Item::Frame(_) | Item::OtherMode(_) | Item::Synch(_)) {
                self.protocol = Protocol::Razor;
                found(item);
            }
        });
        if self.protocol == Protocol::Razor {
            return;
        }
        // A line of either protocol is a remark or a fault to the other's codec.
        log_rows.feed(bytes, |item| {
            if matches!(item, Item::Timed(_) | Item::Early) {
                self.protocol = Protocol::LogRows;
            }
            found(item);
        });
    }

    /// Whether binary frames are misaligned until the device answers `#s01`.
    pub(super) fn is_lost(&self) -> bool {
        self.protocol == Protocol::RazorBinary && !self.razor_binary.aligned
    }
}
