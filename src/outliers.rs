//! Readings that no sensor has taken: lost bytes, a bus that slipped, an absurd register. They are dropped first, since a gyro is
//! integrated: a single reading of 2279 °/s turns a heading by 23°.
//!
//! Two kinds of value are impossible: one beyond what any chip measures, and one that leaps away from neighbours that
//! agree with each other. Only the next reading tells a leap from motion, so the first reading after a leap is always
//! dropped. If the next ones follow it, the board has moved, and the line between the neighbours replaces the dropped
//! reading. A hand that shakes a sensor leaps all the time, so the threshold grows with the changes of late.

use nalgebra::Vector3;

use crate::reading::Reading;

/// Faster than any gyro of such boards measures, degrees a second.
const LARGEST_RATE_DEG_S: f64 = 4600.0;
/// A gyro's registers go beyond its nominal range by up to this factor.
const BEYOND_RANGE: f64 = 1.15;
/// Stronger than any accelerometer of such boards measures, m/s² (16 g on each axis and more).
const LARGEST_FORCE_M_S2: f64 = 400.0;
/// Stronger than any magnetometer of such boards measures, milligauss.
pub const LARGEST_FIELD_MGAUSS: f64 = 1e5;

/// Neighbours are at most this far apart, seconds.
const GAP_S: f64 = 0.5;
/// Times jitter: neighbours are taken as apart by at least this, seconds.
const SHORTEST_S: f64 = 0.002;
/// A change counts as a leap if it is this many times steeper than the steepest recent one.
const STEEPER: f64 = 3.0;
/// Time constant with which that steepness fades, seconds.
const LATELY_S: f64 = 0.5;
/// At most this many in a row are dropped: what persists is what the sensor measures.
const IN_A_ROW: u32 = 2;

/// Changes up to this are never a leap: an offset, plus a slope times the time between both (90 °/s and 3000 °/s²).
const USUAL_RATE: (f64, f64) = (1.57, 52.0);
/// The same for a force, m/s² and m/s³.
const USUAL_FORCE: (f64, f64) = (10.0, 500.0);

/// Drops outliers, and counts them.
#[derive(Clone, Debug)]
pub struct Outliers {
    largest_rate_rad_s: f64,
    rate: Neighbours,
    force: Neighbours,
    dropped: Dropped,
}

/// How many values of each sensor were dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped {
    /// Of the gyro.
    pub rates: u64,
    /// Of the accelerometer.
    pub forces: u64,
    /// Of the magnetometer.
    pub fields: u64,
}

impl Dropped {
    /// Of all sensors together.
    pub fn total(&self) -> u64 {
        self.rates + self.forces + self.fields
    }
}

impl Outliers {
    /// For a gyro with this full scale, if it is known.
    pub fn new(gyro_range_deg_s: Option<f64>) -> Self {
        let largest = gyro_range_deg_s.map_or(LARGEST_RATE_DEG_S, |range| BEYOND_RANGE * range);
        Self {
            largest_rate_rad_s: largest.to_radians(),
            // Without an earlier value the gyro is compared with rest. The accelerometer has no such value: its first reading is taken
            // as it is.
            rate: Neighbours::new(USUAL_RATE, Some(Vector3::zeros())),
            force: Neighbours::new(USUAL_FORCE, None),
            dropped: Dropped::default(),
        }
    }

    /// The reading without what cannot be.
    pub fn filter(&mut self, reading: &Reading) -> Reading {
        let mut kept = *reading;
        // Not `amax`: it ignores NaN.
        let within =
            |vector: &Vector3<f64>, largest: f64| vector.iter().all(|axis| axis.abs() <= largest);
        kept.rate_rad_s = kept.rate_rad_s.filter(|rate| {
            within(rate, self.largest_rate_rad_s) && self.rate.accepts(reading.t_s, *rate)
        });
        kept.specific_force_m_s2 = kept.specific_force_m_s2.filter(|force| {
            within(force, LARGEST_FORCE_M_S2) && self.force.accepts(reading.t_s, *force)
        });
        kept.field_mgauss = kept.field_mgauss.filter(|field| {
            let mut axes = field.iter().flatten();
            axes.all(|axis| axis.abs() <= LARGEST_FIELD_MGAUSS)
        });
        let dropped = &mut self.dropped;
        dropped.rates += lost(kept.rate_rad_s, reading.rate_rad_s);
        dropped.forces += lost(kept.specific_force_m_s2, reading.specific_force_m_s2);
        dropped.fields += lost(kept.field_mgauss, reading.field_mgauss);
        kept
    }

    /// How many values were dropped.
    pub fn dropped(&self) -> Dropped {
        self.dropped
    }
}

/// 1 if a value that was read has not been kept.
fn lost<T>(kept: Option<T>, read: Option<T>) -> u64 {
    u64::from(read.is_some() && kept.is_none())
}

/// One sensor's values, each held against those before it.
#[derive(Clone, Debug, Default)]
struct Neighbours {
    usual: (f64, f64),
    /// What is taken for the last value where there is none.
    rest: Option<Vector3<f64>>,
    last: Option<(f64, Vector3<f64>)>,
    /// The steepest change of late, a second.
    steepest: f64,
    /// The value that was dropped after the last one.
    doubted: Option<Vector3<f64>>,
    in_a_row: u32,
}

impl Neighbours {
    fn new(usual: (f64, f64), rest: Option<Vector3<f64>>) -> Self {
        Self {
            usual,
            rest,
            ..Self::default()
        }
    }

    fn accepts(&mut self, t_s: f64, value: Vector3<f64>) -> bool {
        let near = |last: &(f64, Vector3<f64>)| (0.0..=GAP_S).contains(&(t_s - last.0));
        self.last = self.last.filter(near);
        if self.last.is_none() {
            self.steepest = 0.0;
        }
        let Some((last_s, from)) = self.last.or(self.rest.map(|rest| (t_s, rest))) else {
            return self.accept(t_s, value, 0.0);
        };
        let span_s = (t_s - last_s).max(SHORTEST_S);
        let change = value - from;
        let steepness = change.norm() / span_s;
        let (at_once, a_second) = self.usual;
        let usual = at_once + a_second * span_s;
        let goes_on = |doubted: Vector3<f64>| {
            let before = doubted - from;
            change.dot(&before) >= 0.5 * before.norm_squared()
        };
        if change.norm() <= usual
            || steepness <= STEEPER * self.steepest
            || self.doubted.is_some_and(goes_on)
            || self.in_a_row >= IN_A_ROW
        {
            let steepness = self.last.map_or(0.0, |_| steepness);
            self.steepest *= (-span_s / LATELY_S).exp();
            return self.accept(t_s, value, steepness);
        }
        self.doubted = Some(value);
        self.in_a_row += 1;
        false
    }

    fn accept(&mut self, t_s: f64, value: Vector3<f64>, steepness: f64) -> bool {
        self.last = Some((t_s, value));
        self.steepest = self.steepest.max(steepness);
        self.doubted = None;
        self.in_a_row = 0;
        true
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    const PERIOD_S: f64 = 1.0 / 95.0;

    fn turning(t_s: f64, deg_s: [f64; 3]) -> Reading {
        Reading {
            t_s,
            rate_rad_s: Some(Vector3::from(deg_s).map(f64::to_radians)),
            ..Reading::default()
        }
    }

    /// Which of these rates about Z, rows at 95 Hz, are dropped.
    fn dropped(outliers: &mut Outliers, deg_s: impl IntoIterator<Item = f64>) -> Vec<usize> {
        let rows = deg_s.into_iter().enumerate();
        rows.filter(|(i, z)| {
            let reading = turning(*i as f64 * PERIOD_S, [0.1, -0.2, *z]);
            outliers.filter(&reading).rate_rad_s.is_none()
        })
        .map(|(i, _)| i)
        .collect()
    }

    #[test]
    fn a_single_absurd_rate_is_dropped_wherever_it_comes() {
        for absurd in [-2279.0, -450.0, 250.0, 2279.0, 5000.0, 1e9] {
            for base in [0.0, 51.4, -300.0] {
                for at in [0, 1, 50, 99] {
                    let mut outliers = Outliers::new(None);
                    let ramp = |i: usize| base * (i as f64 / 20.0).min(1.0);
                    let found = dropped(
                        &mut outliers,
                        (0..100).map(|i| if i == at { absurd } else { ramp(i) }),
                    );
                    assert_eq!(found, [at], "{absurd} in {base}");
                    assert_eq!(outliers.dropped().total(), 1);
                }
            }
        }
    }

    #[test]
    fn what_is_no_number_is_dropped_however_often_it_comes() {
        for broken in [f64::NAN, f64::INFINITY, -1e300] {
            let mut outliers = Outliers::new(None);
            for i in 0..50 {
                let kept = outliers.filter(&Reading {
                    t_s: f64::from(i) * PERIOD_S,
                    field_mgauss: Some([None, Some(1.0), Some(broken)]),
                    rate_rad_s: Some(Vector3::new(0.0, broken, 0.0)),
                    specific_force_m_s2: Some(Vector3::new(broken, 0.0, 9.8)),
                });
                let nothing = Reading {
                    t_s: kept.t_s,
                    ..Reading::default()
                };
                assert_eq!(kept, nothing);
            }
        }
    }

    #[test]
    fn two_absurd_rates_in_a_row_and_many_apart_are_dropped() {
        let mut outliers = Outliers::new(None);
        let wrong = |i: usize| match i {
            40 => Some(2279.0),
            41 => Some(-900.0),
            _ => (i % 7 == 3).then_some(if i.is_multiple_of(2) { 700.0 } else { -1500.0 }),
        };
        let found = dropped(&mut outliers, (0..200).map(|i| wrong(i).unwrap_or(30.0)));
        let right: Vec<usize> = (0..200).filter(|i| wrong(*i).is_some()).collect();
        assert_eq!(found, right);
    }

    #[test]
    fn beyond_the_gyros_range_nothing_is_a_reading() {
        let mut outliers = Outliers::new(Some(250.0));
        let found = dropped(
            &mut outliers,
            [240.0, 280.0, 300.0, 300.0, 300.0, 300.0, 250.0],
        );
        assert_eq!(found[found.len() - 4..], [2, 3, 4, 5]);
    }

    /// Shaken at 5 Hz with 1500 °/s: from row to row the rate changes by up to 490 °/s.
    #[test]
    fn a_sensor_that_is_shaken_by_hand_loses_next_to_nothing() {
        let mut outliers = Outliers::new(None);
        let swing = |i: usize| {
            let t_s = i as f64 * PERIOD_S;
            let grows = ((t_s - 1.0) / 0.1).clamp(0.0, 1.0);
            1500.0 * grows * (std::f64::consts::TAU * 5.0 * (t_s - 1.0)).sin()
        };
        let found = dropped(&mut outliers, (0..950).map(swing));
        assert!(found.len() <= 3, "{found:?}");
        // And an absurd one is found all the same.
        let found = dropped(
            &mut outliers,
            (950..1900).map(|i| if i == 1400 { 3900.0 } else { swing(i) }),
        );
        assert!(found.contains(&450) && found.len() <= 3, "{found:?}");
    }

    #[test]
    fn a_turn_that_begins_at_once_costs_a_reading_at_each_end() {
        let mut outliers = Outliers::new(None);
        let step = |i: usize| if (100..200).contains(&i) { 360.0 } else { 0.0 };
        assert_eq!(dropped(&mut outliers, (0..300).map(step)), [100, 200]);
    }

    #[test]
    fn noise_is_no_leap_at_any_rate() {
        for (period_s, noise) in [(0.001, 20.0), (0.01, 5.0), (0.1, 50.0)] {
            let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(1);
            let mut outliers = Outliers::new(None);
            for i in 0..5000 {
                let rate = [0; 3].map(|_| random.random_range(-noise..noise));
                outliers.filter(&turning(f64::from(i) * period_s, rate));
            }
            assert_eq!(outliers.dropped().total(), 0, "{period_s}");
        }
    }

    #[test]
    fn a_force_and_a_field_beyond_every_chip_are_dropped_alone() {
        let mut outliers = Outliers::new(None);
        let good = Reading {
            t_s: 0.0,
            field_mgauss: Some([Some(1.0), None, Some(-500.0)]),
            rate_rad_s: Some(Vector3::zeros()),
            specific_force_m_s2: Some(Vector3::new(0.0, 0.0, -9.8)),
        };
        assert_eq!(outliers.filter(&good), good);
        let mut wrong = Reading { t_s: 0.01, ..good };
        wrong.field_mgauss = Some([Some(1.0), None, Some(-5e5)]);
        // It has lost its sign.
        wrong.specific_force_m_s2 = Some(Vector3::new(0.0, 0.0, 9.8));
        let kept = outliers.filter(&wrong);
        assert_eq!((kept.field_mgauss, kept.specific_force_m_s2), (None, None));
        assert_eq!(kept.rate_rad_s, good.rate_rad_s);
        assert_eq!(outliers.dropped().total(), 2);
    }
}
