//! A device behind a serial line, on the source's thread.

use std::sync::atomic::AtomicBool;

use tokio::runtime::Builder;
use tokio::sync::mpsc;

use super::source::Message;
use crate::condition::Trouble;
use crate::sensor::serial::{Bridge, Heard};

/// Hands on what the bridge hears, until it is told to stop.
pub(super) fn play(mut bridge: Bridge, out: &mpsc::Sender<Message>, stop: &AtomicBool) {
    let runtime = match Builder::new_current_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => {
            let trouble = Trouble {
                code: "internal",
                message: format!("cannot wait for a serial port: {error}"),
            };
            // An error means that the daemon is about to end anyway.
            let _ = out.blocking_send(Message::Broken(trouble));
            return;
        }
    };
    while let Some(heard) = runtime.block_on(bridge.next(stop)) {
        let message = match heard {
            Heard::Reading(reading, taken) => Message::Reading(reading, taken),
            Heard::Trouble(trouble) => Message::Trouble(trouble),
        };
        if out.blocking_send(message).is_err() {
            return;
        }
    }
}
