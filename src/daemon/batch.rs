//! Readings of chips that go out as one message: each message wakes the daemon.

use crate::sensor::SourceEvent;

/// Messages with a field are at least this far apart, seconds; a field that comes sooner waits and goes with the next. Up to
/// 40 Hz none waits; at 50 Hz every second one does, for 20 ms, and the daemon costs a quarter less (tests/board/cost).
const APART_S: f64 = 0.0225;

/// Readings without a field wait up to this long, seconds, for one with a field. Only readings with a field give headings, so
/// no heading is delayed.
const WAITING_S: f64 = 0.05;

/// Capacity of a batch at the usual rates.
const TOGETHER: usize = 8;

/// Events in order.
pub(super) type Events = Vec<SourceEvent>;

/// Collects events until they are handed on.
#[derive(Default)]
pub(super) struct Batch {
    events: Events,
    /// Time of the newest reading with a field that was handed on.
    handed_on_s: Option<f64>,
    /// Times of the oldest reading that waits, and of the newest of a field.
    oldest_s: Option<f64>,
    field_s: Option<f64>,
}

impl Batch {
    /// Takes an event; all that wait, if it is time to hand them on.
    pub(super) fn take(&mut self, event: SourceEvent) -> Option<Events> {
        let due = match &event {
            SourceEvent::Reading(reading, _) => {
                let oldest_s = *self.oldest_s.get_or_insert(reading.t_s);
                let apart = |handed_on_s| reading.t_s - handed_on_s >= APART_S;
                let has_field = reading.field_mgauss.is_some();
                if has_field {
                    self.field_s = Some(reading.t_s);
                }
                reading.t_s - oldest_s >= WAITING_S
                    || has_field && self.handed_on_s.is_none_or(apart)
            }
            _ => true,
        };
        self.events.push(event);
        if !due {
            return None;
        }
        self.oldest_s = None;
        self.handed_on_s = self.field_s;
        let empty = Vec::with_capacity(TOGETHER);
        Some(std::mem::replace(&mut self.events, empty))
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use nalgebra::Vector3;

    use super::*;
    use crate::reading::Reading;

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
            let event = SourceEvent::Reading(*reading, Instant::now());
            let Some(events) = batch.take(event) else {
                continue;
            };
            woken += 1;
            for event in &events {
                let SourceEvent::Reading(one, _) = event else {
                    panic!("{event:?}");
                };
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
