//! What can be set of the simulated board.

use serde::{Deserialize, Serialize};

use crate::check::{Check, Fault, within};

/// What the simulated board does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Scenario {
    /// Rest, level turns about the vertical, rest.
    #[default]
    Planar,
    /// Rest, level turns, a full roll at heading 30° and one at 120°, rest.
    Spatial,
    /// Tumbling that shows the field from all sides.
    Free,
    /// Rest, level turns, then small changes of heading and tilt.
    Demo,
    /// That of `demo`, again and again.
    #[value(skip)]
    Endless,
}

/// The simulated board, its sensors' errors and its motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// What the board does.
    pub scenario: Scenario,
    /// Number that fixes all noise.
    pub seed: u64,
    /// Turns about the vertical (not in `free`), −100 to 100; negative is counter-clockwise.
    pub turns: f64,
    /// Rate of a turn, 1 to 2000 degrees per second.
    pub turn_deg_s: f64,
    /// Constant tilt of the board, nose up, −80 to 80 degrees.
    pub tilt_deg: f64,
    /// Horizontal field, 0 to 1000 mG. The default is that of Calgary, as is the vertical one.
    pub horizontal_mgauss: f64,
    /// Vertical field, positive down, −1000 to 1000 mG.
    pub vertical_mgauss: f64,
    /// Scale factor of each magnetometer axis, 0.1 to 10. The default is the paper's first set, as is
    /// the bias.
    pub scale: [f64; 3],
    /// Bias of each magnetometer axis, −2000 to 2000 mG.
    pub bias_mgauss: [f64; 3],
    /// Noise of each magnetometer axis, one standard deviation, 0 to 1000 mG.
    pub noise_mgauss: f64,
    /// Share of the magnetometer's samples with a spike on one axis, 0 to 0.5.
    pub spikes: f64,
    /// Height of a spike, up or down, 0 to 2000 mG.
    pub spike_mgauss: f64,
    /// Readings of the magnetometer a second, 1 to 1000.
    pub mag_rate_hz: f64,
    /// Readings of gyro and accelerometer a second, 1 to 1000.
    pub gyro_rate_hz: f64,
    /// Bias of each gyro axis, −100 to 100 degrees per second.
    pub gyro_bias_deg_s: [f64; 3],
    /// Noise of each gyro axis, one standard deviation, 0 to 100 degrees per second.
    pub gyro_noise_deg_s: f64,
    /// Whether the board has a gyro.
    pub with_gyro: bool,
    /// Whether the board has an accelerometer.
    pub with_accel: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            scenario: Scenario::default(),
            seed: 1,
            turns: 2.0,
            turn_deg_s: 51.4,
            tilt_deg: 0.0,
            horizontal_mgauss: 162.8,
            vertical_mgauss: 526.7,
            scale: [0.873, 0.998, 0.94],
            bias_mgauss: [87.28, 54.19, 135.0],
            noise_mgauss: 2.0,
            spikes: 0.0,
            spike_mgauss: 200.0,
            mag_rate_hz: 40.0,
            gyro_rate_hz: 100.0,
            gyro_bias_deg_s: [1.2, -0.8, 0.6],
            gyro_noise_deg_s: 0.1,
            with_gyro: true,
            with_accel: true,
        }
    }
}

impl Check for Settings {
    fn check(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        let mut check = |key, value, range, unit| within(&mut faults, key, value, range, unit);
        check("turns", self.turns, -100.0..=100.0, "turns");
        check(
            "turn_deg_s",
            self.turn_deg_s,
            1.0..=2000.0,
            "degrees per second",
        );
        check("tilt_deg", self.tilt_deg, -80.0..=80.0, "degrees");
        check(
            "horizontal_mgauss",
            self.horizontal_mgauss,
            0.0..=1000.0,
            "mG",
        );
        check(
            "vertical_mgauss",
            self.vertical_mgauss,
            -1000.0..=1000.0,
            "mG",
        );
        for axis in 0..3 {
            check("scale", self.scale[axis], 0.1..=10.0, "");
            check(
                "bias_mgauss",
                self.bias_mgauss[axis],
                -2000.0..=2000.0,
                "mG",
            );
            check(
                "gyro_bias_deg_s",
                self.gyro_bias_deg_s[axis],
                -100.0..=100.0,
                "degrees per second",
            );
        }
        check("noise_mgauss", self.noise_mgauss, 0.0..=1000.0, "mG");
        check("spikes", self.spikes, 0.0..=0.5, "");
        check("spike_mgauss", self.spike_mgauss, 0.0..=2000.0, "mG");
        check("mag_rate_hz", self.mag_rate_hz, 1.0..=1000.0, "Hz");
        check("gyro_rate_hz", self.gyro_rate_hz, 1.0..=1000.0, "Hz");
        check(
            "gyro_noise_deg_s",
            self.gyro_noise_deg_s,
            0.0..=100.0,
            "degrees per second",
        );
        faults
    }
}
