//! The lines of one format: each heading is encoded once, and only if a client wants it.

use std::sync::{Mutex, PoisonError};

/// The newest lines, as many as the ring holds headings: a client that lags finds its own, too.
#[derive(Debug)]
pub(super) struct SharedLines {
    slots: Box<[Mutex<Slot>]>,
}

#[derive(Debug, Default)]
struct Slot {
    /// Of the heading; 0 is none.
    number: u64,
    text: String,
}

impl SharedLines {
    /// For a ring of this size.
    pub(super) fn new(backlog: usize) -> Self {
        Self {
            // The ring rounds its size up like this.
            slots: (0..backlog.next_power_of_two())
                .map(|_| Mutex::default())
                .collect(),
        }
    }

    /// Appends the lines of the heading with this number, which `encode` puts into an empty text if nobody has asked for
    /// them before.
    pub(super) fn put(&self, out: &mut String, number: u64, encode: impl FnOnce(&mut String)) {
        let slot = &self.slots[number as usize % self.slots.len()];
        // The number comes last, so a panic elsewhere cannot have left half a text under it.
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if slot.number != number {
            slot.text.clear();
            encode(&mut slot.text);
            slot.number = number;
        }
        out.push_str(&slot.text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_encoded_once_as_long_as_the_ring_holds_its_heading() {
        let lines = SharedLines::new(6);
        let mut encoded = Vec::new();
        let mut out = String::new();
        // The newest, one that lags by the whole ring, and one of which nobody has asked before.
        for number in [1, 2, 8, 1, 8, 2, 5, 9, 9, 2, 1] {
            lines.put(&mut out, number, |text| {
                encoded.push(number);
                text.push_str(&number.to_string());
            });
        }
        assert_eq!(encoded, [1, 2, 8, 5, 9, 1]);
        assert_eq!(out, "12818259921");
    }
}
