//! Notices a sensor that repeats its value while the board turns: its chip hangs, or whoever reads it does.
//!
//! At rest a coarse sensor, or a simulated one without noise, may well repeat its value for ever. So only values that come while the gyro
//! shows motion count. `axis` notices a single axis, by the noise of the other two.

mod axis;
mod rest;

use nalgebra::Vector3;

use crate::frame::Mountings;
use crate::reading::{Field, HELD_S, Reading};
pub use axis::AxisWatch;
use rest::RestRate;

/// Number of identical values before a sensor counts as frozen.
const READINGS: u32 = 20;
/// Least duration of the run, seconds: some rows repeat a sensor's last value until it has a new one.
const LASTING_S: f64 = 0.5;
/// Least rotation during the run, radians (30°): no field looks the same after it.
const TURNED_RAD: f64 = 0.52;
/// Rotation counts at this rate or faster, rad/s (20 °/s), which exceeds any gyro's bias. Slower rotation counts once the rate at rest is
/// known.
pub(crate) const MOVING_RAD_S: f64 = 0.35;
/// A gyro that repeats its rate counts as frozen after this rotation by its own account, radians (90°), if the field stands still.
/// Otherwise the rotation may be a turntable's.
const BELIED_RAD: f64 = 1.57;
/// A field that changes by less than this share of it meanwhile stands still.
const BELIED_SHARE: f64 = 0.05;
/// A gyro that is silent for longer shows no motion, seconds.
pub(crate) const GAP_S: f64 = 0.5;

/// What is frozen, as a code and as a sentence.
pub type Frozen = (&'static str, &'static str);

/// The magnetometer repeats its value while the gyro shows that the board turns.
const MAGNETOMETER: Frozen = (
    "frozen_magnetometer",
    "the magnetometer repeats its value while the gyro shows that the board turns; switch the \
     board off and on, and check what reads the magnetometer",
);

/// The gyro repeats its rate while the field stands still.
const GYRO: Frozen = (
    "frozen_gyro",
    "the gyro repeats its rate while the field stands still; switch the board off \
     and on, and check what reads the gyro",
);

/// The accelerometer repeats its value while the gyro shows that the board tilts.
const ACCELEROMETER: Frozen = (
    "frozen_accelerometer",
    "the accelerometer repeats its value while the gyro shows that the board tilts; switch the \
     board off and on, and check what reads the accelerometer",
);

/// Readings in, what is frozen out.
#[derive(Clone, Debug, Default)]
pub struct FrozenWatch {
    /// Time of the gyro's last reading, and the rate then.
    rate: Option<(f64, f64)>,
    field: Run<Field>,
    gyro: Run<Vector3<f64>>,
    force: Run<Vector3<f64>>,
    rest: RestRate,
    /// When the field last changed, seconds.
    changed_s: f64,
    /// The field at the beginning of the gyro's run (taken anew after each `BELIED_RAD`), and the largest distance from it since.
    seen: Option<(Vector3<f64>, f64)>,
    magnetometer_frozen: bool,
    gyro_frozen: bool,
    accelerometer_frozen: bool,
    accelerometer_resumed: bool,
    /// When the accelerometer was read last, seconds, and whether the board tilted then.
    force_s: f64,
    tilts: bool,
}

/// The same value again and again, in motion.
#[derive(Clone, Debug, Default)]
struct Run<T> {
    value: Option<T>,
    readings: u32,
    passed_s: f64,
    turned_rad: f64,
}

impl<T: PartialEq> Run<T> {
    fn begin(&mut self, value: T) {
        *self = Self {
            value: Some(value),
            readings: 1,
            passed_s: 0.0,
            turned_rad: 0.0,
        };
    }

    /// Whether this value repeats that of the run.
    fn is(&self, value: &T) -> bool {
        self.value.as_ref() == Some(value)
    }

    fn lasts(&self, turned_rad: f64) -> bool {
        self.readings >= READINGS && self.passed_s >= LASTING_S && self.turned_rad >= turned_rad
    }

    fn turn(&mut self, passed_s: f64, rate_rad_s: f64) {
        self.passed_s += passed_s;
        self.turned_rad += rate_rad_s * passed_s;
    }
}

impl FrozenWatch {
    /// Takes a reading of chips that are mounted like this; what is frozen, until its value changes.
    pub fn take(&mut self, reading: &Reading, mountings: &Mountings) -> Option<Frozen> {
        self.take_force(reading.t_s, reading.specific_force_m_s2);
        if let Some(rate) = reading.rate_rad_s {
            let tilting = self.tilting_rad_s(&rate, mountings);
            self.take_rate(reading.t_s, rate, tilting);
        }
        if let Some(field) = reading.field_mgauss {
            self.take_field(reading.t_s, field);
        }
        if let Some(field) = reading.whole_field_mgauss() {
            self.rest.take_field(reading.t_s, field);
            let (begun, far) = self.seen.get_or_insert((field, 0.0));
            *far = far.max((field - *begun).norm());
        }
        if self.magnetometer_frozen {
            Some(MAGNETOMETER)
        } else if self.gyro_frozen {
            Some(GYRO)
        } else {
            self.accelerometer_frozen.then_some(ACCELEROMETER)
        }
    }

    /// Whether the accelerometer has measured again, or fallen silent, after it was frozen, since the last call.
    pub fn take_accelerometer_resumed(&mut self) -> bool {
        std::mem::take(&mut self.accelerometer_resumed)
    }

    fn take_force(&mut self, t_s: f64, force: Option<Vector3<f64>>) {
        let same = force.is_none_or(|force| self.force.is(&force));
        if !same || t_s - self.force_s > GAP_S {
            self.accelerometer_resumed |= std::mem::take(&mut self.accelerometer_frozen);
        }
        let Some(force) = force else { return };
        self.force_s = t_s;
        // A coarse accelerometer on a board that only vibrates may repeat its value, too.
        if same && (self.tilts || self.accelerometer_frozen) {
            self.force.readings += 1;
            self.accelerometer_frozen |= self.force.lasts(TURNED_RAD);
        } else {
            self.force.begin(force);
        }
    }

    /// How fast the board turns across the specific force, rad/s; 0 where that may be bias.
    fn tilting_rad_s(&self, rate: &Vector3<f64>, mountings: &Mountings) -> f64 {
        let force = self.force.value.and_then(|force| force.try_normalize(1e-9));
        let tilting = force.map_or(0.0, |force| {
            let up = mountings.accel.to_body(force);
            mountings.gyro.to_body(*rate).cross(&up).norm()
        });
        if tilting < MOVING_RAD_S { 0.0 } else { tilting }
    }

    fn take_rate(&mut self, t_s: f64, rate: Vector3<f64>, tilting: f64) {
        let speed = rate.norm();
        self.tilts = tilting > 0.0;
        if let Some((last_s, last)) = self.rate
            && (0.0..=GAP_S).contains(&(t_s - last_s))
        {
            let mean = 0.5 * (last + speed);
            let turn = if mean < MOVING_RAD_S {
                self.rest.turn_at_rad_s(rate)
            } else {
                mean
            };
            self.field.turn(t_s - last_s, turn);
            self.gyro.turn(t_s - last_s, mean);
            self.force.turn(t_s - last_s, tilting);
        }
        self.rate = Some((t_s, speed));
        if !self.gyro.is(&rate) {
            self.gyro_frozen = false;
        }
        let field_repeats = t_s - self.changed_s > HELD_S;
        self.rest.take_rate(t_s, rate, field_repeats);
        if self.gyro.is(&rate) && speed >= MOVING_RAD_S {
            self.gyro.readings += 1;
            if self.gyro.lasts(BELIED_RAD) {
                let still = |(begun, far): (Vector3<f64>, f64)| far < BELIED_SHARE * begun.norm();
                // A field that repeats to the last bit may be the frozen one.
                self.gyro_frozen |= self.seen.take().is_some_and(still) && !field_repeats;
                // The board may have turned on before it stood still.
                self.gyro.turned_rad = 0.0;
            }
        } else {
            self.gyro.begin(rate);
            self.seen = None;
        }
    }

    fn take_field(&mut self, t_s: f64, field: Field) {
        let moving = self.rate.is_some_and(|(last_s, speed)| {
            let turns = speed >= MOVING_RAD_S || self.rest.turn_rad_s().is_some();
            (0.0..=GAP_S).contains(&(t_s - last_s)) && turns
        });
        // Whether the board moves is unknown until the gyro's next reading.
        let jumped_back = self.rate.is_some_and(|(last_s, _)| t_s < last_s);
        // An axis that overflows has no reading: where all do, nothing is repeated.
        if field == Field::default() || !self.field.is(&field) {
            self.magnetometer_frozen = false;
            self.changed_s = t_s;
            self.field.begin(field);
        } else if moving {
            self.field.readings += 1;
            self.magnetometer_frozen |= self.field.lasts(TURNED_RAD);
        } else if !jumped_back && !self.magnetometer_frozen {
            self.field.begin(field);
        }
    }
}

#[cfg(test)]
mod tests;
