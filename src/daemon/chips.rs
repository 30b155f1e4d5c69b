//! Real chips as a source: what they say becomes messages, with the moment at which it was read.

use std::time::Instant;

use tokio::sync::mpsc;
use tokio::sync::mpsc::error::TrySendError;

use super::source::Message;
use crate::reading::Reading;
use crate::sensor::bus::LinuxBus;
use crate::sensor::clock::SystemClock;
use crate::sensor::i2c::{Chips, Said, Settings};

/// Readings of the magnetometer are handed on this much apart, seconds, or two at once. Up to 40 Hz none waits; at 50 Hz
/// every second one does, for 20 ms, and the daemon costs a quarter less (tests/board/cost).
const APART_S: f64 = 0.0225;

/// The gyro's readings wait this long for one of the magnetometer, seconds. A heading goes out with that one alone,
/// so nothing is later for it.
const WAITING_S: f64 = 0.05;

/// Room for what comes together at the usual rates.
const TOGETHER: usize = 8;

/// Reads the chips until the clock says stop, or nobody listens any more.
pub(super) fn read(settings: &Settings, out: &mpsc::Sender<Message>, mut clock: SystemClock) {
    let mut bus = LinuxBus::new(settings.bus);
    let taken = clock.clone();
    let mut batch = Batch::default();
    let mut say = |said| {
        let trouble = match said {
            Said::Reading(reading) => {
                if !batch.take(reading, taken.instant(reading.t_s)) {
                    return true;
                }
                None
            }
            Said::Trouble(trouble) => Some(Message::Trouble(trouble)),
        };
        [batch.hand_on(), trouble]
            .into_iter()
            .flatten()
            .all(|message| send(out, message))
    };
    Chips::new(settings).run(&mut bus, &mut clock, &mut say);
}

/// Whether anybody still listens. To wait for room takes far more code than to see that there is some.
fn send(out: &mpsc::Sender<Message>, message: Message) -> bool {
    match out.try_send(message) {
        Err(TrySendError::Full(message)) => out.blocking_send(message).is_ok(),
        sent => sent.is_ok(),
    }
}

/// Readings that go out as one message: each that is sent wakes the daemon.
#[derive(Default)]
struct Batch {
    readings: Vec<(Reading, Instant)>,
    /// Time of the newest reading with a field that was handed on.
    handed_on_s: Option<f64>,
}

impl Batch {
    /// Takes a reading, and says whether it is time to hand on.
    fn take(&mut self, reading: Reading, taken: Instant) -> bool {
        self.readings.push((reading, taken));
        let since_s = reading.t_s - self.readings[0].0.t_s;
        let apart = |handed_on_s| reading.t_s - handed_on_s >= APART_S;
        since_s >= WAITING_S || reading.field_mgauss.is_some() && self.handed_on_s.is_none_or(apart)
    }

    fn hand_on(&mut self) -> Option<Message> {
        let with_field = |(reading, _): &&(Reading, Instant)| reading.field_mgauss.is_some();
        if let Some((newest, _)) = self.readings.iter().rfind(with_field) {
            self.handed_on_s = Some(newest.t_s);
        }
        let empty = Vec::with_capacity(TOGETHER);
        let readings = std::mem::replace(&mut self.readings, empty);
        (!readings.is_empty()).then_some(Message::Readings(readings))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    /// Plays ten seconds of a gyro at 100 Hz, and of a magnetometer if there is one: how often the daemon is woken, and
    /// how long the reading of a field waits at most.
    fn play(mag_hz: Option<f64>) -> (usize, f64) {
        let motion = |t_s| Reading {
            t_s,
            rate_rad_s: Some(Vector3::zeros()),
            ..Reading::default()
        };
        let field = |t_s| Reading {
            t_s,
            field_mgauss: Some([Some(1.0); 3]),
            ..Reading::default()
        };
        let mut all: Vec<Reading> = (0..1000).map(|i| motion(f64::from(i) / 100.0)).collect();
        if let Some(hz) = mag_hz {
            // The chip's clock is not ours.
            all.extend((0..(10.0 * hz) as u32).map(|i| field(0.003 + 1.004 * f64::from(i) / hz)));
        }
        all.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        let (mut batch, mut woken, mut longest_s) = (Batch::default(), 0, 0.0f64);
        let mut handed_on = 0;
        for reading in &all {
            if !batch.take(*reading, Instant::now()) {
                continue;
            }
            let Some(Message::Readings(readings)) = batch.hand_on() else {
                panic!("it was time, and there is nothing");
            };
            woken += 1;
            for (one, _) in &readings {
                assert_eq!(one, &all[handed_on]);
                handed_on += 1;
                if one.field_mgauss.is_some() {
                    longest_s = longest_s.max(reading.t_s - one.t_s);
                }
            }
        }
        assert!(all.len() - handed_on <= 6);
        (woken, longest_s)
    }

    #[test]
    fn up_to_40_hz_no_field_waits_and_above_it_two_go_together() {
        for (hz, most_woken, longest_s) in [
            (10.0, 201, 0.0),
            (30.0, 300, 0.0),
            (40.0, 400, 0.0),
            (50.0, 250, 0.0205),
            (75.0, 376, 0.0136),
        ] {
            let (woken, waited_s) = play(Some(hz));
            assert!(woken <= most_woken, "{hz} Hz: woken {woken} times");
            assert!(waited_s <= longest_s, "{hz} Hz: waits {waited_s} s");
        }
    }

    #[test]
    fn without_a_magnetometer_the_gyro_is_heard_all_the_same() {
        let (woken, _) = play(None);
        // Six or seven at once.
        assert!((142..=167).contains(&woken), "{woken}");
    }
}
