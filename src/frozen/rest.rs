//! The gyro's rate at rest, which is its bias: it distinguishes a slow turn from rest.

use nalgebra::Vector3;

/// The board is at rest after this long, seconds, with a steady rate and a still field.
const LASTING_S: f64 = 3.0;
/// A rate is steady while its mean stays within this, rad/s (1 °/s).
const STEADY_RAD_S: f64 = 0.0175;
/// A field is still while its mean stays within this share of it. A turn of 1.2 °/s moves it further at a dip of 70°.
const STILL_SHARE: f64 = 0.02;
/// Time constant of the means, seconds. At 100 Hz they have less than a tenth of the noise.
const MEAN_S: f64 = 0.5;
/// What the rate was at rest is known for so long, seconds: a bias changes, and a slow turn is told sooner.
const KNOWN_S: f64 = 60.0;
/// A rate that differs by more from that at rest is a turn, rad/s (1.5 °/s); by less, the bias may have drifted.
const TURN_RAD_S: f64 = 0.026;

/// Rates and fields in, the rate at rest out.
#[derive(Clone, Debug, Default)]
pub(super) struct RestRate {
    rate: Mean,
    field: Mean,
    /// When the board seemed to come to rest, and the mean rate and field then.
    begun: Option<(f64, Vector3<f64>, Vector3<f64>)>,
    /// The mean rate at rest, and when it was measured last.
    known: Option<(f64, Vector3<f64>)>,
}

/// A mean of the last values, by time.
#[derive(Clone, Debug, Default)]
struct Mean {
    /// Time of the last value.
    last_s: f64,
    value: Option<Vector3<f64>>,
}

impl Mean {
    /// Begins anew after a gap of more than the time constant.
    fn take(&mut self, t_s: f64, value: Vector3<f64>) -> Vector3<f64> {
        let step_s = t_s - self.last_s;
        let mean = match self.value {
            Some(mean) if (0.0..=MEAN_S).contains(&step_s) => {
                mean + (value - mean) * (step_s / (MEAN_S + step_s))
            }
            _ => value,
        };
        (self.last_s, self.value) = (t_s, Some(mean));
        mean
    }
}

impl RestRate {
    /// Takes a whole field.
    pub(super) fn take_field(&mut self, t_s: f64, field: Vector3<f64>) {
        self.field.take(t_s, field);
    }

    /// Takes a rate. Where the `field_repeats`, it may be that of a frozen magnetometer, which is no sign of rest.
    pub(super) fn take_rate(&mut self, t_s: f64, rate: Vector3<f64>, field_repeats: bool) {
        let mean = self.rate.take(t_s, rate);
        let Some(field) = self.field.value else {
            return;
        };
        let begun = self.begun.filter(|(begun_s, begun_rate, begun_field)| {
            t_s >= *begun_s
                && (mean - begun_rate).norm() < STEADY_RAD_S
                && (field - begun_field).norm() < STILL_SHARE * begun_field.norm()
        });
        if let Some((begun_s, ..)) = begun {
            if t_s - begun_s < LASTING_S {
                return;
            }
            let drifted = |known: Vector3<f64>| (mean - known).norm() < TURN_RAD_S;
            if !field_repeats || self.known().is_none_or(drifted) {
                self.known = Some((t_s, mean));
            }
        }
        self.begun = Some((t_s, mean, field));
    }

    fn known(&self) -> Option<Vector3<f64>> {
        let (measured_s, rate) = self.known?;
        // A clock that was set back makes it older than it seems.
        let age_s = self.rate.last_s - measured_s;
        (0.0..KNOWN_S).contains(&age_s).then_some(rate)
    }

    /// How fast the board turns by the mean rate, rad/s; `None` where that may be bias.
    pub(super) fn turn_rad_s(&self) -> Option<f64> {
        let speed = (self.rate.value? - self.known()?).norm();
        (speed >= TURN_RAD_S).then_some(speed)
    }

    /// Like `turn_rad_s`, but by the mean rate or by this one, whichever is nearer to rest: the mean has no noise, and this rate shows at
    /// once that a turn has ended. 0 where that may be bias.
    pub(super) fn turn_at_rad_s(&self, rate: Vector3<f64>) -> f64 {
        match (self.known(), self.turn_rad_s()) {
            (Some(known), Some(speed)) => speed.min((rate - known).norm()),
            _ => 0.0,
        }
    }
}
