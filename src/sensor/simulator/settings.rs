//! What can be set of the simulated board.

use crate::check::{settings, words};

words! {
    /// What the simulated board does.
    #[derive(Default)]
    pub enum Scenario {
        /// Rest, level turns about the vertical, rest.
        #[default]
        Planar = "planar",
        /// Rest, level turns, a full roll at heading 30° and one at 120°, rest.
        Spatial = "spatial",
        /// Tumbling that shows the field from all sides.
        Free = "free",
        /// Rest, level turns, then changes of heading and tilt, as a hand carries a board.
        Demo = "demo",
        /// That of `demo`, again and again.
        Endless = "endless",
    }
}

settings! {
    /// The simulated board, its sensors' errors and its motion.
    pub struct Settings {
        /// What the board does.
        scenario: Scenario = Scenario::default();
        /// Number that fixes all noise.
        seed: u64 = 1;
        /// Turns about the vertical (not in `free`); negative is counter-clockwise.
        turns: f64 = 2.0, -100.0..=100.0, "turns";
        /// Rate of a turn.
        turn_deg_s: f64 = 51.4, 1.0..=2000.0, "degrees per second";
        /// Constant tilt of the board, nose up.
        tilt_deg: f64 = 0.0, -80.0..=80.0, "degrees";
        /// Horizontal field. The default is that of Calgary, as is the vertical one.
        horizontal_mgauss: f64 = 162.8, 0.0..=1000.0, "mG";
        /// Vertical field, positive down.
        vertical_mgauss: f64 = 526.7, -1000.0..=1000.0, "mG";
        /// Scale factor of each magnetometer axis. The default is the paper's first set, as is
        /// the bias.
        scale: [f64; 3] = [0.873, 0.998, 0.94], 0.1..=10.0, "";
        /// Bias of each magnetometer axis.
        bias_mgauss: [f64; 3] = [87.28, 54.19, 135.0], -2000.0..=2000.0, "mG";
        /// Noise of each magnetometer axis, one standard deviation.
        noise_mgauss: f64 = 2.0, 0.0..=1000.0, "mG";
        /// Share of the magnetometer's samples with a spike on one axis.
        spikes: f64 = 0.0, 0.0..=0.5, "";
        /// Height of a spike, up or down.
        spike_mgauss: f64 = 200.0, 0.0..=2000.0, "mG";
        /// Readings of the magnetometer a second.
        mag_rate_hz: f64 = 40.0, 1.0..=1000.0, "Hz";
        /// Readings of gyro and accelerometer a second.
        gyro_rate_hz: f64 = 100.0, 1.0..=1000.0, "Hz";
        /// Bias of each gyro axis.
        gyro_bias_deg_s: [f64; 3] = [1.2, -0.8, 0.6], -100.0..=100.0, "degrees per second";
        /// Noise of each gyro axis, one standard deviation.
        gyro_noise_deg_s: f64 = 0.1, 0.0..=100.0, "degrees per second";
        /// Whether the board has a gyro.
        with_gyro: bool = true;
        /// Whether the board has an accelerometer.
        with_accel: bool = true;
    }
}
