//! The Razor AHRS firmware's raw readings in binary, `#osrb`: 36 bytes a frame, nine little-endian floats,
//! accelerometer, magnetometer, gyro.
//!
//! Frames have neither a beginning nor a checksum, so they are counted from the answer to `#s01`, and
//! believed only while they hold what raw counts can be: whole numbers within 16 bits. Error lines would
//! mix with the frames, so error output is off, and a failed read shows only in repeated numbers.

use super::Item;
use super::razor::{RazorFrame, reading};
use crate::sensor::chip::RepeatWatch;

/// Bytes of a frame.
const FRAME: usize = 36;
/// What frames are counted from.
const MARK: &[u8] = b"#SYNCH01\r\n";
/// Raw counts have 16 bits, with or without a sign.
const MOST: f32 = 65536.0;

/// Bytes in, frames out.
#[derive(Debug)]
pub struct RazorBinary {
    counts_per_gauss: f64,
    /// Less than a frame while aligned, less than a mark while not.
    pending: Vec<u8>,
    /// Whether it knows where frames begin; if not, it waits for the answer to `#s01`.
    pub(super) aligned: bool,
    /// Bytes passed over since the last complaint.
    passed: usize,
    /// A sensor whose numbers repeat for 0.4 s is taken as not read.
    repeats: [RepeatWatch<[f32; 3]>; 3],
}

impl RazorBinary {
    /// For a magnetometer with this gain, counts per gauss.
    pub fn new(counts_per_gauss: f64) -> Self {
        Self {
            counts_per_gauss,
            pending: Vec::with_capacity(2 * FRAME),
            aligned: false,
            passed: 0,
            repeats: Default::default(),
        }
    }

    /// Decodes `bytes`, and calls `found` with each completed item.
    pub fn feed(&mut self, bytes: &[u8], mut found: impl FnMut(Item)) {
        for &byte in bytes {
            self.take(byte, &mut found);
        }
    }

    fn take(&mut self, byte: u8, found: &mut impl FnMut(Item)) {
        self.pending.push(byte);
        if self.aligned {
            self.step(found);
        } else {
            self.hunt(found);
        }
    }

    fn step(&mut self, found: &mut impl FnMut(Item)) {
        if self.pending == MARK {
            self.pending.clear();
            found(Item::Synch(*b"01"));
        } else if self.pending.len() == FRAME {
            let numbers = numbers(&self.pending);
            if numbers
                .iter()
                .flatten()
                .all(|n| n.fract() == 0.0 && n.abs() <= MOST)
            {
                self.pending.clear();
                let frame = self.frame(numbers);
                found(Item::Frame(reading(frame, self.counts_per_gauss)));
            } else {
                found(Item::Bad(
                    "36 bytes are not a raw-count frame: bytes were lost, or the board is in another mode"
                        .to_owned(),
                ));
                self.aligned = false;
                // The mark may begin in them.
                for byte in std::mem::take(&mut self.pending) {
                    self.take(byte, found);
                }
            }
        }
    }

    /// Passes over everything that cannot be the beginning of the mark.
    fn hunt(&mut self, found: &mut impl FnMut(Item)) {
        if self.pending.ends_with(MARK) {
            self.pending.clear();
            self.passed = 0;
            self.aligned = true;
            found(Item::Synch(*b"01"));
            return;
        }
        if self.pending.ends_with(b"#SYNCH00") {
            found(Item::Synch(*b"00"));
        }
        // Lines of another mode identify it.
        if self.pending.ends_with(b"#YPR") {
            found(Item::OtherMode("angles (#ot)"));
        }
        if self.pending.len() > MARK.len() {
            self.pending.remove(0);
        }
        self.passed += 1;
        if self.passed > 10 * FRAME {
            self.passed = 0;
            found(Item::Bad(
                "found bytes without #SYNCH01 among them".to_owned(),
            ));
        }
    }

    fn frame(&mut self, numbers: [[f32; 3]; 3]) -> RazorFrame {
        std::array::from_fn(|sensor| {
            let counts = numbers[sensor].map(|n| Some(f64::from(n)));
            (!self.repeats[sensor].is_frozen(numbers[sensor])).then_some(counts)
        })
    }
}

/// The frame's numbers, by sensor.
fn numbers(frame: &[u8]) -> [[f32; 3]; 3] {
    let mut numbers = [[0.0; 3]; 3];
    let (all, _) = frame.as_chunks();
    for (number, bytes) in numbers.as_flattened_mut().iter_mut().zip(all) {
        *number = f32::from_le_bytes(*bytes);
    }
    numbers
}
